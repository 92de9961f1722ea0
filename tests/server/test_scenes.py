"""What clients read: scenes, recordings, localizers, content; and what they may change of it."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from tests.formats.test_colmap_points import content_of
from tests.scene.scenes import make_scene
from tests.server.captures import AUTH

from vioapr.recipes.demo import unpack_demo

ANCHOR = {"label": "door", "position_m": [1.0, 2.0, 0.0]}
ANCHORS = {"format": "vioapr anchors", "version": 1, "scene": "Courtyard", "anchors": [ANCHOR]}


@pytest.fixture
def hall(served):
    return make_scene(served.folder / "hall")


def get(client, path, **headers):
    return client.get(path, headers={**AUTH, **headers})


def test_scenes_are_listed_made_and_described(client, served, hall):
    made = {"id": "yard", "name": "Yard", "is_outdoor": True}
    assert client.post("/api/scenes", json=made, headers=AUTH).status_code == 201
    assert client.post("/api/scenes", json=made, headers=AUTH).status_code == 409
    for bad in ("../yard", ".yard", "a/b", ""):
        answer = client.post("/api/scenes", json={**made, "id": bad}, headers=AUTH)
        assert answer.status_code == 422
    (served.folder / "with space").mkdir()
    (served.folder / "with space" / "scene.toml").write_text("")
    (served.folder / "broken").mkdir()
    (served.folder / "broken" / "scene.toml").write_text("version = ")
    found = {one["id"]: one for one in get(client, "/api/scenes").json()}
    assert list(found) == ["broken", "court", "hall", "with space", "yard"]
    assert "expected TOML" in found["broken"]["problem"]
    assert "letters, digits" in found["with space"]["problem"]
    assert found["hall"]["recordings"] == {"walk-1": "train", "walk-2": "test"}
    assert (found["yard"]["name"], found["yard"]["has_map"]) == ("Yard", False)
    assert get(client, "/api/scenes/nowhere").status_code == 404
    summary = get(client, "/api/scenes/hall/summary").json()
    assert summary["images"] == {"train": 10, "test": 10}
    assert get(client, "/api/scenes/hall/map").status_code == 404


def test_the_points_of_a_map(client, served, monkeypatch):
    path = "/api/scenes/court/map/points"
    assert get(client, path).status_code == 404
    (served.folder / "court" / "map").mkdir()
    (served.folder / "court" / "map" / "points3D.bin").write_bytes(content_of(10))
    answer = get(client, path)
    rows = np.frombuffer(answer.content, dtype=[("xyz", "<f4", 3), ("rgb", "u1", 4)])
    assert rows["xyz"][3].tolist() == [3.0, 6.0, -1.5]
    assert rows["rgb"][3].tolist() == [3, 7, 255, 0]
    assert len(rows) == 10
    known = get(client, path, **{"if-none-match": answer.headers["etag"]})
    assert (known.status_code, known.content) == (304, b"")
    monkeypatch.setattr("vioapr.server.scenes._MAX_POINTS", 4)
    fewer = np.frombuffer(get(client, path).content, dtype=[("xyz", "<f4", 3), ("rgb", "u1", 4)])
    assert fewer["xyz"][:, 0].tolist() == [0.0, 3.0, 6.0, 9.0]


def test_files_of_recordings(client, hall):
    folder = hall.recording_folder("walk-1")
    for name in ("recording.json", "frames.csv", "images/frame-3.jpg"):
        answer = get(client, f"/api/scenes/hall/recordings/walk-1/files/{name}")
        assert answer.content == (folder / name).read_bytes()
    gt = get(client, "/api/scenes/hall/recordings/walk-1/gt")
    assert gt.content == hall.gt_path("walk-1").read_bytes()
    part = get(client, "/api/scenes/hall/recordings/walk-1/files/frames.csv", range="bytes=0-10")
    assert (part.status_code, part.content) == (206, b"timestamp_s")


@pytest.mark.parametrize(
    "path",
    [
        "hall/recordings/walk-1/files/imu.csv",
        "hall/recordings/walk-1/files/images/none.jpg",
        "hall/recordings/walk-1/files/images/..%2f..%2fscene.toml",
        "hall/recordings/walk-1/files/..%2f..%2fscene.toml",
        "hall/recordings/walk-1/files/%2fetc%2fpasswd",
        "hall/recordings/walk-1/files/images/.hidden",
        "hall/recordings/walk-1/files/images/..",
        "hall/recordings/walk-1/files/.import.json",
        "hall/recordings/..%2f..%2f/files/scene.toml",
        "hall/recordings/../gt",
        "../.vioapr-server/token",
        ".vioapr-server",
    ],
)
def test_other_files_are_not_given_out(client, hall, path):
    (hall.recording_folder("walk-1") / "images" / ".hidden").write_text("secret")
    assert get(client, f"/api/scenes/{path}").status_code in (404, 422)


def test_localizers_by_hash(client, served):
    demo = unpack_demo(served.folder)
    (served.folder / "other.onnx").write_bytes(b"no ONNX")
    (served.folder / "court" / "build").mkdir()
    (served.folder / "court" / "build" / "localizer.onnx").write_bytes(demo.model.read_bytes())
    found = {one["path"]: one for one in get(client, "/api/localizers").json()}
    assert list(found) == ["localizer.onnx", "court/build/localizer.onnx"]
    one, sha256 = found["localizer.onnx"], hashlib.sha256(demo.model.read_bytes()).hexdigest()
    assert (one["sha256"], one["scene"]) == (sha256, "")
    assert found["court/build/localizer.onnx"]["scene"] == "court"
    assert one["contract"]["method"] == "chain"
    assert {spec["name"] for spec in one["contract"]["inputs"]} >= {"image", "state"}
    answer = get(client, "/api/localizers/localizer.onnx")
    assert answer.content == demo.model.read_bytes()
    assert answer.headers["etag"] == f'"{sha256}"'
    known = get(client, "/api/localizers/localizer.onnx", **{"if-none-match": f'"{sha256}"'})
    assert (known.status_code, known.content) == (304, b"")
    for path in ("other.onnx", "none.onnx", "court/scene.toml", "..%2fx.onnx"):
        assert get(client, f"/api/localizers/{path}").status_code in (404, 422)


def test_content_is_replaced_only_by_who_has_read_it(client, served):
    path = "/api/scenes/court/anchors"
    assert get(client, path).status_code == 404

    def put(json, **headers):
        return client.put(path, json=json, headers={**AUTH, **headers})

    assert put(ANCHORS).status_code == 412
    first = put(ANCHORS, **{"if-none-match": "*"})
    assert first.status_code == 204
    read = get(client, path)
    assert read.headers["etag"] == first.headers["etag"]
    assert read.json()["anchors"][0]["label"] == "door"
    moved = {**ANCHORS, "anchors": [{**ANCHOR, "position_m": [5.0, 2.0, 0.0]}]}
    second = put(moved, **{"if-match": first.headers["etag"]})
    assert second.status_code == 204
    assert put(ANCHORS, **{"if-match": first.headers["etag"]}).status_code == 412
    assert put(ANCHORS, **{"if-none-match": "*"}).status_code == 412
    tag = second.headers["etag"]
    for bad in ({}, {**ANCHORS, "anchors": []}, {**ANCHORS, "anchors": [{"position_m": [1, 2]}]}):
        assert put(bad, **{"if-match": tag}).status_code == 422
    for model in ("../../token", "/etc/passwd", "a/../../x.glb", ".hidden.glb", "a\\b.glb"):
        odd = {**ANCHORS, "anchors": [{**ANCHOR, "model": model}]}
        assert put(odd, **{"if-match": tag}).status_code == 422, model
    assert get(client, path).headers["etag"] == tag
    assert get(client, "/api/scenes/court").json()["has_anchors"]


def test_only_models_that_the_content_names(client, served):
    folder = served.folder / "court"
    (folder / "models").mkdir()
    (folder / "models" / "bunny.glb").write_bytes(b"glTF")
    content = {**ANCHORS, "anchors": [{**ANCHOR, "model": "models/bunny.glb"}]}
    headers = {**AUTH, "if-none-match": "*"}
    client.put("/api/scenes/court/anchors", json=content, headers=headers)
    answer = get(client, "/api/scenes/court/anchors/files/models/bunny.glb")
    assert (answer.content, answer.headers["content-type"]) == (b"glTF", "model/gltf-binary")
    for path in ("scene.toml", "anchors.json", "models/other.glb", "../hall/scene.toml"):
        assert get(client, f"/api/scenes/court/anchors/files/{path}").status_code == 404


def test_a_build_is_queued_once(client, served):
    asked = client.post("/api/scenes/court/build", json={"refine": True}, headers=AUTH)
    assert asked.status_code == 202
    assert asked.json()["arguments"] == ["build", "court", "--refine"]
    again = client.post("/api/scenes/court/build", json={}, headers=AUTH)
    assert again.json() == asked.json()
    assert get(client, "/api/scenes/court/build").status_code == 404
    (served.folder / "court" / "build").mkdir()
    (served.folder / "court" / "build" / "build.json").write_text("{}")
    assert get(client, "/api/scenes/court/build").json() == {}
    assert client.post("/api/scenes/none/build", json={}, headers=AUTH).status_code == 404
    assert client.post("/api/scenes/court/build", json={"x": 1}, headers=AUTH).status_code == 422
