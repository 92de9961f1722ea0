"""A constant transform is found again from motions, with noise, outliers and little excitation."""

import numpy as np
import pytest

from vioapr.geometry import hand_eye, quaternion, rigid
from vioapr.geometry.rigid import Rigid3

BODY_FROM_CAM = Rigid3(
    np.array([-0.02, -0.06, 0.01]), quaternion.from_rotvec(np.array([0.4, -1.2, 0.8]))
)


def motions(rng, count=200, axes=(1.0, 1.0, 1.0)):
    """Relative poses of a camera, about some axes, and of the body it is fixed to."""
    rotvec = rng.normal(scale=0.6, size=(count, 3)) * axes
    cam = Rigid3(rng.normal(scale=2.0, size=(count, 3)), quaternion.from_rotvec(rotvec))
    return cam, BODY_FROM_CAM @ cam @ BODY_FROM_CAM.inverse()


def fit(body, cam):
    sets = (
        hand_eye.rotation_vectors(body.quat_xyzw, cam.quat_xyzw),
        hand_eye.unit_directions(body.translation_m, cam.translation_m),
    )
    return hand_eye.fit_rotation(sets, 1.0)


def error_deg(fitted):
    return float(quaternion.angle_between_deg(fitted.left_from_right_xyzw, BODY_FROM_CAM.quat_xyzw))


def test_motions_without_noise_give_rotation_and_lever_arm(rng):
    cam, body = motions(rng)
    rotation = hand_eye.fit_rotation(
        (hand_eye.rotation_vectors(body.quat_xyzw, cam.quat_xyzw),), 1.0
    )
    assert error_deg(rotation) < 1e-6
    arm = hand_eye.fit_lever_arm(body, cam, rotation.left_from_right_xyzw, 1.0)
    np.testing.assert_allclose(arm.position_m, BODY_FROM_CAM.translation_m, atol=1e-5)
    assert arm.sigma_m.max() < 1e-3


def test_outliers_and_noise(rng):
    cam, body = motions(rng, 400)
    noise = quaternion.from_rotvec(rng.normal(scale=0.05, size=(400, 3)))
    is_wrong = rng.random(400) < 0.2
    noise[is_wrong] = quaternion.from_rotvec(rng.normal(scale=1.0, size=(int(is_wrong.sum()), 3)))
    noisy = cam._replace(quat_xyzw=quaternion.multiply(cam.quat_xyzw, noise))
    fitted = fit(body, noisy)
    sigma_deg = np.rad2deg(fitted.sigma_rad)
    assert error_deg(fitted) < 4 * sigma_deg
    assert sigma_deg < 1.0


def test_the_stated_deviation_is_that_of_many_draws():
    errors, sigmas = [], []
    for seed in range(40):
        draw = np.random.default_rng(seed)
        cam, body = motions(draw, 100)
        noise = quaternion.from_rotvec(draw.normal(scale=0.08, size=(100, 3)))
        fitted = fit(body, cam._replace(quat_xyzw=quaternion.multiply(cam.quat_xyzw, noise)))
        turn = quaternion.multiply(
            quaternion.inverse(BODY_FROM_CAM.quat_xyzw), fitted.left_from_right_xyzw
        )
        errors.append(quaternion.to_rotvec(turn))
        sigmas.append(fitted.sigma_rad)
    actual = float(np.sqrt(np.mean(np.square(errors))))
    assert 0.5 * actual < np.median(sigmas) < 2.5 * actual


def test_turns_about_one_axis_leave_the_arm_along_it_unknown(rng):
    cam, body = motions(rng, axes=(0.0, 1.0, 0.0))
    cam = cam._replace(translation_m=cam.translation_m + rng.normal(scale=0.05, size=(200, 3)))
    fitted = fit(body, cam)
    assert error_deg(fitted) < 2.0  # directions of motion tell the rest of the rotation
    arm = hand_eye.fit_lever_arm(body, cam, BODY_FROM_CAM.quat_xyzw, 1.0)
    axis = quaternion.rotate(BODY_FROM_CAM.quat_xyzw, np.array([0.0, 1.0, 0.0]))
    along = abs(float(arm.position_m @ axis))
    assert along < 1e-3  # drawn to zero
    assert arm.sigma_m.max() > hand_eye.ARM_PRIOR_M / 2


def test_no_motion_determines_nothing():
    still = Rigid3.identity((20,))
    fitted = fit(still, still)
    assert fitted.sigma_rad == np.inf


@pytest.mark.parametrize("angle", [np.pi - 1e-3, np.pi])
def test_half_turns_do_not_mislead(rng, angle):
    cam, _ = motions(rng)
    half = quaternion.from_rotvec(np.array([angle, 0.0, 0.0]))
    quats = cam.quat_xyzw.copy()
    quats[::10] = half
    cam = cam._replace(quat_xyzw=quats)
    body = BODY_FROM_CAM @ cam @ BODY_FROM_CAM.inverse()
    assert error_deg(fit(body, cam)) < 1e-5


def test_the_fit_explains_the_motion(rng):
    cam, body = motions(rng)
    fitted = fit(body, cam)
    x = Rigid3(np.zeros(3), fitted.left_from_right_xyzw)
    assert rigid.angle_deg(x.inverse() @ body @ x, cam).max() < 1e-4
