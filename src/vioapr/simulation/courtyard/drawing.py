"""Meshes on the graphics side: cut into chunks, so that only those in view are drawn."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.simulation.courtyard.mesh import ATTRIBUTES, Mesh
from vioapr.simulation.courtyard.world import Material

CHUNK_M = 9.0
"""Side of the squares of ground by which meshes are cut."""
_FEW_TRIANGLES = 400
"""A mesh of fewer is not worth cutting."""


class Drawable:
    """A mesh that is loaded, with its picture."""

    def __init__(self, context: Any, mesh: Mesh, material: Material, texture: Any) -> None:
        vertices = mesh.vertex_array()
        vertices[:, 6:8] /= material.size_m
        self.texture, self.is_cutout = texture, material.is_cutout
        self.is_glossy = bool((mesh.gloss > 0).any())
        self._context = context
        self._vertices = context.buffer(vertices)
        self._index = context.buffer(mesh.triangles)
        self._arrays: dict[Any, Any] = {}

    def array(self, program: Any) -> Any:
        """Its vertices as the input of a program."""
        if program not in self._arrays:
            # Drivers leave out of a program what it does not use: such attributes are skipped.
            names = {name: "uv" if name == "uv_m" else name for name, _ in ATTRIBUTES}
            layout = " ".join(
                f"{size}f" if names[name] in program else f"{4 * size}x"
                for name, size in ATTRIBUTES
            )
            used = [name for name in names.values() if name in program]
            content = [(self._vertices, layout, *used)]
            self._arrays[program] = self._context.vertex_array(program, content, self._index)
        return self._arrays[program]


class Chunk(NamedTuple):
    """A run of a drawable's triangles: first index, number of indices."""

    drawable: Drawable
    first: int
    count: int


@dataclass(frozen=True)
class Cut:
    """A mesh whose triangles are sorted by the square of ground that they stand on.

    Attributes:
        mesh: With its triangles sorted.
        runs: For every square its first index and number of indices.
        low_m: Lower corner of each square's triangles, (k, 3).
        high_m: Upper corners.
    """

    mesh: Mesh
    runs: list[tuple[int, int]]
    low_m: NDArray
    high_m: NDArray


def load_texture(context: Any, material: Material) -> Any:
    """A material's picture with its smaller copies."""
    pixels = np.full((*material.pixels.shape[:2], 4), 255, dtype=np.uint8)
    # Texture rows start at the bottom, as heights do.
    pixels[..., : material.pixels.shape[2]] = material.pixels[::-1]
    texture = context.texture(pixels.shape[1::-1], 4, pixels.tobytes())
    texture.build_mipmaps()
    texture.filter = context.LINEAR_MIPMAP_LINEAR, context.LINEAR
    return texture


def split_by_gloss(mesh: Mesh) -> list[Mesh]:
    """The matte and the glossy triangles of a mesh, which have programs of their own."""
    is_glossy = mesh.gloss[mesh.triangles[:, 0], 0] > 0
    parts = []
    for triangles in (mesh.triangles[~is_glossy], mesh.triangles[is_glossy]):
        if len(triangles):
            used, rows = np.unique(triangles, return_inverse=True)
            columns = {name: getattr(mesh, name)[used] for name, _ in ATTRIBUTES}
            parts.append(Mesh(**columns, triangles=rows.reshape(-1, 3).astype(np.int32)))
    return parts


def cut(mesh: Mesh) -> Cut:
    """Cut a mesh by squares of ground, unless it is small."""
    corners = mesh.position_m[mesh.triangles]
    square = np.floor(corners.mean(axis=1)[:, :2] / CHUNK_M).astype(int)
    if len(mesh.triangles) < _FEW_TRIANGLES:
        square[:] = 0
    key = square[:, 0] * 1000 + square[:, 1]
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    pieces = [corners[order][f : f + n] for f, n in zip(first, count, strict=True)]
    runs = [(int(3 * f), int(3 * n)) for f, n in zip(first, count, strict=True)]
    low, high = (
        np.array([getattr(piece, end)(axis=(0, 1)) for piece in pieces]) for end in ("min", "max")
    )
    return Cut(replace(mesh, triangles=mesh.triangles[order]), runs, low, high)


class ChunkList:
    """Chunks of all drawables, with their bounds."""

    def __init__(self, drawn: Iterable[tuple[Drawable, Cut]]) -> None:
        drawn = list(drawn)
        self.drawables = [drawable for drawable, _ in drawn]
        self._chunks = [Chunk(drawable, *run) for drawable, cut in drawn for run in cut.runs]
        self._low = np.concatenate([cut.low_m for _, cut in drawn])
        self._high = np.concatenate([cut.high_m for _, cut in drawn])
        self._is_cutout = np.array([chunk.drawable.is_cutout for chunk in self._chunks])

    def in_view(self, clip_from_world: NDArray, camera_m: NDArray) -> list[Chunk]:
        """What may be visible: solid things from near to far, then those with holes.

        A box is out of view if it lies wholly on the outer side of one of the view's planes.
        """
        low, high = self._low, self._high
        # Planes of the four sides and of the near end, pointing inwards.
        signs = np.array([1, 1, -1, -1, 1])[:, None]
        planes = clip_from_world[3] + signs * clip_from_world[[0, 1, 0, 1, 2]]
        inner = np.where(planes[:, None, :3] > 0, high, low)
        is_seen = ((inner * planes[:, None, :3]).sum(-1) + planes[:, None, 3] > 0).all(axis=0)
        gap = np.maximum(np.maximum(low - camera_m, camera_m - high), 0)
        distance = np.linalg.norm(gap, axis=1) + 1e4 * self._is_cutout
        order = np.argsort(distance, kind="stable")
        return [self._chunks[i] for i in order if is_seen[i]]
