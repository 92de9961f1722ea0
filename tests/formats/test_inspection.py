"""Every defect that is put into a clean walk is found, and a clean walk gives no warning."""

import json

import numpy as np
import pytest

from vioapr.errors import AssociationError, FormatError
from vioapr.formats import conventions
from vioapr.formats.base import ReadOptions
from vioapr.formats.inspection import inspect_file
from vioapr.formats.readings import (
    READINGS,
    fit_readings,
    fits_better_inverted,
    up_of,
)
from vioapr.formats.registry import FORMATS
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.schemas.base import to_plain
from vioapr.simulation.handheld import looking
from vioapr.trajectory import Trajectory

BY_NAME = {reading.name: reading for reading in READINGS}
UNDONE_BY = {
    "wxyz": "xyzw",
    "xyzw": "wxyz",
    "positions-y-up": "positions-z-up",
    "positions-z-up": "positions-y-up",
}
"""The reading that puts the defect of another in; all others undo themselves."""


def make_walk(count=600, rate_hz=10.0, seed=3, world_yaw=0.0, phase=0.0):
    """A person on a winding path and stairs, z up, a level camera ahead that sways a little."""
    rng = np.random.default_rng(seed)
    time = np.arange(count) / rate_hz
    yaw = 1.5 * np.sin(0.13 * time + phase) + 0.8 * np.sin(0.31 * time) + 0.05 * time
    speed = 1.2 + 0.2 * np.sin(1.7 * time)
    velocity = np.stack([np.cos(yaw) * speed, np.sin(yaw) * speed, 0.7 * np.sin(0.4 * time)], 1)
    positions = np.cumsum(velocity / rate_hz, axis=0) + rng.normal(scale=1e-4, size=(count, 3))
    pitch, roll = 0.12 * np.sin(1.1 * time), 0.06 * np.sin(2.3 * time)
    quats = looking(yaw, np.outer(pitch, [0.0, 1.0, 0.0]), np.outer(roll, [1.0, 0.0, 0.0]))
    walk = Trajectory.from_arrays(100 + time, positions, quats)
    heading = Rigid3(np.array([7.0, -3, 1]), quaternion.from_rotvec(np.array([0, 0, world_yaw])))
    return walk.with_transforms(heading @ walk.target_from_source)


@pytest.fixture(scope="module")
def walk():
    return make_walk()


@pytest.fixture(scope="module")
def other():
    """The same walk in another world, as a VIO has it."""
    return make_walk(world_yaw=2.0)


def inspect(tmp_path, trajectory, **options):
    path = tmp_path / "walk.tum"
    FORMATS["tum"].write(path, trajectory)
    return inspect_file(path, **options)


def changed(walk, **fields):
    arrays = {
        "timestamp_s": walk.timestamp_s.copy(),
        "position_m": walk.position_m.copy(),
        "quat_xyzw": walk.quat_xyzw.copy(),
    }
    for name, change in fields.items():
        arrays[name] = change(arrays[name])
    return Trajectory.from_arrays(**arrays)


def only_warning(inspection):
    assert len(inspection.warnings) == 1, inspection.warnings
    return inspection.warnings[0]


def test_a_clean_walk(walk, tmp_path):
    inspection = inspect(tmp_path, walk)
    assert inspection.warnings == ()
    assert inspection.candidates[0].name == "tum"
    assert inspection.frames == "world_from_cam"
    assert inspection.duration_s == pytest.approx(59.9)
    assert inspection.rate_hz == pytest.approx(10)
    assert 1.0 < inspection.speed.median_m_s < 1.6
    assert inspection.up.axis == "+z"
    assert inspection.up.off_axis_deg < 5
    assert not inspection.up.is_portrait
    assert inspection.path_length_m == pytest.approx(59.9 * 1.3, rel=0.05)
    low, high = inspection.extent_m[2]
    assert high - low == pytest.approx(2 * 0.7 / 0.4, rel=0.05)


def test_a_clean_walk_against_a_clean_one(walk, other, tmp_path):
    inspection = inspect(tmp_path, walk, against=other)
    assert inspection.warnings == ()
    assert inspection.fits[0].title == "as read"
    assert inspection.fits[0].rotation_deg < 1e-6


def test_portrait(walk):
    quarter = quaternion.from_rotvec(np.array([0, 0, np.pi / 2]))
    up, spread, is_portrait = up_of(quaternion.multiply(walk.quat_xyzw, quarter))
    assert is_portrait
    assert abs(up[2]) > 0.99
    assert spread < 10


def freeze(rows):
    rows[200:260] = rows[200]
    return rows


def test_frozen(walk, tmp_path):
    bad = changed(walk, position_m=freeze, quat_xyzw=freeze)
    warnings = inspect(tmp_path, bad).warnings
    assert warnings[0].startswith("frozen: 59 of 600 poses (10%)")
    assert warnings[1].startswith("jumps: 1 of 599")
    assert len(warnings) == 2


def test_gap(walk, tmp_path):
    bad = walk.at_rows(np.r_[0:300, 330:600])
    assert "gaps: 1 in time, the longest of 3.100 s" in only_warning(inspect(tmp_path, bad))


def test_jump(walk, tmp_path):
    def jump(positions):
        positions[400:] += [0, 5, 0]
        return positions

    assert "jumps: 1 of 599 steps" in only_warning(
        inspect(tmp_path, changed(walk, position_m=jump))
    )


def test_millimetres(walk, tmp_path):
    bad = changed(walk, position_m=lambda positions: positions * 1000)
    assert "scale or clock: the median speed is 1.3" in only_warning(inspect(tmp_path, bad))


def test_kilometres(walk, tmp_path):
    bad = changed(walk, position_m=lambda positions: positions / 1000)
    assert "scale: 95 % of the steps are slower than" in only_warning(inspect(tmp_path, bad))


@pytest.mark.parametrize("order", [[3, 0, 1, 2], [1, 2, 3, 0]])
def test_quaternion_order(order, walk, tmp_path):
    bad = changed(walk, quat_xyzw=lambda quats: quats[:, order])
    assert "rotations: maybe quaternion in the other order" in only_warning(inspect(tmp_path, bad))


def test_opengl_axes(walk, tmp_path):
    bad = walk.with_transforms(conventions.world_from_arcam(walk.target_from_source))
    assert "camera axes: maybe OpenGL's" in only_warning(inspect(tmp_path, bad))


def test_inverted_rotations_alone(walk, tmp_path):
    bad = walk.with_transforms(conventions.centre_and_cam_from_world(walk.target_from_source))
    assert "rotations: maybe rotations inverted" in only_warning(inspect(tmp_path, bad))


def test_time_going_back(walk, tmp_path):
    path = tmp_path / "walk.tum"
    FORMATS["tum"].write(path, walk)
    lines = path.read_text().split("\n")
    lines[100], lines[101] = lines[101], lines[100]
    lines.insert(300, lines[299])
    path.write_text("\n".join(lines))
    with pytest.raises(FormatError, match="walk.tum:102: expected increasing"):
        FORMATS["tum"].read(path, ReadOptions(strict=True))
    warning = only_warning(inspect_file(path))
    assert "time: 2 rows out of order" in warning
    assert "line 102" in warning
    assert "earlier than" in warning
    assert "line 301" in warning
    assert "a duplicate of" in warning


@pytest.mark.slow
@pytest.mark.parametrize("reading", READINGS[1:], ids=lambda reading: reading.title)
def test_every_wrong_reading_is_found_against_another_track(reading, walk, other, tmp_path):
    """Put the defect in (each reading undoes itself, or the next order does), and find it."""
    poses = walk.target_from_source
    if reading.name.endswith("-opengl"):
        poses = conventions.world_from_arcam(poses)
        first = reading.name.removesuffix("-opengl")
        poses = BY_NAME[UNDONE_BY.get(first, first)].change(poses)
    else:
        poses = BY_NAME[UNDONE_BY.get(reading.name, reading.name)].change(poses)
    rng = np.random.default_rng(0)
    noise = Rigid3(
        rng.normal(scale=0.1, size=(len(walk), 3)),
        quaternion.from_rotvec(rng.normal(scale=0.01, size=(len(walk), 3))),
    )
    noisy = Trajectory.from_arrays(
        walk.timestamp_s,
        poses.translation_m + noise.translation_m,
        quaternion.multiply(poses.quat_xyzw, noise.quat_xyzw),
    )
    better = fit_readings(noisy, other).better
    assert better is not None
    assert better.title == reading.title
    warnings = inspect(tmp_path, noisy, against=other).warnings
    told = [w for w in warnings if w.startswith("convention: ")]
    assert len(told) == 1
    assert f"walk.tum fits the other track as {reading.title}" in told[0]
    assert told[0].endswith(f"--reading {reading.name}`")


def test_the_check_of_marvins_quaternions(walk, other):
    assert not fits_better_inverted(walk, other)
    inverted = walk.with_transforms(conventions.centre_and_cam_from_world(walk.target_from_source))
    assert fits_better_inverted(inverted, other)


def test_another_walk_fits_no_reading(walk, tmp_path):
    warnings = inspect(tmp_path, walk, against=make_walk(phase=2.0)).warnings
    assert warnings
    assert all("convention" in warning for warning in warnings)


def test_too_few_common_frames(walk, other):
    with pytest.raises(AssociationError, match="expected more than 8 common frames.*got 5"):
        fit_readings(walk.at_rows(slice(0, 5)), other)


def test_doubt_is_said(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text("a/1.png 10 20 30 0.6 0 0.8 0\n")
    warning = only_warning(inspect_file(path))
    assert "format: only 50% sure of hrapr; it may be marvin (35%)" in warning


def test_one_pose(tmp_path):
    one = Trajectory.from_arrays([0], [[0, 0, 0]], [[0, 0, 0, 1]])
    inspection = inspect(tmp_path, one)
    assert inspection.rate_hz is None
    assert inspection.speed is None
    assert inspection.duration_s == 0


def test_times_that_hardly_differ(walk, tmp_path):
    times = np.arange(len(walk)) * 5e-324
    bad = Trajectory.from_arrays(times, walk.position_m, walk.quat_xyzw)
    assert any("scale or clock" in warning for warning in inspect(tmp_path, bad).warnings)
    json.dumps(to_plain(inspect(tmp_path, bad)), allow_nan=False)


def test_json_has_no_nan(walk, other, tmp_path):
    still = changed(walk, position_m=lambda positions: positions * 0)
    inspection = inspect(tmp_path, still, against=other)
    text = json.dumps(to_plain(inspection), allow_nan=False)
    assert json.loads(text)["fits"][0]["direction_deg"] is None


@pytest.mark.slow
def test_real_tracks_give_no_false_alarm(data_dir):
    """Axes, order and direction of all prepared tracks are as they should be."""
    files = sorted((data_dir / "bench").glob("*/*/gt.tum"))
    assert files
    for file in [*files, *sorted((data_dir / "bench").glob("*/*/vio_*.tum"))]:
        warnings = inspect_file(file).warnings
        wrong = [w for w in warnings if w.startswith(("camera", "rotations", "scale"))]
        assert wrong == [], file


@pytest.mark.slow
def test_real_regressors_fit_the_odometry_as_they_are(data_dir):
    for walk_dir in sorted((data_dir / "bench").glob("*/*/")):
        vio = sorted(walk_dir.glob("vio_[sa]*.tum"))
        if vio:
            reference = FORMATS["tum"].read(vio[0], ReadOptions())
            for file in sorted(walk_dir.glob("apr_*.tum")):
                inspection = inspect_file(file, against=reference)
                kinds = ("convention", "device", "clock", "scale", "same", "no-fit")
                assert not any(w.startswith(kinds) for w in inspection.warnings), file


def test_the_axes_of_real_arkit_tracks_are_noticed(data_dir):
    file = data_dir / "advio/tum10hz/advio-18_arkit.tum.gz"
    reference = FORMATS["tum"].read(data_dir / "bench/ADVIO/advio_18/vio_arkit.tum", ReadOptions())
    inspection = inspect_file(file, against=reference)
    assert inspection.fits[0].title.startswith("OpenGL camera axes")
    assert {warning.split(":")[0] for warning in inspection.warnings} == {
        "camera axes",
        "convention",
    }
