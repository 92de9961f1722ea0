"""The simulated courtyard, whose facades repeat: walks that share views, and walks that do not."""

from dataclasses import replace

import pytest
from tests.room import QUICK

from vioapr.errors import MappingError
from vioapr.mapping.pipeline import map_scene
from vioapr.simulation.courtyard.plan import PRESETS
from vioapr.simulation.courtyard.simulate import simulate

pytestmark = pytest.mark.slow

pytest.importorskip("pycolmap", reason="pycolmap is not installed")

PARAMS = replace(QUICK, max_features=2048)


def test_the_small_scene_can_be_mapped(rendering, tmp_path):
    small = replace(PRESETS["small"], test=0, rate_hz=3.0)
    scene = simulate(tmp_path / "scene", small, workers=1)
    summary = map_scene(scene, PARAMS)
    assert summary.matches.islands == [["train-01", "train-02"]]
    assert all(facts.registered >= 0.9 * facts.images for facts in summary.recordings.values())


def test_walks_without_a_common_view_are_not_joined(rendering, tmp_path):
    """Facades, setts and weathers are alike, but no place is seen by both walks."""
    apart = replace(PRESETS["small"], test=0, rate_hz=3.0, same_way=False)
    scene = simulate(tmp_path / "scene", apart, workers=1)
    with pytest.raises(MappingError, match=r"share no view: train-0. \| train-0."):
        map_scene(scene, PARAMS)
