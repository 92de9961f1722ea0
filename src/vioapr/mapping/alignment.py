"""Turning and scaling a model into the world: metric, z up, east and north where known."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import MappingError
from vioapr.geometry.rigid import Rigid3, stack
from vioapr.geometry.umeyama import Sim3
from vioapr.mapping import metric
from vioapr.mapping.colmap import load_pycolmap, world_from_cam
from vioapr.mapping.georeference import Georeference, georeference
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.reconstruct import registered_images
from vioapr.scene.sensors import Gnss

MAX_FIX_GAP_S = 2.0
"""Satellite positions between images further apart are left out."""


def place_model(model: Any, images: MapImages, gnss: Mapping[str, Gnss]) -> dict[str, Any]:
    """Move a model into the world, in place.

    Args:
        model: COLMAP's reconstruction, as structure from motion left it.
        images: All images.
        gnss: Satellite positions of the training recordings, by id.

    Returns:
        What VIO said of scale and gravity, and satellites of the place on earth, as plain data.

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
    is_metric, has_up = _where_any(images.is_metric[rows]), _where_any(images.is_level[rows])
    scales = metric.estimate_scales(
        poses.at(is_metric), vio.at(is_metric), worlds[is_metric],
        images.timestamp_s[rows[is_metric]],
    )  # fmt: skip
    scale = metric.mean_scale(scales)
    gravity = metric.estimate_gravity(poses.at(has_up), vio.at(has_up), worlds[has_up])
    is_first = worlds == worlds[has_up][0]
    _transform(
        model, metric.place_in_world(poses.at(is_first), vio.at(is_first), scale, gravity.up)
    )
    geo = _georeference(model, images, gnss)
    if isinstance(geo, Georeference):
        half = np.radians(geo.enu_heading_deg) / 2
        about_z = np.array([0.0, 0.0, np.sin(half), np.cos(half)])
        _transform(model, Sim3(np.array(1.0), Rigid3(np.zeros(3), about_z)))
    return {
        "is_metric": bool(images.is_metric[rows].any()),
        "is_gravity_aligned": bool(images.is_level[rows].any()),
        "scales": [dataclasses.asdict(s) for s in scales],
        "metres_per_unit": scale,
        "gravity_spread_deg": gravity.spread_deg,
        "gravity_p95_deg": gravity.p95_deg,
        "gravity_offset_deg": gravity.world_offset_deg,
        "georeference": dataclasses.asdict(geo) if isinstance(geo, Georeference) else geo,
    }


def _where_any(good: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The good ones; if there is none, all: the map is then as wrong as they are, and says so."""
    return good if good.any() else np.ones_like(good)


def poses_of_model(model: Any, images: MapImages) -> tuple[NDArray[np.intp], Rigid3]:
    """Rows of a model's images, and their poses in its world."""
    mapped = registered_images(model)
    rows = np.array([k for k, name in enumerate(images.names) if name in mapped], dtype=np.intp)
    return rows, stack([world_from_cam(mapped[images.names[k]]) for k in rows])


def _transform(model: Any, new_from_old: Sim3) -> None:
    pycolmap = load_pycolmap()
    offset, quat = new_from_old.rigid
    rotation = pycolmap.Rotation3d(quat)
    model.transform(pycolmap.Sim3d(float(new_from_old.scale), rotation, offset))


def _georeference(
    model: Any, images: MapImages, gnss: Mapping[str, Gnss]
) -> Georeference | str | None:
    """By the satellite positions of all recordings; None where there are none."""
    rows, poses = poses_of_model(model, images)
    columns = []
    for number, (id_, fixes) in enumerate(gnss.items()):
        is_own = images.recording[rows] == images.ids.index(id_)
        if len(fixes) and is_own.sum() >= 2:
            times = images.timestamp_s[rows[is_own]]
            columns.append(_fixes(fixes, times, poses.translation_m[is_own], number))
    if not columns:
        return None
    return georeference(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def _fixes(
    gnss: Gnss, timestamp_s: NDArray[np.float64], position_m: NDArray[np.float64], number: int
) -> tuple[NDArray[np.float64], ...]:
    """The arguments of `georeference` for one recording."""
    at = gnss.timestamp_s
    after = np.searchsorted(timestamp_s, at).clip(1, len(timestamp_s) - 1)
    gap = timestamp_s[after] - timestamp_s[after - 1]
    kept = (at >= timestamp_s[0]) & (at <= timestamp_s[-1]) & (gap <= MAX_FIX_GAP_S)
    where = np.column_stack([np.interp(at, timestamp_s, column) for column in position_m.T])
    # Clocks of recordings may overlap; their fixes are independent all the same.
    clock = at - timestamp_s[0] + 1e6 * number
    values = (where, gnss.latitude_deg, gnss.longitude_deg, gnss.altitude_m,
              gnss.horizontal_sigma_m, clock)  # fmt: skip
    return tuple(value[kept] for value in values)
