"""`vioapr map`: a map and ground truth from a scene's recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from vioapr.cli.console import progress, say
from vioapr.cli.tables import Column, Row, Table, draw
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pipeline import map_scene
from vioapr.plurals import count_of
from vioapr.report.map_report import FIGURES, write_map_report
from vioapr.scene.scene import Scene
from vioapr.schemas.map_summary import MapSummary


def map_(
    scene: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")],
    replace_gt: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    params: tyro.conf.OmitArgPrefixes[MappingParams] = MappingParams(),  # noqa: B008
) -> None:
    """Map a scene: structure from motion of its training recordings, metric and gravity-aligned.

    Writes map/ (a COLMAP model in the world frame: metres, z up), gt/<recording>.tum for training
    and test recordings, and the map's report. Test images do not change the map. A run that was
    interrupted goes on where it was; delete .mapping/ in the scene to start over. Ground truth
    that came from elsewhere is not replaced: the map's then goes to map/gt/.

    Args:
        scene: The scene's folder.
        replace_gt: Replace ground truth that mapping did not write; it is copied to gt.backup-1/
            (or -2, ...) first.
        params: How it is mapped.

    Example:
        vioapr map courtyard
    """
    opened = Scene.open(scene)
    summary = map_scene(opened, params, progress, replace_gt=replace_gt)
    with progress("drawing figures", FIGURES) as tick:
        page = write_map_report(Scene.open(scene), summary, tick)
    print_summary(summary)
    say(f"report: {page.resolve()}")


def print_summary(summary: MapSummary) -> None:
    """Print what was registered, how exact the map is, and what is missing."""
    headers = ("images", "registered", "not", "unusable", "misplaced", "VIO parts from map")
    names = (Column("recording", is_figure=False), Column("split", is_figure=False))
    rows: list[Row] = []
    for id_, facts in summary.recordings.items():
        lists = (facts.unregistered, facts.unusable, facts.misplaced, facts.parts_from_vio_at_s)
        counts = [facts.images, facts.registered, *map(len, lists)]
        rows.append(Row((id_, facts.split, *map(str, counts)), {}))
    draw(Table("registered images", (*names, *map(Column, headers)), [rows]))
    model, world = summary.model, summary.world
    say(
        f"map: {count_of(model.images, 'image')}, {count_of(model.points, 'point')}, "
        f"reprojection error {model.mean_reprojection_error_px:.2f} px"
    )
    percents = [100 * (scale.relative - 1) for scale in world.scales]
    say(
        f"scale by VIO: tracking worlds agree within {min(percents):+.2f} to {max(percents):+.2f} "
        f"%; up by VIO: median spread {world.gravity_spread_deg:.2f} deg"
    )
    if isinstance(geo := world.georeference, str):
        say(f"not georeferenced: {geo}")
    elif geo is not None:
        say(
            f"georeferenced by {geo.fixes} satellite positions: x is east, origin at "
            f"{geo.origin.latitude_deg:.7f}, {geo.origin.longitude_deg:.7f}; median distance "
            f"{geo.residual_m:.1f} m, heading to {geo.heading_sigma_deg:.1f} deg"
        )
    for id_, facts in summary.recordings.items():
        lists = {"unregistered": facts.unregistered, "unusable": [*facts.unusable]}
        for title, paths in (lists | {"misplaced": facts.misplaced}).items():
            if paths:
                names = [path.rsplit("/", 1)[-1] for path in paths]
                more = f" and {len(names) - 5} more (all in map/map.json)" if names[5:] else ""
                say(f"{id_}, {title}: {', '.join(names[:5])}{more}")
    if summary.kept_gt:
        say(
            f"note: the ground truth in gt/ of {', '.join(summary.kept_gt)} is not mapping's and "
            f"was kept; the map's is in {summary.gt_folder}/: --replace-gt puts it into gt/",
            "yellow",
        )
    if summary.gt_backup:
        say(f"the ground truth that was replaced is in {summary.gt_backup}/", "yellow")
    if summary.reused_steps:
        say(f"done before and not repeated: {', '.join(summary.reused_steps)}")
