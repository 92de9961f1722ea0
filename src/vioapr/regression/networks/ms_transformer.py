"""MS-Transformer: one network for many scenes (Shavit et al., ICCV 2021).

Two transformers read the feature maps of an EfficientNet-B0, one for position and one for
orientation. Each has one learned query a scene; which scene's answer counts is a class that
the network predicts too.

Shapes: B batch, T = H W tokens of a map, D = 256 channels, S scenes.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from vioapr.regression.networks.base import PoseNetwork, Raw, one_hot_of_largest
from vioapr.regression.networks.efficientnet import EfficientNetB0
from vioapr.regression.networks.rotation import RotationCode

_WIDTH, _HEADS, _FEED_FORWARD, _HIDDEN = 256, 4, 256, 1024
_LONGEST_SIDE = 64
"""Of a map, tokens; 28 at the paper's size."""


class Attention(nn.Module):
    """Multi-head attention, residual connection, normalization."""

    def __init__(self, dropout: float) -> None:
        """Of D channels."""
        super().__init__()
        self.attention = nn.MultiheadAttention(_WIDTH, _HEADS, dropout, batch_first=True)
        self.dropout = nn.Dropout(dropout)
        self.norm = nn.LayerNorm(_WIDTH)

    def forward(self, tokens: Tensor, query: Tensor, key: Tensor, value: Tensor) -> Tensor:
        """Tokens (B, N, D) plus what their queries find."""
        found, _ = self.attention(query, key, value, need_weights=False)
        return self.norm(tokens + self.dropout(found))


class FeedForward(nn.Module):
    """Two layers, residual connection, normalization."""

    def __init__(self, dropout: float) -> None:
        """Of D channels."""
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(_WIDTH, _FEED_FORWARD), nn.ReLU(), nn.Dropout(dropout),
            nn.Linear(_FEED_FORWARD, _WIDTH), nn.Dropout(dropout),
        )  # fmt: skip
        self.norm = nn.LayerNorm(_WIDTH)

    def forward(self, tokens: Tensor) -> Tensor:
        """(B, N, D) to (B, N, D)."""
        return self.norm(tokens + self.layers(tokens))


class EncoderLayer(nn.Module):
    """DETR's: positions are added to queries and keys of every layer."""

    def __init__(self, dropout: float) -> None:
        """Of D channels."""
        super().__init__()
        self.attend, self.feed = Attention(dropout), FeedForward(dropout)

    def forward(self, tokens: Tensor, places: Tensor) -> Tensor:
        """(B, T, D), with places (1, T, D)."""
        placed = tokens + places
        return self.feed(self.attend(tokens, placed, placed, tokens))


class DecoderLayer(nn.Module):
    """DETR's: scenes attend to each other, then to the image."""

    def __init__(self, dropout: float) -> None:
        """Of D channels."""
        super().__init__()
        self.attend_scenes, self.attend_image = Attention(dropout), Attention(dropout)
        self.feed = FeedForward(dropout)

    def forward(self, answers: Tensor, queries: Tensor, memory: Tensor, keys: Tensor) -> Tensor:
        """Answers (B, S, D) so far, queries (1, S, D), memory and its keys (B, T, D)."""
        asked = answers + queries
        answers = self.attend_scenes(answers, asked, asked, answers)
        return self.feed(self.attend_image(answers, answers + queries, keys, memory))


class SceneTransformer(nn.Module):
    """From a feature map, one answer a scene."""

    def __init__(
        self, channels: int, scenes: int, encoders: int, decoders: int, dropout: float
    ) -> None:
        """Of a map with a number of channels."""
        super().__init__()
        self.project = nn.Conv2d(channels, _WIDTH, 1)
        self.rows = nn.Parameter(torch.rand(_LONGEST_SIDE, _WIDTH // 2))
        self.columns = nn.Parameter(torch.rand(_LONGEST_SIDE, _WIDTH // 2))
        self.queries = nn.Parameter(torch.randn(scenes, _WIDTH))
        self.encoder = nn.ModuleList(EncoderLayer(dropout) for _ in range(encoders))
        self.decoder = nn.ModuleList(DecoderLayer(dropout) for _ in range(decoders))
        self.norm = nn.LayerNorm(_WIDTH)
        for parameter in (*self.encoder.parameters(), *self.decoder.parameters()):
            if parameter.dim() > 1:
                nn.init.xavier_uniform_(parameter)

    def forward(self, feature_map: Tensor) -> Tensor:
        """(B, C, H, W) to (B, S, D)."""
        places = self._places(*feature_map.shape[-2:])
        tokens = self.project(feature_map).flatten(2).transpose(1, 2)
        for layer in self.encoder:
            tokens = layer(tokens, places)
        queries = self.queries[None]
        answers = torch.zeros_like(queries).expand(len(tokens), -1, -1)
        keys = tokens + places
        for layer in self.decoder:
            answers = layer(answers, queries, tokens, keys)
        return self.norm(answers)

    def _places(self, height: int, width: int) -> Tensor:
        """Learned embeddings of column and row, shape (1, T, D)."""
        columns = self.columns[None, :width].expand(height, -1, -1)
        rows = self.rows[:height, None].expand(-1, width, -1)
        return torch.cat([columns, rows], dim=-1).flatten(0, 1)[None]


class MSTransformer(PoseNetwork):
    """Position from the coarse map, orientation from the fine one."""

    def __init__(
        self, code: RotationCode, scenes: int, orientation_layers: int = 6, dropout: float = 0.1
    ) -> None:
        """For a number of scenes.

        Args:
            code: Of rotations.
            scenes: S.
            orientation_layers: Of encoder and decoder; 6 for Cambridge, 4 for 7Scenes.
            dropout: While training.
        """
        super().__init__(code, scenes)
        self.backbone = EfficientNetB0()
        self.backbone.freeze_unmapped()
        coarse, fine = EfficientNetB0.COARSE_CHANNELS, EfficientNetB0.FINE_CHANNELS
        depth = orientation_layers
        self.position = SceneTransformer(coarse, scenes, 6, 6, dropout)
        self.orientation = SceneTransformer(fine, scenes, depth, depth, dropout)
        self.scene = nn.Linear(2 * _WIDTH, 1)
        self.position_head = _regressor(3)
        self.rotation_head = _regressor(code.size)
        self.log_sigma = nn.Linear(2 * _WIDTH, 2)
        nn.init.zeros_(self.log_sigma.weight)
        with torch.no_grad():
            self.log_sigma.bias.fill_(-1.0)
            last = self.rotation_head.get_submodule("2")
            last.get_parameter("bias").copy_(torch.tensor(code.start))

    def position_modules(self) -> tuple[nn.Module, ...]:
        """Two layers, and one."""
        return self.position_head, self.log_sigma

    def forward_raw(self, images: Tensor, scene: Tensor | None = None) -> Raw:
        """The true scene's answer where scenes are given, else that of the likeliest one."""
        fine, coarse = self.backbone.forward_maps(images)
        position, orientation = self.position(coarse), self.orientation(fine)
        both = torch.cat([position, orientation], dim=-1)
        logits = self.scene(both)[..., 0]
        if scene is None:
            chosen = one_hot_of_largest(logits)
        else:
            chosen = nn.functional.one_hot(scene, logits.shape[-1]).to(logits.dtype)
        position, orientation, both = (
            (answers * chosen[..., None]).sum(dim=1) for answers in (position, orientation, both)
        )
        return Raw(
            self.position_head(position),
            self.rotation_head(orientation),
            self.log_sigma(both.detach()),
            logits,
        )


def _regressor(outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(_WIDTH, _HIDDEN), nn.GELU(), nn.Linear(_HIDDEN, outputs))
