"""A folder of images with any trajectory: by names, timestamps or order."""

import json
from pathlib import Path, PurePosixPath

import numpy as np
import pytest
from tests.formats.conftest import file_name, names_of
from tests.formats.samples import write_sample
from tests.importers.sources import (
    COUNT,
    make_images,
    map_of,
    named,
    read_walks,
    texts,
    walk,
    write_images,
)

from vioapr.errors import FormatError, ParameterError
from vioapr.formats import tum
from vioapr.formats.registry import FORMATS
from vioapr.geometry.frames import z_up_from_y_up
from vioapr.importers.images import IMPORTER
from vioapr.trajectory import Trajectory

NOT_OF_A_CAMERA = {"euroc", "aria"}  # of a body, whose axes the up test does not know


@pytest.fixture
def source(tmp_path):
    return make_images(tmp_path)


def test_by_order(source):
    (found,) = read_walks(
        IMPORTER, source / "images", poses=source / "vio.tum", gt=source / "gt.tum"
    )
    assert (found.id, found.split, found.info.tracker) == ("images", "train", "vio.tum")
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m)
    np.testing.assert_allclose(found.timestamp_s, walk().timestamp_s)
    np.testing.assert_allclose(found.gt.position_m, map_of(walk()).position_m)
    assert "pose k is taken to be of image k" in texts(found, warnings=False)
    assert found.info.clock == "device"


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in FORMATS if name not in NOT_OF_A_CAMERA])
def test_every_format(name, tmp_path):
    format_ = FORMATS[name]
    vio = walk()
    names = [PurePosixPath(image).name for image in names_of(name, vio.timestamp_s)]
    write_images(tmp_path / "images", names)
    if not format_.has_times:
        vio = named(vio, names)
    path = tmp_path / file_name(format_)
    write_sample(format_, path, vio)
    (found,) = read_walks(IMPORTER, tmp_path / "images", poses=path)
    assert np.isfinite(found.vio_from_cam.translation_m).all()
    steps = np.linalg.norm(np.diff(found.vio_from_cam.translation_m, axis=0), axis=1)
    np.testing.assert_allclose(steps, np.linalg.norm(np.diff(walk().position_m, axis=0), axis=1))


def test_a_z_up_world_is_turned(source):
    z_up = walk().with_transforms(z_up_from_y_up(walk().target_from_source))
    tum.write(source / "vio.tum", z_up)
    (found,) = read_walks(IMPORTER, source / "images", poses=source / "vio.tum")
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m, atol=1e-12)
    assert "world of vio.tum: z up, turned to y up" in texts(found, warnings=False)


@pytest.mark.parametrize(("scale", "digits"), [(1, 6), (1e3, 0), (1e6, 0), (1e9, 0)])
def test_by_timestamps_in_names(scale, digits, tmp_path):
    times = 1700000000 + walk().timestamp_s
    write_images(tmp_path / "images", [f"{scale * t:.{digits}f}.png" for t in times])
    tum.write(
        tmp_path / "vio.tum", Trajectory(times, *walk().target_from_source).at_rows(slice(2, 15))
    )
    (found,) = read_walks(IMPORTER, tmp_path / "images", poses=tmp_path / "vio.tum")
    np.testing.assert_allclose(found.timestamp_s, times, atol=1e-6, rtol=0)
    assert np.flatnonzero(np.isfinite(found.vio_from_cam.translation_m[:, 0])).tolist() == list(
        range(2, 15)
    )
    assert "poses: 7 of 20 frames have none" in texts(found, warnings=True)


def test_numbers_of_frames_are_no_times(tmp_path):
    """000000.png to 000019.png count frames: a trajectory from 0 s on does not mean seconds."""
    write_images(tmp_path / "images", [f"{5 * k:06d}.png" for k in range(COUNT)])
    (found,) = read_walks(IMPORTER, tmp_path / "images")
    assert found.info.clock == "frame-rate"
    assert "no timestamps: counted at 1 Hz" in texts(found, warnings=True)
    tum.write(tmp_path / "vio.tum", walk())
    (found,) = read_walks(IMPORTER, tmp_path / "images", poses=tmp_path / "vio.tum")
    np.testing.assert_allclose(found.timestamp_s, walk().timestamp_s)
    assert found.vio_from_cam.is_known.all()
    tum.write(tmp_path / "long.tum", walk(COUNT + 1))
    with pytest.raises(FormatError, match="give `rate_hz`, or a trajectory with names"):
        read_walks(IMPORTER, tmp_path / "images", poses=tmp_path / "long.tum")
    (found,) = read_walks(IMPORTER, tmp_path / "images", time_unit="ms")
    assert found.timestamp_s[1] == 0.005


@pytest.mark.parametrize(("digits", "unit"), [(3, "milliseconds"), (6, "microseconds")])
def test_small_whole_numbers_that_are_the_poses_times(digits, unit, tmp_path):
    """Milliseconds since the start, of which some images are missing."""
    times = walk().timestamp_s
    write_images(tmp_path / "images", [f"{round(t * 10**digits)}.png" for t in times[3:]])
    tum.write(tmp_path / "vio.tum", walk())
    (found,) = read_walks(IMPORTER, tmp_path / "images", poses=tmp_path / "vio.tum")
    np.testing.assert_allclose(found.timestamp_s, times[3:])
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m[3:])
    assert f"from the images' names, in {unit}" in texts(found, warnings=False)


def test_times_of_another_clock_are_paired_in_order_with_a_warning(tmp_path):
    times = walk().timestamp_s
    names = [f"{round((t + 1700000000) * 1000)}.jpg" for t in times]
    write_images(tmp_path / "images", names)
    tum.write(tmp_path / "vio.tum", walk())
    (found,) = read_walks(IMPORTER, tmp_path / "images", poses=tmp_path / "vio.tum")
    np.testing.assert_allclose(found.timestamp_s, times)
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m)
    said = texts(found, warnings=True)
    assert "images are named by times of another clock (1700000000.000 to" in said
    assert "their steps agree at 1700000000.000 s apart, so pose k is taken to be of" in said


def test_times_of_another_clock_with_other_steps_are_refused(tmp_path):
    """As many images as poses, but one was dropped in the middle, and one came at the end."""
    times = walk(COUNT + 1).timestamp_s
    dropped = np.delete(times, COUNT // 2)
    write_images(tmp_path / "images", [f"{round((t + 1.7e9) * 1000)}.jpg" for t in dropped])
    tum.write(tmp_path / "vio.tum", walk())
    with pytest.raises(FormatError, match="another clock .*, and their steps differ by up to 0"):
        read_walks(IMPORTER, tmp_path / "images", poses=tmp_path / "vio.tum")
    tum.write(tmp_path / "vio.tum", walk(COUNT + 2))
    with pytest.raises(FormatError, match=r"rows \(22 poses\), got 20 .* times of another clock"):
        read_walks(IMPORTER, tmp_path / "images", poses=tmp_path / "vio.tum")


def test_the_count_that_is_refused_is_that_of_the_rows(source):
    lines = (source / "vio.tum").read_text().splitlines()
    time, *_ = lines[-1].split()
    extra = [f"{float(time) + k} nan nan nan nan nan nan nan" for k in (1, 2)]
    (source / "vio.tum").write_text("\n".join([*lines, *extra]) + "\n")
    with pytest.raises(FormatError, match=r"\(20 poses, of 22 rows 2 have none\), got 20 images"):
        read_walks(IMPORTER, source / "images", poses=source / "vio.tum")


def test_by_timestamps_after_the_videos_number(tmp_path):
    """ARKitScenes: pictures and poses have a clock in common, and nothing else."""
    times = 306.508 + walk().timestamp_s
    write_images(tmp_path / "images", [f"41069021_{t:.3f}.png" for t in times[::2]])
    vio = Trajectory(times, *walk().target_from_source)
    FORMATS["arkitscenes"].write(tmp_path / "lowres_wide.traj", vio)
    (found,) = read_walks(IMPORTER, tmp_path / "images", poses=tmp_path / "lowres_wide.traj")
    np.testing.assert_allclose(found.timestamp_s, times[::2], atol=1e-3)
    assert np.isfinite(found.vio_from_cam.translation_m).all()


def test_numbers_with_underscores_are_no_times(tmp_path):
    write_images(tmp_path / "images", [f"2024_{k:04d}.png" for k in range(COUNT)])
    (found,) = read_walks(IMPORTER, tmp_path / "images", rate_hz=None)
    assert found.timestamp_s[:3].tolist() == [0, 1, 2]


def test_poses_of_no_image_are_counted(source):
    names = [f"frame-{k:04d}.jpg" for k in range(5, COUNT + 5)]
    FORMATS["hloc"].write(source / "vio.txt", named(walk(), names))
    (found,) = read_walks(IMPORTER, source / "images", poses=source / "vio.txt")
    assert "vio.txt: 5 of 20 poses belong to no image" in texts(found, warnings=True)
    assert "poses: 5 of 20 frames have none" in texts(found, warnings=True)


def test_a_rate(source):
    (found,) = read_walks(IMPORTER, source / "images", rate_hz=4)
    assert found.timestamp_s[:3].tolist() == [0, 0.25, 0.5]
    assert found.info.clock == "frame-rate"
    assert "no timestamps: 4 Hz" in texts(found, warnings=False)
    assert not found.info.tracker


def test_another_number_of_poses(source):
    tum.write(source / "vio.tum", walk(COUNT - 1))
    with pytest.raises(FormatError, match=r"each of its rows \(19 poses\), got 20 images"):
        read_walks(IMPORTER, source / "images", poses=source / "vio.tum")


def test_names_that_do_not_meet(source):
    FORMATS["hloc"].write(source / "vio.txt", named(walk(), [f"x{k}.jpg" for k in range(COUNT)]))
    with pytest.raises(FormatError, match=r"vio.txt: expected names that fit the 20 images"):
        read_walks(IMPORTER, source / "images", poses=source / "vio.txt")


def test_a_pattern_takes_images_of_several_folders(source):
    images = source / "images"
    for k, path in enumerate(sorted(images.iterdir())):
        folder = images / ("left" if k % 2 else "right")
        folder.mkdir(exist_ok=True)
        path.rename(folder / path.name)
    with pytest.raises(FormatError, match=r"found folders of images: left, right\. Import one"):
        read_walks(IMPORTER, images)
    (found,) = read_walks(IMPORTER, images / "**/*.jpg", poses=source / "vio.tum", rate_hz=10)
    assert found.id == "images"
    assert len(found) == COUNT
    assert Path(found.images[0]).exists()
    (left,) = read_walks(IMPORTER, images / "left" / "*.jpg")
    assert len(left) == COUNT // 2
    with pytest.raises(FormatError, match=r"found none of this pattern"):
        read_walks(IMPORTER, images / "**/*.png")


def test_images_of_other_kinds_are_named(source):
    for k in range(3):
        (source / f"images/IMG_{k}.HEIC").write_bytes(b"x")
    (found,) = read_walks(IMPORTER, source / "images")
    assert "images: 3 .heic are not read: convert them" in texts(found, warnings=True)
    for path in (source / "images").glob("*.jpg"):
        path.unlink()
    with pytest.raises(FormatError, match=r"found 3 .heic: convert them to JPEG or PNG first"):
        read_walks(IMPORTER, source / "images")


@pytest.mark.parametrize(("name", "is_metric"), [("images.txt", False), ("poses.kitti", True)])
def test_poses_of_colmap_are_not_metric(name, is_metric, source):
    format_ = FORMATS["colmap" if name == "images.txt" else "kitti"]
    names = [f"frame-{k:04d}.jpg" for k in range(COUNT)]
    format_.write(source / name, named(walk(), names))
    (found,) = read_walks(IMPORTER, source / "images", poses=source / name)
    assert found.info.is_metric == is_metric
    assert ("give `metric`" in texts(found, warnings=True)) != is_metric
    (found,) = read_walks(IMPORTER, source / "images", poses=source / name, metric=True)
    assert found.info.is_metric


@pytest.mark.parametrize(("name", "is_aligned"), [("stray", True), ("record3d", False)])
def test_a_format_says_which_way_is_up(name, is_aligned, source):
    path = source / file_name(FORMATS[name])
    FORMATS[name].write(path, walk())
    (found,) = read_walks(IMPORTER, source / "images", poses=path)
    assert found.info.is_gravity_aligned == is_aligned


@pytest.mark.parametrize("name", ["tum", "kitti"])
def test_poses_in_order_of_which_some_are_none(name, source):
    """A row without a pose leaves its image without one, and shifts no other."""
    path = source / "some.txt"
    FORMATS[name].write(path, walk() if name == "tum" else named(walk(), ["x"] * COUNT))
    lines = path.read_text().splitlines()
    first = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    for row in (0, 6):
        fields = lines[first + row].split()
        start = 1 if name == "tum" else 0
        lines[first + row] = " ".join([*fields[:start], *["nan"] * (len(fields) - start)])
    path.write_text("\n".join(lines) + "\n")
    (found,) = read_walks(IMPORTER, source / "images", poses=path)
    assert np.flatnonzero(~found.vio_from_cam.is_known).tolist() == [0, 6]
    np.testing.assert_allclose(found.vio_from_cam.translation_m[7], walk().position_m[7], atol=1e-9)
    assert "2 rows have no pose" in texts(found, warnings=True)


def test_a_repeated_row_is_no_image(source):
    lines = (source / "vio.tum").read_text().splitlines()
    path = source / "again.tum"
    path.write_text("\n".join([*lines[:9], lines[8], *lines[9:]]) + "\n")
    (found,) = read_walks(IMPORTER, source / "images", poses=path)
    assert found.vio_from_cam.is_known.all()
    np.testing.assert_allclose(found.timestamp_s, walk().timestamp_s)
    with pytest.raises(FormatError, match="again.tum"):
        read_walks(IMPORTER, source / "images", poses=path, strict=True)


@pytest.mark.parametrize(
    "name_of",
    [
        lambda k: f"frame-{k:04d}.jpg",
        lambda k: f"frame-{k:04d}",
        lambda k: f"images/frame-{k:04d}.png",
        lambda k: f"C:\\scan\\images\\frame-{k:04d}.jpg",
    ],
)
def test_names_of_poses_as_other_programs_write_them(name_of, source):
    content = {
        "frames": [
            {"file_path": name_of(k), "transform_matrix": matrix}
            for k, matrix in enumerate(walk().target_from_source.to_matrix().tolist())
        ]
    }
    (source / "transforms.json").write_text(json.dumps(content))
    (found,) = read_walks(IMPORTER, source / "images", poses=source / "transforms.json")
    assert found.vio_from_cam.is_known.all()


def test_the_unit_of_times_and_the_format_that_are_given(source):
    lines = (source / "vio.tum").read_text().splitlines()
    rows = [line.split() for line in lines if not line.startswith("#")]
    path = source / "odd.log"
    path.write_text("".join(f"{round(float(t) * 1e3)} {' '.join(p)}\n" for t, *p in rows))
    (found,) = read_walks(
        IMPORTER, source / "images", poses=path, poses_format="tum", time_unit="ms"
    )
    np.testing.assert_allclose(found.timestamp_s, walk().timestamp_s)
    with pytest.raises(ParameterError, match="unknown format"):
        read_walks(IMPORTER, source / "images", poses=path, poses_format="nothing")


def test_no_images(tmp_path):
    with pytest.raises(FormatError, match=r"expected images \(.jpg, .png\), found none"):
        read_walks(IMPORTER, tmp_path)


def test_real_images_with_real_odometry(data_dir, tmp_path):
    folder = data_dir / "redkitchen_seq01_images"
    rows = np.genfromtxt(folder / "poses.csv", delimiter=",", names=True, dtype=None, encoding=None)
    positions = np.stack([rows[f"dslam_{axis}"] for axis in "xyz"], axis=1)
    quats = np.stack([rows[f"dslam_q{axis}"] for axis in "xyzw"], axis=1)
    tum.write(tmp_path / "dslam.tum", Trajectory(rows["t"], positions, quats))
    (found,) = read_walks(IMPORTER, folder / "images", poses=tmp_path / "dslam.tum")
    assert len(found) == 500
    np.testing.assert_allclose(found.vio_from_cam.translation_m, positions)
    # RGB-D SLAM's world is that of its first frame, y down.
    assert "nearest to -y: marked as not gravity-aligned" in texts(found, warnings=True)
    assert not found.info.is_gravity_aligned
