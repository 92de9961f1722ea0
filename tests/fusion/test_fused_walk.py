from dataclasses import replace

import numpy as np
import pytest
from tests.helpers import frames_of

from vioapr.errors import FileMissingError, FormatError
from vioapr.fusion.fused_walk import FusedWalk, read_fused_csv, write_fused_csv
from vioapr.fusion.methods import METHODS
from vioapr.fusion.offline import fuse_walk
from vioapr.fusion.pairing import PairedFrames
from vioapr.geometry.tree import tree_leaves
from vioapr.simulation.walks import WalkParams, simulate_walk


def fused_by(name) -> FusedWalk:
    method = METHODS[name]
    frames = frames_of(simulate_walk(WalkParams(duration_s=10), seed=3))
    lost = frames._replace(tracking_ok=np.arange(20) % 7 != 0, has_apr=np.arange(20) % 5 != 0)
    return fuse_walk(method, method.params_type(), PairedFrames(lost))


@pytest.mark.parametrize("name", ["vio-apr", "chain"])
def test_reading_gives_the_numbers_that_were_written(tmp_path, name):
    fused = fused_by(name)
    assert not fused.is_localized.all()
    write_fused_csv(tmp_path / "fused.csv", fused)
    again = read_fused_csv(tmp_path / "fused.csv")
    # Where the tracking world lies is not written, nor sigmas by axis.
    assert again.world_from_vio is None
    assert again.sigma_position_axes_m is None
    unwritten = ("world_from_vio", "sigma_position_axes_m", "sigma_orientation_axes_deg")
    written = replace(fused, **dict.fromkeys(unwritten))
    ours, theirs = (list(tree_leaves(tuple(vars(walk).values()))) for walk in (written, again))
    assert len(ours) == (8 if name == "chain" else 4)
    for left, right in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(left, right)


def test_the_trajectory_has_the_localized_frames():
    fused = fused_by("vio-apr")
    trajectory = fused.to_trajectory()
    np.testing.assert_array_equal(trajectory.timestamp_s, fused.timestamp_s[fused.is_localized])
    np.testing.assert_array_equal(
        trajectory.position_m, fused.world_from_cam.translation_m[fused.is_localized]
    )


HEADER = "timestamp_s,status,x,y,z,qx,qy,qz,qw\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (HEADER + "0.5,lucky,1,2,3,0,0,0,1\n", r":2: expected one of unlocalized, .* got 'lucky'"),
        (HEADER + "0.5,tracked,1,2,z,0,0,0,1\n", ":2: expected a number, got 'z'"),
        (HEADER + "0.5,tracked,1,2\n", ":2: expected 9 columns"),
        ("timestamp_s,x\n0.5,1\n", "expected a header with the columns status"),
        ("", "the file is empty"),
    ],
)
def test_malformed_files_are_refused(tmp_path, content, message):
    path = tmp_path / "fused.csv"
    path.write_text(content)
    with pytest.raises(FormatError, match=message):
        read_fused_csv(path)


def test_a_missing_file_is_said_to_be_missing(tmp_path):
    with pytest.raises(FileMissingError):
        read_fused_csv(tmp_path / "none.csv")
