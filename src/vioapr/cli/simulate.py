"""`vioapr simulate`: a whole scene without a phone, and walks without images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vioapr.cli.console import progress, say
from vioapr.errors import ParameterError
from vioapr.plurals import count_of
from vioapr.scene.walks import walk_file_names, write_walk
from vioapr.work.results import ResultFolder


def simulate_courtyard(
    out: Path,
    preset: Literal["full", "small"] = "full",
    seed: int = 0,
    train: int | None = None,
    test: int | None = None,
    duration_s: float | None = None,
    rate_hz: float | None = None,
    width_px: int | None = None,
    height_px: int | None = None,
    oversampled: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    people: int | None = None,
    workers: int | None = None,
) -> None:
    """Render a courtyard, walk through it several times and write a scene.

    Images, exact ground truth, and what a phone would say: tracker, IMU, GNSS and compass with
    their errors. Beside them preview.png and routes.png: pictures and routes of up to 8
    recordings a split.

    Args:
        out: The scene's folder: new or empty. It appears when the scene is whole.
        preset: full: 4 + 2 recordings of 90 s at 10 Hz. small: 2 + 1 of 10 s, in seconds.
        seed: The same seed gives the same scene.
        train: Recordings to train and map with; by default the preset's, as all that follow.
        test: Recordings to test with.
        duration_s: Length of each recording, s.
        rate_hz: Images per second.
        width_px: Width of the images.
        height_px: Height of the images.
        oversampled: Render four pixels for one: sharper, and two to three times slower.
        people: Passers-by.
        workers: Processes that render; by default one a core. They do not change the result.

    Example:
        vioapr simulate courtyard --out courtyard --preset small
    """
    # Imported here: `simulate walks` should not wait for what only this verb needs.
    from vioapr.report.scene_preview import (
        Background,
        contact_sheet,
        route_map,
        save_photo_figure,
    )
    from vioapr.simulation.courtyard.plan import PRESETS, plan_recordings
    from vioapr.simulation.courtyard.record import FROM_ABOVE, FROM_ABOVE_WIDTH_M
    from vioapr.simulation.courtyard.simulate import simulate

    given = {
        "train": train, "test": test, "duration_s": duration_s, "rate_hz": rate_hz,
        "width_px": width_px, "height_px": height_px, "people": people,
    }  # fmt: skip
    given = {name: value for name, value in given.items() if value is not None}
    params = replace(PRESETS[preset], oversampled=oversampled, **given)
    plans = plan_recordings(params)
    with progress("rendering images", params.frames * len(plans)) as tick:
        scene = simulate(out, params, seed, workers=workers, tick=tick)
    save_photo_figure(contact_sheet(scene), out / "preview.png")
    background = Background(out / FROM_ABOVE, FROM_ABOVE_WIDTH_M)
    save_photo_figure(route_map(scene, background), out / "routes.png")
    for plan in plans:
        text = f"{plan.id_}: {count_of(params.frames, 'image')}, {plan.weather}, {plan.route}"
        if plan.tracker_events.lost_s is not None:
            text += f", tracking lost at {plan.tracker_events.lost_s:.0f} s"
        if plan.tracker_events.jump_s is not None:
            text += f", relocalization jump at {plan.tracker_events.jump_s:.0f} s"
        say(text)
    say(f"scene: {out} (see preview.png and routes.png)")


def simulate_walks(
    out: Path,
    walks: int = 5,
    seed: int = 0,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Simulate walks: ground truth, VIO and the predictions of a regressor, without images.

    Files are like a user's own: try `vioapr inspect`, `fuse` and `evaluate` on them.

    Args:
        out: Folder to write a folder a walk to; walks that were simulated there before are
            replaced, other files stay.
        walks: Number of walks.
        seed: Of the first walk; the same seed gives the same walks.
        overwrite: Replace files of the same names too that were not simulated.

    Example:
        vioapr simulate walks --out walks --walks 5
    """
    from vioapr.simulation.walks import WalkParams, simulate_walk

    if walks < 1:
        raise ParameterError(f"walks: expected at least 1, got {walks}")
    if seed < 0:
        raise ParameterError(f"seed: expected a number of at least 0, got {seed}")
    names = [f"walk{index + 1:02d}" for index in range(walks)]
    files = walk_file_names(["sim"], ["simulated"])
    earlier = [f"walk{'[0-9]' * digits}/{file}" for digits in (2, 3, 4) for file in files]
    results = ResultFolder(out, overwrite=overwrite)
    results.check(f"{name}/{file}" for name in names for file in files)
    with progress("simulating walks", walks) as tick, results.adding(all_of=earlier) as partial:
        for index, name in enumerate(names):
            walk = simulate_walk(WalkParams(), seed + index)
            write_walk(
                partial / name, gt=walk.gt, vios={"sim": walk.vio}, aprs={"simulated": walk.apr}
            )
            tick()
    say(f"evaluate them: vioapr evaluate {out}")
