"""What a fault leaves on disk: verbs are killed, stopped, starved of space and pointed at files.

    python benchmarks/work_faults.py [--only GROUP ...] [--verbs VERB ...] [--kills 20]
        [--json FILE] [--update-docs]

Every trial is a `vioapr` of its own on a toy scene in a temporary folder. `kept` counts trials
after which everything that was there before the fault, or was finished before it, is there as it
was; `same` those in which the same command, run again, ends with the result of a run without
fault (compared by content), and leaves no temporary file. With --json, rows that are not
made again are taken from the file, so a table can be made in several sittings.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from common import publish, write_json
from rich.table import Table
from work_fault_cases import CASES, FILE_CASES, Case, Places, make_places, visible_files

PAGE, SECTION = "faults.md", "work"
GROUPS = ("kill", "signals", "disk", "processes", "files")


@dataclass
class Row:
    """What a fault did to a verb.

    Attributes:
        group: One of `GROUPS`.
        fault: For people.
        verb: That it hit.
        trials: How often.
        kept: Trials after which nothing was lost.
        same: Trials after which the same command ended with the right result; None where the
            fault is the user's, and there is nothing to run again.
        happened: What the verb said, or how it ended.
        left: What is on disk.
    """

    group: str
    fault: str
    verb: str
    trials: int
    kept: int
    same: int | None
    happened: str
    left: str


def start(words: list[object], cwd: Path) -> subprocess.Popen[str]:
    """Start `vioapr` with these words, in a session of its own."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-m", "vioapr", *map(str, words)]
    pipe = subprocess.PIPE
    return subprocess.Popen(
        command, cwd=cwd, env=environment, stdout=pipe, stderr=pipe, text=True,
        start_new_session=True,
    )  # fmt: skip


def run(words: list[object], cwd: Path) -> tuple[int, str]:
    """Run `vioapr`; gives its exit code and the last line that it said of an error."""
    process = start(words, cwd)
    _, said = process.communicate()
    lines = [line for line in said.splitlines() if line.strip()]
    assert "Traceback" not in said, said
    return process.returncode, lines[-1] if lines else ""


def go_on(case: Case, places: Places) -> bool:
    """Run a case's command again after a fault; whether it ends as without fault."""
    code, said = run(case.again(places), places.folder)
    if code == 2 and "give --overwrite" in said:  # it had been finished
        code = 0
    leftovers = [path for path in places.folder.rglob(".*") if ".partial" in path.name]
    return code == 0 and not leftovers and case.result(places) == case.expected(places)


def stop_at(case: Case, places: Places, number: int, delay_s: float) -> tuple[int, str, bool]:
    """Send a signal to a case's command after a time.

    Returns:
        Its exit code, its last words, and whether all that was finished is still there.
    """
    process = start(case.words(places), places.folder)
    try:
        process.communicate(timeout=delay_s)
    except subprocess.TimeoutExpired:
        process.send_signal(number)
    _, said = process.communicate(timeout=120)
    assert "Traceback" not in said, said
    lines = said.strip().splitlines()
    return process.returncode, lines[-1] if lines else "", case.is_kept(places)


def kill_rows(
    cases: Sequence[Case], kills: int, rng: random.Random, note: Callable[[Row], None]
) -> None:
    """Kill verbs at random moments."""
    for case in cases:
        if not case.is_killed:
            continue
        ended = 0
        with make_places(case) as reference:
            began = time.monotonic()
            code, said = run(case.words(reference), reference.folder)
            assert code == 0, said
            seconds = time.monotonic() - began
            wanted = case.result(reference)
        row = Row("kill", "kill -9", case.verb, 0, 0, 0, "", case.left)
        for trial in range(kills):
            with make_places(case, wanted) as places:
                delay_s = rng.uniform(0.1, 1.0) * seconds
                code, _, is_kept = stop_at(case, places, signal.SIGKILL, delay_s)
                ended += code == 0
                finished = case.finished(places)
                row.kept += is_kept
                row.same = (row.same or 0) + (
                    go_on(case, places) and finished <= case.finished(places)
                )
            row.trials = trial + 1
            row.happened = f"killed at a random moment of {seconds:.0f} s"
            if ended:
                row.happened += f" ({ended} had ended)"
            note(row)


def signal_rows(cases: Sequence[Case], note: Callable[[Row], None]) -> None:
    """Stop verbs as people and schedulers do."""
    for number, name in ((signal.SIGINT, "Ctrl-C"), (signal.SIGTERM, "SIGTERM")):
        for case in cases:
            with make_places(case) as reference:
                began = time.monotonic()
                code, said = run(case.words(reference), reference.folder)
                assert code == 0, said
                delay_s = 0.7 * (time.monotonic() - began)
                wanted = case.result(reference)
            with make_places(case, wanted) as places:
                code, said, is_kept = stop_at(case, places, number, delay_s)
                left = [p for p in places.folder.rglob(".*") if ".partial" in p.name]
                same = go_on(case, places) and not left
            words = said.replace(str(places.folder) + "/", "")
            # Python lets signals end a process that has finished its work.
            happened = "it had ended" if code in (0, -number) else f"exit code {code}: {words}"
            note(Row("signals", name, case.verb, 1, int(is_kept), int(same), happened, case.left))


def disk_rows(cases: Sequence[Case], note: Callable[[Row], None]) -> None:
    """Let verbs run on a disk that is nearly full, then give it space."""
    for case in cases:
        with make_places(case) as reference:
            code, said = run(case.words(reference), reference.folder)
            assert code == 0, said
            wanted = case.result(reference)
        with tempfile.TemporaryDirectory() as disk:
            mount = ["mount", "-t", "tmpfs", "-o", "size=1g", "tmpfs", disk]
            subprocess.run(mount, check=True)
            try:
                with make_places(case, wanted, Path(disk)) as places:
                    row = fill_disk(case, places, Path(disk))
            finally:
                subprocess.run(["umount", disk], check=True)
        note(row)


def fill_disk(case: Case, places: Places, disk: Path) -> Row:
    """Leave a case a little less space than it needs, and then all that it needs."""
    used = os.statvfs(disk)
    used_kb = (used.f_blocks - used.f_bfree) * used.f_frsize // 1024

    def resize(spare_kb: int) -> None:
        size = f"remount,size={used_kb + spare_kb}k"
        subprocess.run(["mount", "-o", size, str(disk)], check=True)

    resize(case.spare_kb)
    code, said = run(case.words(places), places.folder)
    is_kept = case.is_kept(places)
    resize(1 << 20)
    same = go_on(case, places)
    happened = f"exit code {code}: {said.replace(str(places.folder) + '/', '')}"
    return Row("disk", "full disk", case.verb, 1, int(is_kept and code == 2), int(same), happened,
               case.left)  # fmt: skip


def process_rows(cases: Sequence[Case], note: Callable[[Row], None]) -> None:
    """Start the same verb twice in one folder."""
    for case in cases:
        if not case.is_locked:
            continue
        with make_places(case) as places:
            first = start(case.words(places), places.folder)
            lock = None
            while lock is None and first.poll() is None:
                lock = next(iter(places.folder.rglob(".lock")), None)
                time.sleep(0.02)
            first.send_signal(signal.SIGSTOP)  # so that it does not end meanwhile
            code, said = run(case.words(places), places.folder)
            names_it = f"process {first.pid} " in said
            first.send_signal(signal.SIGCONT)
            first.communicate()
            same = first.returncode == 0
        words = said.replace(str(places.folder) + "/", "").replace(f" {first.pid} ", " PID ")
        happened = f"exit code {code}: {words.partition(' (')[0]} (...)"
        note(Row("processes", "two processes", case.verb, 1, int(names_it and code == 2), int(same),
                 happened, "the first goes on to its end"))  # fmt: skip


def file_rows(cases: Sequence[Case], note: Callable[[Row], None]) -> None:
    """Point verbs at files that are not theirs."""
    for case in cases:
        for fault in case.mistakes:
            with make_places(case) as places:
                words = fault.words(places)
                before = visible_files(places.folder)
                code, said = run(words, places.folder)
                after = visible_files(places.folder)
            kept = set(before.values()) <= set(after.values())  # a backup keeps it too
            said = said.replace(str(places.folder) + "/", "")
            happened = f"exit code {code}" + (f": {said}" if code else f": {fault.says}")
            is_right = kept and (code == 0) == fault.succeeds
            note(Row("files", fault.name, case.verb, 1, int(is_right), None, happened, fault.left))


def main() -> None:
    """Inject the faults and report."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", nargs="*", choices=GROUPS, default=GROUPS)
    verbs = [case.verb for case in CASES]
    parser.add_argument("--verbs", nargs="*", choices=verbs, default=verbs)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    chosen = parser.parse_args()
    cases = [case for case in CASES if case.verb in chosen.verbs]
    rows: list[Row] = []
    if chosen.json and chosen.json.exists():
        rows = [Row(**row) for row in json.loads(chosen.json.read_text(encoding="utf-8"))["rows"]]
        rows = [r for r in rows if r.group not in chosen.only or r.verb not in chosen.verbs]

    def note(row: Row) -> None:
        if row not in rows:  # those of many trials are noted after each
            rows.append(row)
        print(f"{row.fault}, {row.verb}: {row.kept}, {row.same} of {row.trials}; {row.happened}")
        if chosen.json:
            write_json(chosen.json, {"rows": [asdict(one) for one in rows]})

    work: dict[str, Callable[[], None]] = {
        "kill": lambda: kill_rows(cases, chosen.kills, random.Random(chosen.seed), note),
        "signals": lambda: signal_rows(cases, note),
        "disk": lambda: disk_rows(cases, note),
        "processes": lambda: process_rows(cases, note),
        "files": lambda: file_rows((*FILE_CASES, *cases), note),
    }
    for group in chosen.only:
        work[group]()
    rows.sort(key=lambda row: GROUPS.index(row.group))
    table = Table()
    for header in ("fault", "verb", "kept", "same result", "what happened", "what is left"):
        table.add_column(header)
    for row in rows:
        same = "-" if row.same is None else f"{row.same} of {row.trials}"
        kept = f"{row.kept} of {row.trials}"
        table.add_row(row.fault, row.verb, kept, same, row.happened, row.left)
    publish(table, PAGE, SECTION, update_docs=chosen.update_docs)


if __name__ == "__main__":
    main()
