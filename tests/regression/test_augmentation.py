"""Crops, colours and turns."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from vioapr.errors import ParameterError
from vioapr.geometry.rigid import Rigid3
from vioapr.regression.augmentation import (
    AugmentationParams,
    Draw,
    augment,
    draw,
    middle_crop,
    normalize,
)
from vioapr.schemas.regressor import IMAGE_MEAN, IMAGE_STD
from vioapr.simulation.rooms import BOX_CAMERA, coloured_box, render, stand_about

NONE = AugmentationParams(jitter=0, hue=0)
CAMERAS = torch.tensor(
    [[BOX_CAMERA.fx / BOX_CAMERA.width, BOX_CAMERA.fy / BOX_CAMERA.height, 0.5, 0.5]]
)
IDENTITY = torch.tensor([[0.0, 0.0, 0.0, 1.0]])


def numbered(count=2, side=40):
    """Every pixel says where it is."""
    rows, columns = torch.meshgrid(torch.arange(side), torch.arange(side), indexing="ij")
    image = torch.stack([rows, columns, 0 * rows], dim=-1).to(torch.uint8)
    return image.expand(count, -1, -1, -1).contiguous()


def to_grey(images):
    mean, std = (torch.tensor(values)[:, None, None] for values in (IMAGE_MEAN, IMAGE_STD))
    return (images * std + mean) * 255


def nothing(count):
    return Draw(torch.full((count, 2), 0.5), torch.zeros(count, 4), torch.zeros(count, 3))


def test_middle_crop_is_the_middle():
    pixels = to_grey(middle_crop(numbered(), 32))
    assert pixels.shape == (2, 3, 32, 32)
    torch.testing.assert_close(pixels[0, :2, 0, 0], torch.tensor([4.0, 4.0]))


def test_crops_are_anywhere_and_whole():
    corners = torch.tensor([[0.0, 0.0], [0.999, 0.999], [0.0, 0.999]])
    drawn = nothing(3)._replace(corner=corners)
    images, _ = augment(numbered(3), IDENTITY.expand(3, 4), CAMERAS.expand(3, 4), 32, NONE, drawn)
    pixels = to_grey(images)
    expected = torch.tensor([[0.0, 0.0], [8.0, 8.0], [0.0, 8.0]])
    torch.testing.assert_close(pixels[:, :2, 0, 0], expected, atol=1e-3, rtol=0)
    torch.testing.assert_close(pixels[:, :2, -1, -1], expected + 31, atol=1e-3, rtol=0)


def test_no_turn_is_the_middle_crop():
    params = AugmentationParams(jitter=0, hue=0, turn_deg=10)
    images, quat = augment(numbered(1), IDENTITY, CAMERAS, 32, params, nothing(1))
    torch.testing.assert_close(images, middle_crop(numbered(1), 32), atol=1e-4, rtol=0)
    torch.testing.assert_close(quat, IDENTITY)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_turned_picture_is_what_the_turned_camera_sees(axis):
    poses = stand_about(1, 5).target_from_source
    picture = torch.from_numpy(render(coloured_box(), BOX_CAMERA, poses.at(0)))[None]
    turn = torch.zeros(1, 3)
    turn[0, axis] = 1.0
    params = AugmentationParams(jitter=0, hue=0, turn_deg=8)
    quat = torch.as_tensor(poses.quat_xyzw, dtype=torch.float32)
    images, turned = augment(picture, quat, CAMERAS, 24, params, nothing(1)._replace(turn=turn))
    true = Rotation.from_quat(poses.quat_xyzw[0]) * Rotation.from_rotvec(
        np.radians(8) * turn.numpy()[0]
    )
    assert (Rotation.from_quat(turned[0].numpy()) * true.inv()).magnitude() < 1e-5
    turned_camera = Rigid3(poses.translation_m[0], true.as_quat())
    seen = render(coloured_box(), BOX_CAMERA, turned_camera)
    expected = middle_crop(torch.from_numpy(seen)[None], 24)
    unturned = middle_crop(picture, 24)
    off, off_unturned = ((other - expected).abs().mean() for other in (images, unturned))
    assert off < 0.1 * off_unturned


def test_colours_by_hand():
    grey = torch.full((1, 40, 40, 3), 100, dtype=torch.uint8)
    params = AugmentationParams(jitter=0.5, hue=0.25)
    brighter = nothing(1)._replace(colour=torch.tensor([[1.0, 0, 0, 0]]))
    images, _ = augment(grey, IDENTITY, CAMERAS, 32, params, brighter)
    torch.testing.assert_close(to_grey(images), torch.full_like(images, 150.0), atol=0.1, rtol=0)
    # Contrast, saturation and hue leave a grey picture as it is.
    others = nothing(1)._replace(colour=torch.tensor([[0.0, 1, -1, 1]]))
    images, _ = augment(grey, IDENTITY, CAMERAS, 32, params, others)
    torch.testing.assert_close(to_grey(images), torch.full_like(images, 100.0), atol=0.1, rtol=0)


def test_hue_keeps_luma_and_no_saturation_is_grey():
    red = torch.zeros(1, 40, 40, 3, dtype=torch.uint8)
    red[..., 0] = 100
    weights = torch.tensor([0.299, 0.587, 0.114])
    turned = nothing(1)._replace(colour=torch.tensor([[0.0, 0, 0, 0.2]]))
    images, _ = augment(red, IDENTITY, CAMERAS, 32, AugmentationParams(0, 0.1), turned)
    assert not torch.allclose(to_grey(images)[0, :, 0, 0], torch.tensor([100.0, 0, 0]), atol=2)
    assert (to_grey(images)[0, :, 0, 0] @ weights - 29.9).abs() < 6  # clipped at 0
    dull = nothing(1)._replace(colour=torch.tensor([[0.0, 0, -1.0, 0]]))
    images, _ = augment(red, IDENTITY, CAMERAS, 32, AugmentationParams(1.0, 0), dull)
    expected = torch.full((3,), 29.9)
    torch.testing.assert_close(to_grey(images)[0, :, 0, 0], expected, atol=0.5, rtol=0)


def test_draws_depend_on_the_seed_alone():
    first, second = (draw(8, torch.Generator().manual_seed(4)) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(first, second, strict=True))
    assert not torch.equal(first.corner, draw(8, torch.Generator().manual_seed(5)).corner)


def test_normalization_is_imagenets():
    white = normalize(torch.ones(1, 3, 2, 2))
    torch.testing.assert_close(white[0, 0, 0, 0], torch.tensor((1 - 0.485) / 0.229))


@pytest.mark.parametrize("values", [{"jitter": 1.5}, {"hue": -0.1}, {"turn_deg": 90}])
def test_odd_parameters(values):
    with pytest.raises(ParameterError, match="expected 0 to"):
        AugmentationParams(**values)
