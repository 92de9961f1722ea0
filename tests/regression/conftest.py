"""Tests here need PyTorch, and keep to one thread: they run beside others."""

import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
for package in ("safetensors", "lightning_fabric", "tensorboard"):
    pytest.importorskip(package, reason=f"{package} is not installed")


@pytest.fixture(autouse=True)
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)
