"""`vioapr map`: a map and ground truth from a scene's recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Table

from vioapr.cli.console import console, progress
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pipeline import map_scene
from vioapr.report.map_report import FIGURES, write_map_report
from vioapr.scene.scene import Scene
from vioapr.schemas.map_summary import Georeference, MapSummary


def map_(
    scene: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")],
    params: tyro.conf.OmitArgPrefixes[MappingParams] = MappingParams(),  # noqa: B008
) -> None:
    """Map a scene: structure from motion of its training recordings, metric and gravity-aligned.

    Writes map/ (a COLMAP model in the world frame: metres, z up), gt/<recording>.tum for training
    and test recordings, and the map's report. Test images do not change the map. A run that was
    interrupted goes on where it was; delete .mapping/ in the scene to begin anew.

    Args:
        scene: The scene's folder.
        params: How it is mapped.
    """
    opened = Scene.open(scene)
    summary = map_scene(opened, params, progress)
    with progress("drawing figures", FIGURES) as tick:
        page = write_map_report(Scene.open(scene), summary, tick)
    console.print(_table(summary))
    for line in _notes(summary):
        console.print(line, soft_wrap=True, markup=False)
    console.print(f"report: {page.resolve()}", soft_wrap=True, markup=False)


def _table(summary: MapSummary) -> Table:
    table = Table(title="registered images", title_justify="left")
    for header in ("recording", "split"):
        table.add_column(header, no_wrap=True)
    for header in ("images", "registered", "not", "unusable", "misplaced", "VIO parts from map"):
        table.add_column(header, justify="right")
    for id_, facts in summary.recordings.items():
        lists = (facts.unregistered, facts.unusable, facts.misplaced, facts.parts_from_vio_at_s)
        counts = [facts.images, facts.registered, *map(len, lists)]
        table.add_row(id_, facts.split, *(str(count) for count in counts))
    return table


def _notes(summary: MapSummary) -> list[str]:
    model, world = summary.model, summary.world
    ratios = [scale.relative for scale in world.scales]
    lines = [
        f"map: {model.images} images, {model.points} points, reprojection error "
        f"{model.mean_reprojection_error_px:.2f} px",
        f"scale by VIO: tracking worlds agree within {100 * (min(ratios) - 1):+.2f} to "
        f"{100 * (max(ratios) - 1):+.2f} %; up by VIO: median spread "
        f"{world.gravity_spread_deg:.2f} deg",
        *_describe_place(world.georeference),
    ]
    for id_, facts in summary.recordings.items():
        for what in ("unregistered", "unusable", "misplaced"):
            images = getattr(facts, what)
            if images:
                names = [name.rsplit("/", 1)[-1] for name in images]
                more = f" and {len(names) - 5} more (all in map/map.json)" if names[5:] else ""
                lines.append(f"{id_}, {what}: {', '.join(names[:5])}{more}")
    if summary.reused_steps:
        lines.append(f"done before and not repeated: {', '.join(summary.reused_steps)}")
    return lines


def _describe_place(geo: Georeference | str | None) -> list[str]:
    if isinstance(geo, str):
        return [f"not georeferenced: {geo}"]
    if geo is None:
        return []
    origin = geo.origin
    return [
        f"georeferenced by {geo.fixes} satellite positions: x is east, origin at "
        f"{origin.latitude_deg:.7f}, {origin.longitude_deg:.7f}; median distance "
        f"{geo.residual_m:.1f} m, heading to {geo.heading_sigma_deg:.1f} deg"
    ]
