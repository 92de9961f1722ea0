"""Exports of other apps, put as files and imported by a job."""

from __future__ import annotations

import zipfile

import pytest
from tests.importers.sources import COUNT, make_record3d, make_stray
from tests.server.captures import AUTH, put, put_all, sha256, wait_for_job

from vioapr.errors import ParameterError
from vioapr.scene.check import check_scene
from vioapr.scene.scene import Scene
from vioapr.server.names import is_upload_name


def content_of(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def packed(folder, name):
    with zipfile.ZipFile(folder.parent / name, "w") as archive:
        for file, content in content_of(folder).items():
            archive.writestr(f"Scan 7/{file}" if name.endswith(".zip") else file, content)
    return (folder.parent / name).read_bytes()


def in_pieces(name, content, size):
    return {
        f"{name}.{k:03d}": content[k * size : (k + 1) * size]
        for k in range(-(-len(content) // size))
    }


def files_of(kind, folder):
    if kind == "stray folder":
        return content_of(make_stray(folder / "s")), "stray"
    if kind == "stray zip in pieces":
        return in_pieces("scan.zip", packed(make_stray(folder / "s"), "scan.zip"), 3000), "auto"
    return {"noon.r3d": packed(make_record3d(folder / "s"), "noon.r3d")}, "auto"


@pytest.mark.parametrize("kind", ["stray folder", "stray zip in pieces", "record3d"])
def test_an_export_is_imported(open_client, served, tmp_path, kind):
    files, format_ = files_of(kind, tmp_path)
    hashes = {name: sha256(content) for name, content in files.items()}
    wanted = {
        "upload": "u1",
        "files": hashes,
        "format": format_,
        "split": "test",
        "recording": "noon",
    }
    with open_client() as client:
        last = list(files)[-1]
        put_all(client, "u1", {n: c for n, c in files.items() if n != last}, "uploads")
        answer = client.post("/api/scenes/court/imports", json=wanted, headers=AUTH)
        assert (answer.status_code, answer.json()["missing"]) == (409, [last])
        assert put(client, "u1", last, files[last], "uploads").status_code == 201
        answer = client.post("/api/scenes/court/imports", json=wanted, headers=AUTH)
        assert answer.status_code == 202, answer.text
        again = client.post("/api/scenes/court/imports", json=wanted, headers=AUTH)
        assert again.json()["id"] == answer.json()["id"]
        ended = wait_for_job(client, answer.json()["id"])
        assert ended["state"] == "done", client.get(
            f"/api/jobs/{ended['id']}/log", headers=AUTH
        ).text
    assert not check_scene(served.folder / "court").errors
    scene = Scene.open(served.folder / "court")
    assert scene.splits["test"] == ("noon",)
    assert len(scene.recording("noon").frames) == COUNT


def test_an_export_that_is_none_fails_with_the_reason(open_client, served):
    files = {"scan.zip": b"no zip"}
    wanted = {"upload": "u1", "files": {"scan.zip": sha256(b"no zip")}}
    with open_client() as client:
        put_all(client, "u1", files, "uploads")
        answer = client.post("/api/scenes/court/imports", json=wanted, headers=AUTH)
        ended = wait_for_job(client, answer.json()["id"])
        assert (ended["state"], ended["exit_code"]) == ("failed", 2)
        assert (
            "give its --format" in ended["message"] or "nothing that is known" in ended["message"]
        )
        assert client.delete("/api/uploads/u1", headers=AUTH).status_code == 204
    assert Scene.open(served.folder / "court").recording_ids == []


def test_a_killed_server_hands_over_what_was_complete(open_client, served, monkeypatch):
    from vioapr.server.jobs import Jobs

    files = {"scan.zip": b"no zip"}
    wanted = {"upload": "u1", "files": {"scan.zip": sha256(b"no zip")}}

    def killed(self, *given, **more):
        raise ConnectionError("killed")

    client = open_client()
    put_all(client, "u1", files, "uploads")
    with monkeypatch.context() as patch:
        patch.setattr(Jobs, "submit", killed)
        with pytest.raises(ConnectionError):
            client.post("/api/scenes/court/imports", json=wanted, headers=AUTH)
    assert client.get("/api/jobs", headers=AUTH).json() == []
    (found,) = open_client().get("/api/jobs", headers=AUTH).json()
    assert (found["job"]["state"], found["job"]["kind"]) == ("queued", "import")


@pytest.mark.parametrize(
    "change", [{"format": "--help"}, {"format": "stray;ls"}, {"recording": "-x"}]
)
def test_flags_cannot_be_slipped_in(client, change):
    put_all(client, "u1", {"scan.zip": b"x"}, "uploads")
    wanted = {"upload": "u1", "files": {"scan.zip": sha256(b"x")}, **change}
    answer = client.post("/api/scenes/court/imports", json=wanted, headers=AUTH)
    assert answer.status_code == 422


def test_names_of_uploads():
    for name in (
        "a",
        "rgb/000001.png",
        "Scan 1 (2).zip",
        "a/b/c/d/e/f/g/h",
        "_x",
        "export.zip.000",
    ):
        assert is_upload_name(name), name
    for name in ("", "/a", "a//b", "../a", "a/..", "a/.b", ".a", "a\\b", "a\n", "a:b", "é", "-a",
                 "a.", "a ", "a/b/c/d/e/f/g/h/i", "x" * 121, "a/"):  # fmt: skip
        assert not is_upload_name(name), name


def test_what_of_an_upload_is_imported():
    from vioapr.server.handovers import find_source

    def of(*names):
        return find_source(dict.fromkeys(names, "0" * 64))

    assert of("a.zip") == "a.zip"
    assert of("a.zip.001", "a.zip.000") == "a.zip.000"
    assert of("a.csv", "rgb/1.png") == ""
    assert of("a.csv", "frame.000") == ""
    with pytest.raises(ParameterError, match="beside them"):
        of("a.zip.000", "a.zip.001", "b.csv")
