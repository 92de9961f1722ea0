"""Packed sources: unpacked whole and inside their folder, or refused before a byte is written."""

from __future__ import annotations

import io
import zipfile

import pytest
from tests.importers.sources import COUNT, make_nerfstudio, make_record3d, make_stray

from vioapr.errors import FormatError, ParameterError, UnwritableError
from vioapr.importers.archives import PiecesReader, find_pieces, opened_source
from vioapr.importers.base import ImportOptions
from vioapr.importers.registry import import_source, is_known
from vioapr.scene.check import check_scene
from vioapr.scene.scene import Scene
from vioapr.work.progress import silent


def pack(folder, path, inside=""):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                archive.write(file, inside + file.relative_to(folder).as_posix())
        archive.writestr("__MACOSX/._x", b"litter")
        archive.writestr(f"{inside}.DS_Store", b"litter")
    return path


def split(path, size):
    content = path.read_bytes()
    path.unlink()
    for number, start in enumerate(range(0, len(content), size)):
        piece = path.with_name(f"{path.name}.{number:03d}")
        piece.write_bytes(content[start : start + size])
    return path.with_name(f"{path.name}.000")


def import_all(source, out, **options):
    return list(
        import_source(None, source, out, ImportOptions(**options), place="indoor", progress=silent)
    )


@pytest.mark.parametrize("inside", ["", "Scan/", "a/b/Scan/"])
@pytest.mark.parametrize("size", [None, 1000])
def test_a_zipped_folder_is_imported_as_the_folder(tmp_path, inside, size):
    source = pack(make_stray(tmp_path / "s"), tmp_path / "walk.zip", inside)
    source = source if size is None else split(source, size)
    (imported,) = import_all(source, tmp_path / "scene")
    assert imported.folder.name == ("Scan" if inside else "walk")
    assert not check_scene(tmp_path / "scene").errors
    recording = Scene.open(tmp_path / "scene").recording(imported.folder.name)
    assert len(recording.frames) == COUNT
    assert recording.frames.has_image.all()
    left = [path.name for path in tmp_path.iterdir() if "partial" in path.name]
    assert left == []
    (again,) = import_all(source, tmp_path / "scene")
    assert "imported before" in again.findings[0].text


def test_record3d_in_pieces(tmp_path):
    source = pack(make_record3d(tmp_path / "s"), tmp_path / "noon.r3d")
    (whole,) = import_all(source, tmp_path / "scene", id="whole")
    (pieces,) = import_all(split(source, 500), tmp_path / "scene")
    assert pieces.folder.name == "noon"
    scene = Scene.open(tmp_path / "scene")
    frames = [scene.recording(one.folder.name).frames for one in (whole, pieces)]
    positions = [one.vio_from_cam.translation_m.tolist() for one in frames]
    assert positions[0] == positions[1]
    assert frames[1].has_image.all()


def test_the_format_is_seen_by_the_files(tmp_path):
    folder = make_nerfstudio(tmp_path / "s")
    (imported,) = import_all(folder, tmp_path / "scene", id="folder")
    (other,) = import_all(folder / "transforms.json", tmp_path / "scene", id="file")
    assert (imported.folder.name, other.folder.name) == ("folder", "file")
    (tmp_path / "odd").mkdir()
    with pytest.raises(ParameterError, match="give its `format`"):
        import_all(tmp_path / "odd", tmp_path / "scene")


def test_a_folder_alone_in_a_zip_may_be_part_of_the_format(tmp_path):
    (tmp_path / "keyframes" / "cameras").mkdir(parents=True)
    (tmp_path / "keyframes" / "cameras" / "1.json").write_text("{}")
    source = pack(tmp_path / "keyframes", tmp_path / "room.zip", "keyframes/")
    with opened_source(source, tmp_path / "scene", silent, is_known) as opened:
        assert opened.path.name == "room"
        assert (opened.path / "keyframes" / "cameras" / "1.json").exists()
    odd = zip_of(tmp_path / "odd.zip", {"a/b/notes.txt": "x"})
    with opened_source(odd, tmp_path / "scene", silent, is_known) as opened:
        assert (opened.path / "a" / "b" / "notes.txt").exists()


def zip_of(path, members):
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


@pytest.mark.parametrize(
    "name", ["../out.txt", "/etc/out.txt", "a/../../out.txt", "..\\out.txt", "C:\\out.txt"]
)
def test_a_zip_that_names_files_outside_is_refused(tmp_path, name):
    source = zip_of(tmp_path / "walk.zip", {"odometry.csv": "x", name: "x"})
    with pytest.raises(FormatError, match="outside of it"):
        import_all(source, tmp_path / "in" / "scene")
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["walk.zip"]


def test_a_link_in_a_zip_becomes_a_file(tmp_path):
    link = zipfile.ZipInfo("link")
    link.external_attr = 0o120777 << 16
    with zipfile.ZipFile(tmp_path / "x.zip", "w") as archive:
        archive.writestr(link, "/etc/passwd")
        archive.writestr("other", "x")
    with opened_source(tmp_path / "x.zip", tmp_path / "scene", silent, is_known) as opened:
        assert not (opened.path / "link").is_symlink()
        assert (opened.path / "link").read_text() == "/etc/passwd"


def test_broken_zips_are_refused(tmp_path):
    whole = pack(make_stray(tmp_path / "s"), tmp_path / "walk.zip").read_bytes()
    middle = len(whole) // 3
    damaged = tmp_path / "damaged.zip"
    damaged.write_bytes(whole[:middle] + bytes(64) + whole[middle + 64 :])
    with pytest.raises(FormatError, match="can be unpacked"):
        import_all(damaged, tmp_path / "scene")
    encrypted = zip_of(tmp_path / "encrypted.zip", {"odometry.csv": "x"})
    content = bytearray(encrypted.read_bytes())
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        content[content.index(mark) + offset] |= 1
    encrypted.write_bytes(content)
    with pytest.raises(FormatError, match="encrypted"):
        import_all(encrypted, tmp_path / "scene")
    with pytest.raises(FormatError, match="found none"):
        import_all(zip_of(tmp_path / "empty.zip", {"__MACOSX/x": ""}), tmp_path / "scene")
    assert not (tmp_path / "scene").exists()


def test_a_zip_that_is_too_large_for_the_disk_is_refused(tmp_path, monkeypatch):
    source = zip_of(tmp_path / "walk.zip", {"odometry.csv": "x" * 1000})
    usage = type("Usage", (), {"free": (256 << 20) + 999})
    monkeypatch.setattr("vioapr.importers.archives.shutil.disk_usage", lambda path: usage)
    with pytest.raises(FormatError, match="the disk has"):
        import_all(source, tmp_path / "scene")


def test_a_missing_piece_is_named(tmp_path):
    first = split(zip_of(tmp_path / "walk.zip", {"a": "x" * 500}), 100)
    (tmp_path / "walk.zip.002").unlink()
    with pytest.raises(FormatError, match="expected a piece 002 beside it, found 003"):
        find_pieces(first)
    (tmp_path / "lonely.zip.004").write_bytes(b"x")
    with pytest.raises(FormatError, match="expected a piece 001"):
        find_pieces(tmp_path / "lonely.zip.004")


def test_pieces_read_as_one_file(tmp_path):
    content = bytes(range(256)) * 3
    source = split_bytes(tmp_path, content, 100)
    with io.BufferedReader(PiecesReader(source)) as file:
        assert file.read() == content
        file.seek(-10, 2)
        assert file.read() == content[-10:]
        file.seek(95)
        assert file.read(10) == content[95:105]


def split_bytes(folder, content, size):
    path = folder / "x.bin"
    path.write_bytes(content)
    return find_pieces(split(path, size))


def test_errors_of_who_reads_pass_as_they_are(tmp_path):
    source = zip_of(tmp_path / "walk.zip", {"a": "x"})
    opened = opened_source(source, tmp_path / "s", silent, is_known)
    with pytest.raises(OSError, match="mine"), opened:
        raise OSError("mine")
    (tmp_path / "file").write_text("")
    opened = opened_source(source, tmp_path / "file" / "s", silent, is_known)
    with pytest.raises(UnwritableError), opened:
        pass
