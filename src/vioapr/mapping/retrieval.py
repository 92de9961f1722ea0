"""Which images look alike: VLAD of SIFT descriptors (Jegou et al. 2010).

No trained network and no vocabulary to download: the few words are found in the scene itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans

from vioapr.mapping.colmap import open_database
from vioapr.mapping.features import image_ids, read_descriptors
from vioapr.work.progress import Tick, ignore

WORDS = 64
SAMPLE = 10_000
CONVERGENCE = 1e-3
"""Words are found when the mean distance to them changes by less; descriptors have length 1."""


def describe_features(
    path: Path, names: Sequence[str], seed: int, tick: Tick
) -> NDArray[np.float32]:
    """Describe images by their features in a database; see `describe_images`.

    Raises:
        MappingError: It cannot be read.
    """
    with open_database(path) as database:
        ids = image_ids(database)
        return describe_images(
            lambda name: read_descriptors(database, ids[name]), names, seed=seed, tick=tick
        )


def describe_images(
    read: Callable[[str], NDArray[np.float32]],
    names: Sequence[str],
    *,
    seed: int,
    tick: Tick = ignore,
) -> NDArray[np.float32]:
    """One vector an image; the inner product of two says how alike they look.

    Args:
        read: Gives an image's unit descriptors, shape (features, 128), at least one.
        names: The images.
        seed: Of the words' random start.
        tick: Called once an image.

    Returns:
        Unit vectors, shape (images, words * 128).
    """
    words = find_words(read, names, seed)
    vectors = []
    for name in names:
        vectors.append(vlad(read(name), words))
        tick()
    return np.stack(vectors)


def find_words(
    read: Callable[[str], NDArray[np.float32]], names: Sequence[str], seed: int
) -> NDArray[np.float32]:
    """Find the words of a scene: means of groups of descriptors that are alike (k-means).

    Args:
        read: As of `describe_images`.
        names: The images.
        seed: Of the random start.

    Returns:
        Shape (words, 128); at most `WORDS`.
    """
    rng = np.random.default_rng(seed)
    spread = [names[int(k)] for k in rng.permutation(len(names))[:300]]
    each = -(-SAMPLE // len(spread))
    sample = [rng.permutation(read(name))[:each] for name in spread]
    descriptors = np.concatenate(sample)[:SAMPLE].astype(np.float64)
    count = min(WORDS, max(len(descriptors) // 20, 1))  # a word of few has no differences to sum
    start = descriptors[rng.choice(len(descriptors), count, replace=False)]
    words, _ = kmeans(descriptors, start, thresh=CONVERGENCE)
    return words.astype(np.float32)


def vlad(descriptors: NDArray[np.float32], words: NDArray[np.float32]) -> NDArray[np.float32]:
    """Describe an image by its vector of locally aggregated descriptors.

    Of every word the sum of its descriptors' differences from it, normalized; then all together.

    Args:
        descriptors: Shape (features, 128).
        words: Shape (words, 128).

    Returns:
        A unit vector, shape (words * 128,).
    """
    nearest = np.argmax(descriptors @ words.T - 0.5 * (words**2).sum(axis=1), axis=1)
    order = np.argsort(nearest, kind="stable")
    present, first = np.unique(nearest[order], return_index=True)
    sums = np.zeros_like(words)
    sums[present] = np.add.reduceat((descriptors - words[nearest])[order], first, axis=0)
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-9)
    vector = sums.ravel()
    return vector / max(float(np.linalg.norm(vector)), 1e-9)
