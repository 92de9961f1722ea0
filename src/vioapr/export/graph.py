"""The localizer as one PyTorch module: image and tracker pose in, fused pose and state out.

The fusion step is the same source that NumPy runs, traced in float32 at batch shape (1,). Inputs
and outputs are flat tensors; docs/reference/contract.md describes them.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor, nn

from vioapr.export.preprocess import Preprocessor
from vioapr.export.state import StateLayout
from vioapr.fusion import session
from vioapr.fusion.easing import Eased
from vioapr.fusion.session import Picture, Session
from vioapr.fusion.types import Estimate, FrameInput, Method
from vioapr.geometry.rigid import Rigid3

RUN_TIME_PARAMS: dict[str, tuple[str, ...]] = {
    "vio-apr": ("distance_threshold_m", "angle_threshold_deg", "run_pairs", "optimized_frames"),
}
"""Parameters that are inputs of the graph, by method; all others are fixed at export."""

MAX_RUN_PAIRS = 8
"""The largest N of method `vio-apr` that the graph has room for, unless exported with more."""

_FARTHEST_M = 1e6
"""Metres; a position beyond is none."""

_LARGEST = 1e30
"""A number of the state that is larger has overflowed."""


SIGMAS = (
    "sigma_position_m",
    "sigma_orientation_deg",
    "sigma_position_axes_m",
    "sigma_orientation_axes_deg",
    "localization_state",
    "confidence",
)
"""Outputs of the methods that state their uncertainty."""


class AprPose(NamedTuple):
    """The regressor's pose and uncertainty, flat; NaN for a frame without image.

    Attributes:
        apr_world_from_cam: Shape (7,): x y z qx qy qz qw.
        apr_sigma_position_m: Shape (1,).
        apr_sigma_orientation_deg: Shape (1,).
    """

    apr_world_from_cam: Tensor
    apr_sigma_position_m: Tensor
    apr_sigma_orientation_deg: Tensor


class NetworkGraph(nn.Module):
    """A regressor with flat outputs."""

    def __init__(self, network: nn.Module) -> None:
        """Wrap a network.

        Args:
            network: From images (1, 3, crop, crop) to `position_m` (1, 3), `quat_xyzw` (1, 4),
                `sigma_position_m` (1,), `sigma_orientation_rad` (1,).
        """
        super().__init__()
        self.network = network

    def forward(self, images: Tensor, has_image: Tensor) -> AprPose:
        """Regress.

        Args:
            images: Shape (1, 3, crop, crop), see `Preprocessor`.
            has_image: Shape (1,), 1 if there is an image, else 0.
        """
        found = self.network(images)
        flat = (
            torch.cat([found.position_m, found.quat_xyzw], dim=-1).reshape(7),
            found.sigma_position_m.reshape(1),
            found.sigma_orientation_rad.reshape(1) * (180 / math.pi),
        )
        is_seen = has_image > 0.5
        return AprPose(*(torch.where(is_seen, x, torch.full_like(x, torch.nan)) for x in flat))


class FusionGraph(nn.Module):
    """One step of a fusion method on flat tensors."""

    initial_state: Tensor

    def __init__(self, method: Method, params: Any, identity: str = "") -> None:
        """Fix the method.

        Args:
            method: A batched one.
            params: Of it. Those in `RUN_TIME_PARAMS` become inputs.
            identity: See `StateLayout`.
        """
        super().__init__()
        self.method, self.params = method, params
        template = session.begin(
            Session(method, with_room(params)), (1,), np.zeros((1,), dtype=np.float32)
        )
        self.layout = StateLayout(template, f"{method.name} {identity}")
        initial = torch.from_numpy(self.layout.initial)
        self.register_buffer("initial_state", initial, persistent=False)

    @property
    def param_names(self) -> tuple[str, ...]:
        """Names of the numbers in the input `params`, in order."""
        return RUN_TIME_PARAMS.get(self.method.name, ())

    def forward(
        self,
        apr_world_from_cam: Tensor,
        apr_sigma_position_m: Tensor,
        apr_sigma_orientation_deg: Tensor,
        has_apr: Tensor,
        vio_from_cam: Tensor,
        timestamp_s: Tensor,
        tracking_ok: Tensor,
        tracking_reset: Tensor,
        image_timestamp_s: Tensor,
        image_vio_from_cam: Tensor,
        state: Tensor,
        params: Tensor | None = None,
    ) -> dict[str, Tensor]:
        """One frame; see docs/reference/contract.md for the tensors."""
        apr, is_predicted = _read_pose(apr_world_from_cam, has_apr)
        vio, is_tracked = _read_pose(vio_from_cam, tracking_ok)
        frame = FrameInput(
            timestamp_s,
            apr,
            is_predicted,
            vio,
            is_tracked,
            tracking_reset > 0.5,
            apr_sigma_position_m,
            apr_sigma_orientation_deg * (math.pi / 180),
        )
        picture = Picture(image_timestamp_s, *_read_pose(image_vio_from_cam, torch.ones(1)))
        running = Session(self.method, self.numbers(params))
        after, estimate = session.step(running, self.unpack(state), frame, picture)
        return self.name_outputs(after, estimate)

    def unpack(self, state: Tensor) -> Any:
        """The session's state; one of another graph counts as none."""
        is_ours = state[:1] == self.initial_state[:1]
        state = torch.where(is_ours, state, self.initial_state)
        _, *pieces = state.split([1, *(leaf.size for leaf in self.layout.leaves)])
        return self.layout.unpack(pieces)

    def numbers(self, params: Tensor | None) -> Any:
        """The method's parameters, those that are inputs as given."""
        if params is None:
            return self.params
        values = dict(zip(self.param_names, params.split(1), strict=True))
        fixed = {field.name: getattr(self.params, field.name) for field in fields(self.params)}
        return SimpleNamespace(**(fixed | values))

    def name_outputs(self, after: Any, estimate: Estimate) -> dict[str, Tensor]:
        """The outputs, by name, of the state after a step and its estimate."""
        pose = _flat(estimate.world_from_cam)
        next_state = torch.cat([self.initial_state[:1], *self.layout.pack(after)])
        # Numbers that overflowed must not look like a pose, nor live on.
        status = cast("Tensor", estimate.status)
        status = torch.where(_is_below(_FARTHEST_M, pose), status, torch.zeros_like(status))
        next_state = torch.where(
            _is_below(_LARGEST, next_state), next_state, torch.zeros_like(next_state)
        )
        outputs = {
            "world_from_cam": torch.where(status > 0, pose, torch.full_like(pose, torch.nan)),
            "world_from_vio": _flat(estimate.world_from_vio),
            "status": status,
            "confirmed_run": estimate.confirmed_run,
            **_name_eased(cast("Eased", estimate.eased)),
        }
        for name in SIGMAS:
            if (sigma := getattr(estimate, name)) is not None:
                outputs[name] = sigma.reshape(-1)
        return outputs | {"next_state": next_state}


class LocalizerGraph(nn.Module):
    """The whole: an image and the tracker's pose to the fused pose."""

    def __init__(
        self, preprocess: Preprocessor, network: NetworkGraph, fusion: FusionGraph
    ) -> None:
        """Join the parts."""
        super().__init__()
        self.preprocess, self.network, self.fusion = preprocess, network, fusion

    def forward(
        self,
        image: Tensor,
        has_image: Tensor,
        vio_from_cam: Tensor,
        timestamp_s: Tensor,
        tracking_ok: Tensor,
        tracking_reset: Tensor,
        image_timestamp_s: Tensor,
        image_vio_from_cam: Tensor,
        state: Tensor,
        params: Tensor | None = None,
    ) -> dict[str, Tensor]:
        """One frame; see docs/reference/contract.md for the tensors."""
        apr = self.network(self.preprocess(image), has_image)
        fused = self.fusion(
            *apr,
            has_image,
            vio_from_cam,
            timestamp_s,
            tracking_ok,
            tracking_reset,
            image_timestamp_s,
            image_vio_from_cam,
            state,
            params,
        )
        return fused | apr._asdict()


class CarryGraph(nn.Module):
    """One frame without prediction: the cheap part of a fusion step, on the same state."""

    def __init__(self, fusion: FusionGraph) -> None:
        """Wrap a fusion step."""
        super().__init__()
        self.fusion = fusion

    def forward(
        self,
        vio_from_cam: Tensor,
        timestamp_s: Tensor,
        tracking_ok: Tensor,
        tracking_reset: Tensor,
        state: Tensor,
        params: Tensor | None = None,
    ) -> dict[str, Tensor]:
        """One frame; see docs/reference/contract.md for the tensors."""
        vio, is_tracked = _read_pose(vio_from_cam, tracking_ok)
        nobody = torch.zeros(1) > 0
        frame = FrameInput(
            timestamp_s, vio, nobody, vio, is_tracked, tracking_reset > 0.5,
            torch.ones(1), torch.ones(1),
        )  # fmt: skip
        fusion = self.fusion
        running = Session(fusion.method, fusion.numbers(params))
        return fusion.name_outputs(*session.carry(running, fusion.unpack(state), frame))


def with_room(params: Any) -> Any:
    """The parameters that fix the state's size: room for any N up to the largest."""
    pairs = getattr(params, "run_pairs", None)
    return params if pairs is None else replace(params, run_pairs=max(pairs, MAX_RUN_PAIRS))


def _read_pose(flat: Tensor, flag: Tensor) -> tuple[Rigid3, Tensor]:
    """A pose of shape (1,), and whether there is one; if not, it is the identity."""
    squares = flat[3:] * flat[3:]
    norm = torch.sqrt(squares.sum(dim=0, keepdim=True))
    is_there = (flag > 0.5) & _is_below(_FARTHEST_M, flat) & (norm > 0.5)
    identity = torch.tensor([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    pose = torch.where(is_there, flat, identity)
    unit = pose[3:] / torch.where(is_there, norm, torch.ones_like(norm))
    return Rigid3(pose[:3][None], unit[None]), is_there


def _name_eased(eased: Eased) -> dict[str, Tensor]:
    return {
        "display_from_vio": _flat(eased.display_from_vio),
        "display_left_m": cast("Tensor", eased.left_m),
        "display_left_deg": cast("Tensor", eased.left_deg),
        "display_placed_anew": cast("Tensor", eased.is_placed_anew).to(torch.int32),
    }


def _is_below(limit: float, values: Tensor) -> Tensor:
    """Whether all sizes are below a limit, shape (1,); false for NaN."""
    return (torch.abs(values) < limit).all().reshape(1)


def _flat(pose: Rigid3) -> Tensor:
    return torch.cat([pose.translation_m, pose.quat_xyzw], dim=-1).reshape(7)
