"""The printed figures, and what they say of how they were computed."""

import os
import re
from pathlib import Path

import pytest

from vioapr.recipes.comparison import load_paper, load_references
from vioapr.recipes.datasets import DATA_SETS
from vioapr.recipes.paper import MODELS
from vioapr.schemas.reproduction import ImageCounts, Levels, PrintedCell

LABELS = {
    2: "tab:ape_kopt_out",
    3: "tab:ape_kopt_in",
    4: "tab:ratio_outdoor",
    5: "tab:ratio_indoor",
}
SECTIONS = {
    "only keyframes": "Only Keyframes",
    "only optimized": "Only Optimization",
    "keyframes + optimized": "Keyframes + Optimization",
}


@pytest.fixture(scope="module")
def tables():
    return {table.number: table for table in load_paper().tables}


@pytest.fixture(scope="module")
def tex() -> str:
    path = Path(os.environ.get("VIOAPR_DATA", "")).parent / "paper" / "vio-apr.tex"
    if "VIOAPR_DATA" not in os.environ or not path.is_file():
        pytest.skip("the paper's source is needed: paper/vio-apr.tex beside VIOAPR_DATA's folder")
    return path.read_text()


def numbers_of_tex(tex: str, label: str, section: str, scene: str) -> list[float]:
    """All numbers of a scene's row, in the order in which they are printed."""
    end = tex.index(rf"\label{{{label}}}")
    table = tex[tex.rindex(r"\begin{array}", 0, end) : end]
    start = table.index(rf"\text{{{section}")
    row = re.search(rf"\\text\s*{{{scene}\s*}}(.*?)\\\\", table[start:], re.DOTALL)
    assert row is not None
    return [float(number) for number in re.findall(r"\d+\.?\d*", row[1])]


def numbers_of_data(cells: dict) -> list[float]:
    """The same of ours: models in turn, raw before fused, a share after the figures."""
    numbers = []
    for model in MODELS:
        for cell in (cells[model].raw, cells[model].fused):
            if isinstance(cell, Levels):
                numbers += [*cell.levels, *([] if cell.share is None else [cell.share])]
            else:
                numbers += cell
    return numbers


def test_every_figure_is_the_printed_one(tables, tex):
    count = 0
    for number, label in LABELS.items():
        for subset, section in SECTIONS.items():
            for scene, cells in tables[number].rows[subset].items():
                printed = numbers_of_tex(tex, label, section, scene)
                assert numbers_of_data(cells) == printed, (number, subset, scene)
                count += len(printed)
    # Medians: 2 tables, 3 sections, 4 rows of 8 figures. Levels: 2 tables, 3 scenes, 12 figures
    # in each section, with 2, 4 and 2 shares.
    assert count == 2 * 3 * 4 * 8 + 2 * 3 * (14 + 16 + 14)


def test_table_1_is_the_printed_one(tex):
    for scene, images in load_paper().images.items():
        row = re.search(rf"\\text\s*{{\s*{scene}\s*}}\s*&\s*(\d+)\s*&\s*(\d+)", tex)
        assert row is not None
        assert images == ImageCounts(int(row[1]), int(row[2]))


def test_some_figures(tables):
    """Read off the paper by eye."""
    square = tables[2].rows["only keyframes"]["Square"]
    assert square["posenet"] == PrintedCell((1.11, 3.61), (0.68, 2.75))
    average = tables[3].rows["keyframes + optimized"]["average"]
    assert average["ms-transformer"] == PrintedCell((0.84, 4.32), (0.66, 3.44))
    church = tables[4].rows["only optimized"]["Church"]["ms-transformer"]
    assert church.fused == Levels((12.3, 39.0, 100.0), 22.9)
    assert church.raw == Levels((2.6, 20.5, 84.1), 22.9)
    stairs = tables[5].rows["only keyframes"]["Stairs"]["ms-transformer"]
    assert stairs.fused == Levels((25.0, 76.4, 97.9), 64.9)


def test_all_scenes_are_there(tables):
    groups = DATA_SETS["marvin"].groups
    for table in tables.values():
        for rows in table.rows.values():
            scenes = groups[table.group]
            assert tuple(rows)[:3] == scenes
            assert tuple(rows)[3:] == (("average",) if table.kind == "median" else ())


def test_printed_averages_are_means_over_scenes(tables):
    off = []
    for number in (2, 3):
        for rows in tables[number].rows.values():
            for model in MODELS:
                for column in ("raw", "fused"):
                    for figure in (0, 1):
                        values = [getattr(cells[model], column)[figure] for cells in rows.values()]
                        off.append(abs(sum(values[:3]) / 3 - values[3]))
    assert len(off) == 48
    # Rounding alone.
    assert max(off) < 0.0051


def test_printed_percentages_are_of_a_scenes_pooled_frames(tables):
    """Not means over recordings: almost all are whole numbers of Table 1's frames."""
    images = load_paper().images
    fits = []
    for number in (4, 5):
        for subset, rows in tables[number].rows.items():
            for scene, cells in rows.items():
                everything = images[scene].test
                for model in MODELS:
                    raw, fused = cells[model].raw, cells[model].fused
                    part = round(fused.share / 100 * everything)
                    fits.append(is_share(fused.share, everything))
                    of = part if subset == "only optimized" else everything
                    fits += [is_share(level, of) for level in raw.levels]
                    fits += [is_share(level, part) for level in fused.levels]
    assert len(fits) == 252
    assert sum(fits) == 247


def is_share(percent: float, of: int) -> bool:
    near = round(percent / 100 * of)
    return any(abs(round(100 * k / of, 1) - percent) < 0.01 for k in (near - 1, near, near + 1))


def test_references():
    seven, cambridge = load_references("7scenes"), load_references("cambridge")
    assert seven["fire"] == {
        "posenet": (0.283, 9.44),
        "ms-transformer": (0.227, 10.9),
        "dfnet": (0.058, 2.3),
    }
    assert cambridge["ShopFacade"]["ms-transformer"] == (0.88, 3.2)
    assert set(seven) < set(DATA_SETS["7scenes"].scenes)
    assert set(cambridge) < set(DATA_SETS["cambridge"].scenes)
