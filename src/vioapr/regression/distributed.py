"""More than one device, through Lightning Fabric."""

from __future__ import annotations

import torch
from lightning_fabric import Fabric
from torch import Tensor, nn
from torch.distributed.nn.functional import all_reduce

from vioapr.errors import ParameterError
from vioapr.regression.params import TrainingParams


def start_fabric(params: TrainingParams) -> Fabric:
    """Start the processes of a run; with one device nothing is started.

    Raises:
        ParameterError: This machine has fewer GPUs than asked for.
    """
    has_gpu = torch.cuda.is_available()
    if has_gpu and params.devices > torch.cuda.device_count():
        raise ParameterError(
            f"devices: expected at most {torch.cuda.device_count()}, the GPUs of this machine, "
            f"got {params.devices}"
        )
    has_bf16 = has_gpu and torch.cuda.is_bf16_supported()
    is_mixed = params.precision == "bf16" or (params.precision == "auto" and has_bf16)
    several = params.devices * params.nodes > 1
    fabric = Fabric(
        accelerator="cuda" if has_gpu else "cpu",
        devices=params.devices,
        num_nodes=params.nodes,
        strategy="ddp" if several else "auto",
        precision="bf16-mixed" if is_mixed else "32-true",
    )
    fabric.launch()
    if has_gpu:
        # The same seed shall give the same weights.
        torch.backends.cudnn.deterministic = True
    return fabric


def synchronize_norms(network: nn.Module, fabric: Fabric) -> None:
    """Let batch normalization see the batch of all processes, as one process would."""
    if fabric.world_size == 1:
        return
    for name, module in list(network.named_modules()):
        if isinstance(module, nn.BatchNorm2d):
            parent = network.get_submodule(name.rpartition(".")[0])
            setattr(parent, name.rpartition(".")[2], _synchronized(module, fabric))


def _synchronized(norm: nn.BatchNorm2d, fabric: Fabric) -> nn.Module:
    if fabric.device.type == "cuda":
        return nn.SyncBatchNorm.convert_sync_batchnorm(norm)
    shared = SharedBatchNorm(norm.num_features, norm.eps, norm.momentum)
    shared.load_state_dict(norm.state_dict())
    return shared


class SharedBatchNorm(nn.BatchNorm2d):
    """Batch normalization over all processes; PyTorch's own is for GPUs only."""

    def forward(self, input: Tensor) -> Tensor:
        """(B, C, H, W) to the same."""
        if not self.training:
            return super().forward(input)
        count = torch.distributed.get_world_size()
        mean = all_reduce(input.mean(dim=(0, 2, 3))) / count
        centred = input - mean[:, None, None]
        variance = all_reduce(centred.square().mean(dim=(0, 2, 3))) / count
        self._remember(mean.detach(), variance.detach(), input[:, 0].numel() * count)
        scale = self.weight * torch.rsqrt(variance + self.eps)
        return centred * scale[:, None, None] + self.bias[:, None, None]

    @torch.no_grad()
    def _remember(self, mean: Tensor, variance: Tensor, values: int) -> None:
        momentum = self.momentum or 0.0
        unbiased = variance * values / max(values - 1, 1)
        self.running_mean.lerp_(mean, momentum)  # type: ignore[union-attr]
        self.running_var.lerp_(unbiased, momentum)  # type: ignore[union-attr]
        self.num_batches_tracked.add_(1)  # type: ignore[union-attr]
