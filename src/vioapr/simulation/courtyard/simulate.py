"""The courtyard, walked several times and written as a scene."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vioapr.errors import AlreadyExistsError, ParameterError, UnwritableError, VioAprError
from vioapr.files.atomic import sync, sync_folder
from vioapr.scene.scene import SCENE_FILE, Scene
from vioapr.schemas.scene import World
from vioapr.simulation.courtyard import devices, world
from vioapr.simulation.courtyard.context import create_context
from vioapr.simulation.courtyard.plan import CourtyardParams, Plan, plan_recordings
from vioapr.simulation.courtyard.record import make_renderer, record
from vioapr.work.locks import locked_folder
from vioapr.work.progress import Tick, ignore


def simulate(
    folder: Path,
    params: CourtyardParams | None = None,
    seed: int = 0,
    *,
    workers: int | None = None,
    tick: Tick = ignore,
) -> Scene:
    """Render the courtyard's recordings and write them as a scene.

    The same parameters and seed give the same files on one machine, whatever the number of
    workers; another OpenGL driver or version of NumPy may round a pixel otherwise.

    Args:
        folder: The scene's folder; made if needed.
        params: Sizes, rates and numbers of recordings; None for the whole scene.
        seed: Of everything random.
        workers: Processes that render, a recording each at a time; None for one a core.
        tick: Called about once a frame, for progress; `params.frames` times a recording.

    Raises:
        MissingExtraError: moderngl is not installed.
        RenderingError: This machine cannot render.
        AlreadyExistsError: The folder holds something already.
        LockedError: Another process simulates this scene.
        UnwritableError: It cannot be written.
    """
    params = params or CourtyardParams()
    if seed < 0:
        raise ParameterError(f"seed: expected a number of at least 0, got {seed}")
    if workers is not None and workers < 1:
        raise ParameterError(f"workers: expected at least 1, got {workers}")
    create_context().release()  # fails before anything is written
    plans = plan_recordings(params)
    check_new(folder)
    # The scene appears when it is whole; what a killed simulation left is begun again.
    target = Path(os.path.realpath(folder))
    work = target.with_name(f".{target.name}.simulating")
    with locked_folder(work):
        try:
            partial = work / "scene"
            shutil.rmtree(partial, ignore_errors=True)
            scene = Scene.create(
                partial, "Simulated courtyard", is_outdoor=True, world=World(origin=devices.ORIGIN)
            )
            place = world.build(seed, params.texture_px_per_m)
            for plan in _record_all(scene, place, plans, params, seed, workers, tick):
                scene = scene.with_recording(plan.id_, plan.split)
            scene.save()
            sync_folder(partial)
            partial.replace(target)  # also of an empty folder
            sync(target.parent)
        except OSError as error:
            raise UnwritableError.of(folder, error) from None
        finally:
            shutil.rmtree(work, ignore_errors=True)
    return Scene.open(folder)


def check_new(folder: Path) -> None:
    """See that a scene can be made in a folder: it is new, or empty.

    Raises:
        AlreadyExistsError: It holds something, or is a file.
    """
    if (folder / SCENE_FILE).exists():
        problem = "expected to make a new scene, but it exists"
        raise AlreadyExistsError(folder / SCENE_FILE, problem)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        found = "other files" if folder.is_dir() else "a file"
        raise AlreadyExistsError(folder, f"expected a new or empty folder, found {found}")


def _record_all(
    scene: Scene,
    place: world.World,
    plans: list[Plan],
    params: CourtyardParams,
    seed: int,
    workers: int | None,
    tick: Tick,
) -> Iterator[Plan]:
    """Record all plans, here or in processes of their own; yields those that are done."""
    count = min(workers or os.cpu_count() or 1, len(plans))
    if count == 1:
        renderer = make_renderer(place, params, seed)
        for plan in plans:
            record(scene, renderer, plan, params, seed, tick)
            yield plan
        renderer.release()
        return
    context = multiprocessing.get_context("spawn")
    frames_done = context.Value("q", 0)
    shown = 0
    given = (scene, place, params, seed, frames_done)
    with few_threads(count), ProcessPoolExecutor(count, context, _start_worker, given) as pool:
        pending: set[Future[str | None]] = {pool.submit(_work, plan) for plan in plans}
        try:
            while pending:
                done, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
                while shown < frames_done.value:
                    tick()
                    shown += 1
                for problem in filter(None, map(_problem_of, done)):
                    pool.shutdown(cancel_futures=True)
                    raise VioAprError(problem)
        except KeyboardInterrupt:
            # The pool would wait for the recordings that they are rendering.
            for process in multiprocessing.active_children():
                process.kill()
            raise
    yield from plans


def _problem_of(future: Future[str | None]) -> str | None:
    """What went wrong in a process that has ended, or None."""
    try:
        return future.result()
    except BrokenProcessPool:
        return "a process that renders was killed (out of memory?): try fewer workers"


@contextmanager
def few_threads(workers: int) -> Iterator[None]:
    """Let every process of Mesa's renderer use its share of the cores, no more."""
    name, threads = "LP_NUM_THREADS", max((os.cpu_count() or 1) // workers - 1, 0)
    before = os.environ.get(name)
    os.environ[name] = before or str(threads)
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]


_worker: dict[str, Any] = {}
"""What a process keeps from one recording to the next."""


def _start_worker(
    scene: Scene, place: world.World, params: CourtyardParams, seed: int, frames_done: Any
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the first process tells
    _worker.update(scene=scene, place=place, params=params, seed=seed, frames_done=frames_done)


def _work(plan: Plan) -> str | None:
    """Record a plan in a process of its own; what went wrong, or None."""
    params, seed, frames_done = (_worker[name] for name in ("params", "seed", "frames_done"))

    def tick() -> None:
        with frames_done.get_lock():
            frames_done.value += 1

    try:
        if "renderer" not in _worker:
            _worker["renderer"] = make_renderer(_worker["place"], params, seed)
        record(_worker["scene"], _worker["renderer"], plan, params, seed, tick)
    except VioAprError as error:
        return str(error)
    return None
