"""Trackers that ran away, and those that only jumped."""

import numpy as np

from vioapr.scene.divergence import find_divergence

TIMES = np.arange(0, 30, 0.1)


def along_x(x):
    return np.stack([x, 0 * x, 0 * x], axis=1)


def test_a_walk():
    assert find_divergence(TIMES, along_x(1.5 * TIMES)) is None


def test_from_the_middle_on():
    x = np.where(TIMES < 15, TIMES, 15 + 20 * (TIMES - 15))
    onset = find_divergence(TIMES, along_x(x))
    # Half of the window that begins there is too fast.
    assert 11.5 < onset < 15.1


def test_a_jump_is_none():
    assert find_divergence(TIMES, along_x(TIMES + 500.0 * (TIMES > 10))) is None


def test_too_short_to_tell():
    assert find_divergence(TIMES[:1], along_x(TIMES[:1])) is None
    assert find_divergence(TIMES[:20], along_x(100 * TIMES[:20])) is None
