"""The map's page: what it says of a summary. That it is written, tests/mapping/test_pipeline.py."""

import pytest
from msgspec.structs import replace

from vioapr.report.map_report import (
    MapPage,
    list_facts,
    list_missing,
    make_recordings_table,
    make_vio_table,
)
from vioapr.report.page import Heading, Table, render_page
from vioapr.schemas.map_summary import (
    GeodeticOrigin,
    Georeference,
    GravityOffset,
    MapSummary,
    MatchSummary,
    ModelSummary,
    RecordingSummary,
    ScaleSummary,
    WorldSummary,
)

RECORDING = RecordingSummary(
    split="train",
    images=10,
    registered=7,
    unregistered=["c.jpg"],
    unusable={"d.jpg": "torn <off>"},
    misplaced=["e.jpg"],
    parts_from_vio_at_s=[1.5],
    median_inliers=None,
    median_error_px=None,
    tracking_worlds=[0, 1],
    carried_by_vio=0,
)
SCALE = ScaleSummary(
    world=0, metres_per_unit=2.0, sigma=0.001, length_m=9.0, is_used=True, recording="a&b",
    relative=1.01,
)  # fmt: skip
WORLD = WorldSummary(
    is_metric=True,
    is_gravity_aligned=True,
    scales=[SCALE, replace(SCALE, world=1, relative=0.98)],
    metres_per_unit=2.0,
    gravity_spread_deg=0.7,
    gravity_p95_deg=1.9,
    gravity_offset_deg=[GravityOffset(world=0, recording="a&b", offset_deg=0.5)],
    georeference=None,
)
SUMMARY = MapSummary(
    vioapr="0.1.0",
    params={"mapper": "incremental"},
    recordings={"a&b": RECORDING},
    model=ModelSummary(
        images=7,
        points=900,
        mean_reprojection_error_px=0.613,
        mean_track_length=4.25,
        observations_per_image=546.4,
        other_models=[],
        cameras=[],
    ),
    matches=MatchSummary(pairs=9, good_pairs=8, pruned_pairs=0, islands=[["a&b"]]),
    world=WORLD,
    seconds={"features": 1.2, "model": 3.4},
    reused_steps=[],
)


def placed(georeference):
    summary = replace(SUMMARY, world=replace(WORLD, georeference=georeference))
    return dict(list_facts(summary))["Place on earth"]


def test_facts():
    facts = dict(list_facts(SUMMARY))
    assert facts["Images"] == "7 of 10 registered, 7 of them in the map"
    assert facts["Points"] == "900, each seen by 4.2 images"
    assert facts["Scale"].endswith("2 tracking worlds, which are -2.00 to +1.00 % off it")
    assert facts["Place on earth"] == "no satellite positions in the training recordings"
    assert facts["Seconds"] == "features 1, model 3"


def test_the_place_on_earth():
    assert placed("the walk is too short") == "not known: the walk is too short"
    origin = GeodeticOrigin(latitude_deg=48.1, longitude_deg=11.5, altitude_m=520.0)
    fit = Georeference(
        enu_heading_deg=3.0, origin=origin, fixes=12, residual_m=2.04, heading_sigma_deg=1.26,
        scale=0.998,
    )  # fmt: skip
    assert placed(fit) == (
        "origin at 48.1000000, 11.5000000, x east; 12 satellite positions, median distance "
        "2.0 m, heading to 1.3 deg, their scale 0.998 of the map's"
    )


def test_recordings_and_missing_images():
    (row,) = make_recordings_table(SUMMARY).rows
    assert row == ["a&b", "train", "10", "7", "1", "1", "1", "1", "+1.00, -2.00", "0.50"]
    assert list_missing(SUMMARY) == [
        ("a&b: 1 not registered", ["c.jpg"]),
        ("a&b: 1 cannot be read", ["d.jpg: torn <off>"]),
        ("a&b: 1 misplaced", ["e.jpg"]),
    ]


@pytest.mark.parametrize("missing", [True, False])
def test_the_page_escapes_and_says_if_nothing_is_missing(missing):
    page = MapPage(
        title="Map of <a>",
        contents=[("map", "The map")],
        warnings=["Mind <this>"],
        facts=list_facts(SUMMARY),
        recordings=make_recordings_table(SUMMARY),
        map_figures=[],
        vio=make_vio_table([]),
        vio_figures=[],
        missing=list_missing(SUMMARY) if missing else [],
    )
    text = render_page("map.html", page)
    assert "<title>Map of &lt;a&gt;</title>" in text
    assert "<p><b>Mind &lt;this&gt;</b></p>" in text
    assert '<td class="text">a&amp;b</td>' in text
    assert ("d.jpg: torn &lt;off&gt;" in text) == missing
    assert ("All images are registered" in text) != missing


def test_headings_that_span_columns_and_lines_between_them():
    table = Table(
        [[Heading(""), Heading("both", 2)], [Heading("a"), Heading("b"), Heading("c")]],
        [["x", "1", "2"]],
        text_columns=1,
        starts=[1],
    )
    page = MapPage(
        title="t", contents=[], warnings=[], facts=[], recordings=table, map_figures=[],
        vio=table, vio_figures=[], missing=[],
    )  # fmt: skip
    text = render_page("map.html", page)
    assert '<tr><th class="text"></th><th class="left" colspan="2">both</th></tr>' in text
    assert '<tr><td class="text">x</td><td class="left">1</td><td>2</td></tr>' in text
