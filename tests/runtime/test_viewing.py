"""The browser's scene and the rerun file hold what was localized."""

import urllib.request

import numpy as np
import pytest
from PIL import Image
from tests.localizers import pictures, vio_pose

from vioapr.errors import UnwritableError
from vioapr.fusion.types import Status
from vioapr.geometry import rigid
from vioapr.runtime.viewing import STATUS_RGB, BrowserView, RerunFile
from vioapr.runtime.walk import WalkFrames, localize

pytestmark = pytest.mark.slow
pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
FRAMES = 6


@pytest.fixture
def frames(walk, tmp_path):
    paths = []
    for row, picture in zip(range(FRAMES), pictures(walk), strict=False):
        paths.append(tmp_path / f"{row}.png")
        Image.fromarray(picture).save(paths[-1])
    poses = rigid.stack([vio_pose(walk, row) for row in range(FRAMES)])
    resets = np.zeros(FRAMES, dtype=bool)
    times = walk.gt.timestamp_s[:FRAMES]
    return WalkFrames("walk", times, (*paths[:-1], None), poses, resets, walk.gt)


def test_the_browser_view_is_served_on_this_machine(frames, model_of):
    pytest.importorskip("viser", reason="viser is not installed")
    from vioapr.runtime.localizer import OnnxLocalizer

    said = []
    view = BrowserView(frames, said.append)
    try:
        localize(OnnxLocalizer(model_of("chain")), frames, view.add)
        (line,) = said
        url = line.removeprefix("view: ")
        assert url.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(url, timeout=10) as page:
            assert page.status == 200
        names = set(view.server.scene._handle_from_node_name)
        assert {f"/frames/{row}" for row in range(FRAMES)} <= names
        assert {"/gt", "/uncertainty"} <= names
    finally:
        view.server.stop()


def test_the_rerun_file_has_every_frame(frames, model_of, tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    from vioapr.runtime.localizer import OnnxLocalizer

    path = tmp_path / "walk.rrd"
    view = RerunFile(frames, path)
    localize(OnnxLocalizer(model_of("chain")), frames, view.add)
    view.finish()
    content = path.read_bytes()
    assert content[:3] == b"RRF"
    for name in (b"world/fused", b"world/gt", b"world/uncertainty"):
        assert name in content
    with pytest.raises(UnwritableError, match="its folder does not exist"):
        RerunFile(frames, tmp_path / "none" / "walk.rrd")


def test_every_status_has_a_colour():
    assert set(STATUS_RGB) == set(Status)
    assert len(set(STATUS_RGB.values())) == len(Status)
