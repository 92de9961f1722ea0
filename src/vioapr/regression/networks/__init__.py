"""The networks by name, built from a specification."""

from __future__ import annotations

from torch import nn

from vioapr.errors import ParameterError
from vioapr.regression.networks.base import PoseNetwork, Prediction, Raw
from vioapr.regression.networks.efficientnet_lite import EfficientNetLite0
from vioapr.regression.networks.mobilenet import MobileNetV3Large
from vioapr.regression.networks.ms_transformer import MSTransformer
from vioapr.regression.networks.posenet import PoseNet
from vioapr.regression.networks.resnet import ResNet34
from vioapr.regression.networks.retrieval import RetrievalNetwork
from vioapr.regression.networks.rotation import ROTATION_CODES
from vioapr.regression.networks.timm_backbone import TIMM_PREFIX, TimmBackbone
from vioapr.regression.pretrained import LITE0, POINTS, RETRIEVAL
from vioapr.schemas.regressor import PointsShape, RegressorSpec, RetrievalShape

__all__ = ["MODELS", "PoseNetwork", "Prediction", "Raw", "build", "check_model"]

MODELS = ("posenet", "ms-transformer", "mobile", LITE0, RETRIEVAL, POINTS)
"""Names besides `timm:<name>`."""

_DROPOUT = {"posenet": 0.5, "ms-transformer": 0.1, "mobile": 0.2, LITE0: 0.2}


def check_model(name: str) -> None:
    """Whether there is a network of a name.

    Raises:
        ParameterError: There is none; the message lists them.
    """
    if name not in MODELS and not name.startswith(TIMM_PREFIX):
        raise ParameterError(
            f"unknown model {name!r}: expected one of {', '.join(MODELS)}, {TIMM_PREFIX}<name>"
        )


def build(spec: RegressorSpec) -> PoseNetwork:
    """The network of a specification, with random weights.

    Raises:
        ParameterError: Unknown model or rotation, or several scenes where it has one only.
        MissingExtraError: Its package is not installed.
    """
    check_model(spec.model)
    if spec.rotation not in ROTATION_CODES:
        raise ParameterError(
            f"rotation: expected one of {', '.join(ROTATION_CODES)}, got {spec.rotation!r}"
        )
    code = ROTATION_CODES[spec.rotation]
    dropout = _DROPOUT.get(spec.model, 0.5) if spec.dropout is None else spec.dropout
    if spec.model == "ms-transformer":
        return MSTransformer(code, len(spec.scenes), spec.orientation_layers, dropout)
    if len(spec.scenes) != 1:
        raise ParameterError(
            f"model {spec.model} learns one scene, got {len(spec.scenes)}: "
            f"train one model a scene, or use ms-transformer"
        )
    if spec.model == RETRIEVAL:
        if not isinstance(spec.retrieval, RetrievalShape):
            raise ParameterError(f"model {RETRIEVAL}: expected the size of its index, got none")
        return RetrievalNetwork(spec.retrieval)
    if spec.model == POINTS:
        from vioapr.regression.points.network import PointsNetwork

        if not isinstance(spec.points, PointsShape):
            raise ParameterError(f"model {POINTS}: expected the size of its map, got none")
        return PointsNetwork(spec.points)
    if spec.model == "mobile":
        channels = MobileNetV3Large.CHANNELS
        return PoseNet(MobileNetV3Large(), channels, 1280, nn.Hardswish, dropout, code)
    if spec.model == LITE0:
        channels = EfficientNetLite0.CHANNELS
        return PoseNet(EfficientNetLite0(), channels, 1280, nn.ReLU, dropout, code)
    if spec.model == "posenet":
        return PoseNet(ResNet34(), ResNet34.CHANNELS, 2048, nn.ReLU, dropout, code)
    backbone = TimmBackbone(spec.model.removeprefix(TIMM_PREFIX))
    return PoseNet(backbone, backbone.channels, 2048, nn.ReLU, dropout, code)
