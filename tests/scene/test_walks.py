import numpy as np
import pytest
from tests.scene.scenes import make_scene

from vioapr.errors import FileMissingError, FormatError, ParameterError
from vioapr.formats.registry import read_trajectory
from vioapr.formats.stated_sigmas import Sigmas, read_sigmas_beside
from vioapr.scene.walks import (
    find_walks,
    is_sidecar,
    walks_at,
    write_walk,
    write_walk_of_recording,
)
from vioapr.trajectory import Trajectory


def touch(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def test_walks_are_found_below_any_path(tmp_path):
    for walk in ("SetA/walk1", "SetA/walk2", "SetB/walk1"):
        touch(tmp_path / walk, "gt.tum", "vio_sim0.tum", "vio_sim1.csv", "apr_good.tum")
        touch(tmp_path / walk, "apr_bad.tum.gz", "apr_good.sigma.csv", "apr_bad.sigma.csv.gz")
        touch(tmp_path / walk, ".vio_old.tum", "vio_sim0.json", "notes.txt")
    touch(tmp_path / "SetC" / "walk1", "gt.tum", "vio_sim.tum")
    found = find_walks([tmp_path])
    assert [(w.set_name, w.walk) for w in found] == [
        ("SetA", "walk1"), ("SetA", "walk2"), ("SetB", "walk1"),
    ]  # fmt: skip
    assert found[0].gt == tmp_path / "SetA" / "walk1" / "gt.tum"
    assert list(found[0].vios) == ["sim0", "sim1"]
    assert list(found[0].aprs) == ["bad", "good"]
    only = find_walks([tmp_path / "SetB" / "walk1", tmp_path / "SetB"])
    assert [(w.set_name, w.walk) for w in only] == [("SetB", "walk1")]


def test_files_with_a_common_beginning_are_a_walk(tmp_path):
    touch(tmp_path / "Set", "a2_gt.tum", "a2_arkit.tum", "a2_vio_core.tum.gz", "a2_apr_net.tum")
    touch(tmp_path / "Set", "a10_gt.csv", "a10_x.tum", "a10_x.sigma.csv", "b_arkit.tum")
    two, ten = walks_at(tmp_path)
    assert (two.set_name, two.walk, list(two.vios), two.aprs) == (
        "Set",
        "a2",
        ["arkit", "core"],
        {},
    )
    assert (ten.walk, list(ten.vios)) == ("a10", ["x"])
    for beginning in ("a2", "a2_gt.tum"):
        assert list(walks_at(tmp_path / "Set" / beginning)) == [two]
    assert list(walks_at(tmp_path / "Set" / "b")) == []
    with pytest.raises(FormatError, match="expected walks: folders with a file gt"):
        find_walks([tmp_path])


def test_missing_and_empty_folders_are_named(tmp_path):
    with pytest.raises(ParameterError, match="paths: expected at least one folder"):
        find_walks([])
    with pytest.raises(
        FileMissingError, match="nowhere: expected a folder with walks, got nothing"
    ):
        find_walks([tmp_path / "nowhere"])
    with pytest.raises(FormatError, match="expected walks: folders with a file gt"):
        find_walks([tmp_path])
    touch(tmp_path, "gt.tum")
    with pytest.raises(FormatError, match="got a file"):
        find_walks([tmp_path / "gt.tum"])


def test_two_ground_truths_are_refused(tmp_path):
    touch(tmp_path, "gt.tum", "gt.csv", "vio_a.tum", "apr_a.tum")
    with pytest.raises(FormatError, match=r"expected one ground truth file gt.*gt.csv, gt.tum"):
        find_walks([tmp_path])


def test_two_files_of_one_name_are_refused(tmp_path):
    touch(tmp_path, "gt.tum", "vio_a.tum", "vio_a.csv", "apr_a.tum")
    with pytest.raises(FormatError, match="vio_a.tum: expected one file of this name"):
        find_walks([tmp_path])


def test_sidecars_are_no_trajectories(tmp_path):
    names = ("apr_a.sigma.csv", "apr_a.sigma.csv.gz", "vio_a.json", "vio_a.csv", "sigma.csv")
    assert [is_sidecar(tmp_path / name) for name in names] == [True, True, True, False, False]


def test_a_written_walk_is_found_and_read(tmp_path):
    track = Trajectory.from_arrays(
        np.arange(3.0), np.arange(9.0).reshape(3, 3), np.tile([0.0, 0, 0, 1], (3, 1))
    )
    folder = tmp_path / "Set" / "walk"
    sigmas = Sigmas(np.array([1.0, 2, 3]), np.array([4.0, 5, 6]))
    write_walk(folder, aprs={"net": track}, apr_sigmas={"net": sigmas})
    write_walk(folder, gt=track, vios={"sim": track})
    (walk,) = find_walks([tmp_path])
    for path in (walk.gt, walk.vios["sim"], walk.aprs["net"]):
        np.testing.assert_array_equal(read_trajectory(path).position_m, track.position_m)
    stated = read_sigmas_beside(walk.aprs["net"], track)
    assert stated is not None
    np.testing.assert_allclose(stated, sigmas)
    assert len(list(folder.iterdir())) == 4


def test_a_recording_becomes_a_walk(tmp_path):
    scene = make_scene(tmp_path / "scene", 4)
    assert write_walk_of_recording(tmp_path / "walk-1", scene, "walk-1")
    scene.gt_path("walk-2").unlink()
    assert not write_walk_of_recording(tmp_path / "walk-2", scene, "walk-2")
    assert {p.relative_to(tmp_path).as_posix() for p in tmp_path.glob("walk-*/*")} == {
        "walk-1/gt.tum", "walk-1/vio_arkit.tum", "walk-2/vio_arkit.tum",
    }  # fmt: skip
