"""Coverage-guided fuzzing of every reader and of archives: no traceback, no hang, bounded memory.

    pip install atheris
    python benchmarks/fuzz_readers.py [--cpu-minutes 60] [--only FORMAT ...] [--json FILE] \
        [--update-docs]

Every format's reader gets files that atheris (libFuzzer) grows from a valid one, in a process of
its own. A target fails if anything but one of our errors is raised, if one input takes longer than
10 s, or if the process takes more than 2 GB. `archive` imports Record3D zips whose members have
hostile names, links and sizes, and fails as well if a file appears outside the scene.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # the tests' valid files are the seeds

PAGE = "faults.md"
SECONDS_AN_INPUT, MEGABYTES, MAX_BYTES = 10, 2048, 16384
ARCHIVE = "archive"
NAMES = (
    "metadata", "rgbd/0.jpg", "rgbd/1.jpg", "rgb/0.png", "../outside.jpg", "rgbd/../../outside.jpg",
    "/tmp/outside.jpg", "rgbd/0.jpg/", "C:\\outside.jpg", "rgbd/\u2028.jpg", "",
)  # fmt: skip
BOMB_BYTES = 64 << 20
LINK = 0o120777 << 16


def fuzz(target: str, corpus: Path, seconds: int) -> None:
    """Fuzz one target in this process, which ends at the first failure."""
    import atheris

    with atheris.instrument_imports(include=["vioapr.formats", "vioapr.files", "vioapr.importers"]):
        from vioapr.formats.registry import FORMATS, rank_formats  # noqa: F401
        from vioapr.importers.registry import IMPORTERS  # noqa: F401

    import logging

    logging.disable()
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir=memory_folder()))
    one = archive_target(folder) if target == ARCHIVE else reader_target(target, folder, corpus)
    options = [
        f"-max_total_time={seconds}", f"-timeout={SECONDS_AN_INPUT}",
        f"-rss_limit_mb={MEGABYTES}", f"-max_len={MAX_BYTES}", "-print_final_stats=1",
        f"-artifact_prefix={corpus.parent}/{target}-",
    ]  # fmt: skip
    atheris.Setup([sys.argv[0], str(corpus), *options], one)
    try:
        atheris.Fuzz()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def memory_folder() -> str | None:
    """Where files cost no disk, if there is such a place."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


def reader_target(name: str, folder: Path, corpus: Path) -> Callable[[bytes], None]:
    """Read the bytes as a file of one format; the corpus gets a valid one."""
    from tests.formats.conftest import make_trajectory
    from tests.formats.samples import write_sample
    from tests.formats.test_fuzz import file_name, place

    from vioapr.errors import VioAprError
    from vioapr.formats.base import ReadOptions
    from vioapr.formats.registry import FORMATS, rank_formats

    format_ = FORMATS[name]
    sample = folder / "valid" / file_name(format_)
    write_sample(format_, sample, make_trajectory(format_, 4))
    files = [sample] if sample.is_file() else sorted(p for p in sample.rglob("*") if p.is_file())
    for index, file in enumerate(files[:4]):
        (corpus / f"valid-{index}").write_bytes(file.read_bytes())
    place_in = folder / "fuzzed"
    place_in.mkdir()

    def read(content: bytes) -> None:
        path = place(format_, place_in, content)
        try:
            rank_formats(path)
            format_.read(path, ReadOptions(rate_hz=2.0))
        except VioAprError:
            return

    return read


def archive_target(folder: Path) -> Callable[[bytes], None]:
    """Import a Record3D zip made of the bytes, and look for files where none belong."""
    import atheris

    from vioapr.errors import VioAprError
    from vioapr.importers.base import ImportOptions
    from vioapr.importers.registry import get_importer, import_source
    from vioapr.work.progress import silent

    metadata = json.dumps({
        "w": 4, "h": 4, "K": [4, 0, 0, 0, 4, 0, 2, 2, 1], "fps": 30,
        "poses": [[0, 0, 0, 1, 0.1 * row, 0, 0] for row in range(3)],
    }).encode()  # fmt: skip
    importer = get_importer("record3d")

    def import_zip(content: bytes) -> None:
        data = atheris.FuzzedDataProvider(content)
        source = folder / "walk.r3d"
        with zipfile.ZipFile(source, "w", zipfile.ZIP_DEFLATED) as archive:
            for _ in range(data.ConsumeIntInRange(0, 5)):
                info = zipfile.ZipInfo(NAMES[data.ConsumeIntInRange(0, len(NAMES) - 1)] or "-")
                info.external_attr = LINK if data.ConsumeBool() else 0
                kind = data.ConsumeIntInRange(0, 20)
                member = metadata if kind < 8 else data.ConsumeBytes(400)
                archive.writestr(info, bytes(BOMB_BYTES) if kind == 20 else member)
        if data.ConsumeIntInRange(0, 3) == 0:  # sizes and checksums that lie
            packed = bytearray(source.read_bytes())
            for _ in range(data.ConsumeIntInRange(1, 8)):
                packed[data.ConsumeIntInRange(0, len(packed) - 1)] = data.ConsumeIntInRange(0, 255)
            source.write_bytes(packed)
        scene = folder / "scene"
        before = set(folder.iterdir()) | set(Path(tempfile.gettempdir()).glob("outside*"))
        try:
            for _ in import_source(
                importer, source, scene, ImportOptions(), place="indoor", progress=silent
            ):
                pass
        except VioAprError:
            pass
        links = [path for path in scene.rglob("*") if path.is_symlink()] if scene.exists() else []
        shutil.rmtree(scene, ignore_errors=True)
        after = set(folder.iterdir()) | set(Path(tempfile.gettempdir()).glob("outside*"))
        if links or after - before:
            raise AssertionError(f"outside the scene: {links or after - before}")

    return import_zip


def run_target(target: str, folder: Path, seconds: int) -> dict[str, Any]:
    """Fuzz a target in a process of its own, and say what came of it."""
    corpus = folder / target
    corpus.mkdir(parents=True, exist_ok=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, __file__, "--target", target, str(corpus), str(seconds)]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)

    def statistic(name: str) -> int:
        found = re.search(rf"stat::{name}:\s+(\d+)", done.stderr)
        return int(found[1]) if found else 0

    return {
        "target": target,
        "inputs": statistic("number_of_executed_units"),
        "slowest_s": statistic("slowest_unit_time_sec"),
        "peak_mb": statistic("peak_rss_mb"),
        "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "failure": "" if done.returncode == 0 else describe_failure(done.stdout + done.stderr),
    }


def describe_failure(output: str) -> str:
    """Cut the exception out of what a process printed, and where its input lies."""
    start = output.find("Uncaught Python exception")
    exception = output[start : output.find("==", start + 60)] if start >= 0 else output[-600:]
    written = re.findall(r"Test unit written to \S+", output)
    return "\n".join([exception.strip()[-1500:], *written])


def main() -> None:
    """Fuzz all targets in rounds until the time is used up."""
    if sys.argv[1:2] == ["--target"]:
        fuzz(sys.argv[2], Path(sys.argv[3]), int(sys.argv[4]))
        return
    from common import describe_machine, publish, write_json
    from rich.table import Table

    from vioapr.formats.registry import FORMATS

    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--cpu-minutes", type=float, default=60.0)
    parser.add_argument("--only", nargs="*", default=[*FORMATS, ARCHIVE])
    parser.add_argument("--folder", type=Path, help="keeps what was found, for another run")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    folder = options.folder or Path(tempfile.mkdtemp(prefix="fuzz-"))
    wanted_s = 60 * options.cpu_minutes
    results: dict[str, dict[str, Any]] = {}
    while (used_s := sum(one["cpu_s"] for one in results.values())) < wanted_s:
        seconds = max(5, round(min(40.0, (wanted_s - used_s) / len(options.only))))
        for target in options.only:
            try:
                found = run_target(target, folder, seconds)
            except KeyboardInterrupt:  # what there is counts
                wanted_s = 0.0
                break
            known = results.setdefault(target, found | {"inputs": 0, "cpu_s": 0.0, "failures": []})
            known["inputs"] += found["inputs"]
            known["cpu_s"] += found["cpu_s"]
            known["peak_mb"] = max(known["peak_mb"], found["peak_mb"])
            known["slowest_s"] = max(known["slowest_s"], found["slowest_s"])
            known["failures"] += [found["failure"]] if found["failure"] else []
            print(
                f"{target}: {known['inputs']} inputs, {known['cpu_s']:.0f} s, "
                f"{known['peak_mb']} MB, {len(known['failures'])} failures", flush=True,
            )  # fmt: skip
            if found["failure"]:
                print(found["failure"], flush=True)
    table = Table(
        "target", "inputs", "CPU s", "slowest input s", "peak MB", "failures",
        title=f"Fuzzed for {sum(one['cpu_s'] for one in results.values()) / 60:.0f} minutes of CPU",
    )  # fmt: skip
    for one in results.values():
        table.add_row(
            one["target"], f"{one['inputs']:,}", f"{one['cpu_s']:.0f}",
            "< 1" if one["slowest_s"] == 0 else str(one["slowest_s"]), str(one["peak_mb"]),
            str(len(one["failures"])),
        )  # fmt: skip
    if options.json:
        machine = describe_machine(("atheris", "numpy", "vioapr"))
        write_json(options.json, {"machine": machine, "targets": list(results.values())})
    publish(table, PAGE, "fuzz", update_docs=options.update_docs)


if __name__ == "__main__":
    main()
