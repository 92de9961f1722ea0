"""Images a second of the simulated courtyard, rendered and encoded as JPEG.

Every worker is a process that walks through the place as a recording does: people, motion blur,
automatic exposure and noise included, images kept in memory. Loading the place is not counted.
A machine that does other work at the same time renders less: the load is part of the result.

    python benchmarks/rendering_speed.py [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import describe_machine, publish, write_json
from rich.table import Table

from vioapr.cli.console import progress
from vioapr.simulation.courtyard import world
from vioapr.simulation.courtyard.context import describe
from vioapr.simulation.courtyard.people import Crowd
from vioapr.simulation.courtyard.photography import Photographer
from vioapr.simulation.courtyard.plan import CourtyardParams, plan_motion, plan_recordings
from vioapr.simulation.courtyard.record import make_renderer
from vioapr.simulation.courtyard.simulate import few_threads
from vioapr.simulation.courtyard.weather import WEATHERS

CASES = ((256, 192, False), (256, 192, True), (480, 360, False))
REPEATS = 3


def work(
    place: world.World, params: CourtyardParams, number: int, images: int, barrier: Any, out: Any
) -> None:
    """Render one recording's images; report start, end and processor time of every repeat."""
    plan = plan_recordings(params)[number]
    renderer = make_renderer(place, params, seed=0)
    weather = WEATHERS[plan.weather]
    renderer.set_weather(weather)
    rng = np.random.default_rng(number)
    motion, crowd = plan_motion(plan, params, seed=0), Crowd(rng, params.people)
    photographer = Photographer(rng, renderer, weather, params.camera)

    def take(first: int, count: int) -> None:
        for row in range(first, first + count):
            time_s = (row + 0.5) / params.rate_hz
            camera_m = motion.position_m(time_s)
            photographer.take(motion, time_s, crowd.at(time_s, camera_m))

    take(0, 20)  # compiles the programs
    for repeat in range(REPEATS):
        barrier.wait()
        start, start_cpu = time.monotonic(), time.process_time()
        take(20 + repeat * images, images)
        out.put((repeat, start, time.monotonic(), time.process_time() - start_cpu))
    if number == 0:
        out.put(describe(renderer.context))


def measure(place: world.World, params: CourtyardParams, workers: int, images: int) -> dict:
    """Images a second of all workers together, median of the repeats."""
    context = multiprocessing.get_context("spawn")
    barrier, out = context.Barrier(workers), context.Queue()
    with few_threads(workers):
        processes = [
            context.Process(target=work, args=(place, params, number, images, barrier, out))
            for number in range(workers)
        ]
        for process in processes:
            process.start()
    reports = [out.get(timeout=600) for _ in range(workers * REPEATS + 1)]
    for process in processes:
        process.join()
    spans = [r for r in reports if not isinstance(r, str)]
    rates = []
    for repeat in range(REPEATS):
        ours = [span for span in spans if span[0] == repeat]
        seconds = max(s[2] for s in ours) - min(s[1] for s in ours)
        rates.append(workers * images / seconds)
    return {
        "size_px": [params.width_px, params.height_px],
        "oversampled": params.oversampled,
        "workers": workers,
        "images_per_s": statistics.median(rates),
        "best_images_per_s": max(rates),
        "cpu_ms_per_image": 1e3 * sum(s[3] for s in spans) / (REPEATS * workers * images),
        "renderer": next(r for r in reports if isinstance(r, str)),
    }


def main() -> None:
    """Measure all sizes and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    parser.add_argument("--quick", action="store_true", help="few images, to see that it runs")
    options = parser.parse_args()
    images = 20 if options.quick else 100
    workers = os.cpu_count() or 1
    load_before = os.getloadavg()[0]
    cases = [
        CourtyardParams(
            train=max(workers, 4), test=0, width_px=width, height_px=height, oversampled=oversampled
        )
        for width, height, oversampled in CASES
    ]
    place = world.build()
    with progress("rendering", len(cases)) as tick:
        results = []
        for params in cases:
            results.append(measure(place, params, workers, images))
            tick()
    table = Table(title=f"{workers} workers, {images} images each, median of {REPEATS}")
    for column in ("size", "pixels of", "images/s", "best", "CPU ms/image"):
        table.add_column(column)
    for result in results:
        size = "x".join(map(str, result["size_px"]))
        numbers = (result[k] for k in ("images_per_s", "best_images_per_s", "cpu_ms_per_image"))
        table.add_row(size, "4" if result["oversampled"] else "1", *(f"{n:.1f}" for n in numbers))
    publish(table, "rendering.md", "rendering", update_docs=options.update_docs)
    print(f"load of the machine before: {load_before:.1f}")
    if options.json:
        machine = describe_machine(["numpy", "moderngl", "pillow"])
        write_json(options.json, {"machine": machine, "load_before": load_before,
                                  "repeats": REPEATS, "results": results})  # fmt: skip


if __name__ == "__main__":
    main()
