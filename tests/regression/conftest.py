"""Tests here need PyTorch, and keep to one thread: they run beside others."""

import pytest

pytest.importorskip("torch", reason="PyTorch is not installed")
for package in ("safetensors", "lightning_fabric", "tensorboard"):
    pytest.importorskip(package, reason=f"{package} is not installed")


@pytest.fixture(autouse=True)
def beside_others(one_thread):
    pass
