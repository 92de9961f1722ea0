"""Losses by hand."""

import pytest
import torch
from tests.regression.toy import spec

from vioapr.errors import ParameterError
from vioapr.regression.losses import PoseLoss
from vioapr.regression.networks import Raw, build
from vioapr.regression.params import LossParams

IDENTITY = torch.tensor([[0.0, 0.0, 0.0, 1.0]])
SCENE = torch.zeros(1, dtype=torch.int64)


@pytest.fixture(scope="module")
def network():
    return build(spec(rotation="quat"))


def raw(position, rotation=(0.0, 0.0, 0.0, 1.0), log_sigma=(0.0, 0.0)):
    return Raw(torch.tensor([position]), torch.tensor([rotation]), torch.tensor([log_sigma]))


def loss_of(name, network, said, **values):
    params = LossParams(loss=name, position_weight=0.0, rotation_weight=0.0, **values)
    return PoseLoss(params)(network, said, torch.zeros(1, 3), IDENTITY, SCENE)


def test_nothing_wrong_costs_nothing(network):
    for name in ("learnable", "learnable-l2", "geometric"):
        assert loss_of(name, network, raw((0.0, 0.0, 0.0))).item() == pytest.approx(0, abs=1e-5)


def test_positions_by_hand(network):
    # Mean of 0.3, 0, 0.6: 0.3; the uncertainty's part is the same mean over two, 0.15.
    said = raw((0.3, 0.0, 0.6))
    assert loss_of("learnable", network, said).item() == pytest.approx(0.45, abs=1e-5)
    # Points are displaced by what the camera is: 0.3 on average.
    assert loss_of("geometric", network, said).item() == pytest.approx(0.45, abs=1e-5)
    l2 = (0.09 + 0.36) ** 0.5
    assert loss_of("learnable-l2", network, said).item() == pytest.approx(l2 + 0.15, abs=1e-5)


def test_learned_weights_by_hand(network):
    said = raw((0.3, 0.0, 0.6))
    loss = PoseLoss(LossParams(position_weight=1.0, rotation_weight=-3.0))
    expected = 0.3 * torch.e**-1 + 1 + (-3) + 0.15
    value = loss(network, said, torch.zeros(1, 3), IDENTITY, SCENE)
    assert value.item() == pytest.approx(expected, abs=1e-5)
    value.backward()
    # d/ds (L exp(-s) + s) = 1 - L exp(-s)
    assert loss.weights.grad[0].item() == pytest.approx(1 - 0.3 * torch.e**-1, abs=1e-5)


def test_geometric_loss_grows_with_depth(network):
    half = 2**-0.5
    said = raw((0.0, 0.0, 0.0), rotation=(0.0, half, 0.0, half))
    near, far = (loss_of("geometric", network, said, depth=depth).item() for depth in (1, 3))
    uncertainty = (torch.pi / 2 / 3**0.5) / 2
    assert far - uncertainty == pytest.approx(3 * (near - uncertainty), rel=1e-4)


def test_uncertainty_does_not_teach_the_pose(network):
    """With a huge stated sigma, the pose's gradient is the same as with a small one."""
    gradients = []
    for log_sigma in (-3.0, 3.0):
        said = raw((0.3, 0.0, 0.6), log_sigma=(log_sigma, log_sigma))
        said.position.requires_grad_(True)
        loss_of("learnable", network, said).backward()
        gradients.append(said.position.grad)
    assert torch.equal(*gradients)


def test_uncertainty_is_best_at_the_mean_error(network):
    errors = torch.tensor([[0.2, 0.2, 0.2]])
    sizes = torch.linspace(-4, 1, 101)
    losses = [
        loss_of("geometric", network, raw(errors[0].tolist(), log_sigma=(s.item(), -2.0))).item()
        for s in sizes
    ]
    best = sizes[int(torch.tensor(losses).argmin())]
    assert best.exp().item() == pytest.approx(0.2, rel=0.06)


def test_scenes_are_classified():
    network = build(spec("ms-transformer", scenes=("a", "b"), rotation="quat"))
    said = raw((0.0, 0.0, 0.0))._replace(scene_logits=torch.tensor([[0.0, 0.0]]))
    value = PoseLoss(LossParams(rotation_weight=0.0))(
        network, said, torch.zeros(1, 3), IDENTITY, SCENE
    )
    assert value.item() == pytest.approx(torch.log(torch.tensor(2.0)).item(), abs=1e-5)


def test_odd_parameters():
    with pytest.raises(ParameterError, match="expected learnable"):
        LossParams(loss="huber")  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="depth"):
        LossParams(depth=0)
