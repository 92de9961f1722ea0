"""What a user has is never destroyed: inputs, results that are there, files in folders."""

import errno
import importlib
import os
from pathlib import Path

import pytest

from vioapr.formats.registry import read_trajectory


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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.parametrize(
    "name", ["localizer.onnx", "fused.csv", "predictions.tum", "report/index.html"]
)
def test_a_demo_replaces_no_file_of_the_user(fails, tmp_path, name):
    path = tmp_path / "demo" / name
    path.parent.mkdir(parents=True)
    path.write_text("mine")
    line = fails("demo", "--out", tmp_path / "demo")
    assert f"{name}: exists, and vioapr did not write it" in line
    assert content_of(tmp_path / "demo") == {Path(name): b"mine"}


def test_fewer_simulated_walks_leave_none_of_the_earlier_ones(run, tmp_path):
    out = tmp_path / "walks"
    assert run("simulate", "walks", "--out", out, "--walks", 3)[0] == 0
    (out / "walk03" / "notes.txt").write_text("mine")
    assert run("simulate", "walks", "--out", out, "--walks", 1)[0] == 0
    assert sorted(path.name for path in out.iterdir() if path.is_dir()) == ["walk01", "walk03"]
    assert [path.name for path in (out / "walk03").iterdir()] == ["notes.txt"]


@pytest.mark.slow
@pytest.mark.parametrize("flags", [(), ("--overwrite",)])
@pytest.mark.parametrize("flag", ["--out", "--tum"])
def test_of_two_fusions_to_one_file_one_is_refused(
    run, fails, fuse, tmp_path, monkeypatch, flag, flags
):
    """The other one writes it while this one fuses; both began when there was none."""
    verb = importlib.import_module("vioapr.cli.fuse")
    path = tmp_path / "wanted"
    fuse_walk = verb.fuse_walk

    def fuse_slowly(*args, **options):
        path.write_text("by the other")
        return fuse_walk(*args, **options)

    monkeypatch.setattr(verb, "fuse_walk", fuse_slowly)
    words = (*fuse, flag, path, *(() if flag == "--out" else ("--out", tmp_path / "fused")), *flags)
    if flags:
        assert run(*words)[0] == 0
        assert path.read_text() != "by the other"
    else:
        assert "wanted: exists now, and did not before: choose another name" in fails(*words)
        assert path.read_text() == "by the other"


def poses_of(path, count, folder):
    """A file of the first poses of another."""
    lines = path.read_text().splitlines()[: count + 1]
    folder.mkdir(exist_ok=True)
    (folder / "short.tum").write_text("\n".join(lines) + "\n")
    return folder / "short.tum"


@pytest.mark.slow
@pytest.mark.parametrize("first", ["7scenes", "scannet", "colmap", "colmap-binary"])
@pytest.mark.parametrize("second", ["7scenes", "scannet", "colmap", "colmap-binary"])
def test_a_folder_that_is_overwritten_holds_the_new_poses_alone(
    run, fails, walk_dir, tmp_path, first, second
):
    """Fewer of them, in the same format or another; what the user put there stays, and is told."""
    gt, out = walk_dir / "gt.tum", tmp_path / "poses"
    assert run("convert", gt, out, "--to", first)[0] == 0
    (out / "notes.md").write_text("mine")
    short = poses_of(gt, 7, tmp_path / "short")
    assert "give --overwrite" in fails("convert", short, out, "--to", second)
    code, said, _ = run("convert", short, out, "--to", second, "--overwrite")
    assert code == 0
    assert "kept notes.md, which vioapr did not write" in " ".join(said.split())
    assert run("convert", short, tmp_path / "fresh", "--to", second)[0] == 0
    assert content_of(out) == {**content_of(tmp_path / "fresh"), Path("notes.md"): b"mine"}
    assert len(read_trajectory(out)) == 7


@pytest.mark.parametrize(
    ("format_name", "name"),
    [
        ("7scenes", "frame-000100.pose.txt"),
        ("7scenes", "seq-02/frame-000000.pose.txt"),
        ("scannet", "900.txt"),
        ("colmap", "points3D.bin"),
        ("colmap-binary", "images.txt"),
    ],
)
def test_poses_of_others_are_not_mixed_with_new_ones(
    run, fails, walk_dir, tmp_path, format_name, name
):
    short, out = poses_of(walk_dir / "gt.tum", 7, tmp_path / "short"), tmp_path / "poses"
    (out / name).parent.mkdir(parents=True)
    (out / name).write_text("mine")
    line = fails("convert", short, out, "--to", format_name, "--overwrite")
    assert f"{name}: would be read as a part of the result, and vioapr did not write it" in line
    assert content_of(out) == {Path(name): b"mine"}
