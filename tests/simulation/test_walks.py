import numpy as np
import pytest

from vioapr.errors import ParameterError
from vioapr.evaluation.metrics import pose_errors, relative_errors
from vioapr.geometry.frames import z_up_from_y_up
from vioapr.geometry.umeyama import align_umeyama
from vioapr.simulation.walks import WalkParams, simulate_walk


@pytest.fixture(scope="module")
def walk():
    return simulate_walk(WalkParams(duration_s=600), seed=5)


def test_the_seed_decides(walk):
    again = simulate_walk(WalkParams(duration_s=600), seed=5)
    np.testing.assert_array_equal(walk.apr.position_m, again.apr.position_m)
    other = simulate_walk(WalkParams(duration_s=600), seed=6)
    assert not np.array_equal(walk.apr.position_m, other.apr.position_m)


def test_it_is_walked_by_a_person(walk):
    speed = np.linalg.norm(np.diff(walk.gt.position_m, axis=0), axis=1) * 2
    assert 0.7 < np.median(speed) < 1.6
    assert speed.max() < 4
    extent = np.ptp(walk.gt.position_m, axis=0)
    assert 25 < extent[0] < 45
    assert extent[2] < 0.5


def test_the_camera_is_held_upright(walk):
    down = walk.gt.target_from_source._replace(translation_m=np.zeros((len(walk.gt), 3)))
    up = -down.apply(np.array([0.0, 1.0, 0.0]))
    assert np.median(up[:, 2]) > 0.98
    vio = walk.vio.target_from_source._replace(translation_m=np.zeros((len(walk.gt), 3)))
    assert np.median(-vio.apply(np.array([0.0, 1.0, 0.0]))[:, 1]) > 0.98


def test_vio_drifts_as_a_phone_does(walk):
    gaps = relative_errors(walk.gt.target_from_source, walk.vio.target_from_source)
    assert (gaps.distance_m < 0.1).mean() > 0.9
    assert (gaps.angle_deg < 1).mean() > 0.9
    z_up = z_up_from_y_up(walk.vio.target_from_source)
    aligned = align_umeyama(z_up.translation_m, walk.gt.position_m)
    errors = pose_errors(walk.gt.target_from_source, aligned.apply_to(z_up))
    share = np.sqrt((errors.position_m**2).mean()) / 600
    assert 0.0005 < share < 0.02


def test_the_regressor_is_biased_and_sometimes_lost(walk):
    errors = pose_errors(walk.gt.target_from_source, walk.apr.target_from_source)
    assert 0.6 < np.median(errors.position_m) < 2.0
    assert np.percentile(errors.position_m, 99) > 5
    # A bias of the view: neighbours share most of it.
    offset = walk.apr.position_m - walk.gt.position_m
    usual = errors.position_m < 3
    pairs = usual[1:] & usual[:-1]
    correlation = np.corrcoef(offset[1:, 0][pairs], offset[:-1, 0][pairs])[0, 1]
    assert correlation > 0.5


@pytest.mark.parametrize(
    "kwargs", [{"rate_hz": 0.0}, {"duration_s": float("nan")}, {"duration_s": 0.1}]
)
def test_bad_parameters_are_refused(kwargs):
    with pytest.raises(ParameterError, match="expected"):
        WalkParams(**kwargs)
