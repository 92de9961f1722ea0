"""Matrices written column by column are read right, or refused, wherever a file has 4x4 numbers."""

import json
import re

import numpy as np
import pytest
from tests.formats.samples import opengl_matrices, write_sample

from vioapr.errors import FormatError
from vioapr.formats.base import ReadOptions
from vioapr.formats.matrix_order import TRANSPOSED, are_transposed, to_rows
from vioapr.formats.registry import FORMATS, read_with_notes
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import ImportOptions
from vioapr.importers.registry import IMPORTERS
from vioapr.simulation.walks import WalkParams, simulate_walk

OF_4X4 = ["nerfstudio", "scannetpp", "3dscannerapp", "7scenes", "scannet", "open3d"]
SOURCE = {"nerfstudio": "transforms.json", "scannetpp": "poses.json",
          "open3d": "poses.log"}  # fmt: skip


@pytest.fixture(scope="module")
def walk():
    return simulate_walk(WalkParams(duration_s=10, rate_hz=2), 3).gt


@pytest.fixture
def write_by_columns(monkeypatch):
    by_rows = Rigid3.to_matrix

    def write(*args):
        with monkeypatch.context() as patch:
            patch.setattr(Rigid3, "to_matrix", lambda self: np.swapaxes(by_rows(self), -1, -2))
            write_sample(*args)

    return write


def is_said(reading):
    return any(note.text == TRANSPOSED and note.is_warning for note in reading.notes)


@pytest.mark.parametrize("name", OF_4X4)
def test_a_file_by_columns_is_read_with_a_warning(name, walk, write_by_columns, tmp_path):
    right, wrong = (tmp_path / kind / SOURCE.get(name, "capture") for kind in ("right", "wrong"))
    for path in (right, wrong):
        path.parent.mkdir()
    write_sample(FORMATS[name], right, walk)
    write_by_columns(FORMATS[name], wrong, walk)
    expected, found = (read_with_notes(path, name) for path in (right, wrong))
    assert not is_said(expected)
    assert is_said(found)
    np.testing.assert_array_equal(found.trajectory.position_m, expected.trajectory.position_m)
    np.testing.assert_array_equal(found.trajectory.quat_xyzw, expected.trajectory.quat_xyzw)
    assert np.ptp(found.trajectory.position_m, axis=0).max() > 1


def test_metashapes_cameras(walk, tmp_path):
    path, wrong = tmp_path / "cameras.xml", tmp_path / "wrong.xml"
    write_sample(FORMATS["metashape"], path, walk)

    def transpose(match):
        numbers = np.array(match[1].split()).reshape(4, 4).T.ravel()
        return f"<transform>{' '.join(numbers)}</transform></camera>"

    pattern = r"<transform>([^<]*)</transform></camera>"
    wrong.write_text(re.sub(pattern, transpose, path.read_text()))
    reading = read_with_notes(wrong)
    assert is_said(reading)
    expected = read_with_notes(path)
    assert not is_said(expected)
    np.testing.assert_array_equal(reading.trajectory.position_m, expected.trajectory.position_m)


def test_open3ds_json_is_by_columns_and_rows_are_said(walk, tmp_path):
    readings = {}
    extrinsic = walk.target_from_source.inverse().to_matrix()
    for kind, matrices in (("columns", np.swapaxes(extrinsic, 1, 2)), ("rows", extrinsic)):
        parameters = [{"extrinsic": matrix.ravel().tolist()} for matrix in matrices]
        path = tmp_path / f"{kind}.json"
        content = {"class_name": "PinholeCameraTrajectory", "parameters": parameters}
        path.write_text(json.dumps(content))
        readings[kind] = read_with_notes(path)
        positions = readings[kind].trajectory.position_m
        np.testing.assert_allclose(positions, walk.position_m, atol=1e-9)
    assert [is_said(readings[kind]) for kind in ("columns", "rows")] == [False, True]


def test_spectaculars_camera_to_world(walk, tmp_path):
    path = tmp_path / "out.jsonl"
    lines = [
        json.dumps({"time": time_s, "cameraPoses": [{"cameraToWorld": matrix.T.tolist()}]})
        for time_s, matrix in zip(
            walk.timestamp_s.tolist(), walk.target_from_source.to_matrix(), strict=True
        )
    ]
    path.write_text("\n".join(lines) + "\n")
    reading = read_with_notes(path)
    assert is_said(reading)
    np.testing.assert_allclose(reading.trajectory.position_m, walk.position_m, atol=1e-9)


def transforms_json(path, walk, rows_by_columns):
    frames = [
        {
            "file_path": f"{row}.png",
            "timestamp": float(row),
            "transform_matrix": np.transpose(matrix).tolist() if row in rows_by_columns else matrix,
        }
        for row, matrix in enumerate(opengl_matrices(walk))
    ]
    path.write_text(json.dumps({"frames": frames}))


def test_one_frame_by_columns_is_left_out_and_named(walk, tmp_path):
    path = tmp_path / "transforms.json"
    transforms_json(path, walk, {4})
    reading = read_with_notes(path)
    assert len(reading.trajectory) == len(walk) - 1
    assert not is_said(reading)
    assert any("matrix is transposed" in text for text in reading.warnings)
    with pytest.raises(FormatError, match="5: expected 0 0 0 1 as the last row of a matrix, got"):
        read_with_notes(path, options=ReadOptions(strict=True))


def test_an_import_reads_columns_too(walk, tmp_path):
    path = tmp_path / "transforms.json"
    poses = {}
    for kind, rows in (("right", set()), ("columns", set(range(len(walk)))), ("one", {4})):
        transforms_json(path, walk, rows)
        ((scene,),) = [IMPORTERS["nerfstudio"].read(path, ImportOptions())]
        (found,) = scene.read()
        poses[kind] = found.vio_from_cam
        texts = [finding.text for finding in found.findings]
        assert (TRANSPOSED in texts) == (kind == "columns")
    np.testing.assert_array_equal(poses["columns"].translation_m, poses["right"].translation_m)
    assert np.flatnonzero(~poses["one"].is_known).tolist() == [4]


def test_poses_at_the_origin_tell_nothing_and_go_with_the_others():
    still = np.eye(4)
    turned = Rigid3(np.zeros(3), np.array([0.6, 0, 0, 0.8])).to_matrix()
    moved = Rigid3(np.array([1.0, 2, 3]), np.array([0, 0.6, 0, 0.8])).to_matrix()
    assert not are_transposed(np.stack([still, turned, moved])).any()
    assert are_transposed(moved.T[None]).all()
    matrices, is_transposed = to_rows(np.stack([still, turned, moved.T]))
    assert is_transposed
    np.testing.assert_array_equal(matrices, [still, turned.T, moved])
    assert to_rows(np.stack([still, turned]))[1] is False
    assert to_rows(np.full((2, 4, 4), np.nan))[1] is False
    assert not are_transposed(np.zeros((2, 3, 4))).any()
