"""Whatever a writer writes is recognized as its format and read back as it was, without a word."""

import shutil

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from tests.formats.conftest import file_name, names_of

from vioapr.errors import ParameterError
from vioapr.files.text import natural_key
from vioapr.formats.conversion import convert_file
from vioapr.formats.registry import FORMATS, LEAST_CONFIDENCE, format_of_name, read_with_notes
from vioapr.geometry import quaternion, rigid
from vioapr.simulation.handheld import looking
from vioapr.trajectory import Trajectory

WRITTEN = [format_ for format_ in FORMATS.values() if format_.write is not None]
TICK_S = 1e-6
"""The coarsest clock of a format with times."""

NAMES = st.text("abcXYZ019_-/é", min_size=1, max_size=12).map(lambda name: f"i{name}n.png")
# Clocks that run since 1970, since the phone was started, and since the recording began.
STARTS_S = st.sampled_from([1700000000.0, 105230.5, 1500.25, 12.0, 0.0])


@st.composite
def trajectories(draw, format_):
    """Trajectories as people have them: noise, or a walk; timed and named, or neither."""
    count = draw(st.integers(1, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    steps_s = rng.uniform(0.002, draw(st.sampled_from([0.004, 0.1, 3.0, 60.0])), count)
    times = draw(STARTS_S) + np.cumsum(steps_s)
    times = np.round(times, draw(st.sampled_from([3, 6, 9])))
    if draw(st.booleans()):
        positions = rng.normal(scale=draw(st.sampled_from([0.01, 1, 300])), size=(count, 3))
        quats = quaternion.normalize(rng.normal(size=(count, 4)))
    else:
        yaw = np.cumsum(rng.normal(scale=0.2, size=count))
        velocity = np.stack([np.cos(yaw), np.sin(yaw), np.zeros(count)], axis=1)
        positions = np.cumsum(velocity, axis=0)
        quats = looking(yaw, np.zeros((count, 3)), np.zeros((count, 3)))
    is_timed = draw(st.booleans())
    names = None
    if draw(st.booleans()):
        any_name = not format_.name_pattern
        lists = st.lists(NAMES, min_size=count, max_size=count, unique=True)
        names = draw(lists) if any_name else names_of(format_.name, times)
    return Trajectory.from_arrays(
        times if is_timed else np.arange(count), positions, quats, names, is_timed=is_timed
    )


def assert_read_as_written(format_, written, reading):
    read = reading.trajectory
    assert reading.format.name == format_.name
    assert reading.confidence >= LEAST_CONFIDENCE
    assert reading.warnings == []
    assert reading.left_out == ()
    if not (read.is_timed and written.is_timed) and written.names and format_.has_names:
        # Without times, images come in the natural order of their names.
        order = sorted(range(len(written)), key=lambda row: natural_key(written.names[row]))
        names = [written.names[row] for row in order]
        poses = written.target_from_source.at(order)
    else:
        names, poses = written.names, written.target_from_source
    scale = max(1.0, float(np.abs(written.position_m).max()))
    np.testing.assert_allclose(
        read.position_m, poses.translation_m, rtol=0, atol=1e-9 * scale, err_msg=format_.name
    )
    assert rigid.angle_deg(read.target_from_source, poses).max() < 1e-5
    if written.is_timed and format_.has_times and read.is_timed:
        np.testing.assert_allclose(read.timestamp_s, written.timestamp_s, rtol=0, atol=TICK_S)
    if written.names and format_.has_names and format_.keeps_names(written.names):
        assert list(read.names) == list(names)


@pytest.mark.slow
@pytest.mark.parametrize("format_", WRITTEN, ids=lambda format_: format_.name)
@settings(
    deadline=None,
    max_examples=15,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.filter_too_much],
)
@given(data=st.data())
def test_every_writer_is_understood_by_its_reader(format_, tmp_path, data):
    written = data.draw(trajectories(format_))
    path = tmp_path / file_name(format_)
    shutil.rmtree(path, ignore_errors=True)
    try:
        format_.write(path, written)
    except ParameterError:
        assume(False)
    assert_read_as_written(format_, written, read_with_notes(path))


@pytest.mark.parametrize(
    "name",
    ["apr.csv", "apr.tum", "apr.txt", "arkit.csv", "pose.csv", "data.csv", "ARKit_log.csv"],
)
@pytest.mark.parametrize("format_name", ["tum", "euroc", "table"])
@pytest.mark.parametrize("start_s", [0.0, 12.0, 1700000000.0])
def test_the_name_of_a_file_does_not_change_its_reading(name, format_name, start_s, tmp_path):
    rng = np.random.default_rng(1)
    written = Trajectory.from_arrays(
        start_s + np.arange(1, 9) * 20.0,
        rng.normal(size=(8, 3)),
        quaternion.normalize(rng.normal(size=(8, 4))),
    )
    FORMATS[format_name].write(tmp_path / name, written)
    reading = read_with_notes(tmp_path / name)
    assert_read_as_written(FORMATS[format_name], written, reading)
    np.testing.assert_allclose(reading.trajectory.timestamp_s, written.timestamp_s, atol=1e-9)


@pytest.mark.parametrize("start_s", [0.0, 1700000000.0])
def test_what_convert_writes_by_name_is_read_back(start_s, tmp_path):
    """As a user goes: from one file to the next, and the formats only by their names."""
    rng = np.random.default_rng(2)
    written = Trajectory.from_arrays(
        start_s + np.arange(30) / 30,
        np.cumsum(rng.normal(size=(30, 3)), axis=0),
        quaternion.normalize(rng.normal(size=(30, 4))),
    )
    path = tmp_path / "apr.tum"
    FORMATS["tum"].write(path, written)
    for name in ("apr.csv", "odometry.csv", "metadata", "again.csv", "last.tum"):
        convert_file(path, tmp_path / name)
        path = tmp_path / name
        assert_read_as_written(format_of_name(path), written, read_with_notes(path))
