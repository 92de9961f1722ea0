"""What a user has is never destroyed: inputs, results that are there, files in folders."""

import errno
import os
from pathlib import Path

import pytest


@pytest.fixture
def fuse(walk_dir):
    """The words of `vioapr fuse` but its outputs."""
    return ("fuse", "--apr", walk_dir / "apr_net.tum", "--vio", walk_dir / "vio_sim.tum")


def content_of(folder):
    return {
        path.relative_to(folder): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not path.name.startswith(".")
    }


@pytest.mark.parametrize("name", ["apr_net.tum", "vio_sim.tum"])
@pytest.mark.parametrize("flag", ["--out", "--tum"])
@pytest.mark.parametrize("link", [None, "symbolic", "hard"])
def test_fuse_never_writes_onto_its_input(fails, fuse, walk_dir, tmp_path, name, flag, link):
    path = tmp_path / "linked" if link else walk_dir / name
    if link == "symbolic":
        path.symlink_to(walk_dir / name)
    elif link == "hard":
        os.link(walk_dir / name, path)
    before = content_of(walk_dir)
    out = () if flag == "--out" else ("--out", tmp_path / "fused.csv")
    line = fails(*fuse, *out, flag, path, "--overwrite")
    assert "is the input" in line
    assert content_of(walk_dir) == before
    assert not (tmp_path / "fused.csv").exists()


def test_fuse_never_writes_onto_the_table_beside_its_predictions(fails, fuse, walk_dir):
    table = walk_dir / "apr_net.sigma.csv"
    table.write_text("timestamp_s,sigma_position_m,sigma_orientation_deg\n")
    assert "is the input" in fails(*fuse, "--out", table, "--overwrite")


def test_a_result_is_kept_unless_the_user_says_so(run, fails, fuse, tmp_path):
    out, tum = tmp_path / "fused.csv", tmp_path / "fused.tum"
    tum.write_text("precious")
    line = fails(*fuse, "--out", out, "--tum", tum)
    assert "fused.tum: exists: choose another name, or give --overwrite" in line
    assert (tum.read_text(), out.exists()) == ("precious", False)
    assert run(*fuse, "--out", out, "--tum", tum, "--overwrite")[0] == 0
    assert tum.read_text() != "precious"


def test_two_outputs_need_two_files(fails, fuse, tmp_path):
    assert "also another output" in fails(*fuse, "--out", tmp_path / "f", "--tum", tmp_path / "f")


def test_a_full_disk_spares_an_earlier_result(fails, fuse, tmp_path, monkeypatch):
    out = tmp_path / "fused.csv"
    out.write_text("earlier")

    def fail(self, content):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", fail)
    assert "fused.csv: cannot be written: No space left" in fails(
        *fuse, "--out", out, "--overwrite"
    )
    assert out.read_text() == "earlier"
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("flag", ["--json", "--csv"])
def test_evaluate_keeps_results_and_inputs(fails, walk_dir, tmp_path, flag):
    before = content_of(walk_dir)
    line = fails("evaluate", walk_dir, flag, walk_dir / "gt.tum", "--overwrite")
    assert "is the input" in line
    assert content_of(walk_dir) == before
    (tmp_path / "out").write_text("precious")
    assert "give --overwrite" in fails("evaluate", walk_dir, flag, tmp_path / "out")
    assert (tmp_path / "out").read_text() == "precious"


def test_a_page_of_the_user_is_no_report(fails, walk_dir, tmp_path):
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "index.html").write_text("my page")
    line = fails("evaluate", walk_dir, "--report", tmp_path / "site")
    assert "index.html: exists, and vioapr did not write it" in line
    assert "or give --overwrite" in line
    assert content_of(tmp_path / "site") == {Path("index.html"): b"my page"}


@pytest.mark.slow
def test_a_report_is_replaced_and_other_files_in_its_folder_stay(run, walk_dir, tmp_path):
    folder = tmp_path / "report"
    assert run("evaluate", walk_dir, "--methods", "apr", "--report", folder)[0] == 0
    first = (folder / "index.html").read_bytes()
    (folder / "notes.txt").write_text("mine")
    assert run("evaluate", walk_dir, "--methods", "apr,vio", "--report", folder)[0] == 0
    assert (folder / "index.html").read_bytes() != first
    assert (folder / "notes.txt").read_text() == "mine"


def test_vio_quality_keeps_results_and_inputs(run, fails, walk_dir, tmp_path):
    words = ("vio-quality", walk_dir)
    assert "is the input" in fails(*words, "--json", walk_dir / "vio_sim.tum", "--overwrite")
    (tmp_path / "vio_drift.png").write_bytes(b"mine")
    line = fails(*words, "--figures", tmp_path)
    assert "vio_drift.png: exists, and vioapr did not write it" in line
    assert (tmp_path / "vio_drift.png").read_bytes() == b"mine"
    figures = tmp_path / "figures"
    for _ in range(2):
        assert run(*words, "--figures", figures)[0] == 0
    assert {path.suffix for path in content_of(figures)} == {".png", ".svg"}


def test_convert_leaves_nothing_of_a_folder_on_a_full_disk(fails, walk_dir, tmp_path, monkeypatch):
    writes = []
    write = Path.write_bytes

    def fill_up(self, content):
        writes.append(self)
        if len(writes) > 5:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(self, content)

    monkeypatch.setattr(Path, "write_bytes", fill_up)
    words = ("convert", walk_dir / "gt.tum", tmp_path / "poses", "--to", "7scenes")
    assert "No space left" in fails(*words)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["Set"]


def test_convert_writes_no_file_into_the_folder_that_it_reads(run, fails, walk_dir, tmp_path):
    model = tmp_path / "model"
    assert run("convert", walk_dir / "gt.tum", model, "--to", "colmap")[0] == 0
    before = content_of(model)
    line = fails("convert", model, model / "images.txt", "--to", "colmap", "--overwrite")
    assert "input" in line
    assert content_of(model) == before


def test_scene_info_keeps_results_and_the_scene(fails, tmp_path):
    from vioapr.scene.scene import Scene

    scene = Scene.create(tmp_path / "scene", "Place", is_outdoor=True)
    toml = scene.folder / "scene.toml"
    before = toml.read_bytes()
    words = ("scene", "info", scene.folder, "--json")
    assert "is the input" in fails(*words, toml, "--overwrite")
    assert toml.read_bytes() == before
    (tmp_path / "out.json").write_text("precious")
    assert "give --overwrite" in fails(*words, tmp_path / "out.json")


def test_simulated_walks_replace_walks_that_were_simulated(run, fails, tmp_path):
    out = tmp_path / "walks"
    assert run("simulate", "walks", "--out", out, "--walks", 1)[0] == 0
    (out / "walk01" / "notes.txt").write_text("mine")
    assert run("simulate", "walks", "--out", out, "--walks", 2, "--seed", 3)[0] == 0
    assert (out / "walk01" / "notes.txt").read_text() == "mine"
    (out / "walk02" / "vio_sim.tum").write_text("mine")
    before = content_of(out)
    line = fails("simulate", "walks", "--out", out, "--walks", 2)
    assert "vio_sim.tum: exists, and vioapr did not write it" in line
    assert content_of(out) == before
    assert run("simulate", "walks", "--out", out, "--walks", 2, "--overwrite")[0] == 0
    assert (out / "walk02" / "vio_sim.tum").read_text() != "mine"


@pytest.mark.parametrize("name", ["localizer.onnx", "fused.csv", "report/index.html"])
def test_a_demo_replaces_no_file_of_the_user(fails, tmp_path, name):
    path = tmp_path / "demo" / name
    path.parent.mkdir(parents=True)
    path.write_text("mine")
    line = fails("demo", "--out", tmp_path / "demo")
    assert f"{name}: exists, and vioapr did not write it" in line
    assert content_of(tmp_path / "demo") == {Path(name): b"mine"}
