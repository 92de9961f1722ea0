"""The report of a map: what was registered, how exact it is, and VIO against it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from vioapr.errors import FormatError
from vioapr.evaluation.vio_quality import VioQuality, analyze
from vioapr.evaluation.vio_tables import to_record
from vioapr.evaluation.vio_tracks import find_vio_walks
from vioapr.files.text import write_bytes, write_text
from vioapr.mapping.colmap import read_model
from vioapr.report.figures.mapping import agreement_figure, map_figure
from vioapr.report.figures.vio_quality import vio_distribution_figure, vio_drift_figure
from vioapr.report.formatting import UNKNOWN, format_error, format_number
from vioapr.report.page import embed_figure, make_page, make_table
from vioapr.report.style import render
from vioapr.scene.scene import Scene
from vioapr.schemas.base import to_plain
from vioapr.schemas.map_summary import Georeference, MapSummary
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
        FormatError: A file cannot be read or written.
    """
    folder = scene.map_folder / REPORT_FOLDER
    qualities = [
        analyze(track)
        for walk in find_vio_walks([scene.folder])
        for track in walk.read(DEFAULT_TOLERANCE_S)
    ]
    write_text(folder / "vio.json", json.dumps(to_plain(to_record(qualities)), indent=1) + "\n")
    figures = _draw(scene, summary, qualities, folder / "figures", tick)
    sections = [
        _overview(summary),
        _recordings(summary),
        "\n".join([_heading("map", "The map"), *figures[:2]]),
        _vio(qualities, figures[2:]),
        _unregistered(summary),
    ]
    links = [("overview", "Overview"), ("recordings", "Recordings"), ("map", "The map")]
    links += [("vio", "VIO against the map"), ("missing", "Not registered")]
    page = folder / "index.html"
    write_text(page, make_page(f"Map of {scene.name}", links, sections))
    return page


def _draw(
    scene: Scene,
    summary: MapSummary,
    qualities: list[VioQuality],
    folder: Path,
    tick: Callable[[], object] | None,
) -> list[str]:
    drawings = {
        "map": lambda: _map_figure(scene, summary),
        "agreement": lambda: agreement_figure(summary.world),
        "vio_drift": lambda: vio_drift_figure(qualities),
        "vio_errdis": lambda: vio_distribution_figure(qualities),
    }
    embedded = []
    for name, draw in drawings.items():
        png, svg = (folder / f"{name}.{ending}" for ending in ("png", "svg"))
        for path, content in zip((png, svg), render(draw()), strict=True):
            write_bytes(path, content)
        embedded.append(embed_figure(png, svg, name, _CAPTIONS[name]))
        if tick is not None:
            tick()
    return embedded


def _map_figure(scene: Scene, summary: MapSummary) -> Any:
    model = read_model(scene.map_folder)
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3)
    found = {id_: scene.gt(id_) for id_ in summary.recordings}
    positions = {id_: gt.position_m for id_, gt in found.items() if gt is not None}
    if not positions:
        raise FormatError(scene.folder, "expected ground truth of the map, found none")
    splits = {id_: facts.split for id_, facts in summary.recordings.items()}
    return map_figure(points, positions, splits)


def _heading(anchor: str, title: str) -> str:
    return f'<h2 id="{anchor}">{escape(title)}</h2>'


def _overview(summary: MapSummary) -> str:
    model, world = summary.model, summary.world
    recordings = summary.recordings.values()
    ratios = [100 * (scale.relative - 1) for scale in world.scales]
    entries = {
        "Images": f"{sum(r.registered for r in recordings)} of "
        f"{sum(r.images for r in recordings)} registered, {model.images} of them in the map",
        "Points": f"{model.points}, each seen by {model.mean_track_length:.1f} images",
        "Reprojection error": f"{model.mean_reprojection_error_px:.2f} px (mean)",
        "Scale": f"the mean over {len(ratios)} tracking worlds, which are "
        f"{min(ratios):+.2f} to {max(ratios):+.2f} % off it",
        "Up": f"the robust mean over all images; they scatter by "
        f"{world.gravity_spread_deg:.2f} deg (median), "
        f"{world.gravity_p95_deg:.2f} deg (95 %)",
        "Place on earth": _place(world.georeference),
        "Mapper": str(summary.params["mapper"]),
        "Seconds": ", ".join(f"{name} {s:.0f}" for name, s in summary.seconds.items()),
        "vioapr": summary.vioapr,
    }
    warnings = [
        text
        for is_fine, text in (
            (world.is_metric, "No recording's VIO is metric: nor is the map."),
            (
                world.is_gravity_aligned,
                "No recording's VIO knows gravity: the map's z is not up.",
            ),
        )
        if not is_fine
    ]
    items = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in entries.items())
    notes = "".join(f"<p><b>{escape(text)}</b></p>" for text in warnings)
    return f"{_heading('overview', 'Overview')}{notes}<dl>{items}</dl>"


def _place(geo: Georeference | str | None) -> str:
    if geo is None:
        return "no satellite positions in the training recordings"
    if isinstance(geo, str):
        return f"not known: {geo}"
    origin = geo.origin
    return (
        f"origin at {origin.latitude_deg:.7f}, {origin.longitude_deg:.7f}, x east; "
        f"{geo.fixes} satellite positions, median distance {geo.residual_m:.1f} m, heading "
        f"to {geo.heading_sigma_deg:.1f} deg, their scale {geo.scale:.3f} of the map's"
    )


def _recordings(summary: MapSummary) -> str:
    head = ["recording", "split", "images", "registered", "not registered", "unusable",
            "misplaced", "VIO parts from map", "scale %", "up °"]  # fmt: skip
    world = summary.world
    rows = []
    for id_, facts in summary.recordings.items():
        scales = [s.relative for s in world.scales if s.recording == id_]
        tilts = [t.offset_deg for t in world.gravity_offset_deg if t.recording == id_]
        lists = (facts.unregistered, facts.unusable, facts.misplaced, facts.parts_from_vio_at_s)
        rows.append(
            [
                escape(id_),
                facts.split,
                str(facts.images),
                str(facts.registered),
                *(str(len(each)) for each in lists),
                ", ".join(f"{100 * (s - 1):+.2f}" for s in scales) or UNKNOWN,
                ", ".join(f"{t:.2f}" for t in tilts) or UNKNOWN,
            ]
        )
    return f"""{_heading("recordings", "Recordings")}
<p>Misplaced images move against VIO from both neighbours; they are left out of the ground truth.
Where VIO and map part is either a wrong place in the map or a jump of the tracker. Scale and up
are what each tracking world says, off the map's.</p>
{make_table([head], rows, text_columns=2)}"""


def _vio(qualities: Sequence[VioQuality], figures: Iterable[str]) -> str:
    head = ["recording", "tracker", "path m", "ATE m", "< 0.1 m and 1° at 1 Hz, %",
            "drift % of path", "scale", ""]  # fmt: skip
    rows = [
        [
            escape(q.track.walk),
            escape(q.track.vio),
            format_number(q.path_m, 1),
            format_error(q.ate_m),
            format_number(100 * q.share_within, 1),
            format_error(100 * q.per_distance.position_m / (q.per_distance.stretch or np.nan)),
            format_number(q.scale, 3),
            "diverges" if q.diverges_at_s is not None else "",
        ]
        for q in qualities
    ]
    table = make_table([head], rows, text_columns=2)
    return "\n".join([_heading("vio", "VIO against the map"), table, *figures])


def _unregistered(summary: MapSummary) -> str:
    """Every image without ground truth, by name."""
    parts = [_heading("missing", "Not registered")]
    for id_, facts in summary.recordings.items():
        unusable = [f"{name}: {why}" for name, why in facts.unusable.items()]
        for title, names in (
            ("not registered", facts.unregistered),
            ("cannot be read", unusable),
            ("misplaced", facts.misplaced),
        ):
            if names:
                items = "\n".join(escape(name) for name in names)
                parts.append(
                    f"<details><summary>{escape(id_)}: {len(names)} {title}</summary>"
                    f"<pre>{items}</pre></details>"
                )
    if len(parts) == 1:
        parts.append("<p>All images are registered.</p>")
    return "\n".join(parts)
