"""One pose that can be checked by hand, as each format has it.

The camera stands at (1, 2, 3) of a z-up world and looks along +y, level: its axes x right, y
down, z forward are the world's x, -z, y. A point 4 m in front of it is at (1, 6, 3), and one
1 m above it at (1, 2, 4).
"""

import json

import numpy as np
import pytest

from vioapr.formats.base import ReadOptions
from vioapr.formats.registry import FORMATS, read_trajectory

POSITION = [1, 2, 3]
IN_FRONT = [0, 0, 4]
ABOVE = [0, -1, 0]
HALF = 0.7071067811865476

# world_from_cam is a turn by -90 degrees about x: (x, y, z) to (x, z, -y).
OURS_XYZW = f"-{HALF} 0 0 {HALF}"
OURS_WXYZ = f"{HALF} -{HALF} 0 0"
# cam_from_world turns back, and takes the world's origin to -R^T c = (-1, 3, -2).
INVERSE_WXYZ = f"{HALF} {HALF} 0 0"
INVERSE_T = "-1 3 -2"
# An OpenGL camera's axes x, y up, z backwards are the world's x, z, -y: a turn by +90 about x.
OPENGL_WXYZ = f"{HALF} {HALF} 0 0"
MATRIX = [[1, 0, 0, 1], [0, 0, 1, 2], [0, -1, 0, 3], [0, 0, 0, 1]]
OPENGL_MATRIX = [[1, 0, 0, 1], [0, 0, -1, 2], [0, 1, 0, 3], [0, 0, 0, 1]]


def commas(text):
    return text.replace(" ", ",")


def spaced(text):
    return text.replace(" ", ", ")


ROTATION = [row[:3] for row in MATRIX[:3]]
MST = "scene,split,seq,img_path,t1,t2,t3,q1,q2,q3,q4\n"
EXAMPLES = {
    "tum": ("a.tum", f"10.5 1 2 3 {OURS_XYZW}"),
    "euroc": ("a.csv", f"#t\n10500000000,1,2,3,{commas(OURS_WXYZ)},0,0,0"),
    "kitti": ("a.txt", " ".join(str(v) for row in MATRIX[:3] for v in row)),
    "kitti, numbered": ("b.txt", "7 " + " ".join(str(v) for row in MATRIX[:3] for v in row)),
    "colmap": ("images.txt", f"# x\n7 {INVERSE_WXYZ} {INVERSE_T} 1 a/b.png\n1 2 -1\n"),
    "hloc": ("a.txt", f"a/b.png {INVERSE_WXYZ} {INVERSE_T}"),
    "hloc, focal": ("b.txt", f"a/b.png {INVERSE_WXYZ} {INVERSE_T} 525.5"),
    "ace": ("a.txt", f"a/b.png {INVERSE_WXYZ} {INVERSE_T} 0.1 2.5 900"),
    "ace, no inliers": ("b.txt", f"a/b.png {INVERSE_WXYZ} {INVERSE_T} 0.1 2.5"),
    "marvin": ("train.txt", f"a/b.png 1 2 3 {INVERSE_WXYZ}"),
    "hrapr": ("a.txt", f"a/b.png 1 2 3 {OPENGL_WXYZ}"),
    "mstransformer": (
        "a.csv",
        f"{MST}KingsCollege,test,seq7,a/b.png,1,2,3,{commas(INVERSE_WXYZ)}",
    ),
    "mstransformer, 7Scenes": (
        "b.csv",
        f"{MST}chess,test,seq-01,a/b.png,1,2,3,{commas(OURS_WXYZ)}",
    ),
    "cambridge": (
        "dataset_train.txt",
        "Visual Landmark Dataset V1\nImageFile, Camera Position [X Y Z W P Q R]\n\n"
        f"a/b.png 1 2 3 {INVERSE_WXYZ}",
    ),
    "nerfstudio": (
        "transforms.json",
        json.dumps({"frames": [{"file_path": "a/b.png", "transform_matrix": OPENGL_MATRIX}]}),
    ),
    "stray": (
        "odometry.csv",
        "timestamp, frame, x, y, z, qx, qy, qz, qw, fx, cx\n"
        f"10.5, 000000, 1, 2, 3, -{HALF}, 0, 0, {HALF}, , ",
    ),
    "record3d": ("metadata", json.dumps({"fps": 60, "poses": [[HALF, 0, 0, HALF, 1, 2, 3]]})),
    "scancapture": (
        "poses.txt",
        f"# h\n10500000,tracking,1,2,3,{HALF},0,0,{HALF},640,480,500,500,320,240",
    ),
    "aria": (
        "closed.csv",
        "graph_uid,tracking_timestamp_us,tx_world_device,ty_world_device,tz_world_device,"
        "qx_world_device,qy_world_device,qz_world_device,qw_world_device\n"
        f"x,10500000,1,2,3,-{HALF},0,0,{HALF}",
    ),
    "advio-vio": ("arkit.csv", f"10.5,1,2,3,{commas(OPENGL_WXYZ)}"),
    "ios-logger": ("ARposes.txt", f"10.5,1,2,3,{commas(OPENGL_WXYZ)}\r\n"),
    # cam_from_world turns by +90 degrees about x.
    "arkitscenes": ("lowres_wide.traj", f"10.5 {np.pi / 2} 0 0 {INVERSE_T}"),
    "spectacular": (
        "out.jsonl",
        '{"time": 10.5, "position": {"x": 1, "y": 2, "z": 3}, '
        f'"orientation": {{"w": {HALF}, "x": -{HALF}, "y": 0, "z": 0}}}}',
    ),
    "spectacular, cameras": (
        "cameras.jsonl",
        json.dumps({"time": 10.5, "cameraPoses": [{"cameraToWorld": MATRIX}]}),
    ),
    "kapture": (
        "trajectories.txt",
        "# kapture format: 1.1\n# timestamps: microseconds\n"
        f"10500000, cam, {spaced(INVERSE_WXYZ)}, {spaced(INVERSE_T)}",
    ),
    "lamar": (
        "trajectories.txt",
        "# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz, *covar\n"
        f"10500000, cam, {spaced(OURS_WXYZ)}, 1, 2, 3\n"
        f"10533333, cam, {spaced(OURS_WXYZ)}, 1, 2, 3",
    ),
    "3dgs": (
        "cameras.json",
        json.dumps([{"id": 0, "img_name": "a/b.png", "position": POSITION, "rotation": ROTATION}]),
    ),
    "open3d": ("a.log", "0 0 1\n" + "\n".join(" ".join(map(str, row)) for row in MATRIX)),
    "open3d, JSON": (
        "trajectory.json",
        json.dumps(
            {
                "class_name": "PinholeCameraTrajectory",
                "parameters": [{"extrinsic": np.linalg.inv(MATRIX).ravel(order="F").tolist()}],
            }
        ),
    ),
    "metashape": (
        "cameras.xml",
        '<document version="1.5.0"><chunk><cameras><camera id="0" label="a/b.png"><transform>'
        "1 0 0 0.5 0 0 1 1 0 -1 0 1 0 0 0 1</transform></camera></cameras><transform>"
        "<translation>0 0 1</translation><scale>2</scale></transform></chunk></document>",
    ),
    # Level, and the top of the picture up: the view is raised by 90 degrees from straight down.
    "realitycapture": (
        "cameras.csv",
        "#cameras 1\n#name,x,y,alt,heading,pitch,roll,f\na/b.png,1,2,3,0,90,0,24.5",
    ),
    "meshroom": (
        "cameras.sfm",
        json.dumps(
            {
                "views": [{"viewId": "7", "poseId": "7", "path": "a/b.png"}],
                "poses": [
                    {
                        "poseId": "7",
                        "pose": {
                            "transform": {
                                "rotation": [str(v) for row in ROTATION for v in row],
                                "center": ["1", "2", "3"],
                            }
                        },
                    }
                ],
            }
        ),
    ),
    "opensfm": (
        "reconstruction.json",
        json.dumps(
            [
                {
                    "cameras": {},
                    "shots": {
                        "a/b.png": {"rotation": [np.pi / 2, 0, 0], "translation": [-1, 3, -2]}
                    },
                }
            ]
        ),
    ),
    # An OpenGL camera's cam_from_world: a turn by -90 degrees about x, t = (-1, -3, 2).
    "bundler": ("bundle.out", "# Bundle file v0.3\n1 0\n500 0 0\n1 0 0\n0 0 1\n0 -1 0\n-1 -3 2"),
    "nvm": ("a.nvm", f"NVM_V3 \n\n1\na/b.png\t500 {INVERSE_WXYZ} 1 2 3 0 0\n"),
}


@pytest.mark.parametrize("case", EXAMPLES)
def test_a_pose_that_can_be_checked_by_hand(case, tmp_path):
    name, content = EXAMPLES[case]
    path = tmp_path / name
    path.write_text(content)
    read = read_trajectory(path, case.split(",")[0])
    pose = read.target_from_source.at(0)
    np.testing.assert_allclose(read.position_m[0], POSITION, atol=1e-12)
    np.testing.assert_allclose(pose.apply(np.array(IN_FRONT) * 1.0), [1, 6, 3], atol=1e-12)
    np.testing.assert_allclose(pose.apply(np.array(ABOVE) * 1.0), [1, 2, 4], atol=1e-12)
    format_ = FORMATS[case.split(",")[0]]
    assert read.names == (("a/b.png",) if format_.has_names else None)
    if read.is_timed and format_.name != "record3d":
        assert read.timestamp_s[0] == 10.5


def test_7scenes_folder(tmp_path):
    folder = tmp_path / "seq-01"
    folder.mkdir()
    rows = "\n".join("\t".join(str(v) for v in row) for row in MATRIX)
    (folder / "frame-000012.pose.txt").write_text(rows)
    for path in (folder, tmp_path):
        read = read_trajectory(path)
        assert read.names == ("seq-01/frame-000012.color.png",)
        front = read.target_from_source.at(0).apply(np.array([0.0, 0, 4]))
        np.testing.assert_allclose(front, [1, 6, 3], atol=1e-12)


def read_one(path, content, name, options=None):
    path.write_text(content)
    return read_trajectory(path, name, options).target_from_source.at(0)


def test_unity_keeps_up_and_right(tmp_path):
    """A Unity camera at (1, 2, 3) without rotation: z is forward and becomes -z."""
    pose = read_one(tmp_path / "ARKit.txt", "a.png 1 2 3 1 0 0 0", "marvin-vio")
    np.testing.assert_allclose(pose.translation_m, [1, 2, -3], atol=1e-12)
    np.testing.assert_allclose(pose.apply(np.array([0, 0, 1.0])), [1, 2, -4], atol=1e-12)
    np.testing.assert_allclose(pose.apply(np.array([0, -1.0, 0])), [1, 3, -3], atol=1e-12)
    np.testing.assert_allclose(pose.apply(np.array([1.0, 0, 0])), [2, 2, -3], atol=1e-12)


def test_unity_turns_to_the_right_about_up(tmp_path):
    """In Unity, +90 degrees about y turns the view from forward to the right."""
    pose = read_one(tmp_path / "ARKit.txt", f"a.png 0 0 0 {HALF} 0 {HALF} 0", "marvin-vio")
    np.testing.assert_allclose(pose.apply(np.array([0, 0, 1.0])), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(pose.apply(np.array([0, -1.0, 0])), [0, 1, 0], atol=1e-12)


def test_advio_truth_is_mirrored_back(tmp_path):
    """Positions are negated in z; a device at rest in its z-up world stands upright."""
    pose = read_one(tmp_path / "pose.csv", "0,1,2,3,1,0,0,0", "advio-gt")
    np.testing.assert_allclose(pose.translation_m, [1, 2, -3], atol=1e-12)
    # The camera of a phone lying on its back looks down: along the device's -z, the world's -y.
    front = pose.apply(np.array([0, 0, 1.0])) - pose.translation_m
    np.testing.assert_allclose(front, [0, -1, 0], atol=1e-12)


def test_advio_rows_before_the_tracker_started_are_left_out(tmp_path):
    path = tmp_path / "arkit.csv"
    path.write_text("0,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0\n2,0,0,0,1,0,0,0\n3,1,0,0,1,0,0,0\n")
    assert read_trajectory(path).timestamp_s.tolist() == [3]
    path.write_text("0,0,0,0,1,0,0,0\n1,1,0,0,1,0,0,0\n")
    assert read_trajectory(path).timestamp_s.tolist() == [0, 1]


def test_nanoseconds_are_rounded_once(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("1403636579763555584,0,0,0,1,0,0,0\n")
    assert read_trajectory(path, "euroc").timestamp_s[0] == 1403636579.763555584


def test_record3d_times(tmp_path):
    path = tmp_path / "metadata"
    pose = [0, 0, 0, 1, 0, 0, 0]
    path.write_text(json.dumps({"fps": 50, "poses": [pose] * 3}))
    assert read_trajectory(path).timestamp_s.tolist() == [0, 0.02, 0.04]
    path.write_text(json.dumps({"fps": 50, "frameTimestamps": [1, 2, 4], "poses": [pose] * 3}))
    assert read_trajectory(path).timestamp_s.tolist() == [1, 2, 4]
    path.write_text(json.dumps({"poses": [pose] * 3}))
    assert not read_trajectory(path).is_timed
    assert read_trajectory(path, None, ReadOptions(rate_hz=2)).timestamp_s.tolist() == [0, 0.5, 1]
