"""Training's input pipeline: does it keep up with the network, and what does the cache save?

    python benchmarks/training_speed.py [--model posenet] [--quick] [--paper] [--json PATH]

In one process, taking turns so that a slow spell of the machine hits all:

- `resident + step`: training steps on one batch that lies in memory: nothing can be faster;
- `ours + step`: the same steps, fed as `vioapr train` feeds them, from the decoded cache;
- `plain + step`: the same steps, fed by PyTorch's DataLoader, whose processes decode and resize
  every JPEG with PIL in every epoch, as the published code of both networks does;
- `ours` and `plain`: the two loaders alone.

Ours varies colours too, the plain loader only crops. Ratios are medians of the paired ratios of
all rounds. The images are noise with the spectrum of photographs, in JPEGs of a phone's size.

`--paper` (on a GPU only) runs a few epochs of the paper's setting, 2,058 images in batches of 32,
and says what 400 would take.
"""

from __future__ import annotations

import itertools
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from common import describe_machine, publish, time_interleaved, write_json
from PIL import Image
from rich.console import Console
from rich.table import Table
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from vioapr.cli.console import progress
from vioapr.files.images import encode_image, read_rgb, write_image
from vioapr.geometry import quaternion
from vioapr.regression.augmentation import normalize
from vioapr.regression.batches import Batch, BatchSource
from vioapr.regression.cache import cached_images
from vioapr.regression.data import Samples
from vioapr.regression.distributed import start_fabric
from vioapr.regression.losses import Learner
from vioapr.regression.networks import build
from vioapr.regression.params import TrainingParams
from vioapr.schemas.regressor import RegressorSpec
from vioapr.simulation.courtyard.noise import fractal

PAPER_IMAGES, PAPER_EPOCHS = 2058, 400
GOAL_RESIDENT, GOAL_PLAIN = 0.95, 5.0
Job = Callable[[], object]


@dataclass(frozen=True)
class Config:
    """What to measure."""

    update_docs: bool = False
    """Put the table into docs/results/performance.md."""
    model: str = "posenet"
    """Network, as of vioapr train."""
    images: int = 256
    """Training images; what does not fill a batch is left out."""
    distinct: int = 16
    """Different ones among them; the others are copies under other names."""
    width_px: int = 1920
    height_px: int = 1440
    """Size of the JPEGs."""
    resize: int = 256
    crop: int = 224
    batch_size: int = 32
    rounds: int = 7
    """Each of one epoch of every variant."""
    workers: int = os.cpu_count() or 1
    """Processes of the plain loader."""
    quick: bool = False
    """Tiny, to see that it runs."""
    paper: bool = False
    """On a GPU: the paper's setting, extrapolated from --epochs epochs a round."""
    epochs: int = 3
    """Of each variant in every round of --paper."""
    json: Path | None = None
    """File to write the figures to."""


QUICK = Config(
    model="mobile", images=12, distinct=2, width_px=160, height_px=120, resize=40, crop=32,
    batch_size=4, rounds=2, workers=1,
)  # fmt: skip


def make_images(folder: Path, config: Config) -> list[Path]:
    """JPEGs of a photograph's spectrum."""
    rng = np.random.default_rng(0)
    shape = (config.height_px, config.width_px)
    contents = []
    for _ in range(config.distinct):
        light = fractal(rng, shape, slope=1.25)
        colours = [light + 0.3 * fractal(rng, shape, slope=1.25) for _ in range(3)]
        pixels = np.clip(120 + 45 * np.stack(colours, axis=-1), 0, 255).astype(np.uint8)
        contents.append(encode_image("a.jpg", pixels))
    paths = [folder / f"{number:05d}.jpg" for number in range(config.images)]
    for path, content in zip(paths, itertools.cycle(contents), strict=False):
        write_image(path, content)
    return paths


def make_samples(paths: list[Path], resize: int, file: Path) -> Samples:
    """The images, decoded, with poses."""
    rng = np.random.default_rng(1)
    count = len(paths)
    with progress("building the cache", count) as tick:
        images = cached_images(paths, resize, file, tick)
    return Samples(
        (images,), np.zeros(count, dtype=np.int64), np.arange(count),
        np.zeros(count, dtype=np.int64), rng.normal(size=(count, 3)),
        quaternion.normalize(rng.normal(size=(count, 4))), np.ones((count, 4)), "",
    )  # fmt: skip


class PlainImages(Dataset):
    """Decodes an image whenever it is asked for."""

    def __init__(self, paths: list[Path], samples: Samples, resize: int, crop: int) -> None:
        """Of these images, with the samples' poses."""
        self.paths, self.samples, self.resize, self.crop = paths, samples, resize, crop

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, row: int) -> tuple[Tensor, Tensor, Tensor]:
        """Image (3, crop, crop), position and rotation."""
        with Image.open(self.paths[row]) as image:
            small = image.convert("RGB").resize((self.resize, self.resize))
        left, top = np.random.default_rng().integers(0, self.resize - self.crop + 1, 2)
        pixels = np.array(small.crop((left, top, left + self.crop, top + self.crop)))
        tensor = torch.from_numpy(pixels).permute(2, 0, 1).to(torch.float32) / 255
        position = torch.as_tensor(self.samples.position_m[row], dtype=torch.float32)
        quat = torch.as_tensor(self.samples.quat_xyzw[row], dtype=torch.float32)
        return normalize(tensor), position, quat


class Bench:
    """The two loaders and the step, on one device."""

    def __init__(self, paths: list[Path], samples: Samples, config: Config) -> None:
        """With a network of random weights."""
        self.config = config
        self.fabric = start_fabric(TrainingParams(batch_size=config.batch_size))
        self.device = self.fabric.device
        params = TrainingParams(batch_size=config.batch_size)
        spec = RegressorSpec(config.model, ("Noise",), resize=config.resize, crop=config.crop)
        learner = Learner(build(spec), params.loss)
        learner.to(memory_format=torch.channels_last)
        optimizer = torch.optim.Adam([p for p in learner.parameters() if p.requires_grad])
        self.learner, self.optimizer = self.fabric.setup(learner, optimizer)
        self.learner.train()
        self.source = BatchSource(
            samples, config.crop, params.augmentation, config.batch_size, 0, self.device
        )
        # One for each variant: their processes stay, and rest between two epochs.
        self.loaders = [
            DataLoader(
                PlainImages(paths, samples, config.resize, config.crop), config.batch_size,
                shuffle=True, num_workers=config.workers, drop_last=True, persistent_workers=True,
                pin_memory=self.device.type == "cuda",
            )
            for _ in range(2)
        ]  # fmt: skip
        self.resident = next(iter(self.source.epoch(0)))
        self.numbers = itertools.count()

    def same(self) -> Iterator[Batch]:
        """An epoch of one batch."""
        return itertools.repeat(self.resident, len(self.source))

    def ours(self) -> Iterator[Batch]:
        """An epoch, as in training."""
        return self.source.epoch(next(self.numbers))

    def plain(self, number: int) -> Iterator[Batch]:
        """An epoch, decoded again, by one of the two plain loaders."""
        for tensors in self.loaders[number]:
            images, position, quat = (t.to(self.device, non_blocking=True) for t in tensors)
            scene = torch.zeros(len(images), dtype=torch.int64, device=self.device)
            yield Batch(images, position, quat, scene)

    def step(self, batch: Batch) -> None:
        """As in training."""
        images = batch.images.contiguous(memory_format=torch.channels_last)
        loss = self.learner(batch._replace(images=images))
        self.fabric.backward(loss)
        self.optimizer.step()
        self.optimizer.zero_grad()

    def job(self, make_epoch: Callable[[], Iterator[Batch]], epochs: int = 1) -> Job:
        """Trains for whole epochs, so that no batch is made ready before it begins."""
        return lambda: self._run(make_epoch, self.step, epochs)

    def loading(self, make_epoch: Callable[[], Iterator[Batch]]) -> Job:
        """Loads an epoch, and nothing else."""
        return lambda: self._run(make_epoch, lambda batch: None, 1)

    def _run(
        self, make_epoch: Callable[[], Iterator[Batch]], use: Callable[[Batch], None], epochs: int
    ) -> None:
        for _ in range(epochs):
            for batch in make_epoch():
                use(batch)
        if self.device.type == "cuda":
            torch.cuda.synchronize()


def measure(bench: Bench, config: Config) -> dict[str, Any]:
    """Images a second of every variant, and their ratios."""
    jobs = {
        "resident + step": bench.job(bench.same),
        "ours + step": bench.job(bench.ours),
        "plain + step": bench.job(lambda: bench.plain(0)),
        "ours": bench.loading(bench.ours),
        "plain": bench.loading(lambda: bench.plain(1)),
    }
    seconds = time_interleaved(jobs, config.rounds)
    images = len(bench.source) * config.batch_size
    return {
        "images_per_s": {name: images / float(np.median(s)) for name, s in seconds.items()},
        "ours_over_resident": _ratio(seconds, "resident + step", "ours + step"),
        "ours_over_plain": _ratio(seconds, "plain", "ours"),
        "ours_over_plain_with_step": _ratio(seconds, "plain + step", "ours + step"),
    }


def measure_paper(bench: Bench, config: Config) -> dict[str, Any]:
    """Hours of the paper's training, and their ratio to steps on a resident batch."""
    jobs = {
        "resident + step": bench.job(bench.same, config.epochs),
        "ours + step": bench.job(bench.ours, config.epochs),
    }
    seconds = time_interleaved(jobs, config.rounds)
    epoch_s = float(np.median(seconds["ours + step"])) / config.epochs
    return {
        "epochs_measured": config.epochs,
        "epoch_s": epoch_s,
        f"hours_of_{PAPER_EPOCHS}_epochs_extrapolated": PAPER_EPOCHS * epoch_s / 3600,
        "over_resident": 1 / _ratio(seconds, "resident + step", "ours + step"),
    }


def _ratio(seconds: dict[str, list[float]], slow: str, fast: str) -> float:
    """How many times faster, median of the rounds."""
    return float(np.median(np.divide(seconds[slow], seconds[fast])))


def print_figures(found: dict[str, Any], device: str, config: Config) -> None:
    """A table, and the goals."""
    console = Console(width=120)
    title = f"{config.model}, {device}, batches of {config.batch_size}, median of {config.rounds}"
    table = Table(title=title)
    for column in ("", "images/s"):
        table.add_column(column, justify="left" if not column else "right")
    for name, rate in found["images_per_s"].items():
        table.add_row(name, f"{rate:.1f}")
    section = f"training_{config.model}".replace("-", "_")
    publish(table, "performance.md", section, update_docs=config.update_docs)
    for name, ratio, goal in (
        ("ours + step, over resident + step", found["ours_over_resident"], GOAL_RESIDENT),
        ("loader alone, over the plain one alone", found["ours_over_plain"], GOAL_PLAIN),
    ):
        verdict = "met" if ratio >= goal else "MISSED"
        console.print(f"{name}: {ratio:.3f} (goal: at least {goal:g}, {verdict})")
    console.print(f"ours + step, over plain + step: {found['ours_over_plain_with_step']:.2f}")
    if "paper" in found:
        paper = found["paper"]
        hours = paper[f"hours_of_{PAPER_EPOCHS}_epochs_extrapolated"]
        console.print(
            f"the paper's setting: {hours:.2f} h for {PAPER_EPOCHS} epochs of {PAPER_IMAGES} "
            f"images, extrapolated from {paper['epochs_measured']} epochs; "
            f"{paper['over_resident']:.3f} times as long as on a resident batch"
        )


def main(config: Config) -> None:
    """Measure and print."""
    if config.quick:
        config = replace(QUICK, json=config.json, update_docs=config.update_docs)
    if config.paper and not torch.cuda.is_available():
        sys.exit("--paper: expected a GPU, found none")
    if config.paper:
        config = replace(config, images=PAPER_IMAGES, batch_size=32, resize=256, crop=224)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = make_images(folder, config)
        samples = make_samples(paths, config.resize, folder / "cache" / "images.npy")
        bench = Bench(paths, samples, config)
        found = measure(bench, config)
        if config.paper:
            found["paper"] = measure_paper(bench, config)
        size_kb = float(np.mean([path.stat().st_size for path in paths])) / 1e3
        decoded = read_rgb(paths[0]).shape
        del bench  # its processes
    cuda = bench_device()
    print_figures(found, cuda, config)
    if config.json is not None:
        settings = {k: v for k, v in vars(config).items() if k not in ("json", "quick")}
        content = {
            "machine": {**describe_machine(["numpy", "torch", "pillow"]), "device": cuda},
            "load": os.getloadavg(),
            "threads": torch.get_num_threads(),
            "settings": settings,
            "jpeg": {"mean_kb": size_kb, "width_px": decoded[1], "height_px": decoded[0]},
            **found,
        }
        write_json(config.json, content)


def bench_device() -> str:
    """What trains."""
    return torch.cuda.get_device_name() if torch.cuda.is_available() else "CPU"


if __name__ == "__main__":
    main(tyro.cli(Config))
