"""The report of a map: what was registered, how exact it is, and VIO against it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vioapr.errors import FormatError
from vioapr.evaluation.vio_quality import VioQuality, analyze
from vioapr.evaluation.vio_tables import to_record
from vioapr.evaluation.vio_tracks import find_walks_of_scene
from vioapr.files.text import write_text
from vioapr.mapping.colmap import read_model
from vioapr.report.figures.mapping import agreement_figure, map_figure
from vioapr.report.figures.vio_quality import vio_distribution_figure, vio_drift_figure
from vioapr.report.formatting import UNKNOWN, format_error, format_number
from vioapr.report.page import Figure, Heading, Page, Table, embed_figure, render_page
from vioapr.report.style import save_figure
from vioapr.scene.scene import Scene
from vioapr.schemas.base import encode
from vioapr.schemas.map_summary import MapSummary
from vioapr.trajectory import DEFAULT_TOLERANCE_S

REPORT_FOLDER = "report"
FIGURES = 4
"""How often `write_map_report` calls its tick."""

_CAPTIONS = {
    "map": "The map's points (grey) and the registered cameras from above, z up.",
    "agreement": (
        "What each tracking world says of scale and of the direction up, against what the map "
        "took. Left: 2 sigma is of the scatter within a tracking world; VIO's own error of scale "
        "is the same for a whole walk. Right: angle between a tracking world's mean up and the "
        "map's."
    ),
    "vio_drift": (
        "VIO against the map over time, after rigid alignment on the first 30 s (grey) of every "
        "tracking world."
    ),
    "vio_errdis": (
        "Cumulative distributions of VIO's errors against the map. Above: differences between the "
        "lengths and the angles of motions within one second, which need no alignment. Below: "
        "errors after alignment."
    ),
}


@dataclass(frozen=True, kw_only=True)
class MapPage(Page):
    """The data of `map.html`.

    Attributes:
        warnings: What the map lacks, in sentences.
        facts: Names and texts.
        recordings: A row a recording: what is registered, and its scale and up by VIO.
        map_figures: The map from above, and the agreement of the tracking worlds.
        vio: A row a tracker and recording.
        vio_figures: Drift and distributions of errors.
        missing: Lists of images without ground truth, each with its title.
    """

    warnings: Sequence[str]
    facts: Sequence[tuple[str, str]]
    recordings: Table
    map_figures: Sequence[Figure]
    vio: Table
    vio_figures: Sequence[Figure]
    missing: Sequence[tuple[str, Sequence[str]]]


def write_map_report(
    scene: Scene, summary: MapSummary, tick: Callable[[], object] | None = None
) -> Path:
    """Write `map/report/`: a page with everything inside, its figures, and VIO's figures as JSON.

    Args:
        scene: With map and ground truth.
        summary: As `map.json` has it.
        tick: Called after every figure, for progress.

    Returns:
        The page's path.

    Raises:
        FileError: A file cannot be read or written.
    """
    folder = scene.map_folder / REPORT_FOLDER
    scene = dataclasses.replace(scene, gt_folder=summary.gt_folder)
    qualities = [
        analyze(track)
        for walk in find_walks_of_scene(scene)
        for track in walk.read(DEFAULT_TOLERANCE_S)
    ]
    write_text(folder / "vio.json", encode(to_record(qualities), indent=1))
    drawings = {
        "map": partial(draw_map, scene, summary),
        "agreement": partial(agreement_figure, summary.world),
        "vio_drift": partial(vio_drift_figure, qualities),
        "vio_errdis": partial(vio_distribution_figure, qualities),
    }
    figures = []
    for name, draw in drawings.items():
        png, svg = save_figure(draw(), folder / "figures" / name)
        figures.append(embed_figure(png, svg, name, _CAPTIONS[name]))
        if tick is not None:
            tick()
    warnings = []
    if not summary.world.is_metric:
        warnings.append("No recording's VIO is metric: nor is the map.")
    if not summary.world.is_gravity_aligned:
        warnings.append("No recording's VIO knows gravity: the map's z is not up.")
    page = MapPage(
        title=f"Map of {scene.name}",
        contents=[
            ("overview", "Overview"),
            ("recordings", "Recordings"),
            ("map", "The map"),
            ("vio", "VIO against the map"),
            ("missing", "Not registered"),
        ],
        warnings=warnings,
        facts=list_facts(summary),
        recordings=make_recordings_table(summary),
        map_figures=figures[:2],
        vio=make_vio_table(qualities),
        vio_figures=figures[2:],
        missing=list_missing(summary),
    )
    write_text(folder / "index.html", render_page("map.html", page))
    return folder / "index.html"


def draw_map(scene: Scene, summary: MapSummary) -> Any:
    """Draw a scene's map from above, with the ground truth of its recordings.

    Raises:
        FormatError: There is no ground truth.
        MappingError: The model cannot be read.
    """
    model = read_model(scene.map_folder)
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3)
    found = {id_: scene.gt(id_) for id_ in summary.recordings}
    positions = {id_: gt.position_m for id_, gt in found.items() if gt is not None}
    if not positions:
        raise FormatError(scene.folder, "expected ground truth of the map, found none")
    splits = {id_: facts.split for id_, facts in summary.recordings.items()}
    return map_figure(points, positions, splits)


def list_facts(summary: MapSummary) -> list[tuple[str, str]]:
    """List sizes and errors of a map, and how exact its scale, up and place are."""
    model, world = summary.model, summary.world
    recordings = summary.recordings.values()
    ratios = [100 * (scale.relative - 1) for scale in world.scales]
    geo = world.georeference
    if geo is None:
        place = "no satellite positions in the training recordings"
    elif isinstance(geo, str):
        place = f"not known: {geo}"
    else:
        place = (
            f"origin at {geo.origin.latitude_deg:.7f}, "
            f"{geo.origin.longitude_deg:.7f}, x east; {geo.fixes} satellite positions, "
            f"median distance {geo.residual_m:.1f} m, heading to "
            f"{geo.heading_sigma_deg:.1f} deg, their scale {geo.scale:.3f} of the map's"
        )
    return [
        (
            "Images",
            f"{sum(r.registered for r in recordings)} of "
            f"{sum(r.images for r in recordings)} registered, {model.images} of them in "
            "the map",
        ),
        ("Points", f"{model.points}, each seen by {model.mean_track_length:.1f} images"),
        ("Reprojection error", f"{model.mean_reprojection_error_px:.2f} px (mean)"),
        (
            "Scale",
            f"the mean over {len(ratios)} tracking worlds, which are "
            f"{min(ratios):+.2f} to {max(ratios):+.2f} % off it",
        ),
        (
            "Up",
            "the robust mean over all images; they scatter by "
            f"{world.gravity_spread_deg:.2f} deg (median), "
            f"{world.gravity_p95_deg:.2f} deg (95 %)",
        ),
        ("Place on earth", place),
        ("Mapper", str(summary.params["mapper"])),
        ("Seconds", ", ".join(f"{name} {s:.0f}" for name, s in summary.seconds.items())),
        ("vioapr", summary.vioapr),
    ]


def make_recordings_table(summary: MapSummary) -> Table:
    """Make a row a recording: what is registered, and its scale and up by VIO."""
    titles = ["recording", "split", "images", "registered", "not registered", "unusable",
              "misplaced", "VIO parts from map", "scale %", "up °"]  # fmt: skip
    world = summary.world
    rows = []
    for id_, facts in summary.recordings.items():
        scales = [s.relative for s in world.scales if s.recording == id_]
        tilts = [t.offset_deg for t in world.gravity_offset_deg if t.recording == id_]
        lists = (facts.unregistered, facts.unusable, facts.misplaced, facts.parts_from_vio_at_s)
        rows.append(
            [
                id_,
                facts.split,
                str(facts.images),
                str(facts.registered),
                *(str(len(names)) for names in lists),
                ", ".join(f"{100 * (s - 1):+.2f}" for s in scales) or UNKNOWN,
                ", ".join(f"{t:.2f}" for t in tilts) or UNKNOWN,
            ]
        )
    return Table([[Heading(title) for title in titles]], rows, text_columns=2)


def make_vio_table(qualities: Sequence[VioQuality]) -> Table:
    """Make a row a tracker and recording: its drift against the map."""
    titles = ["recording", "tracker", "path m", "ATE m", "< 0.1 m and 1° at 1 Hz, %",
              "drift % of path", "scale", ""]  # fmt: skip
    rows = [
        [
            q.track.walk,
            q.track.vio,
            format_number(q.path_m, 1),
            format_error(q.ate_m),
            format_number(100 * q.share_within, 1),
            format_error(100 * q.per_distance.position_m / (q.per_distance.stretch or np.nan)),
            format_number(q.scale, 3),
            "diverges" if q.diverges_at_s is not None else "",
        ]
        for q in qualities
    ]
    return Table([[Heading(title) for title in titles]], rows, text_columns=2)


def list_missing(summary: MapSummary) -> list[tuple[str, list[str]]]:
    """List every image without ground truth by name, recording by recording."""
    missing = []
    for id_, facts in summary.recordings.items():
        unusable = [f"{name}: {why}" for name, why in facts.unusable.items()]
        for title, names in (
            ("not registered", facts.unregistered),
            ("cannot be read", unusable),
            ("misplaced", facts.misplaced),
        ):
            if names:
                missing.append((f"{id_}: {len(names)} {title}", names))
    return missing
