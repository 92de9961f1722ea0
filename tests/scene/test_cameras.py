"""Pictures of another camera than a model knows are named."""

import numpy as np
import pytest

from vioapr.scene.cameras import describe_other_camera, relative_camera
from vioapr.scene.frames import Intrinsics

PHONE = Intrinsics(1920, 1440, 1440, 1440, 960, 720)
KNOWN = (0.75, 1.0, 0.5, 0.5)


def test_intrinsics_over_the_images_size():
    np.testing.assert_allclose(relative_camera(PHONE), KNOWN)
    assert np.isnan(relative_camera(Intrinsics())).all()


def test_the_same_camera_at_another_size_is_no_other():
    smaller = relative_camera(Intrinsics(640, 480, 480, 480, 320, 240))
    assert describe_other_camera(smaller[None], KNOWN) is None


@pytest.mark.parametrize(
    "other",
    [
        Intrinsics(1920, 1080, 1440, 1440, 960, 540),  # 16:9, cropped
        Intrinsics(1440, 1920, 1440, 1440, 720, 960),  # portrait
        Intrinsics(1920, 1440, 900, 900, 960, 720),  # another lens
    ],
)
def test_another_camera_is_named(other):
    text = describe_other_camera(relative_camera(other)[None], KNOWN)
    assert text is not None
    assert "expected 0.750, 1.000, 0.500, 0.500" in text


def test_what_is_not_known_is_not_judged():
    other = relative_camera(Intrinsics(1920, 1080, 1440, 1440, 960, 540))
    assert describe_other_camera(other[None], None) is None
    assert describe_other_camera(np.full((3, 4), np.nan), KNOWN) is None
    assert describe_other_camera(np.zeros((0, 4)), KNOWN) is None
