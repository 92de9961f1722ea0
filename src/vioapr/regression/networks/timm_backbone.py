"""Any backbone of timm, as an optional extra."""

from __future__ import annotations

from torch import Tensor, nn

from vioapr.errors import MissingExtraError, ParameterError

TIMM_PREFIX = "timm:"


class TimmBackbone(nn.Module):
    """Images (B, 3, H, W) to features (B, C, h, w) of a model of timm, with random weights.

    Attributes:
        channels: C.
    """

    def __init__(self, name: str) -> None:
        """By timm's name, e.g. `resnet50`.

        Raises:
            MissingExtraError: timm is not installed.
            ParameterError: It has no such model.
        """
        super().__init__()
        try:
            import timm  # pyright: ignore[reportMissingImports]
        except (ImportError, RuntimeError) as error:
            if isinstance(error, ModuleNotFoundError) and error.name == "timm":
                raise MissingExtraError("a backbone of timm", "timm", "timm") from None
            # timm imports torchvision, which fails beside a torch of another build.
            raise ParameterError(
                f"timm is installed but cannot be imported: {error}; "
                f"it needs the torchvision that belongs to the installed torch"
            ) from None
        try:
            self.model = timm.create_model(name, pretrained=False, num_classes=0, global_pool="")
        except RuntimeError as error:
            raise ParameterError(f"model {TIMM_PREFIX}{name}: {error}") from None
        self.channels = int(self.model.num_features)

    def forward(self, images: Tensor) -> Tensor:
        """Tokens of transformers, (B, T, C), come as a map of one column."""
        features = self.model(images)
        return features if features.dim() == 4 else features.transpose(1, 2)[..., None]
