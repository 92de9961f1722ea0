import dataclasses
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from vioapr.errors import AlreadyExistsError, DiskFullError, UnwritableError
from vioapr.evaluation.cases import load_cases
from vioapr.evaluation.evaluate import evaluate_cases
from vioapr.evaluation.metrics import PoseErrors, summarize
from vioapr.evaluation.tables import group_results
from vioapr.fusion.methods import get_method
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3
from vioapr.report.evaluation_report import count_report_ticks, write_report
from vioapr.report.formatting import (
    format_levels,
    format_median,
    format_p95,
    format_reliability,
    format_share,
)
from vioapr.scene.walks import find_walks

pytestmark = pytest.mark.slow

PARAMS = {name: get_method(name).params_type() for name in ("apr", "vio", "vio-apr")}
VOID = {"meta", "img", "br", "hr", "link", "input"}
INJECTION = '<script>alert("1")</script>&amp;'


class Page(HTMLParser):
    """The page's tags, its tables as text, and whether every tag is closed in order."""

    def __init__(self, text):
        super().__init__()
        self.text, self.open, self.tags, self.tables = [], [], [], []
        self.feed(text)
        self.close()
        assert not self.open, f"left open: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th"):
            self.tables[-1][-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "td" in self.open or "th" in self.open:
            self.tables[-1][-1][-1] += data
        elif "style" not in self.open:
            self.text.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


def write(groups, folder, **options):
    path = write_report(groups, folder, **({"title": "A report"} | options))
    text = path.read_text(encoding="utf-8")
    return text, Page(text)


@pytest.fixture(scope="module")
def groups(walks_dir):
    return group_results(evaluate_cases(load_cases(find_walks([walks_dir])), PARAMS))[:2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("out") / "new" / "report"


@pytest.fixture(scope="module")
def page(groups, folder):
    return write(
        groups,
        folder,
        command="vioapr evaluate walks --report report",
        params_of_method=PARAMS,
        view="live",
        date="2024-05-01",
    )


def test_page_asks_for_nothing_from_elsewhere(page):
    text, parsed = page
    assert "http" not in text
    assert not {"script", "link", "iframe"} & {tag for tag, _ in parsed.tags}
    assert "url(" not in text
    assert "@import" not in text
    for image in parsed.all("img"):
        assert re.match(r"data:image/(png|svg\+xml);base64,[A-Za-z0-9+/=]+$", image["src"])
        assert image["alt"]


def test_links_lead_somewhere(page, folder):
    _, parsed = page
    targets = {attributes["id"] for _, attributes in parsed.tags if "id" in attributes}
    for link in parsed.all("a"):
        kind, name = link["href"].split("#") if "#" in link["href"] else (link["href"], None)
        assert name in targets if name else (folder / kind).is_file()


def test_page_says_what_was_run(page):
    text, parsed = page
    prose = " ".join(parsed.text)
    assert "A report" in prose
    assert "vioapr evaluate walks --report report" in prose
    assert "live: what was known" in prose
    assert "2024-05-01" in prose
    runs = {row[0]: row[2] for row in parsed.tables[0]}
    assert "distance_threshold_m = 0.4" in runs["vio-apr"]
    assert "optimized_frames = 8" in runs["vio-apr"]
    for status in Status:
        assert f"<dt>{status.label}</dt>" in text


def test_overview_has_every_group_and_method(page, groups):
    _, parsed = page
    overview = parsed.tables[1]
    for group, cells in zip(groups, overview[2:], strict=True):
        expected = [group.title, str(group.cases), format_median(group.raw), format_p95(group.raw)]
        for row in group.rows:
            if row.subset == "all frames" and row.method != "apr":
                expected += [format_median(row.fused), format_p95(row.fused)]
                expected += [format_share(row.fused)]
        assert cells == expected


def test_group_tables_are_the_papers(page, groups):
    _, parsed = page
    for group, table in zip(groups, parsed.tables[2::3], strict=True):
        assert len(table) == 2 + len(group.rows)
        for row, cells in zip(group.rows, table[2:], strict=True):
            assert cells == [
                row.method,
                row.subset,
                str(row.walks),
                format_share(row.fused),
                format_median(row.fused),
                format_median(row.raw),
                format_p95(row.fused),
                format_p95(row.raw),
                format_levels(row.fused),
                format_levels(row.raw),
            ]


def test_reliability_tables_have_a_row_a_method(page, groups):
    text, parsed = page
    for group, table in zip(groups, parsed.tables[3::3], strict=True):
        assert table[0][2:5] == ["jumps/min", "largest m", "wrong and sure"]
        for row, cells in zip(group.reliability, table[1:], strict=True):
            assert cells == [row.method, str(row.walks), *format_reliability(row.figures)]
    assert "beyond what the camera itself moved" in " ".join(text.split())


def test_sigmas_bring_a_figure_of_risk(walks_dir, tmp_path):
    cases = load_cases(find_walks([walks_dir / "SetB"]))
    params = {"chain": get_method("chain").params_type()}
    made = group_results(evaluate_cases(cases, params))[:1]
    ticks = []
    text, parsed = write(made, tmp_path, tick=lambda: ticks.append(1))
    assert len(ticks) == count_report_ticks(made) == len(parsed.all("img")) == 4
    assert "ordered by the true error" in text
    assert (tmp_path / "figures" / "SetB_sim_bad_risk.svg").exists()


def test_every_walk_has_its_own_figures(page, groups):
    _, parsed = page
    for group, table in zip(groups, parsed.tables[4::3], strict=True):
        rows = {(cells[0], cells[1], cells[2]): cells[3:] for cells in table[2:]}
        assert len(rows) == len(group.results)
        for result in group.results:
            cells = rows[result.case.walk, result.case.vio, result.method]
            summary = summarize(result.errors)
            assert cells[:3] == [
                str(len(result.status)),
                format_share(summary),
                format_median(summary),
            ]
            assert sum(float(cell) for cell in cells[8:]) == pytest.approx(100, abs=0.3)


def test_the_better_of_two_is_bold(groups, tmp_path):
    group = groups[0]
    row = group.rows[-1]
    better = row.fused._replace(median_m=0.5, median_deg=2.0, p95_m=0.3, p95_deg=1.0, high=0.2)
    worse = row.raw._replace(median_m=1.5, median_deg=1.0, p95_m=0.3, p95_deg=1.0, high=0.1)
    row = dataclasses.replace(row, fused=better, raw=worse)
    text, _ = write([dataclasses.replace(group, rows=[row])], tmp_path)
    assert "<b>0.500 </b>/ 2.00" in text
    assert "1.50 /<b> 1.00</b>" in text
    assert ">0.300 / 1.00<" in text
    assert "<b>20.0</b>/" in text


def test_equal_runs_make_equal_pages(groups, tmp_path):
    first, _ = write(groups[:1], tmp_path / "a")
    second, _ = write(groups[:1], tmp_path / "b")
    assert first == second


def test_ticks_are_as_many_as_promised(groups, tmp_path):
    ticks = []
    write_report(groups[:1], tmp_path, title="t", tick=lambda: ticks.append(1))
    assert len(ticks) == count_report_ticks(groups[:1])


def test_names_cannot_inject_html(groups, tmp_path):
    group = groups[0]
    case = dataclasses.replace(
        group.results[0].case,
        set_name=INJECTION,
        walk=INJECTION,
        vio=INJECTION,
        apr=INJECTION,
    )
    (result,) = evaluate_cases([case], {"vio-apr": PARAMS["vio-apr"]})
    text, parsed = write(
        group_results([result]), tmp_path, title=INJECTION, command=INJECTION, date=INJECTION
    )
    assert "<script" not in text
    assert not parsed.all("script")
    walks = parsed.tables[-1]
    assert walks[2][:2] == [INJECTION, INJECTION]
    assert any(INJECTION in part for part in parsed.text)


def test_a_method_without_any_pose_is_shown_with_dashes(groups, tmp_path):
    result = groups[0].results[-1]
    nothing = np.full(len(result.status), np.nan)
    lost = dataclasses.replace(
        result,
        world_from_cam=Rigid3(*(np.full_like(part, np.nan) for part in result.world_from_cam)),
        status=np.full(len(result.status), Status.UNLOCALIZED),
        errors=PoseErrors(nothing, nothing),
        sigma_position_m=None,
        sigma_orientation_deg=None,
    )
    text, parsed = write(group_results([lost]), tmp_path)
    (cells,) = parsed.tables[2][2:]
    assert cells[2:] == ["0", "0.0 %", *["–"] * 6]
    assert "nan" not in re.sub(r"base64,[^\"]*", "", text)


def test_a_method_unknown_today_is_shown(groups, tmp_path):
    result = dataclasses.replace(groups[0].results[-1], method="later")
    _, parsed = write(group_results([result]), tmp_path)
    assert parsed.tables[0][1] == ["later", "–", "–"]


def test_a_file_in_the_folders_place(groups, tmp_path):
    (tmp_path / "report").write_text("mine")
    with pytest.raises(
        AlreadyExistsError, match="expected a folder to write the report to, got a file"
    ):
        write_report(groups, tmp_path / "report", title="t")
    assert (tmp_path / "report").read_text() == "mine"


def test_a_folder_in_the_pages_place(groups, tmp_path):
    (tmp_path / "index.html").mkdir()
    with pytest.raises(AlreadyExistsError, match="expected to write a file, got a folder"):
        write_report(groups, tmp_path, title="t")


def test_a_folder_below_a_file(groups, tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(UnwritableError, match="cannot be written"):
        write_report(groups[:1], tmp_path / "file" / "report", title="t")


def test_a_full_disk(groups, tmp_path, monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", fail)
    with pytest.raises(
        DiskFullError, match=r"drift.png: cannot be written: No space left on device"
    ):
        write_report(groups[:1], tmp_path, title="t")
