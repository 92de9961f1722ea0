"""The best trajectory after a walk: from what came before and after every frame.

Causal estimates, as a phone needs them, come from `offline.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from vioapr.errors import ParameterError
from vioapr.fusion.chain import offline as chain_offline
from vioapr.fusion.chain.method import METHOD as CHAIN
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.fusion.pairing import PairedFrames
from vioapr.fusion.types import Method
from vioapr.work.progress import Tick, ignore

SMOOTHERS: dict[str, Callable[[Any, Sequence[PairedFrames], Tick], list[FusedWalk]]] = {
    CHAIN.name: chain_offline.smooth_walks
}
"""Of the methods that can use the future; they tick as often as `fuse_walks`."""


def smooth_walk(
    method: Method, params: Any, frames: PairedFrames, *, tick: Tick = ignore
) -> FusedWalk:
    """Smooth one walk; see `smooth_walks`."""
    return smooth_walks(method, params, [frames], tick=tick)[0]


def smooth_walks(
    method: Method, params: Any, walks: Sequence[PairedFrames], *, tick: Tick = ignore
) -> list[FusedWalk]:
    """Find the best trajectories of walks after they have ended.

    Args:
        method: One of `SMOOTHERS`.
        params: Its parameters.
        walks: The walks, of any lengths.
        tick: Called once for every time step of the longest walk.

    Raises:
        ParameterError: The method cannot use the future.
    """
    if method.name not in SMOOTHERS:
        raise ParameterError(
            f"smoothing needs a method that can use the future: {' or '.join(SMOOTHERS)}; "
            f"{method.name} cannot"
        )
    return SMOOTHERS[method.name](params, walks, tick)
