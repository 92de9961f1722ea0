"""More than one device, through Lightning Fabric."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import torch
from lightning_fabric import Fabric
from torch import Tensor, nn
from torch.nn.modules.batchnorm import _BatchNorm

from vioapr.errors import ParameterError
from vioapr.regression.params import TrainingParams


def start_fabric(params: TrainingParams) -> Fabric:
    """Start the processes of a run; with one device nothing is started.

    The other processes are this program, started again with the same arguments: all that comes
    before this call happens in each of them.

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
        # The same seed gives the same weights.
        torch.backends.cudnn.deterministic = True
    return fabric


@contextlib.contextmanager
def ending_together(fabric: Fabric) -> Iterator[None]:
    """End the processes that this one started where it fails: they would wait for it forever."""
    try:
        yield
    except BaseException:
        launcher = fabric.strategy.launcher
        for process in getattr(launcher, "procs", ()):
            process.kill()
        raise


def mean_of_processes(fabric: Fabric, value: Tensor) -> Tensor:
    """Average a value that every process has, without gradient."""
    if fabric.world_size == 1:
        return value.detach()
    summed = value.detach().clone()
    torch.distributed.all_reduce(summed)
    return summed / fabric.world_size


def synchronize_norms(network: nn.Module, fabric: Fabric) -> None:
    """Let batch normalization see the batch of all processes, as one process would.

    The parameters stay the same objects, as an optimizer may know them already.

    Raises:
        ParameterError: There are several, and the network normalizes in a way of its own.
    """
    if fabric.world_size == 1:
        return
    for name, module in list(network.named_modules()):
        if not isinstance(module, _BatchNorm):
            continue
        if type(module) is not nn.BatchNorm2d:
            raise ParameterError(
                f"devices: expected 1 for a network with {type(module).__name__}, which "
                f"processes cannot share, got {fabric.world_size}"
            )
        if fabric.device.type == "cuda":
            shared = nn.SyncBatchNorm.convert_sync_batchnorm(module)
        else:
            shared = SharedBatchNorm(module.num_features, module.eps, module.momentum)
            shared.weight, shared.bias = module.weight, module.bias
            shared.load_state_dict(module.state_dict())
            shared.train(module.training)
        parent = network.get_submodule(name.rpartition(".")[0])
        setattr(parent, name.rpartition(".")[2], shared)


class SharedBatchNorm(nn.BatchNorm2d):
    """Batch normalization over all processes, on CPUs.

    PyTorch's SyncBatchNorm raises "expected input tensor to be on GPU" there (2.13, with gloo),
    and Fabric has none: without this class, training on several CPUs, which the tests of
    everything distributed do, would learn something else than one process.
    """

    def forward(self, input: Tensor) -> Tensor:
        """Normalize (B, C, H, W)."""
        if not self.training:
            return super().forward(input)
        count = torch.distributed.get_world_size()
        values = input.float()  # mixed precision hands over halves, and statistics need more
        mean = _SumOfProcesses.apply(values.mean(dim=(0, 2, 3))) / count
        centred = values - mean[:, None, None]
        variance = _SumOfProcesses.apply(centred.square().mean(dim=(0, 2, 3))) / count
        self._remember(mean.detach(), variance.detach(), input[:, 0].numel() * count)
        scale = self.weight * torch.rsqrt(variance + self.eps)
        return (centred * scale[:, None, None] + self.bias[:, None, None]).to(input.dtype)

    @torch.no_grad()
    def _remember(self, mean: Tensor, variance: Tensor, values: int) -> None:
        momentum = self.momentum or 0.0
        unbiased = variance * values / max(values - 1, 1)
        self.running_mean.lerp_(mean, momentum)  # type: ignore[union-attr]
        self.running_var.lerp_(unbiased, momentum)  # type: ignore[union-attr]
        self.num_batches_tracked.add_(1)  # type: ignore[union-attr]


class _SumOfProcesses(torch.autograd.Function):
    """A tensor summed over all processes; so is its gradient, as each loss depends on each part."""

    @staticmethod
    def forward(ctx: Any, part: Tensor) -> Tensor:
        del ctx
        summed = part.clone()
        torch.distributed.all_reduce(summed)
        return summed

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Tensor:
        del ctx
        summed = grads[0].contiguous().clone()
        torch.distributed.all_reduce(summed)
        return summed
