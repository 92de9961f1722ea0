"""COLMAP's points, read without pycolmap."""

import struct
import time

import numpy as np
import pytest

from vioapr.errors import FileMissingError, FormatError
from vioapr.formats.colmap_points import read_points


def point(number, xyz, rgb, observations):
    head = struct.pack("<Q3d3BdQ", number, *xyz, *rgb, 0.5, observations)
    return head + b"".join(struct.pack("<II", k, number) for k in range(observations))


def content_of(count):
    points = [point(k, (k, 2.0 * k, -1.5), (k % 256, 7, 255), k % 5) for k in range(count)]
    return struct.pack("<Q", count) + b"".join(points)


def test_positions_and_colours(tmp_path):
    path = tmp_path / "points3D.bin"
    path.write_bytes(content_of(300))
    positions, colours = read_points(path)
    np.testing.assert_array_equal(positions[299], [299.0, 598.0, -1.5])
    np.testing.assert_array_equal(colours[299], [43, 7, 255])
    assert (positions.shape, colours.shape) == ((300, 3), (300, 3))
    path.write_bytes(struct.pack("<Q", 0))
    assert len(read_points(path)[0]) == 0


def test_as_pycolmap_reads_it(tmp_path):
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    model = pycolmap.Reconstruction()
    for k in range(20):
        model.add_point3D(
            np.array([k, 0.1 * k, -k]), pycolmap.Track(), np.array([k, 2, 3], np.uint8)
        )
    model.write_binary(str(tmp_path))
    positions, colours = read_points(tmp_path / "points3D.bin")
    order = np.argsort(positions[:, 0])
    wanted = [model.points3D[k] for k in sorted(model.points3D)]
    np.testing.assert_array_equal(positions[order], [one.xyz for one in wanted])
    np.testing.assert_array_equal(colours[order], [one.color for one in wanted])


@pytest.mark.parametrize("end", [0, 5, 8, 60, 200, -1])
def test_a_file_that_is_cut_off(tmp_path, end):
    path = tmp_path / "points3D.bin"
    path.write_bytes(content_of(10)[:end])
    with pytest.raises(FormatError, match="points3D.bin"):
        read_points(path)
    with pytest.raises(FileMissingError):
        read_points(tmp_path / "none.bin")


@pytest.mark.slow
def test_a_large_map_is_read_in_a_second_or_two(tmp_path):
    path = tmp_path / "points3D.bin"
    path.write_bytes(content_of(100_000))
    began = time.process_time()
    read_points(path)
    assert time.process_time() - began < 2
