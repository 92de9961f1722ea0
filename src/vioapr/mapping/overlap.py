"""Which recordings share views, and what to record where they do not."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from vioapr.mapping.inputs import MapImages
from vioapr.mapping.pairs import Pairs
from vioapr.mapping.verification import MIN_INLIERS
from vioapr.plurals import count_of
from vioapr.schemas.map_summary import Overlap


def find_islands(
    images: MapImages, pairs: Pairs, inliers: NDArray[np.intp], ids: Sequence[str]
) -> list[list[str]]:
    """Group the recordings that see common things: ids, the largest group of images first.

    Two recordings are of one group if images of the one match images of the other, directly or
    by way of further recordings.
    """
    good = pairs[inliers >= MIN_INLIERS]
    count = len(images)
    graph = coo_array((np.ones(len(good)), (good[:, 0], good[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    # A recording belongs where most of its images are.
    home = {id_: int(np.bincount(label[images.rows_of(id_)]).argmax()) for id_ in ids}
    sizes = dict.fromkeys(home.values(), 0)
    for id_, island in home.items():
        sizes[island] += len(images.rows_of(id_))
    order = sorted(sizes, key=lambda island: -sizes[island])
    return [[id_ for id_ in ids if home[id_] == island] for island in order]


def find_overlaps(
    images: MapImages, pairs: Pairs, inliers: NDArray[np.intp], ids: Sequence[str]
) -> list[Overlap]:
    """Count the pairs of images between every two recordings, compared and good.

    Args:
        images: All images.
        pairs: Those that were compared.
        inliers: Verified matches of each, shape (len(pairs),).
        ids: The recordings.
    """
    recording = np.sort(images.recording[pairs], axis=1)
    overlaps = []
    for first, second in combinations(ids, 2):
        both = sorted((images.ids.index(first), images.ids.index(second)))
        between = np.flatnonzero((recording == both).all(axis=1))
        good = between[inliers[between] >= MIN_INLIERS]
        best = pairs[between[np.argmax(inliers[between])]] if len(good) else []
        overlaps.append(
            Overlap(
                recordings=[first, second], compared=len(between), good=len(good),
                best=[images.names[row] for row in best],
            )
        )  # fmt: skip
    return overlaps


def describe_gaps(islands: list[list[str]], overlaps: list[Overlap]) -> str:
    """Say which recordings share no view, and what to record.

    Args:
        islands: Groups of recordings that share views, more than one.
        overlaps: Between every two recordings.
    """
    home = {id_: k for k, island in enumerate(islands) for id_ in island}
    names = [" or ".join(island) for island in islands]
    counts = []
    for k, name in enumerate(names[1:], start=1):
        between = [each for each in overlaps if {home[id_] for id_ in each.recordings} == {0, k}]
        compared, good = sum(e.compared for e in between), sum(e.good for e in between)
        few = "none sees the same things" if not good else f"only {good} see the same things"
        counts.append(f"of {count_of(compared, 'pair')} of images of {names[0]} and {name} {few}")
    walks = "; ".join(f"from the place of {names[0]} to that of {name}" for name in names[1:])
    return (
        "recordings share no view: "
        + " | ".join(", ".join(island) for island in islands)
        + f". Record a walk that sees both places, looking the way these recordings do ({walks}), "
        "take one side out of splits.train in scene.toml, or map the largest alone with "
        f"allow_partial. What was compared: {'; '.join(counts)}"
    )


def describe_overlaps(ids: Sequence[str], overlaps: list[Overlap]) -> str:
    """Say how many pairs of images recordings share with all others, e.g. "b: 3 of 40"."""
    parts = []
    for id_ in ids:
        own = [each for each in overlaps if id_ in each.recordings]
        parts.append(f"{id_}: {sum(e.good for e in own)} of {sum(e.compared for e in own)}")
    return ", ".join(parts)
