"""Running the steps of a build: each says which it is, whether it goes on, and how long it took."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from vioapr.work.progress import Progress
from vioapr.work.steps import Steps

BUILD_FOLDER, STEPS_FOLDER = "build", ".steps"
STEPS = ("check", "map", "fit", "predict", "calibrate", "evaluate", "export")
"""Names of the steps in order; those from "fit" on are done for every localizer."""

T = TypeVar("T")


@dataclass(eq=False)
class Runner:
    """Runs the steps of one build.

    Attributes:
        own: The build's folder.
        progress: Opened for every part that takes time.
        say: Called with a line on every step.
        seconds: How long every step took, by its name and that of its localizer.
    """

    own: Path
    progress: Progress
    say: Callable[[str], object]
    seconds: dict[str, float] = field(default_factory=dict[str, float])

    def chain(self, name: str = "") -> Steps:
        """The steps of a localizer, or, without a name, those that all need."""
        return Steps(self.own / STEPS_FOLDER / name)

    def step(
        self,
        steps: Steps,
        name: str,
        inputs: object,
        work: Callable[[bool], T],
        result_type: type[T],
        of: str = "",
    ) -> T:
        """Run a step, unless it is done.

        Args:
            steps: Of `chain`.
            name: One of `STEPS`.
            inputs: See `Steps.run`, as the following.
            work: Does it.
            result_type: Of what it returns.
            of: Which localizer it is for, where there may be several.
        """
        title = f"{STEPS.index(name) + 1} of {len(STEPS)}, {f'{name} {of}'.strip()}"

        def announced(is_resumed: bool) -> T:
            self.say(f"{title}: {'goes on' if is_resumed else 'begins'}")
            return work(is_resumed)

        result = steps.run(name, inputs, announced, result_type)
        is_kept = name in steps.reused
        self.say(f"{title}: {'kept' if is_kept else f'{steps.seconds[name]:.0f} s'}")
        self.seconds[f"{name} {of}".strip()] = round(steps.seconds[name], 1)
        return result
