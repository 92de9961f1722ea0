"""Files that clients put: acknowledged once whole, and nothing else is ever kept."""

from __future__ import annotations

import errno

import pytest
from tests.server.captures import AUTH, TOKEN, make_capture, put, put_all, sha256

from vioapr.server.limits import Limits

NAME = "images/000000.jpg"


def kept(served):
    """All files below the folder around the served one, but for the scene's."""
    around = served.folder.parent
    files = [path for path in around.rglob("*") if path.is_file()]
    return sorted(path.relative_to(served.folder).as_posix() for path in files)


def test_a_file_is_new_then_there_already_then_in_conflict(client, served):
    assert put(client, "walk", NAME, b"one").status_code == 201
    assert put(client, "walk", NAME, b"one").status_code == 200
    refused = put(client, "walk", NAME, b"two")
    assert refused.status_code == 409
    assert "other content" in refused.json()["error"]
    assert (served.captures / "walk" / NAME).read_bytes() == b"one"
    found = client.get("/api/captures/walk", headers=AUTH).json()
    assert found["files"] == {NAME: 3}
    assert not found["is_complete"]


@pytest.mark.parametrize(
    ("headers", "status"),
    [({"x-sha256": sha256(b"other")}, 422), ({"x-sha256": "abc"}, 400), ({"x-sha256": ""}, 400)],
)
def test_a_wrong_hash_keeps_nothing(client, served, headers, status):
    before = kept(served)
    assert put(client, "walk", NAME, b"content", **headers).status_code == status
    assert kept(served) == before


@pytest.mark.parametrize(
    "name",
    [
        "../../escaped.jpg", "images/../../x.jpg", "..%2f..%2fescaped.jpg", "%2e%2e/x",
        "images/..%5cx.jpg", "images/.hidden.jpg", ".complete.json", "images/a/b.jpg",
        "frames-1.csv", "frames-00000.csv.part", "images/000000.exe", "images/a%00.jpg",
        "//etc/passwd", "images/" + 80 * "a" + ".jpg", "images/x.jpg%0a",
    ],
)  # fmt: skip
def test_other_names_are_no_paths(client, served, name):
    before = kept(served)
    assert put(client, "walk", name, b"content").status_code in (400, 404, 405)
    assert kept(served) == before


@pytest.mark.parametrize("id_", ["..", "%2e%2e", ".hidden", "a b", "x" * 101, "a%2fb", "-a"])
def test_other_ids_are_no_folders(client, served, id_):
    before = kept(served)
    assert put(client, id_, NAME, b"content").status_code in (400, 404, 405, 422)
    assert kept(served) == before


def test_links_out_of_the_folder_are_not_followed(client, served, tmp_path):
    outside = tmp_path / "outside.jpg"
    (served.captures / "walk" / "images").mkdir(parents=True)
    (served.captures / "walk" / NAME).symlink_to(outside)
    assert put(client, "walk", NAME, b"content").status_code == 409
    assert not outside.exists()
    outside.write_bytes(b"content")
    assert put(client, "walk", NAME, b"content").status_code == 409


def test_long_bodies_are_refused_declared_or_not(open_client, served):
    client = open_client(limits=Limits(max_file_bytes=1000))
    before = kept(served)
    assert put(client, "walk", NAME, bytes(1001)).status_code == 413

    def endless():
        for _ in range(10_000):
            yield bytes(500)

    headers = {"x-sha256": sha256(b""), **AUTH}
    answer = client.put(f"/api/captures/walk/files/{NAME}", content=endless(), headers=headers)
    assert answer.status_code == 413
    assert kept(served) == before
    assert put(client, "walk", NAME, bytes(1000)).status_code == 201


def test_too_many_files_and_a_full_disk_are_refused(open_client):
    client = open_client(limits=Limits(max_files=2))
    for k in range(2):
        assert put(client, "walk", f"images/{k}.jpg", b"x").status_code == 201
    assert put(client, "walk", "images/2.jpg", b"x").status_code == 413
    full = open_client(limits=Limits(min_free_bytes=1 << 62))
    assert put(full, "other", NAME, b"x").status_code == 507


def test_a_disk_that_is_full_keeps_nothing_and_says_so(client, served, monkeypatch):
    def full(file):
        raise OSError(errno.ENOSPC, "No space left on device")

    before = kept(served)
    with monkeypatch.context() as patch:
        patch.setattr("vioapr.server.transfers.os.fsync", full)
        answer = put(client, "walk", NAME, b"x")
    assert (answer.status_code, answer.json()["error"]) == (507, "the server's disk is full")
    assert kept(served) == before
    assert put(client, "walk", NAME, b"x").status_code == 201


def test_what_was_half_received_is_removed_at_the_start(open_client, served):
    open_client()
    (served.parts / "0123.part").write_bytes(b"half")
    (served.parts / "4567.part").mkdir()
    open_client()
    assert list(served.parts.iterdir()) == []


def test_completing_says_what_is_missing(client):
    capture = make_capture()
    wanted = {"files": capture.hashes, "scene": "court", "recording": "noon"}
    files = dict(capture.files)
    left = [files.popitem()[0], files.popitem()[0]]
    put_all(client, "walk", files)
    answer = client.post("/api/captures/walk/complete", json=wanted, headers=AUTH)
    assert answer.status_code == 409
    assert answer.json()["missing"] == sorted(left)
    put_all(client, "walk", {name: capture.files[name] for name in left})
    changed = {**wanted, "files": {**capture.hashes, "images/000001.jpg": sha256(b"other")}}
    answer = client.post("/api/captures/walk/complete", json=changed, headers=AUTH)
    assert answer.status_code == 409
    assert answer.json()["missing"] == ["images/000001.jpg"]
    files = {name: one for name, one in capture.hashes.items() if name != "capture.json"}
    answer = client.post(
        "/api/captures/walk/complete", json={**wanted, "files": files}, headers=AUTH
    )
    assert (answer.status_code, answer.json()["missing"]) == (409, ["capture.json"])


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"scene": "nowhere"}, 404),
        ({"scene": "../court"}, 422),
        ({"recording": "../noon"}, 422),
        ({"split": "all"}, 422),
        ({"files": {}}, 409),
        ({"files": {"capture.json": "no hash"}}, 422),
        ({"more": 1}, 422),
    ],
)
def test_odd_completions_are_refused(client, change, status):
    capture = make_capture()
    put_all(client, "walk", capture.files)
    wanted = {"files": capture.hashes, "scene": "court", "recording": "noon", **change}
    answer = client.post("/api/captures/walk/complete", json=wanted, headers=AUTH)
    assert answer.status_code == status, answer.text
    assert not client.get("/api/captures/walk", headers=AUTH).json()["is_complete"]


def test_a_complete_capture_stays_as_it_is(client):
    capture = make_capture()
    put_all(client, "walk", capture.files)
    wanted = {"files": capture.hashes, "scene": "court", "recording": "noon"}
    first = client.post("/api/captures/walk/complete", json=wanted, headers=AUTH)
    assert first.status_code == 200
    assert first.json()["state"] == "queued"
    again = client.post("/api/captures/walk/complete", json=wanted, headers=AUTH)
    assert (again.status_code, again.json()["id"]) == (200, first.json()["id"])
    assert put(client, "walk", "images/999999.jpg", b"late").status_code == 409
    assert put(client, "walk", "capture.json", capture.files["capture.json"]).status_code == 200
    assert client.delete("/api/captures/walk", headers=AUTH).status_code == 409
    put_all(client, "other", capture.files)
    answer = client.post("/api/captures/other/complete", json=wanted, headers=AUTH)
    assert answer.status_code == 409
    assert "becomes this one" in answer.json()["error"]


def test_files_that_the_list_lacks_are_said(client):
    capture = make_capture()
    put_all(client, "walk", {**capture.files, "images/extra.jpg": b"x"})
    wanted = {"files": capture.hashes, "scene": "court", "recording": "noon"}
    answer = client.post("/api/captures/walk/complete", json=wanted, headers=AUTH)
    assert answer.status_code == 409
    assert "images/extra.jpg" in answer.json()["error"]


def test_a_capture_can_be_thrown_away(client, served):
    put(client, "walk", NAME, b"x")
    assert client.delete("/api/captures/walk", headers=AUTH).status_code == 204
    assert client.get("/api/captures", headers=AUTH).json() == []
    assert client.delete("/api/captures/walk", headers=AUTH).status_code == 404
    assert list(served.parts.iterdir()) == []


def test_a_body_that_stops_coming_is_given_up(served, monkeypatch):
    monkeypatch.setattr("vioapr.server.access._HEARD_OUT_S", 0.05)
    answers = ask_slowly(served, Limits(idle_s=0.05), body=[b"half"])
    assert answers[0]["status"] == 408
    assert (b"connection", b"close") in answers[0]["headers"]
    assert list(served.parts.iterdir()) == []


def ask_slowly(served, limits, body):
    """Put a file of which some blocks come, and then nothing any more."""
    import anyio

    from vioapr.server.app import make_app

    blocks, answers = list(body), []

    async def receive():
        if not blocks:
            await anyio.sleep(60)
        return {"type": "http.request", "body": blocks.pop(0), "more_body": True}

    async def send(message):
        answers.append(message)

    headers = [(b"authorization", AUTH["authorization"].encode())]
    headers.append((b"x-sha256", sha256(b"whole").encode()))
    path = f"/api/captures/walk/files/{NAME}"
    scope = {
        "type": "http", "method": "PUT", "path": path, "raw_path": path.encode(),
        "query_string": b"", "headers": headers, "root_path": "", "scheme": "http",
    }  # fmt: skip
    anyio.run(make_app(served, TOKEN, limits=limits), scope, receive, send)
    return answers
