"""What a user can choose of a build."""

from __future__ import annotations

from dataclasses import dataclass

from vioapr.errors import ParameterError
from vioapr.regression.pretrained import FITTED, LITE0, POINTS, RETRIEVAL, has_pretrained, has_xfeat


@dataclass(frozen=True)
class BuildParams:
    """What localizer is built, and how long is taken for it."""

    model: str = ""
    """Regressor, as `vioapr train` calls it; by default retrieval, which takes seconds, where its
    weights are installed (extra pretrained), else posenet."""
    refine: bool = False
    """Then make another one, while the first can be used, and keep the better of both."""
    refine_model: str = ""
    """Regressor to refine with; by default points where its weights are installed (extra points),
    else efficientnet-lite0."""
    epochs: int = 60
    """Times that every image is learned from, by what is trained; so are the sizes."""
    resize: int = 256
    """Size to which images are resized, pixels."""
    crop: int = 224
    """Size of the part that the network sees, pixels."""
    seed: int = 0
    """Of everything random."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing; the sizes are checked with the network."""
        if self.epochs < 1:
            raise ParameterError(f"`epochs`: expected at least 1, got {self.epochs}")
        if self.seed < 0:
            raise ParameterError(f"`seed`: expected at least 0, got {self.seed}")
        if self.refine and len(self.models) < 2:
            raise ParameterError(
                f"`refine_model`: expected another than the first, {self.models[0]}"
            )

    @property
    def models(self) -> list[str]:
        """The regressors to fit, in order, each once."""
        wanted = [self.model or (RETRIEVAL if has_pretrained() else "posenet")]
        if self.refine:
            trained = LITE0 if has_pretrained() else "posenet"
            better = POINTS if has_pretrained() and has_xfeat() else trained
            wanted.append(self.refine_model or better)
        return list(dict.fromkeys(wanted))

    def inputs_of(self, model: str) -> list[object]:
        """What a fitted regressor depends on, beside the scene."""
        if model in FITTED:
            return [model]
        return [model, self.epochs, self.resize, self.crop, self.seed]
