import pytest

from vioapr.recipes.datasets import DATA_SETS
from vioapr.work.locks import locked_folder


@pytest.fixture
def data(tmp_path):
    pytest.importorskip("torch", reason="PyTorch is not installed")
    folder = tmp_path / "data" / "Square"
    folder.mkdir(parents=True)
    (folder / "train.txt").touch()
    (folder / "test.txt").touch()
    return folder.parent


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        (("--models", "posenet,mobile"), "--models: expected some of posenet, ms-transformer, got"),
        (("--models", ","), "--models: expected some of posenet, ms-transformer, got none"),
        (("--scenes", "Yard"), "--scenes: expected some of Square, Church"),
        (("--scenes", "Bar"), "expected scenes of MARViN: folders named Bar with train.txt"),
        (("--epochs", "0"), "--epochs: expected at least 1, got 0"),
        (("--batch-size", "0"), "--batch-size: expected at least 1, got 0"),
        (("--lr", "nan"), "--lr: expected a number above 0, got nan"),
        (("--crop", "300"), "got --crop 300 and --resize 256"),
        (("--weights-posenet", "none.pth"), "none.pth: expected weights of posenet's backbone"),
    ],
)
def test_what_cannot_be_is_refused(fails, data, tmp_path, flags, expected):
    out = tmp_path / "out"
    assert expected in fails("reproduce", "marvin", "--data", data, "--out", out, *flags)
    assert not out.exists()


@pytest.mark.parametrize("name", DATA_SETS)
def test_a_folder_without_scenes_is_refused(fails, data, tmp_path, name):
    (tmp_path / "empty").mkdir()
    line = fails("reproduce", name, "--data", tmp_path / "empty", "--out", tmp_path / "out")
    assert f"expected scenes of {DATA_SETS[name].title}" in line
    line = fails("reproduce", name, "--data", tmp_path / "none", "--out", tmp_path / "out")
    assert f"expected the folder of {DATA_SETS[name].title}, found nothing" in line


def test_an_empty_scene_is_refused(fails, data, tmp_path):
    line = fails("reproduce", "marvin", "--data", data, "--out", tmp_path / "out")
    assert "train.txt" in line


def test_out_must_be_a_folder(fails, data, tmp_path):
    (tmp_path / "out").touch()
    line = fails("reproduce", "marvin", "--data", data, "--out", tmp_path / "out")
    assert "out: cannot be written" in line


def test_a_report_of_the_user_is_kept(fails, data, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "reproduction.md").write_text("mine")
    line = fails("reproduce", "marvin", "--data", data, "--out", out)
    assert "reproduction.md: exists, and vioapr did not write it" in line
    assert "or give --overwrite" in line
    assert [path.name for path in out.iterdir()] == ["reproduction.md"]


def test_one_process_reproduces_in_a_folder(fails, data, tmp_path):
    out = tmp_path / "out"
    with locked_folder(out):
        line = fails("reproduce", "marvin", "--data", data, "--out", out)
    assert "out: in use by process" in line
