"""What regressors state of their own errors, as relative weights of predictions.

Only ratios count: a prediction's stated variance over the usual one. A regressor that understates
all of its errors by a factor is taken as one that states them rightly. And the ratios count only
as far as they prove to say something: predictions that are stated to be worse than usual have to
fall farther from where the estimates before them expect the camera. What is stated to be ten times
worse than usual speaks neither for nor against a hypothesis, and begins none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vioapr.fusion.types import FrameInput
from vioapr.geometry.arrays import Array, Mask, namespace, zeros

_MEMORY, _MEMORY_OF_VETO = 0.02, 0.005
"""Least weight of a new prediction in the usual sigma."""

_MOST_CHANGE = 1.0
"""Of a logarithm, that the usual one follows at that rate."""

_LEAST, _MOST = 1 / 9, 1e6
"""Of the ratios of variances: nobody is believed to be more than three times as exact as usual."""

VETO = 100.0
"""Ratio from which on a prediction has no say about where the place is: whoever states to be ten
times worse than usual is believed at once."""

_RECALL = 0.98
"""Share of the evidence that is kept from prediction to prediction."""

_PRIOR = 2.0
"""Evidence from which on stated ratios are believed."""

_LONGEST = 1e6
"""Sigmas from here on say that nothing is known."""


class Usual(NamedTuple):
    """What the regressor usually states, of orientation and position, shape (..., 2, 1).

    Attributes:
        log_sigma: Running mean of the logarithm, of rad and m.
        stated_times: How often something was stated.
        evidence: Logarithm of how much likelier the recent predictions' distances from what was
            expected are with the stated ratios than without.
    """

    log_sigma: Array
    stated_times: Array
    evidence: Array

    def weigh(self, frame: FrameInput, surprise: Array) -> tuple[Usual, Array, Mask]:
        """With a frame; its believed variances over the usual ones; and whether it says no.

        Shapes (..., 2, 1) and (..., 1, 1). The ratios are 1 where nothing is stated.

        Args:
            frame: With a prediction.
            surprise: The prediction's squared distance from what was expected, in units of the
                usual one per axis; not above 0 where nothing was, shape (..., 2, 1).
        """
        xp = namespace(self.stated_times)
        if frame.apr_sigma_m is None and frame.apr_sigma_rad is None:
            nobody = xp.zeros_like(self.stated_times[..., :1, :]) > 0
            return self, xp.ones_like(self.stated_times), nobody
        nothing = xp.zeros_like(frame.timestamp_s)
        stated = (frame.apr_sigma_rad, frame.apr_sigma_m)
        sigma = xp.stack([nothing if s is None else s for s in stated], axis=-1)[..., None]
        is_known = (sigma > 0) & (sigma < _LONGEST)
        log_sigma = xp.log(xp.where(is_known, sigma, 1.0))
        count = self.stated_times + xp.astype(is_known, self.stated_times.dtype)
        last = xp.where(self.stated_times > 0, self.log_sigma, log_sigma)
        log_ratio = xp.where(is_known, 2 * (log_sigma - last), 0.0)
        is_veto = xp.max(log_ratio, axis=-2, keepdims=True) > float(np.log(VETO))
        # Whoever says for a while to know nothing does not thereby make that the usual thing.
        memory = xp.where(is_veto, _MEMORY_OF_VETO, _MEMORY + xp.zeros_like(log_sigma))
        rate = xp.maximum(1 / xp.maximum(count, 1.0), memory)
        change = xp.minimum(xp.maximum(log_sigma - last, -_MOST_CHANGE), _MOST_CHANGE)
        usual = last + xp.where(is_known, rate * change, 0.0)
        log_ratio = xp.where(is_known, 2 * (log_sigma - usual), 0.0)
        least, most = np.log([_LEAST, _MOST]).tolist()
        ratio = xp.exp(xp.minimum(xp.maximum(log_ratio, least), most))
        evidence = _RECALL * self.evidence + _gain(ratio, surprise)
        known = Usual(usual, count, xp.where(is_known, evidence, self.evidence))
        belief = 1 / (1 + xp.exp(_PRIOR - known.evidence))
        belief = xp.where(is_veto, 1.0, belief)
        return known, 1 + belief * (ratio - 1), is_veto


def _gain(ratio: Array, squared: Array) -> Array:
    """Log-likelihood with a ratio of variances over the one without, for heavy-tailed errors.

    Student's t with two degrees of freedom, in three dimensions.
    """
    xp = namespace(ratio)
    gain = -1.5 * xp.log(ratio) - 2.5 * xp.log((1 + squared / (2 * ratio)) / (1 + squared / 2))
    return xp.where(squared > 0, gain, 0.0)


def nothing_usual(batch_shape: tuple[int, ...], like: Array) -> Usual:
    """Before the first frame."""
    shape = (*batch_shape, 2, 1)
    return Usual(*(zeros(shape, like) for _ in range(3)))
