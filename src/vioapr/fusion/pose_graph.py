"""Baseline: incremental smoothing of a pose graph by GTSAM's iSAM2 (Kaess et al. 2012).

Every tracked frame is a variable. VIO ties neighbours together by a between factor; the
regressor's prediction is a prior on its frame, with a Cauchy kernel because its errors have
heavy tails. The graph grows with the walk, and so does its memory: the estimate of a frame is
the newest pose after the graph has taken it in, and is not corrected afterwards.

A lost or reset tracker starts a new graph: nothing ties the two parts together, so one graph
would give the same poses and keep the old part for nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import tyro

from vioapr.errors import MissingExtraError, ParameterError
from vioapr.fusion.types import Estimate, FrameInput, Method, Status
from vioapr.geometry.arrays import Array
from vioapr.geometry.rigid import Rigid3

_EXTRA = "pose-graph"


@dataclass(frozen=True)
class PoseGraphParams:
    """How much the graph trusts the regressor and VIO."""

    prior_sigma_m: Annotated[float, tyro.conf.arg(name="pose-graph-prior-sigma-m")] = 1.0
    """Standard deviation of a prediction's position per axis, m: larger trusts VIO for longer."""
    prior_sigma_deg: Annotated[float, tyro.conf.arg(name="pose-graph-prior-sigma-deg")] = 3.0
    """Standard deviation of a prediction's orientation per axis, deg."""
    between_sigma_m: Annotated[float, tyro.conf.arg(name="pose-graph-between-sigma-m")] = 0.03
    """Standard deviation of VIO's motion between two frames per axis, m: larger forgets old
    predictions sooner."""
    between_sigma_deg: Annotated[float, tyro.conf.arg(name="pose-graph-between-sigma-deg")] = 0.2
    """Standard deviation of VIO's turn between two frames per axis, deg."""
    cauchy_k: Annotated[float, tyro.conf.arg(name="pose-graph-cauchy-k")] = 1.0
    """Of the Cauchy kernel, in standard deviations: a prediction this far off weighs half;
    smaller is more robust."""
    updates: Annotated[int, tyro.conf.arg(name="pose-graph-updates")] = 3
    """iSAM2 updates a frame: more come closer to the optimum and take longer."""
    sigmas: Annotated[bool, tyro.conf.arg(name="pose-graph-sigmas")] = True
    """Whether to compute the uncertainty of every estimate, which takes longer."""

    def __post_init__(self) -> None:
        # Method mapnet-pgo has parameters of the same names: messages say whose these are.
        owner = type(self).__name__
        for name in (
            *("prior_sigma_m", "prior_sigma_deg", "between_sigma_m", "between_sigma_deg"),
            "cauchy_k",
        ):
            value = getattr(self, name)
            if not 0 < value < float("inf"):
                raise ParameterError(
                    f"{owner}.{name}: expected a number greater than 0, got {value}"
                )
        if not (self.updates >= 1 and self.updates == int(self.updates)):
            raise ParameterError(
                f"{owner}.updates: expected a whole number of at least 1, got {self.updates}"
            )


@dataclass(eq=False)
class PoseGraphState:
    """The one state that is not a value: iSAM2 changes in place, so a step changes it.

    A state must therefore be stepped along one walk only; start another with `init`.

    Attributes:
        gtsam: The module, imported when the method is first used.
        prior_noise: Of predictions.
        between_noise: Of VIO.
        graph: The iSAM2 session of the present segment, or None before its first prediction.
        count: Frames in the graph; the newest one's key is `count - 1`.
        world_from_cam: gtsam.Pose3, estimate of the newest frame.
        vio_from_cam: gtsam.Pose3, the tracker's pose of the newest frame.
    """

    gtsam: Any
    prior_noise: Any
    between_noise: Any
    graph: Any = None
    count: int = 0
    world_from_cam: Any = None
    vio_from_cam: Any = None

    def extend(self, frame: FrameInput, has_prediction: bool, updates: int) -> None:
        """Add a frame's variable and factors, and solve for the newest pose.

        Args:
            frame: A tracked frame; a segment's first one has a prediction.
            has_prediction: Whether its prediction counts.
            updates: Of iSAM2.
        """
        gtsam, key = self.gtsam, self.count
        factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        vio_from_cam = _to_pose3(gtsam, frame.vio_from_cam)
        prediction = _to_pose3(gtsam, frame.apr_world_from_cam)
        if has_prediction:
            factors.add(gtsam.PriorFactorPose3(key, prediction, self.prior_noise))
        if self.graph is None:
            options = gtsam.ISAM2Params()
            # GTSAM's default, Cholesky, is faster by a third but gives up where VIO is trusted
            # some 1e4 times more than the regressor.
            options.setFactorization("QR")
            self.graph = gtsam.ISAM2(options)
            values.insert(key, prediction)
        else:
            motion = self.vio_from_cam.between(vio_from_cam)
            factors.add(gtsam.BetweenFactorPose3(key - 1, key, motion, self.between_noise))
            values.insert(key, self.world_from_cam.compose(motion))
        self.graph.update(factors, values)
        for _ in range(updates - 1):
            self.graph.update()
        self.count = key + 1
        self.vio_from_cam = vio_from_cam
        self.world_from_cam = self.graph.calculateEstimatePose3(key)

    def newest_sigmas(self) -> tuple[Array, Array]:
        """Standard deviations of the newest pose per axis, m and deg, each of shape ().

        They are of the mean of the three axes' variances. The covariance is in the camera's
        axes, but that mean is the same in any.
        """
        variances = np.diagonal(self.graph.marginalCovariance(self.count - 1))
        rotation_rad, position_m = np.sqrt(variances.reshape(2, 3).mean(axis=1))
        return np.asarray(position_m), np.asarray(np.rad2deg(rotation_rad))


def init(params: PoseGraphParams, batch_shape: tuple[int, ...], like: Array) -> PoseGraphState:
    """The state before the first frame.

    Raises:
        MissingExtraError: GTSAM is not installed.
        ParameterError: The batch shape is not ().
    """
    if batch_shape != ():
        raise ParameterError(f"method pose-graph: expected one walk, got a batch of {batch_shape}")
    try:
        import gtsam
    except ImportError as error:
        raise MissingExtraError("method pose-graph", "gtsam", _EXTRA) from error
    noise = gtsam.noiseModel
    return PoseGraphState(
        gtsam,
        noise.Robust.Create(
            noise.mEstimator.Cauchy.Create(params.cauchy_k),
            _diagonal_noise(noise, params.prior_sigma_m, params.prior_sigma_deg),
        ),
        _diagonal_noise(noise, params.between_sigma_m, params.between_sigma_deg),
    )


def _diagonal_noise(noise: Any, sigma_m: float, sigma_deg: float) -> Any:
    """GTSAM's tangent vectors of poses have rotation (rad) first, then translation (m)."""
    return noise.Diagonal.Sigmas(np.repeat([np.deg2rad(sigma_deg), sigma_m], 3))


def step(
    params: PoseGraphParams, state: PoseGraphState, frame: FrameInput
) -> tuple[PoseGraphState, Estimate]:
    """Add one frame to the graph; changes `state` and returns it."""
    if not frame.keeps_world:
        state.graph, state.count = None, 0
    has_prediction = bool(frame.has_apr and frame.tracking_ok)
    # Before its first prediction a segment could lie anywhere: the system has no solution.
    if not frame.tracking_ok or (state.graph is None and not has_prediction):
        nowhere = Rigid3(np.full(3, np.nan), np.full(4, np.nan))
        sigma = np.asarray(np.nan) if params.sigmas else None
        zero = np.asarray(int(Status.UNLOCALIZED), dtype=np.int32)
        return state, Estimate(nowhere, nowhere, zero, zero, sigma, sigma)
    state.extend(frame, has_prediction, params.updates)
    world_from_vio = state.world_from_cam.compose(state.vio_from_cam.inverse())
    return state, Estimate(
        _to_rigid3(state.world_from_cam),
        _to_rigid3(world_from_vio),
        np.asarray(Status.OPTIMIZED if has_prediction else Status.TRACKED, dtype=np.int32),
        np.asarray(0, dtype=np.int32),
        *(state.newest_sigmas() if params.sigmas else (None, None)),
    )


def _to_pose3(gtsam: Any, pose: Rigid3) -> Any:
    x, y, z, w = pose.quat_xyzw
    return gtsam.Pose3(gtsam.Rot3.Quaternion(w, x, y, z), pose.translation_m)


def _to_rigid3(pose: Any) -> Rigid3:
    quat = pose.rotation().toQuaternion()
    return Rigid3(
        np.asarray(pose.translation(), dtype=np.float64),
        np.array([quat.x(), quat.y(), quat.z(), quat.w()]),
    )


METHOD = Method(
    name="pose-graph",
    summary="pose graph of all frames with robust priors, smoothed by GTSAM's iSAM2",
    params_type=PoseGraphParams,
    init=init,
    step=step,
    is_batched=False,
    extra=_EXTRA,
)
