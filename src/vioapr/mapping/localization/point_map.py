"""What a localizer needs of a map, as one file: points, who sees them, and how they look."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, MappingError, UnreadableError
from vioapr.files.atomic import write_atomically
from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.features import Sift, unit_descriptors
from vioapr.mapping.localization.posed_images import PosedImage
from vioapr.mapping.localization.uncertainty import PoseSigmas
from vioapr.mapping.retrieval import find_words, vlad
from vioapr.schemas.base import decode, encode
from vioapr.schemas.point_map import PointMapHeader

_ARRAYS = (
    "position_m", "quat_xyzw", "words", "looks", "first", "point", "descriptor", "points_m",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class PointMap:
    """Points of a map, and the images that see them: v images, n points, m observations.

    Attributes:
        header: What it is made from.
        position_m: Of the images' cameras in the world, shape (v, 3).
        quat_xyzw: world_from_cam of the images, shape (v, 4).
        words: That `looks` are sums over, shape (w, 128).
        looks: VLAD of the images, unit vectors, shape (v, w * 128).
        first: Of the observations of an image the first, shape (v + 1,).
        point: Which point an observation is of, shape (m,).
        descriptor: Of the observations, as of `Sift`, shape (m, 128).
        points_m: In the world, shape (n, 3).
    """

    header: PointMapHeader
    position_m: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64]
    words: NDArray[np.float32]
    looks: NDArray[np.float16]
    first: NDArray[np.int64]
    point: NDArray[np.int32]
    descriptor: NDArray[np.uint8]
    points_m: NDArray[np.float64]

    @property
    def world_from_cam(self) -> Rigid3:
        """Poses of the images, shape (v,)."""
        return Rigid3(self.position_m, self.quat_xyzw)

    @property
    def sigmas(self) -> PoseSigmas:
        """What the map itself adds to standard deviations; NaN if that is not known."""
        stated = self.header.sigma_position_m, self.header.sigma_orientation_deg
        return PoseSigmas(*(np.nan if sigma is None else sigma for sigma in stated))

    def with_sigmas(self, sigmas: PoseSigmas) -> PointMap:
        """The same map, which adds this to standard deviations."""
        stated = [None if np.isnan(sigma) else sigma for sigma in sigmas]
        header = msgspec.structs.replace(
            self.header, sigma_position_m=stated[0], sigma_orientation_deg=stated[1]
        )
        return replace(self, header=header)

    def save(self, path: Path) -> None:
        """Write it whole or not at all.

        Raises:
            UnwritableError: It cannot be written; what was there stays.
        """
        header = np.frombuffer(encode(self.header).encode(), dtype=np.uint8)
        buffer = io.BytesIO()
        np.savez(buffer, header=header, **{name: getattr(self, name) for name in _ARRAYS})
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, buffer.getvalue())

    @staticmethod
    def load(path: Path) -> PointMap:
        """Read one.

        Raises:
            FileError: It is missing, broken, or something else.
        """
        header = PointMap.load_header(path)
        with np.load(path, allow_pickle=False) as file:
            try:
                return PointMap(header, *(file[name] for name in _ARRAYS))
            except (KeyError, ValueError, OSError) as error:
                raise FormatError(
                    path, f"expected a point map, got a broken one: {error}"
                ) from None

    @staticmethod
    def load_header(path: Path) -> PointMapHeader:
        """Read what a point map is made from; raises as `load`."""
        try:
            with np.load(path, allow_pickle=False) as file:
                return decode(path, file["header"].tobytes(), PointMapHeader)
        except OSError as error:
            raise UnreadableError.of(path, error) from None
        except (KeyError, ValueError, EOFError):
            raise FormatError(path, "expected a point map") from None


def build_point_map(
    images: Sequence[PosedImage],
    features: Mapping[str, Sift],
    points: Mapping[str, NDArray[np.int64]],
    points_m: Mapping[int, NDArray[np.float64]],
    *,
    key: str,
    source: str,
    is_gravity_aligned: bool,
    shares_cameras: bool,
    max_image_size: int,
    max_features: int,
    seed: int = 0,
) -> PointMap:
    """Put a map's points together.

    Args:
        images: The map's; those that see no point are left out.
        features: Of every image, by name.
        points: By name of an image, the number of the point that each feature sees, -1 for none.
        points_m: The points, by number, each of shape (3,).
        key: Changes with all that this is made from.
        source: For people.
        is_gravity_aligned: Whether the world's z axis is up.
        shares_cameras: Whether images of about the same focal length share a camera.
        max_image_size: That features were found with.
        max_features: Of an image at most.
        seed: Of the words' random start.

    Raises:
        MappingError: There are no points.
    """
    images = [image for image in images if (points[image.name] >= 0).any()]
    if not images:
        raise MappingError(
            f"{source}: no point could be triangulated: too few images see the same things, or "
            "their poses are wrong"
        )
    numbers = np.array(sorted(points_m), dtype=np.int64)
    names = [image.name for image in images]
    described = {name: unit_descriptors(features[name].descriptors) for name in names}
    words = find_words(described.__getitem__, names, seed)
    seen = [points[name] >= 0 for name in names]
    poses = rigid.stack([image.world_from_cam for image in images])
    cameras = Counter(image.camera for image in images)
    header = PointMapHeader(
        key=key,
        source=source,
        is_gravity_aligned=is_gravity_aligned,
        shares_cameras=shares_cameras,
        names=tuple(names),
        cameras=tuple(camera for camera, _ in cameras.most_common()),
        max_image_size=max_image_size,
        max_features=max_features,
        sigma_position_m=None,
        sigma_orientation_deg=None,
    )
    observed = [points[name][is_seen] for name, is_seen in zip(names, seen, strict=True)]
    return PointMap(
        header,
        poses.translation_m,
        poses.quat_xyzw,
        words,
        np.stack([vlad(described[name], words) for name in names]).astype(np.float16),
        np.concatenate([[0], np.cumsum([len(rows) for rows in observed])]),
        np.searchsorted(numbers, np.concatenate(observed)).astype(np.int32),
        np.concatenate(
            [features[name].descriptors[rows] for name, rows in zip(names, seen, strict=True)]
        ),
        np.stack([points_m[int(number)] for number in numbers]),
    )
