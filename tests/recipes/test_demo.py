"""What the demo ships with: small, sound, and the same files from the same folder."""

from importlib.resources import files
from zipfile import ZipFile

import numpy as np
import pytest

from vioapr.errors import AlreadyExistsError, UnwritableError
from vioapr.files.images import decode_problem
from vioapr.recipes.demo import (
    ARCHIVE_FILE,
    LOCALIZER_FILE,
    RECORDING,
    SCENE_FOLDER,
    demo_in,
    pack_folder,
    unpack_demo,
)
from vioapr.scene.check import check_scene
from vioapr.scene.scene import Scene

SHIPPED = files("vioapr.recipes") / "data"


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    return folder, unpack_demo(folder)


def test_everything_is_where_localize_takes_it(unpacked):
    folder, demo = unpacked
    assert demo == demo_in(folder)
    assert demo.model.read_bytes() == (SHIPPED / LOCALIZER_FILE).read_bytes()
    scene = Scene.open(folder / SCENE_FOLDER)
    assert demo.recording == scene.recording_folder(*scene.splits["test"])
    frames = scene.recording(RECORDING).frames
    assert len(frames.timestamp_s) == 450
    assert not any(decode_problem(demo.recording / "images" / name) for name in frames.image[::50])
    assert np.isfinite(scene.gt(RECORDING).position_m).all()
    names = {path.name for path in folder.iterdir()}
    assert names == {SCENE_FOLDER, LOCALIZER_FILE, ".written.json"}


def test_the_scene_is_sound(unpacked):
    (problem,) = check_scene(unpacked[0] / SCENE_FOLDER).problems
    assert "the split train is empty" in problem.text  # only a test walk is shipped


def test_it_is_small():
    sizes = [len((SHIPPED / name).read_bytes()) for name in (ARCHIVE_FILE, LOCALIZER_FILE)]
    assert sum(sizes) < 12e6


def test_files_of_an_earlier_demo_are_replaced_and_what_others_wrote_stays(unpacked):
    folder, demo = unpacked
    frames = demo.recording / "frames.csv"
    content = frames.read_bytes()
    frames.write_bytes(b"changed")
    with pytest.raises(AlreadyExistsError, match=r"frames\.csv: exists, and vioapr did not write"):
        unpack_demo(folder)
    assert frames.read_bytes() == b"changed"
    frames.unlink()
    demo.model.unlink()
    demo.out.write_bytes(b"results")
    unpack_demo(folder)
    assert frames.read_bytes() == content
    assert demo.model.read_bytes() == (SHIPPED / LOCALIZER_FILE).read_bytes()
    assert demo.out.read_bytes() == b"results"
    demo.out.unlink()


def test_a_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(UnwritableError, match="cannot be written"):
            unpack_demo(folder)


def test_packed_and_unpacked_files_are_byte_equal(tmp_path):
    folder = tmp_path / "place"
    contents = {"a.csv": b"1,2\n" * 1000, "images/1.jpg": bytes(range(256)), "empty.txt": b""}
    for name, content in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    pack_folder(folder, tmp_path / "place.zip")
    with ZipFile(tmp_path / "place.zip") as archive:
        archive.extractall(tmp_path / "out")
    found = {
        path.relative_to(tmp_path / "out" / "place").as_posix(): path.read_bytes()
        for path in (tmp_path / "out").rglob("*")
        if path.is_file()
    }
    assert found == contents


def test_the_same_files_give_the_same_archive(unpacked, tmp_path):
    """Whenever they were written: the archive in the repository changes only with its content."""
    pack_folder(unpacked[0] / SCENE_FOLDER, tmp_path / "again.zip")
    with ZipFile(tmp_path / "again.zip") as again, (SHIPPED / ARCHIVE_FILE).open("rb") as file:
        shipped = ZipFile(file)
        assert again.namelist() == shipped.namelist()
        for mine, theirs in zip(again.infolist(), shipped.infolist(), strict=True):
            assert (mine.CRC, mine.date_time) == (theirs.CRC, theirs.date_time)
