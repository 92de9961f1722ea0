"""The parts of method `chain`, each against what can be worked out by hand."""

import numpy as np
import pytest

from vioapr.fusion.chain import columns
from vioapr.fusion.chain.agreement import compare_motion, compare_rolls
from vioapr.fusion.chain.drift import CORRELATED_PART, LOG10_RATES, Samples, weigh_drifts
from vioapr.fusion.chain.hypotheses import Hypotheses, beginning, no_hypotheses
from vioapr.fusion.chain.learning import no_trust_yet
from vioapr.fusion.chain.odometer import new_odometer
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.chain.residuals import residuals_of
from vioapr.fusion.chain.smoothing import Problem, solve
from vioapr.fusion.chain.solver import smooth
from vioapr.fusion.chain.sums import typical_of
from vioapr.fusion.chain.views import negative_half_gaps, view_exponents, view_kernel, view_shares
from vioapr.fusion.chain.window import RECENT, empty_window, new_prediction
from vioapr.fusion.types import FrameInput
from vioapr.geometry import frames, quaternion
from vioapr.geometry.rigid import Rigid3

PARAMS = ChainParams()
IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])
ZERO = np.asarray(0.0)


def column_at(position, quat=IDENTITY):
    return columns.column(Rigid3(np.asarray(position, float), np.asarray(quat, float)))


def window_at(positions, predictions, quats=None, vio_quats=None):
    """Predictions at places, in a tracking world that is the map; the first is newest."""
    count = len(positions)
    turns = np.tile(IDENTITY, (count, 1)) if quats is None else quats
    vio_turns = np.tile(IDENTITY, (count, 1)) if vio_quats is None else vio_quats
    window = empty_window((), count, ZERO)
    all_move = np.ones((1, count)) > 0
    for row in reversed(range(count)):
        prediction = new_prediction(
            column_at(predictions[row], turns[row]),
            column_at(positions[row], vio_turns[row]),
            np.zeros((3, 1)),
        )
        window = window.push(prediction, np.ones((2, 1)), all_move)
    return window


def number(value):
    return np.full((1, 1), float(value))


def shares_of(window):
    return view_shares(window, view_kernel(window, number(1.0)), number(0.0))


def solved(window, params=PARAMS, iterations=6):
    """The leading pose: turn and place, after some steps of reweighting."""
    count = window.is_valid.shape[-1]
    first = beginning(window.rotation[:, :1], window.place_m[:, :1], np.ones((6, 1)))
    last = Hypotheses(np.stack([first, first]), np.zeros((2, 6, count)))
    trust = no_trust_yet(params, (), ZERO)
    world_from_vio, place_m = last.world_from_vio, last.place_m
    for _ in range(iterations):
        matrices = columns.rotation_matrix(world_from_vio)
        residuals = residuals_of(window, world_from_vio, matrices, place_m, last.path)
        gates = np.full((2, 2, 1), 1e6)
        problem = Problem(
            window, residuals, last, trust, np.zeros((3, count)), np.ones((1, count)),
            np.full((3, 1), 1e-9), gates,
        )  # fmt: skip
        solution = solve(params, problem)
        newest = solution.path[..., :1]
        world_from_vio = columns.turned(world_from_vio, newest[..., :3, :])
        place_m = place_m + newest[..., 3:, :]
        rows = last.rows.copy()
        rows[:, :4], rows[:, 4:7], rows[:, 13:14] = world_from_vio, place_m, solution.depth_m
        last = Hypotheses(rows, solution.path - newest)
        trust = trust._replace(scatter=np.sqrt(solution.scatter2))
    return world_from_vio[0, :, 0], place_m[0, :, 0]


def test_columns_agree_with_quaternions_and_frames(rng):
    quats = quaternion.normalize(rng.standard_normal((2, 5, 4)))
    left, right = (Rigid3(rng.standard_normal((5, 3)), q) for q in quats)
    turned = columns.z_up_column(left)
    np.testing.assert_allclose(turned[..., 0], np.concatenate(frames.z_up_from_y_up(left), -1))
    a, b = (pose.quat_xyzw[..., None] for pose in (left, right))
    np.testing.assert_allclose(columns.product(a, b)[..., 0], quaternion.multiply(*quats))
    np.testing.assert_allclose(columns.rotation_matrix(a), quaternion.to_matrix(quats[0]))
    quarter = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    y_up = columns.y_up_turn(a)[..., 0]
    np.testing.assert_allclose(y_up, quaternion.multiply(quats[0], quarter))
    compared = columns.compare(columns.column(left), columns.column(right))[..., 0]
    expected = quaternion.multiply(quats[0], quaternion.inverse(quats[1]))
    np.testing.assert_allclose(compared[:, :4], expected, atol=1e-12)
    for start, quat in ((4, quats[0]), (7, quats[1])):
        forward = quaternion.rotate(quat, np.array([0.0, 0.0, 1.0]))
        np.testing.assert_allclose(compared[:, start : start + 3], forward, atol=1e-12)


def test_turns_of_columns_side_by_side(rng):
    quats = quaternion.normalize(rng.standard_normal((6, 4)))
    origin = quaternion.normalize(rng.standard_normal(4))
    relative = quaternion.multiply(quats, quaternion.inverse(origin))
    vectors = 2 * relative[:, :3] * np.where(relative[:, 3:] < 0, -1, 1)
    turns = columns.turns_from(quats.T, origin[:, None])
    np.testing.assert_allclose(turns.T, vectors, atol=1e-12)
    moved = columns.since(quats.T, origin[:, None]).T
    expected = quaternion.multiply(quaternion.inverse(origin), quats)
    np.testing.assert_allclose(moved, expected, atol=1e-12)
    small = np.array([[0.1], [0.3], [-0.2]])
    back = columns.turns_from(columns.turned(origin[:, None], small), origin[:, None])
    np.testing.assert_allclose(back, small, atol=1e-12)
    half_turn = np.array([[0.0], [0.0], [1.0], [0.0]])  # its real part is exactly 0
    assert np.linalg.norm(columns.turns_from(half_turn, IDENTITY[:, None])) == 2
    a, b = rng.standard_normal((2, 3, 5))
    np.testing.assert_allclose(columns.cross(a, b).T, np.cross(a.T, b.T))


def test_views_far_apart_have_a_share_each_and_equal_views_share_one():
    window = window_at([[0, 0, 0], [0, 0, 0], [0, 0, 0], [50, 0, 0]], np.zeros((4, 3)))
    np.testing.assert_allclose(shares_of(window), [[1 / 3, 1 / 3, 1 / 3, 1]], atol=1e-12)


def test_a_prediction_that_is_not_there_has_no_share():
    window = window_at(np.zeros((3, 3)), np.zeros((3, 3)))
    window = window._replace(is_valid=np.array([[1.0, 1, 0]]))
    np.testing.assert_allclose(shares_of(window), [[0.5, 0.5, 0]])


def test_gaps_between_views_in_metres_and_along_the_unit_sphere():
    places = np.array([[0.0, 3.0], [0.0, 4.0], [0.0, 0.0]])
    gazes = np.array([[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]])  # a quarter turn: chord^2 is 2
    exponents = view_exponents(places, gazes, number(5.0), 2.0)
    np.testing.assert_allclose(-2 * exponents, [[0, 1.5], [1.5, 0]], atol=1e-12)


def test_gaps_of_points(rng):
    points = rng.standard_normal((3, 5))
    gaps = ((points[:, :, None] - points[:, None]) ** 2).sum(axis=0)
    np.testing.assert_allclose(negative_half_gaps(points), -gaps / 2, atol=1e-12)


def test_pairs_in_single_precision_keep_their_digits():
    # Graphs on phones compute so.
    rng = np.random.default_rng(0)
    points = (np.array([[60.0], [20.0], [1.0]]) + 0.02 * rng.normal(size=(3, 28))).astype("f4")
    exact = negative_half_gaps(points.astype(float))
    assert negative_half_gaps(points).dtype == np.float32
    np.testing.assert_allclose(negative_half_gaps(points), exact, rtol=1e-5)


def test_the_median_is_of_the_values_that_count():
    counts = np.array([[1.0, 0, 1, 1, 1, 0], [1.0, 1, 1, 1, 1, 1]])
    values = np.array([[5.0, -100, 1, 9, 3, 100]] * 2)
    typical = typical_of(counts)
    np.testing.assert_array_equal(typical.median(values), [[3], [3]])  # the lower one of four
    np.testing.assert_array_equal(typical.is_few, [[True], [False]])


def dense_smoothing(values, weights, stiffness):
    """The same least squares, by general linear algebra."""
    count = values.shape[-1]
    matrix = np.diag(weights)
    for k in range(count - 1):
        step = np.zeros(count)
        step[k], step[k + 1] = 1, -1
        matrix += stiffness[k] * np.outer(step, step)
    return np.linalg.solve(matrix, weights * values), 1 / np.diag(np.linalg.inv(matrix))


@pytest.mark.parametrize("count", [1, 2, 7, 28])
def test_the_solver_is_exact(rng, count):
    values, weights, stiffness = rng.random((3, 2, 3, count)) + 0.1
    weights[0, 0, : count // 2] = 0
    stiffness[..., -1] = 0
    found, precision = smooth(values, weights, stiffness)
    for index in np.ndindex(2, 3):
        expected = dense_smoothing(values[index], weights[index], stiffness[index])
        np.testing.assert_allclose(found[index], expected[0], rtol=1e-9)
        np.testing.assert_allclose(precision[index], expected[1], rtol=1e-9)


def test_the_solver_keeps_its_digits_in_single_precision_however_stiff(rng):
    values, weights = rng.random((2, 1, 28)) + 0.5
    stiffness = 10.0 ** rng.uniform(-3, 6, (1, 28))
    stiffness[..., -1] = 0
    exact, precision = smooth(values, weights, stiffness)
    single = smooth(*(part.astype("f4") for part in (values, weights, stiffness)))
    assert single[0].dtype == np.float32
    np.testing.assert_allclose(single[0], exact, rtol=2e-6)
    np.testing.assert_allclose(single[1], precision, rtol=2e-6)


def test_a_walk_without_predictions_that_count_is_zero():
    nothing = np.zeros((1, 5))
    found, precision = smooth(nothing + 3, nothing, nothing + 1)
    np.testing.assert_array_equal(found, nothing)
    assert (precision < 1e-20).all()


def test_the_position_is_where_most_predictions_agree():
    positions = np.array([[-1.0 * x, 0.0, 0.0] for x in range(12)])
    predictions = positions + np.array([1.0, 2.0, 3.0])
    predictions[3:6] += [40.0, 0.0, 0.0]
    turn, place = solved(window_at(positions, predictions))
    np.testing.assert_allclose(place, [1, 2, 3], atol=1e-2)
    np.testing.assert_allclose(np.abs(turn), IDENTITY, atol=1e-6)


def test_the_rotation_is_where_most_predictions_agree():
    turns = quaternion.from_rotvec(np.array([[0, 0, 0.2]] * 9 + [[0, 0, -1.0]] * 3))
    positions = np.array([[-1.0 * x, 0.0, 0.0] for x in range(12)])
    turn, _ = solved(window_at(positions, positions, turns))
    np.testing.assert_allclose(quaternion.to_rotvec(turn), [0, 0, 0.2], atol=5e-3)
    np.testing.assert_allclose(turn @ turn, 1, atol=1e-12)


def test_regressors_that_err_about_what_they_look_at_are_corrected(rng):
    """Errors that keep a point 4 m ahead in place: the pivot's depth is found, and the truth."""
    turns = quaternion.from_rotvec(rng.normal(0, 0.05, (20, 3)) * [1, 1, 0])
    ahead = np.array([0.0, 0.0, 4.0])
    positions = np.array([[-3.0 * x, 0.0, 0.0] for x in range(20)])
    predictions = positions + ahead - quaternion.rotate(turns, ahead)
    window = window_at(positions, predictions, turns)
    errors = [
        np.abs(solved(window, ChainParams(look_at=look_at))[1]).max() for look_at in (True, False)
    ]
    assert errors[0] < 0.5 * errors[1]


def samples_of(values, exponents, ages, is_valid=None):
    count = values.shape[-1]
    nothing = np.zeros((1, count))
    valid = nothing + 1 if is_valid is None else is_valid
    return Samples(values, valid, exponents, ages, nothing, nothing)


@pytest.mark.parametrize("true_index", [1, 3])
def test_the_drift_that_the_samples_have_is_found(rng, true_index):
    age = np.arange(40.0)[None]
    rate = CORRELATED_PART * 10.0 ** LOG10_RATES[true_index]
    exponents = -0.5 * (100 * (age.T - age)) ** 2
    scores = 0
    for _ in range(20):
        drift = np.cumsum(rng.standard_normal((6, 40)) * np.sqrt(rate), axis=-1)
        values = 0.3 * (drift + rng.standard_normal((6, 40)))
        evidence = weigh_drifts(samples_of(values, exponents, age), np.full((3, 1), 0.3))
        scores = scores + evidence.log_likelihood
        variance = evidence.variance[:, true_index]
        assert ((np.sqrt(variance) > 0.1) & (np.sqrt(variance) < 0.6)).all()
    assert (np.abs(np.argmax(scores, axis=-1) - true_index) <= 1).all()


def test_samples_that_are_not_there_change_nothing(rng):
    values, age = rng.standard_normal((6, 12)), np.arange(12.0)[None]
    exponents = -0.5 * (age.T - age) ** 2

    def score(count, total):
        valid = (np.arange(total) < count).astype(float)[None]
        part = samples_of(values[:, :total], exponents[:total, :total], age[:, :total], valid)
        return weigh_drifts(part, np.ones((3, 1)))

    for full, short in zip(score(8, 12), score(8, 8), strict=True):
        np.testing.assert_allclose(full, short, atol=1e-9)


def push_at(window, pose, moves):
    return window.push(new_prediction(pose, pose, np.zeros((3, 1))), np.ones((2, 1)), moves)


def test_the_newest_predictions_stay_and_older_ones_only_if_asked():
    window = empty_window((), 6, ZERO)
    for count in range(8):
        moves = (np.arange(6) < RECENT)[None] | (count % 2 == 0)
        window = push_at(window, column_at([count, 0.0, 0.0]), moves)
    np.testing.assert_array_equal(window.vio_place_m[0, :RECENT], [7, 6, 5])
    # When 4 and 6 came, the oldest of the recent ones were 1 and 3.
    np.testing.assert_array_equal(window.place_m[0, RECENT : RECENT + 2], [3, 1])


def test_a_view_is_new_if_the_camera_moved_or_turned_but_not_if_it_rolled():
    def is_novel(position, rotvec):
        """Of the third newest prediction, beside the one before."""
        poses = [column_at([0, 0, 0])] * 6
        poses[2] = column_at(position, quaternion.from_rotvec(np.asarray(rotvec, float)))
        window = empty_window((), 6, ZERO)
        for pose in reversed(poses):
            window = push_at(window, pose, np.ones((1, 6)) > 0)
        moves = window.moving(number(1.0), 0.26, 0.8, 100.0)
        assert moves[0, :RECENT].all()
        return moves[0, -1].item()

    assert is_novel([0.9, 0, 0], [0, 0, 0])
    assert is_novel([0, 0, 0], [0, 0.3, 0])
    assert not is_novel([0, 0, 0], [0, 0, 0.3])
    assert not is_novel([0.5, 0, 0], [0, 0, 0])


@pytest.mark.parametrize("roll", range(4))
def test_a_camera_that_is_turned_about_its_axis_is_told_by_its_turns(rng, roll):
    vio = quaternion.from_rotvec(rng.normal(0, 0.4, (10, 3)))
    turn = quaternion.from_rotvec(np.array([0.0, 0.0, np.pi / 2 * roll]))
    apr = quaternion.multiply(vio, turn)
    rolls = compare_rolls(window_at(np.zeros((10, 3)), np.zeros((10, 3)), apr, vio))[:, 0]
    assert np.argmax(rolls) == roll
    np.testing.assert_allclose(rolls[roll], rolls.max())
    assert np.sort(rolls)[-2] < 0.7 * rolls[roll]


@pytest.mark.parametrize("share", [0.0, 0.33, 1.0])
def test_motion_at_a_fraction_of_its_size_is_told(share):
    positions = np.array([[-2.0 * x, 0.0, 0.0] for x in range(12)])
    window = window_at(positions, share * positions)
    both = no_hypotheses((), 12, ZERO)
    ways = np.stack([positions[:1].T - positions.T] * 2)
    slope, lessons = compare_motion(both, window, ways, number(0.1), np.ones((1, 1, 1)))
    # One lesson, beside the one that it begins with.
    np.testing.assert_allclose(slope[0, 0, 0], 0.5 + share / 2)
    assert lessons[0, 0, 0] == 1


def follow(*steps, seconds=0.5):
    """A tracker that starts at the identity and makes steps, in m along x and rad about y."""
    odometer = new_odometer((), ZERO)
    place, turn = 0.0, 0.0
    yes, no = np.asarray(True), np.asarray(False)
    for index, (distance, angle) in enumerate([(0.0, 0.0), *steps]):
        place, turn = place + distance, turn + angle
        quat = quaternion.from_rotvec(np.array([0.0, turn, 0.0]))
        vio = Rigid3(np.array([place, 0.0, 0.0]), quat)
        frame = FrameInput(np.asarray(index * seconds), vio, yes, vio, yes, no)
        odometer = odometer.follow(frame, columns.column(vio))
    return odometer


def test_a_step_that_nobody_makes_is_a_jump():
    moved, jumps_rad2, jumps_m2 = follow((1.0, 0.0)).readings[:, 0]
    np.testing.assert_allclose(moved, 1 + 0.01 * 0.5)
    assert jumps_rad2 == jumps_m2 == 0
    _, jumps_rad2, jumps_m2 = follow((5.0, 0.1)).readings[:, 0]
    np.testing.assert_allclose([jumps_m2, jumps_rad2], [25, 0.01])


def test_the_odometer_counts_turns_and_takes_the_shorter_way_round():
    np.testing.assert_allclose(follow((0.0, 0.4)).readings[0], 0.3 * 0.4 + 0.01 * 0.5)
    nearly_round = follow((0.0, 2.5), (0.0, 2.5), seconds=1.0)  # quaternions change their sign
    np.testing.assert_allclose(nearly_round.readings[0], 2 * (0.3 * 2.5 + 0.01), rtol=1e-6)


def test_a_pause_counts_by_its_length():
    np.testing.assert_allclose(follow((1.0, 0.0), seconds=10.0).readings[0], 1 + 1.01 * 10)


def test_the_usual_speed_follows_slowly_and_not_at_all_without_time():
    np.testing.assert_allclose(follow((1.0, 0.0)).speed_m_s, 0.9 * 1 + 0.1 * 2)
    np.testing.assert_allclose(follow().speed_m_s, 1.0)
