"""ResNet-34 (He et al., CVPR 2016), with torchvision's names of parameters."""

from __future__ import annotations

from torch import Tensor, nn

from vioapr.regression.networks.blocks import initialize

_STAGES = ((64, 3), (128, 4), (256, 6), (512, 3))
"""Channels and blocks."""


class BasicBlock(nn.Module):
    """Two convolutions and a residual connection."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        """The first convolution has the stride."""
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(outputs)
        self.relu = nn.ReLU(inplace=True)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(outputs)
        self.downsample = None
        if stride != 1 or inputs != outputs:
            self.downsample = nn.Sequential(
                nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs)
            )

    def forward(self, features: Tensor) -> Tensor:
        """BCHW to BCHW."""
        kept = features if self.downsample is None else self.downsample(features)
        features = self.relu(self.bn1(self.conv1(features)))
        return self.relu(self.bn2(self.conv2(features)) + kept)


class ResNet34(nn.Module):
    """Everything but the classifier."""

    CHANNELS = 512

    def __init__(self) -> None:
        """With random weights."""
        super().__init__()
        self.conv1 = nn.Conv2d(3, 64, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        self.relu = nn.ReLU(inplace=True)
        self.maxpool = nn.MaxPool2d(3, 2, 1)
        inputs = 64
        for number, (outputs, count) in enumerate(_STAGES, start=1):
            stride = 1 if number == 1 else 2
            blocks = [BasicBlock(inputs, outputs, stride)]
            blocks += [BasicBlock(outputs, outputs, 1) for _ in range(count - 1)]
            setattr(self, f"layer{number}", nn.Sequential(*blocks))
            inputs = outputs
        initialize(self)

    def forward(self, images: Tensor) -> Tensor:
        """Images (B, 3, H, W) to features (B, 512, H/32, W/32)."""
        features = self.maxpool(self.relu(self.bn1(self.conv1(images))))
        for number in range(1, len(_STAGES) + 1):
            features = self.get_submodule(f"layer{number}")(features)
        return features
