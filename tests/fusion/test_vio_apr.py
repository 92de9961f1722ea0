import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.fusion_oracle import KEYFRAME, OPTIMIZED, TRACKED, UNLOCALIZED, Oracle
from tests.helpers import convert_frames, frames_of, to_numpy

from vioapr.errors import ParameterError
from vioapr.fusion import vio_apr
from vioapr.fusion.offline import run_steps
from vioapr.fusion.types import FrameInput
from vioapr.fusion.vio_apr import VioAprParams
from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.regressors import NO_REGRESSOR_ERRORS
from vioapr.simulation.trackers import NO_TRACKER_ERRORS
from vioapr.simulation.walks import WalkParams, simulate_walk

WALKS, FRAMES = 1000, 60
EXACT = WalkParams(tracker=NO_TRACKER_ERRORS, regressor=NO_REGRESSOR_ERRORS)


def random_frames(rng, walks, count):
    """Random walks whose predictions pass and fail the checker about equally often."""
    steps = rng.normal(0, 0.5, (count, walks, 3)).cumsum(axis=0)
    turns = Rotation.from_rotvec(rng.normal(0, 0.5, (count * walks, 3)))
    tilt = Rotation.random(random_state=3)
    far = rng.normal(0, 30, (1, walks, 3))
    vio = Rigid3(tilt.apply(steps.reshape(-1, 3)), (tilt * turns).as_quat())
    noise_m = rng.standard_t(2, (count, walks, 3)) * rng.choice([0.02, 0.15, 0.4], (1, walks, 1))
    noise = Rotation.from_rotvec(
        np.deg2rad(rng.standard_t(2, (count * walks, 3)) * rng.choice([0.3, 1.5]))
    )
    apr = Rigid3((steps + far + noise_m).reshape(-1, 3), (turns * noise).as_quat())
    shape = (count, walks)
    return FrameInput(
        np.broadcast_to(np.arange(count, dtype=float)[:, None], shape).copy(),
        *(Rigid3(apr.translation_m.reshape(*shape, 3), apr.quat_xyzw.reshape(*shape, 4)),),
        rng.random(shape) < 0.9,
        *(Rigid3(vio.translation_m.reshape(*shape, 3), vio.quat_xyzw.reshape(*shape, 4)),),
        rng.random(shape) < 0.98,
        rng.random(shape) < 0.02,
    )


def run_oracle(frames, walk, params):
    oracle = Oracle(
        params.distance_threshold_m,
        params.angle_threshold_deg,
        params.run_pairs,
        params.optimized_frames,
    )
    rotations = [Rotation.from_quat(p.quat_xyzw[:, walk]) for p in (frames[1], frames[3])]
    out = []
    for k in range(len(frames.timestamp_s)):
        apr = (frames.apr_world_from_cam.translation_m[k, walk], rotations[0][k])
        vio = (frames.vio_from_cam.translation_m[k, walk], rotations[1][k])
        out.append(
            oracle.update(
                apr if frames.has_apr[k, walk] else None,
                vio if frames.tracking_ok[k, walk] else None,
                frames.tracking_reset[k, walk],
            )
        )
    return out


def run_oracles(frames, params, walks):
    return [run_oracle(frames, walk, params) for walk in walks]


def assert_equals_oracle(estimates, frames, params, walks):
    assert_equals(estimates, run_oracles(frames, params, walks))


def assert_equals(estimates, expected_of_walks):
    statuses = to_numpy(estimates.status)
    confirmed = to_numpy(estimates.confirmed_run)
    position, quat = (to_numpy(part) for part in estimates.world_from_cam)
    for walk, expected in enumerate(expected_of_walks):
        assert statuses[:, walk].tolist() == [status for status, *_ in expected]
        assert confirmed[:, walk].tolist() == [count for *_, count in expected]
        is_known = statuses[:, walk] != UNLOCALIZED
        assert np.isnan(position[~is_known, walk]).all()
        assert np.isnan(quat[~is_known, walk]).all()
        if not is_known.any():
            continue
        known = [e for e, k in zip(expected, is_known, strict=True) if k]
        np.testing.assert_allclose(position[is_known, walk], [e[1] for e in known], atol=1e-9)
        rotations = Rotation.concatenate([e[2] for e in known])
        gap = Rotation.from_quat(quat[is_known, walk]) * rotations.inv()
        assert gap.magnitude().max() < 1e-9


@pytest.fixture(scope="module")
def thousand_walks():
    """Frames, and what the oracle says of them, for every backend."""
    frames = random_frames(np.random.default_rng(11), WALKS, FRAMES)
    return frames, run_oracles(frames, VioAprParams(), range(WALKS))


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["numpy", "torch"])
def test_equals_the_oracle_on_a_thousand_walks(backend, thousand_walks):
    xp = pytest.importorskip({"torch": "array_api_compat.torch"}.get(backend, backend))
    params = VioAprParams()
    frames, expected = thousand_walks
    estimates = run_steps(vio_apr.METHOD, params, convert_frames(frames, xp))
    statuses = to_numpy(estimates.status)
    for status in (UNLOCALIZED, TRACKED, KEYFRAME, OPTIMIZED):
        assert (statuses == status).mean() > 0.02, "the walks must exercise every status"
    assert len(expected) == WALKS
    assert_equals(estimates, expected)


@pytest.mark.slow
@pytest.mark.parametrize("batch", [(), (1,), (3, 4)])
@pytest.mark.parametrize("backend", ["numpy", "torch", "array_api_strict"])
def test_batch_shapes(backend, batch):
    xp = pytest.importorskip({"torch": "array_api_compat.torch"}.get(backend, backend))
    params = VioAprParams()
    walks = int(np.prod(batch))
    frames = random_frames(np.random.default_rng(5), walks, FRAMES)

    def reshape(array):
        return array.reshape(FRAMES, *batch, *array.shape[2:])

    shaped = FrameInput(
        *(Rigid3(*map(reshape, v)) if isinstance(v, Rigid3) else reshape(v) for v in frames[:6])
    )
    estimates = run_steps(vio_apr.METHOD, params, convert_frames(shaped, xp))
    assert tuple(estimates.status.shape) == (FRAMES, *batch)
    flat = estimates._replace(
        status=to_numpy(estimates.status).reshape(FRAMES, walks),
        confirmed_run=to_numpy(estimates.confirmed_run).reshape(FRAMES, walks),
        world_from_cam=Rigid3(
            *(
                to_numpy(part).reshape(FRAMES, walks, part.shape[-1])
                for part in estimates.world_from_cam
            )
        ),
    )
    assert_equals_oracle(flat, frames, params, range(walks))


@pytest.mark.slow
@pytest.mark.parametrize(
    "params",
    [
        VioAprParams(0.1, 1.0, 1, 1),
        VioAprParams(0.8, 10.0, 4, 3),
        VioAprParams(2.0, 20.0, 3, 20),
    ],
)
def test_other_parameters(params):
    frames = random_frames(np.random.default_rng(2), 30, FRAMES)
    estimates = run_steps(vio_apr.METHOD, params, frames)
    assert_equals_oracle(estimates, frames, params, range(30))


def test_parameters_may_differ_within_a_batch():
    class PerWalk:
        distance_threshold_m = np.array([0.1, 0.8])
        angle_threshold_deg = np.array([1.0, 10.0])
        run_pairs = np.array([2, 3])
        optimized_frames = np.array([8, 5])

    frames = random_frames(np.random.default_rng(4), 2, FRAMES)
    state = vio_apr.init(VioAprParams(run_pairs=3), (2,), frames.timestamp_s)
    for k in range(FRAMES):
        state, estimate = vio_apr.step(PerWalk, state, frames.at(k))
    for walk, one in enumerate([VioAprParams(0.1, 1.0, 2, 8), VioAprParams(0.8, 10.0, 3, 5)]):
        alone = run_steps(vio_apr.METHOD, one, frames.at((slice(None), walk)))
        assert alone.status[-1] == estimate.status[walk]


def test_exact_inputs_give_exact_poses():
    walk = simulate_walk(EXACT)
    estimates = run_steps(vio_apr.METHOD, VioAprParams(), frames_of(walk))
    assert estimates.status[:2].tolist() == [UNLOCALIZED, UNLOCALIZED]
    assert estimates.status[2] == KEYFRAME
    known = estimates.status > 0
    gt = walk.gt.target_from_source.at(known)
    assert rigid.distance_m(gt, estimates.world_from_cam.at(known)).max() < 1e-9
    assert rigid.angle_deg(gt, estimates.world_from_cam.at(known)).max() < 1e-9


def test_the_papers_reading_of_algorithm_1():
    """Exact poses, one prediction replaced by a wild one: the pose must come out exact."""
    walk = simulate_walk(EXACT)
    frames = frames_of(walk)
    frames.apr_world_from_cam.translation_m.flags.writeable = True
    frames.apr_world_from_cam.translation_m[6] += 50.0
    estimates = run_steps(vio_apr.METHOD, VioAprParams(), frames)
    assert estimates.status[6] == OPTIMIZED
    gt = walk.gt.target_from_source
    assert rigid.distance_m(gt, estimates.world_from_cam)[6] < 1e-9
    placed = estimates.world_from_vio.at(6) @ frames.vio_from_cam.at(6)
    assert rigid.distance_m(gt.at(6), placed) < 1e-9


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        (
            {"distance_threshold_m": -0.1},
            "distance_threshold_m: expected a number of at least 0, got -0.1",
        ),
        ({"angle_threshold_deg": float("nan")}, "angle_threshold_deg: .* got nan"),
        ({"distance_threshold_m": float("inf")}, "distance_threshold_m: .* got inf"),
        ({"run_pairs": 0}, "^run_pairs: expected a whole number of at least 1, got 0"),
        ({"run_pairs": 1.5}, "^run_pairs: .* got 1.5"),
        ({"optimized_frames": 0}, "^optimized_frames: .* got 0"),
    ],
)
def test_bad_parameters_are_refused(kwargs, message):
    with pytest.raises(ParameterError, match=message):
        VioAprParams(**kwargs)
