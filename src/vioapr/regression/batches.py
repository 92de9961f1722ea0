"""Batches of training images, in an order that the seed decides, ahead of the device."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vioapr.regression.augmentation import Draw, augment, draw
from vioapr.regression.data import Samples
from vioapr.regression.params import AugmentationParams, batches_of_epoch

_AHEAD = 2
"""Batches that are read while the device works."""

_RESIDENT_SHARE = 0.4
"""Of a GPU's free memory that images may take: then they are copied there once."""


class Batch(NamedTuple):
    """The inputs of a step: B images on the training device.

    Attributes:
        images: (B, 3, crop, crop), normalized.
        position_m: (B, 3).
        quat_xyzw: (B, 4), world_from_cam.
        scene: (B,).
    """

    images: Tensor
    position_m: Tensor
    quat_xyzw: Tensor
    scene: Tensor


def epoch_order(count: int, batch_size: int, seed: int, epoch: int) -> list[NDArray[np.int64]]:
    """Order the samples of an epoch into batches; a rest that fills none waits for another."""
    order = np.random.default_rng([seed, 1, epoch]).permutation(count)
    size, batches = batches_of_epoch(count, batch_size)
    return [order[number * size : (number + 1) * size] for number in range(batches)]


class BatchSource:
    """Draws the batches of every epoch from the samples."""

    def __init__(
        self,
        samples: Samples,
        crop: int,
        params: AugmentationParams,
        batch_size: int,
        seed: int,
        device: torch.device,
        part: tuple[int, int] = (0, 1),
    ) -> None:
        """Prepare samples for one process of several.

        Args:
            samples: To draw from.
            crop: Size of the images that come out.
            params: How they are varied.
            batch_size: Of all processes together.
            seed: Decides order and variation.
            device: Where batches go.
            part: This process's number, and how many there are.
        """
        self._samples, self._crop, self._params = samples, crop, params
        self._batch_size, self._seed, self._device, self._part = batch_size, seed, device, part
        self._poses = [
            torch.as_tensor(values, dtype=dtype, device=device)
            for values, dtype in (
                (samples.position_m, torch.float32),
                (samples.quat_xyzw, torch.float32),
                (samples.camera, torch.float32),
                (samples.scene, torch.int64),
            )
        ]
        self._resident = self._copy_if_small()

    def varied_by(self, params: AugmentationParams) -> BatchSource:
        """Give the same images in the same order, varied otherwise."""
        other = copy.copy(self)
        other._params = params
        return other

    def __len__(self) -> int:
        """Batches in an epoch."""
        return batches_of_epoch(len(self._samples), self._batch_size).count

    def epoch(self, number: int, first: int = 0) -> Iterator[Batch]:
        """Yield the batches of an epoch: this process's part of each.

        Args:
            number: Of the epoch.
            first: Batches before this one are left out; those after it are the same.
        """
        generator = torch.Generator().manual_seed(self._seed * 1_000_003 + number)
        with ThreadPoolExecutor(1) as pool:
            pending: deque[tuple[NDArray[np.int64], Draw, Future[Tensor]]] = deque()
            order = epoch_order(len(self._samples), self._batch_size, self._seed, number)
            for batch, index in enumerate(order):
                # Drawn for the whole batch: one process gets what all together would.
                drawn = draw(len(index), generator)
                if batch < first:
                    continue
                rows = self._own(len(index))
                own = index[rows]
                pending.append((own, drawn.part(rows), pool.submit(self._images, own)))
                if len(pending) > _AHEAD:
                    yield self._finish(*pending.popleft())
            while pending:
                yield self._finish(*pending.popleft())

    def _own(self, count: int) -> slice:
        number, processes = self._part
        size = count // processes
        return slice(number * size, (number + 1) * size)

    def _images(self, index: NDArray[np.int64]) -> Tensor:
        """Images (B, H, W, 3), uint8, on the device."""
        if self._resident is not None:
            return self._resident[torch.as_tensor(index, device=self._device)]
        images = torch.from_numpy(self._samples.read(index))
        if self._device.type == "cuda":
            return images.pin_memory().to(self._device, non_blocking=True)
        return images

    def _finish(self, index: NDArray[np.int64], drawn: Draw, images: Future[Tensor]) -> Batch:
        chosen = torch.as_tensor(index, device=self._device)
        position_m, quat_xyzw, camera, scene = (values[chosen] for values in self._poses)
        varied, quat_xyzw = augment(
            images.result(), quat_xyzw, camera, self._crop, self._params, drawn.to(self._device)
        )
        return Batch(varied, position_m, quat_xyzw, scene)

    def _copy_if_small(self) -> Tensor | None:
        """All images on the GPU, if they fit well."""
        if self._device.type != "cuda":
            return None
        size = sum(images.nbytes for images in self._samples.images)
        if size > _RESIDENT_SHARE * torch.cuda.mem_get_info(self._device)[0]:
            return None
        everything = np.arange(len(self._samples))
        blocks = [
            torch.from_numpy(self._samples.read(everything[start : start + 1024])).to(self._device)
            for start in range(0, len(everything), 1024)
        ]
        return torch.cat(blocks)
