"""Turning and scaling a model into the world: metric, z up, east and north where known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import MappingError
from vioapr.geometry.rigid import Rigid3, stack
from vioapr.geometry.tree import tree_map
from vioapr.geometry.umeyama import Sim3
from vioapr.mapping import metric
from vioapr.mapping.colmap import load_pycolmap, registered_images, world_from_cam
from vioapr.mapping.georeference import Fixes, georeference
from vioapr.mapping.inputs import MapImages
from vioapr.scene.sensors import Gnss
from vioapr.schemas.map_summary import Georeference, GravityOffset, ScaleSummary, WorldSummary

MAX_FIX_GAP_S = 2.0
"""Satellite positions between images further apart are left out."""


def align_model(model: Any, images: MapImages, gnss: Mapping[str, Gnss]) -> WorldSummary:
    """Move a model into the world, in place: by VIO, then by satellites where there are any.

    Args:
        model: COLMAP's reconstruction, as structure from motion left it.
        images: All images.
        gnss: Satellite positions of the training recordings, by id.

    Returns:
        What VIO says of scale and gravity, and satellites of the place on earth.

    Raises:
        MappingError: VIO says nothing about the scale.
    """
    rows, poses = poses_of_model(model, images)
    is_trusted = images.is_tracked[rows]
    if not is_trusted.any():
        raise MappingError(
            "the map's scale and up are not known: no registered image has a VIO pose with "
            "tracking normal"
        )
    rows, poses = rows[is_trusted], poses.at(is_trusted)
    vio, worlds = images.vio_from_cam.at(rows), images.tracking_world[rows]
    # Where no recording is metric, or level, all are taken: the map is then as wrong as they
    # are, and says so.
    is_metric, is_level = images.is_metric[rows], images.is_level[rows]
    has_scale = is_metric if is_metric.any() else ~is_metric
    has_up = is_level if is_level.any() else ~is_level
    scales = metric.estimate_scales(
        poses.at(has_scale), vio.at(has_scale), worlds[has_scale],
        images.timestamp_s[rows[has_scale]],
    )  # fmt: skip
    scale = metric.mean_scale(scales)
    gravity = metric.estimate_gravity(poses.at(has_up), vio.at(has_up), worlds[has_up])
    is_first = worlds == worlds[has_up][0]
    world_from_model = metric.align_with_world(
        poses.at(is_first), vio.at(is_first), scale, gravity.up
    )
    transform_model(model, world_from_model)

    fixes = find_fixes(*poses_of_model(model, images), images, gnss)
    geo = None if fixes is None else georeference(fixes)
    if isinstance(geo, Georeference):
        half = np.radians(geo.enu_heading_deg) / 2
        about_z = np.array([0.0, 0.0, np.sin(half), np.cos(half)])
        transform_model(model, Sim3(np.array(1.0), Rigid3(np.zeros(3), about_z)))

    ids = {
        int(world): images.ids[images.recording[np.argmax(images.tracking_world == world)]]
        for world in np.unique(worlds)
    }
    return WorldSummary(
        is_metric=bool(is_metric.any()),
        is_gravity_aligned=bool(is_level.any()),
        scales=[
            ScaleSummary(
                **vars(each), recording=ids[each.world], relative=each.metres_per_unit / scale
            )
            for each in scales
        ],
        metres_per_unit=scale,
        gravity_spread_deg=gravity.spread_deg,
        gravity_p95_deg=gravity.p95_deg,
        gravity_offset_deg=[
            GravityOffset(world=number, recording=ids[number], offset_deg=offset)
            for number, offset in gravity.world_offset_deg.items()
        ],
        georeference=geo,
    )


def poses_of_model(model: Any, images: MapImages) -> tuple[NDArray[np.intp], Rigid3]:
    """Rows of a model's images, in order, and their poses in its world."""
    mapped = registered_images(model)
    rows = np.array([k for k, name in enumerate(images.names) if name in mapped], dtype=np.intp)
    return rows, stack([world_from_cam(mapped[images.names[k]]) for k in rows])


def transform_model(model: Any, new_from_old: Sim3) -> None:
    """Move a model into another world, in place."""
    pycolmap = load_pycolmap()
    offset, quat = new_from_old.rigid
    rotation = pycolmap.Rotation3d(quat)
    model.transform(pycolmap.Sim3d(float(new_from_old.scale), rotation, offset))


def find_fixes(
    rows: NDArray[np.intp], poses: Rigid3, images: MapImages, gnss: Mapping[str, Gnss]
) -> Fixes | None:
    """The satellite positions of all recordings, with the map's positions at their times.

    Args:
        rows: The registered images, in order.
        poses: Theirs, world_from_cam.
        images: All images.
        gnss: By id of the recording.

    Returns:
        Those between registered images that are close in time; None if no recording has any
        satellite position.
    """
    parts = []
    for number, (id_, fixes) in enumerate(gnss.items()):
        is_own = images.recording[rows] == images.ids.index(id_)
        if not len(fixes) or is_own.sum() < 2:
            continue
        time_s, position_m = images.timestamp_s[rows[is_own]], poses.translation_m[is_own]
        at_s = fixes.timestamp_s
        after = np.searchsorted(time_s, at_s).clip(1, len(time_s) - 1)
        is_near = time_s[after] - time_s[after - 1] <= MAX_FIX_GAP_S
        is_near &= (at_s >= time_s[0]) & (at_s <= time_s[-1])
        part = Fixes(
            np.column_stack([np.interp(at_s, time_s, column) for column in position_m.T]),
            fixes.latitude_deg,
            fixes.longitude_deg,
            fixes.altitude_m,
            fixes.horizontal_sigma_m,
            # Clocks of recordings may overlap; their fixes are independent all the same.
            at_s - time_s[0] + 1e6 * number,
        )
        parts.append(tree_map(lambda column, kept=is_near: column[kept], part))
    return tree_map(lambda *columns: np.concatenate(columns), *parts) if parts else None
