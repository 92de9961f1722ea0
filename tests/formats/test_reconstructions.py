"""Meshroom, OpenSfM, Bundler, NVM, 3D Gaussian Splatting, Open3D, ScanNet++: what may be wrong."""

import json

import numpy as np
import pytest

from vioapr.errors import FormatError
from vioapr.formats.base import ReadOptions
from vioapr.formats.notes import ReadingNotes
from vioapr.formats.registry import FORMATS, rank_formats, read_trajectory, write_trajectory
from vioapr.trajectory import Trajectory

IDENTITY_TEXT = [str(v) for v in np.eye(3).ravel()]
EYE = np.eye(3).tolist()


def write(path, content):
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def read(path, name=None, **options):
    notes = ReadingNotes()
    return read_trajectory(path, name, ReadOptions(notes=notes, **options)), notes


def meshroom(poses=(0, 1), rig=None):
    views = [
        {"viewId": str(k), "poseId": str(k), "path": f"/home/me/{k}.jpg", **(rig or {})}
        for k in range(3)
    ]
    transform = {"rotation": IDENTITY_TEXT, "center": ["1", "2", "3"]}
    return {
        "views": views,
        "poses": [{"poseId": str(k), "pose": {"transform": transform}} for k in poses],
    }


def test_meshrooms_views_without_a_pose(tmp_path):
    track, notes = read(write(tmp_path / "cameras.sfm", meshroom()))
    assert track.names == ("/home/me/0.jpg", "/home/me/1.jpg")
    assert [row.name for row in notes.left_out] == ["/home/me/2.jpg"]


def test_meshrooms_rigs_are_refused(tmp_path):
    path = write(tmp_path / "cameras.sfm", meshroom(rig={"rigId": "5", "subPoseId": "0"}))
    with pytest.raises(FormatError, match="without rigs"):
        read(path)


def test_opensfms_largest_reconstruction(tmp_path):
    def model(count, first=0):
        shots = {
            f"{first + k}.jpg": {"rotation": [0, 0, 0], "translation": [-k, 0, 0]}
            for k in range(count)
        }
        return {"cameras": {}, "shots": shots}

    path = write(tmp_path / "reconstruction.json", [model(2, 100), model(5)])
    track, notes = read(path)
    assert track.position_m[:, 0].tolist() == [0, 1, 2, 3, 4]
    assert "2 shots of the smaller ones are left out" in notes.warnings[0]


def test_bundlers_images_without_a_pose_and_their_names(tmp_path):
    image = "500 0 0\n1 0 0\n0 1 0\n0 0 1\n{} 0 0\n"
    lost = "0 0 0\n" * 5
    content = "# Bundle file v0.3\n3 1\n" + image.format(-1) + lost + image.format(-3)
    path = write(tmp_path / "bundle.out", content + "1 2 3\n255 0 0\n1 0 5 1.5 2.5\n")
    track, notes = read(path)
    assert (track.position_m[:, 0].tolist(), track.names) == ([1, 3], None)
    assert notes.warnings == ["1 row has no pose (line 8): left out"]
    write(tmp_path / "list.txt", "b.jpg 0 500\na.jpg\nc.jpg\n")
    track, notes = read(path)
    assert track.names == ("b.jpg", "c.jpg")
    assert [row.name for row in notes.left_out] == ["a.jpg"]
    write(tmp_path / "list.txt", "b.jpg\n")  # of another reconstruction
    assert read(path)[0].names is None


def test_nvms_names_with_blanks_and_models_below(tmp_path):
    rows = "my walk/a 1.jpg\t500 1 0 0 0 1 2 3 0 0\nb.jpg 500 1 0 0 0 4 5 6 -0.1 0\n"
    path = write(tmp_path / "a.nvm", f"NVM_V3 FixedK 500 320\n\n2\n{rows}\n1\n1 2 3\n")
    track, _ = read(path)
    assert track.names == ("b.jpg", "my walk/a 1.jpg")
    assert track.position_m.tolist() == [[4, 5, 6], [1, 2, 3]]


def test_redwoods_log_counts_frames(tmp_path):
    matrix = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    path = write(tmp_path / "a.log", f"0 0 1\n{matrix}# lost\n\n1 1 4\n{matrix}")
    assert not read(path)[0].is_timed
    assert read(path, rate_hz=2)[0].timestamp_s.tolist() == [0, 1.5]


def test_3dgs_names_have_no_ending(tmp_path):
    cameras = [
        {"id": k, "img_name": f"frame_{k:04d}", "position": [k, 0, 0], "rotation": EYE}
        for k in (10, 9)
    ]
    track, _ = read(write(tmp_path / "cameras.json", cameras), rate_hz=10)
    assert track.names == ("frame_0009", "frame_0010")
    assert track.timestamp_s.tolist() == [0.9, 1.0]


def test_what_is_written_for_3dgs_has_its_keys(tmp_path):
    track = Trajectory.from_arrays([0], [[1, 2, 3]], [[0, 0, 0, 1]], ["a.jpg"], is_timed=False)
    write_trajectory(tmp_path / "cameras.json", track)
    (camera,) = json.loads((tmp_path / "cameras.json").read_text())
    keys = {"id", "img_name", "width", "height", "position", "rotation", "fx", "fy"}
    assert set(camera) == keys
    assert (camera["position"], camera["rotation"]) == ([1, 2, 3], EYE)


def test_scannetpp_by_hand(tmp_path):
    # At (1, 2, 3), looking along +x of the z-up world.
    matrix = [[0, 0, 1, 1], [-1, 0, 0, 2], [0, -1, 0, 3], [0, 0, 0, 1]]
    frames = {f"frame_{k:06d}": {"aligned_pose": matrix, "pose": EYE} for k in (10, 0)}
    path = write(tmp_path / "pose_intrinsic_imu.json", frames)
    assert rank_formats(path)[0][0].name == "scannetpp"
    track, _ = read(path)
    assert track.names == ("frame_000000.jpg", "frame_000010.jpg")
    assert not track.is_timed
    front = track.target_from_source.at(0).apply(np.array([0.0, 0, 2]))
    np.testing.assert_allclose(front, [3, 2, 3], atol=1e-12)
    for k, frame in enumerate(frames.values()):
        frame["timestamp"] = 100.5 - k
    assert read(write(path, frames))[0].timestamp_s.tolist() == [99.5, 100.5]


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("meshroom", "{", "expected JSON"),
        ("meshroom", {"views": [], "poses": []}, 'a list "poses"'),
        ("meshroom", {**meshroom(), "views": [{"poseId": "1"}]}, 'a view with a text "path"'),
        ("meshroom", {**meshroom(), "poses": [{"poseId": "0"}]}, '9 numbers in "rotation"'),
        ("meshroom", {**meshroom(), "poses": [5]}, 'an object in "poses"'),
        ("meshroom", meshroom(poses=(7,)), "expected finite numbers"),
        ("opensfm", [], 'reconstructions with "shots"'),
        ("opensfm", {}, 'reconstructions with "shots"'),
        ("opensfm", [{"shots": {"a": {"rotation": [0, 0]}}}], '"rotation" as a list of 3'),
        ("opensfm", [{"shots": {"a": 5}}], '"rotation" as a list of 3'),
        ("bundler", "# Bundle file v0.3\n", "got an empty one"),
        ("bundler", "# Bundle file v0.3\n2 0\n1 0 0\n", "5 lines for each of 2 images"),
        ("bundler", "# Bundle file v0.3\nx 0\n", "number of images, got 'x'"),
        ("bundler", "# Bundle file v0.3\n1 0\n1 0 0\n1 0\n0\n0\n0\n", ":4: expected 3 numbers"),
        ("nvm", "NVM_V3\n", "number of images below NVM_V3"),
        ("nvm", "NVM_V3\n\n2\na 1 1 0 0 0 0 0 0 0 0\n", "a line for each of 2 images"),
        ("nvm", "NVM_V3\n\n1\na 1 1 0 0\n", ":4: expected name f qw"),
        ("nvm", "NVM_V3\n\n99999999999\n", "number of images"),
        ("open3d", "0 0\n", "three whole numbers"),
        ("open3d", "0 0 1\n1 0 0\n", ":2: expected a row of a 4x4 matrix"),
        ("open3d", "0 0 1\n1 0 0 0\n0 1 0 0\n", ":1: .*got a pose cut off"),
        ("open3d", "\n", "got none"),
        ("open3d", "0 0 1\n" + "2 0 0 0\n" * 4, ":1: expected a rotation matrix"),
        ("open3d", "{}", 'a list "parameters"'),
        ("open3d", {"parameters": [{}]}, '"extrinsic" as a list of 16'),
        ("3dgs", "{}", "expected a list of cameras"),
        ("3dgs", [], "expected a list of cameras"),
        ("3dgs", [{"position": [0, 0, 0]}], ':1: expected a camera with a text "img_name"'),
        ("3dgs", [{"img_name": "a", "rotation": EYE}], '"position" as a list of 3'),
        ("3dgs", [{"img_name": "a", "rotation": [1]}], '"rotation" as a list of 3x3'),
        ("scannetpp", {}, 'expected frames with an "aligned_pose"'),
        ("scannetpp", {"a": {"pose": EYE}}, '"aligned_pose" as a list of 4x4'),
        ("scannetpp", {"a": 5}, '"aligned_pose" as a list of 4x4'),
        ("arkitscenes", "1 0 0 0 1 2\n", "expected 7 columns"),
        ("arkitscenes", "1 nan 0 0 1 2 3\n", "expected finite numbers"),
        ("arkitscenes", "1 1e9 0 0 1 2 3\n", "expected finite numbers"),
        ("ios-logger", "1,2,3\n", "expected 8 columns"),
        ("ios-logger", "1,0,0,0,0,0,0,0\n", "expected a unit quaternion"),
    ],
)
def test_malformed(name, content, problem, tmp_path):
    path = write(tmp_path / "file", content)
    with pytest.raises(FormatError, match=problem):
        FORMATS[name].read(path, ReadOptions())


def test_ios_loggers_folder(tmp_path):
    write(tmp_path / "ARposes.txt", "100.5,1,2,3,1,0,0,0\r\n100.6,1,2,3,1,0,0,0\r\n")
    write(tmp_path / "Frames.txt", "100.5,0,1000,1000,500,500\r\n")
    assert rank_formats(tmp_path)[0][0].name == "ios-logger"
    track, _ = read(tmp_path)
    assert track.timestamp_s.tolist() == [100.5, 100.6]
    # An OpenGL camera without rotation looks along -z, its top is y.
    pose = track.target_from_source.at(0)
    np.testing.assert_allclose(pose.apply(np.array([0.0, 0, 1])), [1, 2, 2], atol=1e-12)
    np.testing.assert_allclose(pose.apply(np.array([0.0, -1, 0])), [1, 3, 3], atol=1e-12)


def test_published_cameras_of_bundler_and_nvm_agree(tmp_path):
    """naver/kapture, samples/Aachen-Day-Night/3D-models: one model in both formats.

    The world of the Bundler file is the other's, turned by 180 degrees about x.
    """
    nvm = write(
        tmp_path / "aachen.nvm",
        "NVM_V3\n\n1\ndb/4446.jpg 1556.98 0.118007 0.976976 -0.0385554 -0.173511 776.168 "
        "-8.09852 -18.3826 0.086426 0\n\n1\n650.802 -2.78686 -287.018 87 87 87 0\n",
    )
    bundle = write(
        tmp_path / "aachen.out",
        "# Bundle file v0.3\n1 1\n1.55698e+03 0.0 3.565154420e-08\n"
        "9.368148497e-01 3.438436401e-02 3.481316604e-01\n"
        "1.162863863e-01 -9.691756687e-01 -2.172003672e-01\n"
        "3.299324383e-01 2.439595021e-01 -9.119365918e-01\n"
        "-7.338037358e+02 -7.841617584e+01 -2.412949461e+02\n"
        "6.508020e+02 2.786860e+00 2.870180e+02\n87 87 87\n0\n",
    )
    pose = read(nvm)[0].target_from_source.at(0)
    turned = np.diag([1.0, -1, -1, 1]) @ read(bundle)[0].target_from_source.to_matrix()[0]
    np.testing.assert_allclose(turned, pose.to_matrix(), atol=1e-6)
    seen = pose.inverse().apply(np.array([650.802, -2.78686, -287.018]))
    assert seen[2] > 200  # the point that the image observes is in front of it


def test_published_cameras_of_meshroom_face_the_house(tmp_path):
    """Two of ledionkalludra/LoD2to3, cameras.sfm: pictures around a house at the origin."""
    poses = [
        (
            "0.51409451549611185 0.099808617786171699 0.85190672550017588 -0.0055228138890308642 "
            "0.99357132265165315 -0.11307309729105255 -0.85771576158046969 0.0534253368717372 "
            "0.51134079214998696",
            "-22.08541901898915 -2.877778734328845 -19.03880549942653",
        ),
        (
            "-0.26790551259419815 -0.00086122743083794084 -0.96344480620788664 "
            "0.0071020838763475452 0.99997066488701358 -0.0028687575771905345 "
            "0.96341901409835851 -0.0076110217931455414 -0.26789153704626617",
            "31.69367036040039 -7.0014806375631133 -12.912019498456607",
        ),
    ]
    scene = {
        "views": [{"viewId": k, "poseId": k, "path": f"{k}.jpg"} for k in ("0", "1")],
        "poses": [
            {
                "poseId": str(k),
                "pose": {"transform": {"rotation": turn.split(), "center": center.split()}},
            }
            for k, (turn, center) in enumerate(poses)
        ],
    }
    track, _ = read(write(tmp_path / "cameras.sfm", scene))
    forward = track.target_from_source.to_matrix()[:, :3, 2]
    to_house = -track.position_m / np.linalg.norm(track.position_m, axis=1, keepdims=True)
    # Within 45 degrees; the transposed rotations look away from it.
    assert ((forward * to_house).sum(axis=1) > np.sqrt(0.5)).all()
