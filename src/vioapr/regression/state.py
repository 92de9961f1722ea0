"""What an interrupted training goes on from: its state after every epoch, in one file."""

from __future__ import annotations

from typing import Any

from torch import Tensor
from torch.optim import Optimizer

from vioapr.errors import ParameterError
from vioapr.regression.checkpoint import load_tensors, save_tensors
from vioapr.regression.files import STATE_FILE
from vioapr.regression.journal import Journal
from vioapr.regression.learner import Learner, Run
from vioapr.regression.params import TrainingParams

OptimizerStates = dict[int, dict[str, Tensor]]
"""Of parameters by their numbers."""

_NOT_OF_THE_RESULT = {"devices", "nodes", "compile", "patience"}
"""Parameters that may be others when a run is resumed."""


def save_state(run: Run, learner: Learner, optimizer: Optimizer, journal: Journal) -> None:
    """Write all that is needed to go on after the last epoch.

    Raises:
        FormatError: It cannot be written; what was there stays.
    """
    tensors = {f"learner.{name}": value for name, value in learner.state_dict().items()}
    for number, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{number}.{name}": value for name, value in state.items()}
    content = {"run": _identity(run), "epochs": journal.epochs}
    save_tensors(run.folder / STATE_FILE, "state", tensors, content)


def restore_state(run: Run, learner: Learner) -> tuple[Journal, OptimizerStates]:
    """Set a learner to the state in the run's folder.

    Returns:
        What happened so far, and the state of the optimizer.

    Raises:
        FormatError: There is no state, or it is broken.
        ParameterError: It is another run's.
    """
    path = run.folder / STATE_FILE
    tensors, content = load_tensors(path, "state")
    for part, values in _identity(run).items():
        given = content.get("run", {}).get(part)
        if part == "params" and isinstance(given, dict):
            # A state that is older than a parameter was made with what is the default now.
            given = {name: given.get(name, _DEFAULTS.get(name)) for name in values}
        if given != values:
            raise ParameterError(f"{path}: {_describe_change(part, given, values)}")
    prefix = "learner."
    learner.load_state_dict(
        {name.removeprefix(prefix): t for name, t in tensors.items() if name.startswith(prefix)}
    )
    states: OptimizerStates = {}
    for name, value in tensors.items():
        if name.startswith("optimizer."):
            _, number, key = name.split(".", 2)
            states.setdefault(int(number), {})[key] = value
    return Journal(list(content["epochs"])), states


_DEFAULTS = TrainingParams().to_json()


def _identity(run: Run) -> dict[str, Any]:
    """What must be the same for a run to be resumed."""
    params = run.params.to_json()
    return {
        "spec": {**run.spec.to_json(), "scenes": list(run.spec.scenes)},
        "params": {k: value for k, value in params.items() if k not in _NOT_OF_THE_RESULT},
        "samples": run.samples.fingerprint,
    }


def _describe_change(part: str, given: Any, values: Any) -> str:
    if part == "samples" or not isinstance(given, dict):
        return "expected to resume with the same images and poses, they have changed"
    changed = [name for name in values if given.get(name) != values[name]]
    return (
        f"expected to resume with the same {part}, {', '.join(changed)} differ: "
        f"{', '.join(str(given.get(name)) for name in changed)} then, "
        f"{', '.join(str(values[name]) for name in changed)} now"
    )
