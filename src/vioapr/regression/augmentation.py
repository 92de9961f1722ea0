"""Crops, colours and turns of whole batches of images, on the device that trains.

All that is random is drawn for the batch beforehand (`draw`), so that the same seed gives the
same images on any device and any number of devices.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from vioapr.geometry import quaternion
from vioapr.regression.params import AugmentationParams
from vioapr.schemas.regressor import IMAGE_MEAN, IMAGE_STD

# Luma, and two axes of colour in which a turn is a change of hue (NTSC).
_YIQ = torch.tensor(
    [[0.299, 0.587, 0.114], [0.595716, -0.274453, -0.321263], [0.211456, -0.522591, 0.311135]]
)
_RGB = torch.linalg.inv(_YIQ)


class Draw(NamedTuple):
    """The random numbers of B images.

    Attributes:
        corner: (B, 2), row and column of the crop as parts of the margin, 0 to 1.
        colour: (B, 4), of brightness, contrast, saturation and hue, -1 to 1.
        turn: (B, 3), -1 to 1.
    """

    corner: Tensor
    colour: Tensor
    turn: Tensor

    def to(self, device: torch.device) -> Draw:
        """Move to a device."""
        return Draw(*(values.to(device, non_blocking=True) for values in self))

    def part(self, rows: slice) -> Draw:
        """Choose those of some images."""
        return Draw(*(values[rows] for values in self))


def draw(count: int, generator: torch.Generator) -> Draw:
    """Draw the random numbers of `count` images."""
    corner = torch.rand(count, 2, generator=generator)
    colour = 2 * torch.rand(count, 4, generator=generator) - 1
    return Draw(corner, colour, 2 * torch.rand(count, 3, generator=generator) - 1)


def middle_crop(images: Tensor, size: int) -> Tensor:
    """Cut out the middle of images (B, H, W, 3), uint8: (B, 3, size, size), normalized."""
    top, left = ((side - size) // 2 for side in images.shape[1:3])
    cropped = images[:, top : top + size, left : left + size]
    return normalize(cropped.permute(0, 3, 1, 2).to(torch.float32) / 255)


def normalize(images: Tensor) -> Tensor:
    """Normalize RGB of 0 to 1, shape (B, 3, H, W), as networks take it."""
    mean, std = (
        torch.tensor(values, device=images.device)[:, None, None]
        for values in (IMAGE_MEAN, IMAGE_STD)
    )
    return (images - mean) / std


def augment(
    images: Tensor,
    quat_xyzw: Tensor,
    camera: Tensor,
    size: int,
    params: AugmentationParams,
    drawn: Draw,
) -> tuple[Tensor, Tensor]:
    """Vary a batch: turned or cropped at random, its colours jittered.

    Args:
        images: (B, H, W, 3), uint8.
        quat_xyzw: (B, 4), world_from_cam.
        camera: (B, 4), fx, fy, cx, cy over width and height.
        size: Of the crop.
        params: How much.
        drawn: Its random numbers.

    Returns:
        Images (B, 3, size, size), normalized, and the rotations that they show, (B, 4).
    """
    if params.turn_deg > 0:
        old_from_new = quaternion.from_rotvec(torch.deg2rad(drawn.turn * params.turn_deg))
        views = turn_camera(images, old_from_new, camera, size)
        quat_xyzw = quaternion.multiply(quat_xyzw, old_from_new)
    else:
        views = crop_at(images, drawn.corner, size)
    return normalize(jitter_colour(views, params, drawn.colour)), quat_xyzw


def crop_at(images: Tensor, corner: Tensor, size: int) -> Tensor:
    """Crop every image at a corner of its own.

    Args:
        images: (B, H, W, 3), uint8.
        corner: (B, 2), see `Draw`.
        size: Of the crop.

    Returns:
        Shape (B, 3, size, size), 0 to 1.
    """
    margin = torch.tensor([side - size + 1 for side in images.shape[1:3]], device=images.device)
    first = (corner * margin).to(torch.int64)
    steps = torch.arange(size, device=images.device)
    rows, columns = (first[:, axis, None] + steps for axis in (0, 1))
    batch = torch.arange(len(images), device=images.device)[:, None, None]
    views = images[batch, rows[:, :, None], columns[:, None, :]]
    return views.permute(0, 3, 1, 2).to(torch.float32) / 255


def turn_camera(images: Tensor, old_from_new: Tensor, camera: Tensor, size: int) -> Tensor:
    """Show the middle of each image as a turned camera would; grey where nothing is known.

    Exact whatever the depth: a rotation about the camera's centre is a homography.

    Args:
        images: (B, H, W, 3), uint8.
        old_from_new: (B, 4), rotation of the camera.
        camera: (B, 4), see `augment`.
        size: Of the part that is shown.

    Returns:
        Shape (B, 3, size, size), 0 to 1.
    """
    height, width = images.shape[1:3]
    axis_y, axis_x = (
        (torch.arange(size, device=images.device) + (side - size) // 2 + 0.5) / side
        for side in (height, width)
    )
    fx, fy, cx, cy = (value[:, None, None] for value in camera.unbind(dim=-1))
    x = ((axis_x[None, None, :] - cx) / fx).expand(-1, size, -1)
    y = ((axis_y[None, :, None] - cy) / fy).expand(-1, -1, size)
    rays = torch.stack([x, y, torch.ones_like(x)], dim=-1)
    rays = torch.einsum("bij,bhwj->bhwi", quaternion.to_matrix(old_from_new), rays)
    depth = rays[..., 2].clamp_min(1e-6)
    # From 0 to 1 over the image to grid_sample's -1 to 1.
    grid = torch.stack([rays[..., 0] / depth * fx + cx, rays[..., 1] / depth * fy + cy], dim=-1)
    centred = images.permute(0, 3, 1, 2).to(torch.float32) / 255 - 0.5
    seen = functional.grid_sample(centred, 2 * grid - 1, align_corners=False)
    return seen + 0.5


def jitter_colour(images: Tensor, params: AugmentationParams, colour: Tensor) -> Tensor:
    """Vary brightness, contrast, saturation and hue of images (B, 3, H, W) of 0 to 1.

    All four at once, as one affine map of RGB an image.

    Args:
        images: RGB.
        params: By how much at most.
        colour: (B, 4), see `Draw`.
    """
    if params.jitter == 0 and params.hue == 0:
        return images
    brightness, contrast, saturation = (1 + params.jitter * colour[:, :3]).unbind(dim=-1)
    hue_rad = colour[:, 3] * params.hue * 2 * torch.pi
    cosine, sine = saturation * torch.cos(hue_rad), saturation * torch.sin(hue_rad)
    zero, one = torch.zeros_like(cosine), torch.ones_like(cosine)
    rows = (one, zero, zero, zero, cosine, -sine, zero, sine, cosine)
    turned = torch.stack(rows, dim=-1).unflatten(-1, (3, 3))
    mixing = _RGB.to(images.device) @ turned @ _YIQ.to(images.device)
    gain = (brightness * contrast)[:, None, None] * mixing
    mean = brightness[:, None] * torch.einsum("bij,bj->bi", mixing, images.mean(dim=(2, 3)))
    shift = (1 - contrast)[:, None] * mean.mean(dim=-1, keepdim=True)
    varied = torch.einsum("bij,bjhw->bihw", gain, images) + shift[:, :, None, None]
    return varied.clamp(0, 1)
