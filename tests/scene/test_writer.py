"""Writing: what is added is on disk at once, and a full disk or a kill spares what is there."""

import errno
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from tests.scene.scenes import CAMERA, jpeg, pose, write_recording

from vioapr.errors import AlreadyExistsError, DiskFullError, ParameterError
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.frames import Frames, Intrinsics, Tracking
from vioapr.scene.recording import Recording
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.recording import RecordingInfo


@pytest.fixture
def writer(tmp_path):
    with RecordingWriter(tmp_path / "walk", RecordingInfo()) as writer:
        yield writer


def test_round_trip(writer, tmp_path):
    turned = Rigid3(np.array([0.1, 1e-17, -3.3]), np.array([0.5, -0.5, 0.5, 0.5]))
    writer.add_frame(0.1, "a.jpg", jpeg(), Tracking.NORMAL, turned, CAMERA)
    writer.add_frame(0.3, "", None, Tracking.LOST, None)
    writer.add_imu(0.1, [0, -9.81, 0], [1, 2, 3])
    writer.add_gnss(0.2, 22.3, 114.2, horizontal_sigma_m=5.0)
    writer.add_heading(0.2, 359.5)
    # Readable at once, without closing.
    recording = Recording.open(tmp_path / "walk")
    frames = recording.frames
    assert frames.timestamp_s.tolist() == [0.1, 0.3]
    np.testing.assert_array_equal(frames.vio_from_cam.translation_m[0], turned.translation_m)
    np.testing.assert_array_equal(frames.vio_from_cam.quat_xyzw[0], turned.quat_xyzw)
    assert recording.image_path(0).read_bytes() == jpeg()
    assert recording.imu.accel_m_s2.tolist() == [[0, -9.81, 0]]
    assert recording.imu.gyro_rad_s.tolist() == [[1, 2, 3]]
    assert recording.gnss.latitude_deg.tolist() == [22.3]
    assert recording.gnss.horizontal_sigma_m.tolist() == [5.0]
    assert np.isnan(recording.gnss.altitude_m).all()
    assert recording.heading.heading_deg.tolist() == [359.5]


def test_many_frames_at_once_are_the_same_lines(tmp_path):
    one_by_one = write_recording(tmp_path / "a", 3)
    frames = Recording.open(one_by_one).frames
    with RecordingWriter(tmp_path / "b", RecordingInfo()) as writer:
        for name in frames.image:
            writer.write_image(name, one_by_one / "images" / name)
        writer.add_frames(frames)
    again = (tmp_path / "b" / "frames.csv").read_text()
    assert again == (one_by_one / "frames.csv").read_text()


def test_many_frames_without_pose_and_with_several_cameras(tmp_path):
    frames = Frames(
        np.array([0.0, 1.0]), ("a.jpg", ""), np.array([2, 0], dtype=np.uint8),
        Rigid3(np.array([[np.nan] * 3, [1, 2, 3]]), np.array([[np.nan] * 4, [0, 0, 0, 1]])),
        Intrinsics(*np.array([[16, 12, 20, 20, 8, 6], [np.nan] * 6]).T), np.arange(2),
    )  # fmt: skip
    with RecordingWriter(tmp_path / "walk", RecordingInfo()) as writer:
        writer.add_frames(frames)
        with pytest.raises(ParameterError, match="later than 1.0"):
            writer.add_frames(frames)
    lines = (tmp_path / "walk" / "frames.csv").read_text().splitlines()[1:]
    assert lines == [
        "0.0,a.jpg,lost,,,,,,,,16,12,20,20,8,6",
        "1.0,,normal,1.0,2.0,3.0,0.0,0.0,0.0,1.0,,,,,,",
    ]


def test_pixels_are_encoded_by_the_name(writer, tmp_path):
    pixels = np.arange(12 * 16 * 3, dtype=np.uint8).reshape(12, 16, 3)
    writer.add_frame(0, "a.png", pixels, Tracking.NORMAL, pose())
    writer.add_frame(1, "b.jpg", pixels[..., 0], Tracking.NORMAL, pose())
    with Image.open(tmp_path / "walk/images/a.png") as image:
        np.testing.assert_array_equal(np.asarray(image), pixels)
    with Image.open(tmp_path / "walk/images/b.jpg") as image:
        assert (image.format, image.mode, image.size) == ("JPEG", "L", (16, 12))


def test_images_are_copied_or_linked(tmp_path):
    source = tmp_path / "source.jpg"
    source.write_bytes(jpeg())
    for name, link in (("copy", False), ("link", True)):
        with RecordingWriter(tmp_path / name, RecordingInfo(), link_images=link) as writer:
            writer.add_frame(0, "a.jpg", source, Tracking.NORMAL, pose())
    assert not (tmp_path / "copy/images/a.jpg").samefile(source)
    assert (tmp_path / "link/images/a.jpg").samefile(source)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ((1.0, "b.jpg", jpeg(), Tracking.NORMAL, pose()), "later than 1.000000 s, got 1.000000"),
        ((np.nan, "b.jpg", jpeg(), Tracking.NORMAL, pose()), "later than 1.000000 s, got nan"),
        ((2, "x/b.jpg", jpeg(), Tracking.NORMAL, pose()), "expected a plain file name"),
        ((2, "", jpeg(), Tracking.NORMAL, pose()), "an image needs a name"),
        ((2, "b.jpg", jpeg(), Tracking.NORMAL, None), "got tracking normal without pose"),
        ((2, "b.jpg", jpeg(), Tracking.LOST, pose()), "got tracking lost with pose"),
        ((2, "b.jpg", jpeg(), Tracking.NORMAL, pose(np.inf)), "expected a finite position"),
        (
            (2, "b.jpg", jpeg(), Tracking.NORMAL, Rigid3(np.zeros(3), np.zeros(4))),
            "a unit quaternion",
        ),
        (
            (2, "b.jpg", jpeg(), Tracking.NORMAL, Rigid3(np.zeros((2, 3)), np.zeros((2, 4)))),
            "expected one pose",
        ),
        ((2, "b.jpg", np.zeros((2, 2)), Tracking.NORMAL, pose()), "type uint8, got"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_written(arguments, problem, writer, tmp_path):
    writer.add_frame(1.0, "a.jpg", jpeg(), Tracking.NORMAL, pose())
    with pytest.raises(ParameterError, match=problem):
        writer.add_frame(*arguments)
    assert Recording.open(tmp_path / "walk").frames.image == ("a.jpg",)
    assert [path.name for path in (tmp_path / "walk/images").iterdir()] == ["a.jpg"]


def test_a_second_image_of_a_name_is_refused(writer):
    writer.add_frame(1.0, "a.jpg", jpeg(), Tracking.NORMAL, pose())
    with pytest.raises(AlreadyExistsError, match="but it exists"):
        writer.add_frame(2.0, "a.jpg", jpeg(), Tracking.NORMAL, pose())


def test_a_recording_is_never_overwritten(tmp_path):
    folder = write_recording(tmp_path / "walk", 3)
    with pytest.raises(AlreadyExistsError, match=r"frames.csv: expected to write a new file"):
        RecordingWriter(folder, RecordingInfo())
    assert len(Recording.open(folder).frames) == 3


def fill_disk_after(monkeypatch, bytes_left):
    """Writing takes so many bytes, some of a last call, and then fails as on a full disk."""
    real, left = os.write, [bytes_left]

    def write(file, content):
        if left[0] <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = real(file, bytes(content)[: left[0]])
        left[0] -= taken
        return taken

    monkeypatch.setattr("vioapr.files.append_table.os.write", write)


@pytest.mark.parametrize("bytes_left", [0, 10, len(jpeg()), len(jpeg()) + 20])
def test_a_full_disk_loses_the_frame_being_written_only(bytes_left, writer, tmp_path, monkeypatch):
    writer.add_frame(0, "a.jpg", jpeg(), Tracking.NORMAL, pose())
    fill_disk_after(monkeypatch, bytes_left)
    with pytest.raises(DiskFullError, match="cannot be written: No space left on device"):
        writer.add_frame(1, "b.jpg", jpeg(), Tracking.NORMAL, pose())
    monkeypatch.undo()
    recording = Recording.open(tmp_path / "walk")
    assert recording.frames.image == ("a.jpg",)
    assert (tmp_path / "walk/frames.csv").read_bytes().endswith(b"\n")
    # And goes on where there is room again.
    writer.add_frame(2, "c.jpg", jpeg(), Tracking.NORMAL, pose())
    assert Recording.open(tmp_path / "walk").frames.image == ("a.jpg", "c.jpg")


WRITE_FOREVER = """
import sys
from pathlib import Path
from tests.scene.scenes import jpeg, pose
from vioapr.scene.frames import Tracking
from vioapr.schemas.recording import RecordingInfo
from vioapr.scene.writer import RecordingWriter
writer = RecordingWriter(Path(sys.argv[1]), RecordingInfo())
for k in range(10**9):
    writer.add_frame(k, f"{k:09d}.jpg", jpeg(), Tracking.NORMAL, pose())
    print(k, flush=True)
"""


def test_kill_9_loses_nothing_that_was_added(tmp_path, request):
    process = subprocess.Popen(
        [sys.executable, "-c", WRITE_FOREVER, str(tmp_path / "walk")],
        stdout=subprocess.PIPE,
        cwd=request.config.rootpath,
    )
    with process:
        for _ in range(20):
            added = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
    frames = Recording.open(tmp_path / "walk").frames
    assert len(frames) > added
    assert frames.image == tuple(f"{k:09d}.jpg" for k in range(len(frames)))
