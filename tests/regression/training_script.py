"""Trains on the toy scene: `python training_script.py SCENE OUT MODEL DEVICES EPOCHS BATCH`.

EPOCHS are as `2`, or as `2+1` where the last one is of positions alone.

A program of its own, as Lightning Fabric starts a run's other processes by starting the program
again.
"""

from __future__ import annotations

import sys
from pathlib import Path

import torch
from tests.regression.toy import params, spec

from vioapr.regression.data import load_samples, split_frames
from vioapr.regression.networks import build
from vioapr.regression.networks.blocks import StochasticDepth
from vioapr.regression.params import PositionStageParams
from vioapr.regression.run import Run, set_units
from vioapr.regression.training import train
from vioapr.scene.scene import Scene


def main(folder: str, out: str, model: str, devices: str, epochs: str, batch: str) -> None:
    """Without what is random within the network: processes draw it for themselves."""
    scene = Scene.open(Path(folder))
    learned, checked = (
        load_samples([scene], [frames], 36) for frames in split_frames([scene], "train")
    )
    run_spec = spec(model, dropout=0.0)
    torch.manual_seed(0)
    network = build(run_spec)
    for module in network.modules():
        if isinstance(module, StochasticDepth):
            module.probability = 0.0
    set_units(network, learned)
    first, _, second = epochs.partition("+")
    run_params = params(
        epochs=int(first), devices=int(devices), batch_size=int(batch),
        position_stage=PositionStageParams(int(second or 0)),
    )  # fmt: skip
    train(Run(run_spec, network, learned, checked, Path(out), run_params))


if __name__ == "__main__":
    main(*sys.argv[1:])
