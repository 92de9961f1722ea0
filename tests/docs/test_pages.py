"""The docs: links lead somewhere, commands exist, generated pages are what the code says."""

import functools
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from vioapr.cli.verbs import VERBS

ROOT = Path(__file__).parents[2]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
GUIDES = sorted([*(ROOT / "docs" / "guide").glob("*.md"), ROOT / "README.md"])


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as a Git host makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if target.startswith("http"):
            continue
        file, _, anchor = target.partition("#")
        linked = page if not file else (page.parent / file).resolve()
        assert linked.exists(), f"{page.name}: {target}"
        if anchor:
            assert anchor in anchors(linked), f"{page.name}: {target}"


def commands(page: Path) -> list[list[str]]:
    """The `vioapr` commands in a page's code blocks, comments and placeholders taken out."""
    blocks = re.findall(r"^```\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M)
    lines = [line.split("#")[0] for block in blocks for line in block.splitlines()]
    words = [shlex.split(line.removeprefix(".venv/bin/")) for line in lines if "vioapr " in line]
    return [line[1:] for line in words if line[:1] == ["vioapr"]]


@functools.cache
def help_of(verb: str) -> str:
    command = [sys.executable, "-m", "vioapr", *verb.split(), "--help"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.mark.slow
@pytest.mark.parametrize("page", GUIDES, ids=lambda page: page.stem)
def test_commands_have_the_flags_that_are_shown(page):
    found = commands(page)
    for words in found:
        verb = next((v for v in (" ".join(words[:2]), words[0]) if v in VERBS), None)
        assert verb is not None, f"{page.name}: {words}"
        if verb.split()[0] in ("train", "predict", "reproduce", "export"):
            pytest.importorskip("torch", reason="PyTorch is not installed")
        text = help_of(verb)
        for flag in (word for word in words if word.startswith("--")):
            assert re.search(rf"{flag}\b", text), f"{page.name}: {verb} has no {flag}"
    if page.stem not in ("README", "python"):
        assert found


@pytest.mark.slow
def test_generated_pages_are_current():
    pytest.importorskip("torch", reason="PyTorch is not installed: help of train is not complete")
    script = ROOT / "scripts" / "make_reference.py"
    ran = subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
