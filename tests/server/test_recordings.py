"""From a capture to a recording of the scene: poses exact, states and sensors as they were."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from tests.server.captures import (
    AUTH,
    make_capture,
    put,
    put_all,
    rotation_errors_rad,
    wait_for_job,
)

from vioapr.errors import FormatError
from vioapr.importers import capture as importer
from vioapr.importers.base import ImportOptions
from vioapr.importers.capture_logs import FRAMES_HEADER
from vioapr.importers.registry import import_source
from vioapr.recipes.demo import unpack_demo
from vioapr.scene.check import check_scene
from vioapr.scene.frames import Tracking
from vioapr.scene.recording import Recording
from vioapr.scene.scene import Scene
from vioapr.server.job_runner import write_job
from vioapr.server.jobs import Jobs
from vioapr.work.progress import silent

CAMERA = (12, 16, 20.0, 21.0, 6.0, 8.0)


def complete(client, id_="walk", **more):
    capture = make_capture()
    put_all(client, id_, capture.files)
    wanted = {"files": capture.hashes, "scene": "court", "recording": "noon", **more}
    answer = client.post(f"/api/captures/{id_}/complete", json=wanted, headers=AUTH)
    assert answer.status_code == 200, answer.text
    return capture, answer.json()["id"]


def test_a_capture_becomes_a_recording_of_the_scene(open_client, served):
    with open_client() as client:
        capture, job = complete(client, split="test")
        ended = wait_for_job(client, job)
        assert (ended["state"], ended["exit_code"]) == ("done", 0), ended
        entry = client.get("/api/scenes/court", headers=AUTH).json()
        assert entry["recordings"] == {"noon": "test"}
        log = client.get(f"/api/jobs/{job}/log", headers=AUTH)
        assert "1 recording imported" in log.text
        assert client.get("/api/jobs", headers=AUTH).json()[0]["job"] == ended
    report = check_scene(served.folder / "court")
    assert [str(problem) for problem in report.errors] == []
    scene = Scene.open(served.folder / "court")
    recording = scene.recording("noon")
    frames = recording.frames
    assert scene.splits["test"] == ("noon",)
    assert (recording.info.tracker, recording.info.device) == ("WebXR", "Pixel 8")
    assert recording.info.source == ""
    assert recording.info.is_gravity_aligned
    np.testing.assert_allclose(frames.timestamp_s, capture.timestamp_s, atol=1e-6)
    assert [Tracking(state).label for state in frames.tracking] == capture.tracking
    found, truth = frames.vio_from_cam, capture.vio_from_cam
    np.testing.assert_array_equal(frames.has_pose, truth.is_known)
    known = truth.is_known
    np.testing.assert_allclose(found.translation_m[known], truth.translation_m[known], atol=1e-9)
    assert rotation_errors_rad(found.quat_xyzw[known], truth.quat_xyzw[known]).max() < 1e-7
    for column, value in zip(frames.intrinsics, CAMERA, strict=True):
        np.testing.assert_array_equal(column, value)
    for row, name in enumerate(frames.image):
        assert recording.image_path(row).read_bytes() == capture.files[f"images/{name}"]


def test_pictures_with_faces_do_not_stay_on_the_server(open_client, served):
    client = open_client()
    capture, job = complete(client, anonymize=True)
    found = client.get(f"/api/jobs/{job}", headers=AUTH).json()["job"]
    assert found["arguments"][-1] == "--anonymize"
    done = Jobs(served.jobs, served.folder).get(job).job
    write_job(served.jobs / job, msgspec.structs.replace(done, state="done"))
    client = open_client()  # looks for what ended meanwhile
    state = client.get("/api/captures/walk", headers=AUTH).json()
    assert (state["files"], state["is_complete"], state["recording"]) == ({}, True, "noon")
    assert [path.name for path in (served.captures / "walk").iterdir()] == [".complete.json"]
    refused = put(client, "walk", "capture.json", capture.files["capture.json"])
    assert refused.status_code == 409
    wanted = {"files": capture.hashes, "scene": "court", "recording": "noon", "anonymize": True}
    again = client.post("/api/captures/walk/complete", json=wanted, headers=AUTH)
    assert (again.status_code, again.json()["id"]) == (200, job)


def test_jobs_go_on_after_an_error_of_the_disk(open_client, monkeypatch, caplog):
    advance, failures = Jobs.advance, [OSError("the disk is odd")] * 2

    def odd(self):
        if failures:
            raise failures.pop()
        return advance(self)

    monkeypatch.setattr(Jobs, "advance", odd)
    with open_client() as client:
        _, job = complete(client)
        assert wait_for_job(client, job)["state"] == "done"
    said = [record.getMessage() for record in caplog.records if "odd" in record.getMessage()]
    assert said == ["jobs cannot be run: the disk is odd"]  # once


def test_sensors_are_turned_to_the_camera(tmp_path):
    walk = read_capture(tmp_path, make_capture().files)
    # Upright: the device's +y is the image's up, so the force at rest is along the camera's -y.
    np.testing.assert_allclose(walk.imu.accel_m_s2, np.tile([0.0, -9.81, 0.0], (20, 1)), atol=1e-12)
    np.testing.assert_allclose(np.degrees(walk.imu.gyro_rad_s[3]), [3.0, 0.0, 3.0], atol=1e-12)
    assert len(walk.imu) == 20  # the half row at the end is none
    assert walk.gnss.latitude_deg.tolist() == [48.1]
    assert np.isnan(walk.gnss.altitude_m).all()
    # alpha 90 of an upright phone: it looks west. Flat on a table, it looks nowhere.
    np.testing.assert_allclose(walk.heading.heading_deg, [270.0])
    notes = "; ".join(finding.text for finding in walk.findings)
    assert "1 log ends in half a row" in notes
    assert "magnetic" in notes


def read_capture(folder, files):
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    ((scene),) = importer.read(folder, ImportOptions(id="noon"))
    return next(scene.read())


def test_ios_has_the_opposite_acceleration(tmp_path):
    files = make_capture().files
    said = b'{"format": "vioapr capture", "version": 1, "is_acceleration_reversed": true}'
    walk = read_capture(tmp_path, {**files, "capture.json": said})
    np.testing.assert_allclose(walk.imu.accel_m_s2[0], [0.0, 9.81, 0.0], atol=1e-12)


def edited(files, name, old, new):
    text = files[name].decode()
    assert old in text
    return {**files, name: text.replace(old, new, 1).encode()}


def test_rows_that_cannot_be_used_are_left_out_and_said(tmp_path):
    files = make_capture().files
    files = edited(files, "frames-00000.csv", "000001.jpg,normal", "000001.jpg,sometimes")
    files = edited(files, "frames-00001.csv", "000009.jpg", "000010.jpg")
    files["frames-00002.csv"] = files["frames-00001.csv"]  # a segment twice
    del files["images/000003.jpg"]
    walk = read_capture(tmp_path, files)
    assert len(walk) == 11
    assert "000001.jpg" not in walk.image_names
    assert list(walk.image_names).count("000010.jpg") == 1
    warnings = [finding.text for finding in walk.findings if finding.is_warning]
    assert any("left out, the first: frames-00000.csv:3: expected tracking" in w for w in warnings)
    assert any("1 frame names another frame's image" in text for text in warnings)


def test_late_rows_are_put_in_order_and_a_world_survives_its_first_frame(tmp_path):
    capture = make_capture(lost=(8,))
    lines = capture.files["frames-00001.csv"].decode().splitlines()
    lines[1:] = lines[:0:-1]
    files = {**capture.files, "frames-00001.csv": ("\n".join(lines) + "\n").encode()}
    walk = read_capture(tmp_path, files)
    np.testing.assert_allclose(walk.timestamp_s, capture.timestamp_s, atol=1e-6)
    states = [Tracking(state).label for state in walk.tracking]
    assert states[8:10] == ["lost", "reset"]  # the frame that began the world has no pose
    assert states.count("reset") == 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda files: edited(files, "frames-00000.csv", "timestamp_s", "time"), "header"),
        (lambda files: {"capture.json": files["capture.json"]}, "found none that can be used"),
        (lambda files: {**files, "capture.json": b"{}"}, "vioapr capture"),
        (
            lambda files: {**files, "capture.json": files["capture.json"].replace(b": 1", b": 9")},
            "version",
        ),
    ],
)
def test_broken_captures_are_refused(tmp_path, change, says):
    from vioapr.errors import VioAprError

    with pytest.raises(VioAprError, match=says):
        read_capture(tmp_path, change(make_capture().files))


def test_a_walk_without_any_pose_is_refused(tmp_path):
    with pytest.raises(FormatError, match="lost throughout"):
        read_capture(tmp_path, make_capture(lost=tuple(range(12))).files)


def test_the_recordings_id_must_be_free(open_client, served):
    with open_client() as client:
        _, job = complete(client)
        assert wait_for_job(client, job)["state"] == "done"
        capture = make_capture()
        put_all(client, "other", capture.files)
        wanted = {"files": capture.hashes, "scene": "court", "recording": "noon"}
        answer = client.post("/api/captures/other/complete", json=wanted, headers=AUTH)
        assert answer.status_code == 409
        assert "choose another" in answer.json()["error"]


def test_the_demos_walk_comes_through_as_it_was(tmp_path):
    recording = Recording.open(unpack_demo(tmp_path / "demo").recording)
    frames = recording.frames
    rows = []
    for k, (x, y, z, w) in enumerate(frames.vio_from_cam.quat_xyzw.tolist()):
        pose = [*frames.vio_from_cam.translation_m[k].tolist(), -w, -z, y, x]
        text = ["", "", "", "", "", "", ""] if np.isnan(w) else map(repr, pose)
        label = Tracking(frames.tracking[k]).label
        camera = [repr(float(column[k])).removesuffix(".0") for column in frames.intrinsics]
        row = [f"{frames.timestamp_s[k]:.9f}", frames.image[k], label, *text, *camera]
        rows.append(",".join([*row, str(int(frames.tracking_world[k]))]).replace("nan", ""))
    folder = tmp_path / "capture"
    (folder / "images").mkdir(parents=True)
    for k in range(0, len(rows), 100):
        text = "\n".join([FRAMES_HEADER, *rows[k : k + 100]]) + "\n"
        (folder / f"frames-{k // 100:05d}.csv").write_text(text)
    (folder / "capture.json").write_text('{"format": "vioapr capture", "version": 1}')
    for name in filter(None, frames.image):
        (folder / "images" / name).hardlink_to(recording.folder / "images" / name)
    options = ImportOptions(id="again")
    scene = tmp_path / "scene"
    given = import_source(None, folder, scene, options, place="outdoor", progress=silent)
    assert len(list(given)) == 1
    assert not check_scene(scene).errors
    found = Recording.open(scene / "recordings" / "again").frames
    assert len(found) == 450
    assert found.image == frames.image
    np.testing.assert_array_equal(found.tracking, frames.tracking)
    np.testing.assert_allclose(found.timestamp_s, frames.timestamp_s, atol=1e-9)
    for one, other in zip(found.vio_from_cam, frames.vio_from_cam, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)
    for one, other in zip(found.intrinsics, frames.intrinsics, strict=True):
        np.testing.assert_allclose(one, other)
