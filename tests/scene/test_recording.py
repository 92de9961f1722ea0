"""Recordings: opening, sensors, and what a crash leaves."""

import json

import pytest
from tests.scene.scenes import edit, jpeg, write_recording

from vioapr.errors import FileError, FileMissingError, FormatError, VersionError
from vioapr.scene.recording import Recording, read_info, write_info
from vioapr.schemas.recording import RecordingInfo


@pytest.fixture
def folder(tmp_path):
    return write_recording(tmp_path / "walk-1", 4)


def test_what_a_recording_holds(folder):
    recording = Recording.open(folder)
    assert recording.id == "walk-1"
    assert recording.info.device == "iPhone 14 Pro"
    assert len(recording.frames) == 4
    assert recording.image_path(2) == folder / "images" / "frame-2.jpg"
    assert (len(recording.imu), len(recording.gnss), len(recording.heading)) == (0, 0, 0)


@pytest.mark.parametrize("content", [b"", jpeg()[:50], jpeg()[:-2]])
def test_a_torn_last_image_loses_that_frame_only(content, folder):
    (folder / "images/frame-3.jpg").write_bytes(content)
    assert Recording.open(folder).frames.image == ("frame-0.jpg", "frame-1.jpg", "frame-2.jpg")


def test_the_first_malformed_line_is_an_error(folder):
    edit(folder / "frames.csv", "1.0,frame-2.jpg,normal", "1.0,frame-2.jpg,fine")
    with pytest.raises(FormatError, match=r"frames.csv:4: expected tracking to be one of"):
        _ = Recording.open(folder).frames


def test_a_frame_without_image_has_no_path(folder):
    edit(folder / "frames.csv", "1.0,frame-2.jpg,", "1.0,,")
    with pytest.raises(FormatError, match=r"frames.csv:4: this frame has no image"):
        Recording.open(folder).image_path(2)


@pytest.mark.parametrize(
    ("file", "header", "row", "problem"),
    [
        ("imu", "timestamp_s,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s", ",1,1,1,1,1,1",
         "expected a value for timestamp_s"),
        ("imu", "timestamp_s,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s", "1,x,1,1,1,1,1",
         "expected a finite number, got 'x'"),
        ("gnss", "timestamp_s,latitude_deg,longitude_deg,altitude_m,horizontal_sigma_m,"
         "vertical_sigma_m", "1,91,0,,,", "expected latitude_deg within 90"),
        ("gnss", "timestamp_s,latitude_deg,longitude_deg,altitude_m,horizontal_sigma_m,"
         "vertical_sigma_m", "1,1,,,,", "expected a value for timestamp_s,latitude_deg,longitude"),
        ("heading", "timestamp_s,heading_deg,sigma_deg", "1,400,", "heading_deg within 360"),
        ("heading", "timestamp_s,heading_deg,sigma_deg", "1,10", "expected 3 fields, got 2"),
    ],
)  # fmt: skip
def test_a_malformed_sensor_line_is_named(file, header, row, problem, folder):
    (folder / f"{file}.csv").write_text(f"{header}\n{row}\n")
    with pytest.raises(FormatError, match=f"{file}.csv:2: .*{problem}"):
        getattr(Recording.open(folder), file)


def test_only_malformed_sensor_lines(folder):
    (folder / "heading.csv").write_text("timestamp_s,heading_deg,sigma_deg\nx,0,\nnan,0,\n")
    with pytest.raises(FormatError, match=r"heading.csv:2: expected a finite number, got 'x'"):
        _ = Recording.open(folder).heading


def test_sensor_rows_out_of_order_are_named(folder):
    (folder / "heading.csv").write_text("timestamp_s,heading_deg,sigma_deg\n2,0,\n2,1,\n1,2,\n")
    with pytest.raises(FormatError, match=r"heading.csv:4: .*not earlier than the one before"):
        _ = Recording.open(folder).heading


def test_a_torn_sensor_line_is_passed_over(folder):
    (folder / "heading.csv").write_text("timestamp_s,heading_deg,sigma_deg\n1,10,\n2,2")
    assert Recording.open(folder).heading.heading_deg.tolist() == [10]


def test_no_recording(tmp_path):
    with pytest.raises(FileMissingError, match="expected a recording's folder, found none"):
        Recording.open(tmp_path / "none")
    with pytest.raises(FileMissingError, match=r"recording.json: expected a file, found none"):
        Recording.open(tmp_path)


def test_no_frames_table(folder):
    (folder / "frames.csv").unlink()
    with pytest.raises(FileMissingError, match=r"frames.csv: expected a file, found none"):
        _ = Recording.open(folder).frames


def test_info_round_trip(tmp_path):
    info = RecordingInfo(
        device="Pixel", tracker="ARCore", source="test", has_images=False, clock="frame-rate",
        is_metric=False, is_gravity_aligned=False, is_diverging=True, notes=("é",),
    )  # fmt: skip
    write_info(tmp_path / "recording.json", info)
    assert read_info(tmp_path / "recording.json") == info


def test_members_that_lack_have_defaults(tmp_path):
    path = tmp_path / "recording.json"
    path.write_text('{"format": "vioapr recording", "version": 1}')
    assert read_info(path) == RecordingInfo()


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"format": "other"}, 'expected "format": "vioapr recording", got \'other\''),
        ({"version": 2}, "expected version 1, got 2"),
        ({"conventions": {"colour": "blue"}}, "conventions: expected only pose, .*got 'colour'"),
        (
            {"conventions": {"pose": "cam_from_vio"}},
            "conventions.pose: expected 'vio_from_cam'",
        ),
        ({"device": 3}, "device: expected text, got 3"),
        ({"has_images": "yes"}, "has_images: expected true or false, got 'yes'"),
        ({"clock": "sundial"}, "clock: expected 'device' or 'frame-rate', got 'sundial'"),
        ({"notes": ["a", 1]}, r"notes\[1\]: expected text, got 1"),
    ],
)
def test_malformed_info(change, problem, folder):
    path = folder / "recording.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(FileError, match=f"recording.json: {problem}") as error:
        Recording.open(folder)
    assert isinstance(error.value, VersionError) == ("version" in change)


def test_what_is_written_is_for_people_and_names_its_conventions(tmp_path):
    write_info(tmp_path / "recording.json", RecordingInfo(device="é", notes=("a",)))
    written = (tmp_path / "recording.json").read_text()
    assert (
        written
        == """{
  "format": "vioapr recording",
  "version": 1,
  "conventions": {
    "pose": "vio_from_cam",
    "vio_axes": "right-handed, y up",
    "cam_axes": "x right, y down, z forward",
    "quaternion": "Hamilton, x y z w",
    "units": "metres, seconds, pixels"
  },
  "device": "é",
  "tracker": "",
  "source": "",
  "has_images": true,
  "clock": "device",
  "is_metric": true,
  "is_gravity_aligned": true,
  "is_diverging": false,
  "notes": [
    "a"
  ]
}
"""
    )
