"""The courtyard, walked several times and written as a scene."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from vioapr.errors import ParameterError, VioAprError
from vioapr.geometry.rigid import Rigid3
from vioapr.recording.courtyard import devices, world
from vioapr.recording.courtyard.context import create_context
from vioapr.recording.courtyard.devices import Mishaps
from vioapr.recording.courtyard.people import Crowd, figure_meshes
from vioapr.recording.courtyard.photography import Photographer
from vioapr.recording.courtyard.render import Renderer, Shot
from vioapr.recording.courtyard.walks import Motion, walk
from vioapr.recording.courtyard.weather import WEATHERS
from vioapr.recording.frames import Intrinsics, Tracking
from vioapr.recording.info import RecordingInfo
from vioapr.recording.scene import Scene, World
from vioapr.recording.writer import RecordingWriter
from vioapr.trajectory import Trajectory

FOCAL_PER_WIDTH = 0.78
"""Focal length by image width: 65 degrees across, as phones' main cameras have."""


FROM_ABOVE = "from_above.jpg"
"""A picture of the place from above, beside `scene.toml`."""
FROM_ABOVE_WIDTH_M = 46.0
_FROM_ABOVE_HEIGHT_M = 60.0


@dataclass(frozen=True)
class CourtyardParams:
    """What is recorded, and how."""

    train: int = 4
    """Recordings to train and map with."""
    test: int = 2
    """Recordings to test with."""
    duration_s: float = 90.0
    """Length of each, s."""
    rate_hz: float = 10.0
    """Images per second."""
    width_px: int = 480
    """Width of the images."""
    height_px: int = 360
    """Height of the images."""
    oversampled: bool = False
    """Whether every pixel is the mean of four: features are found more exactly, see
    docs/simulation.md, and rendering takes two to three times as long."""
    people: int = 9
    """Passers-by in each recording."""
    texture_px_per_m: float = 64.0
    """Density of the walls' pictures: less is made sooner."""

    def __post_init__(self) -> None:
        lowest = {"train": 1, "test": 0, "width_px": 32, "height_px": 32, "people": 0}
        for name, least in lowest.items():
            if getattr(self, name) < least:
                raise ParameterError(
                    f"{name}: expected at least {least}, got {getattr(self, name)}"
                )
        for name, least in (("duration_s", 2.0), ("rate_hz", 0.5), ("texture_px_per_m", 8.0)):
            if not least <= getattr(self, name) < float("inf"):
                raise ParameterError(
                    f"{name}: expected a number of at least {least:g}, got {getattr(self, name)}"
                )

    @property
    def frames(self) -> int:
        """Images of one recording."""
        return int(self.duration_s * self.rate_hz)

    @property
    def camera(self) -> Intrinsics:
        """The phone's camera."""
        focal = FOCAL_PER_WIDTH * self.width_px
        return Intrinsics(
            self.width_px, self.height_px, focal, focal, self.width_px / 2, self.height_px / 2
        )


PRESETS = {
    "full": CourtyardParams(),
    "small": CourtyardParams(
        train=2, test=1, duration_s=10.0, width_px=192, height_px=144, people=4,
        texture_px_per_m=24.0,
    ),
}  # fmt: skip
"""By name: the whole scene, and one that is made in seconds, for tests and demonstrations."""


@dataclass(frozen=True)
class Plan:
    """One recording before it is made.

    Attributes:
        id_: Its name.
        split: "train" or "test".
        number: Among all recordings, from 0; with the seed it decides all that is random.
        route: A key of `ROUTES_M`.
        backwards: Whether the route is walked the other way round.
        weather: A key of `WEATHERS`.
        mishaps: Of the tracker.
    """

    id_: str
    split: str
    number: int
    route: str
    backwards: bool
    weather: str
    mishaps: Mishaps


_TRAIN = (
    ("around", False, "sunny"), ("figure eight", False, "overcast"),
    ("around", True, "late sun"), ("through the middle", False, "morning"),
    ("along the arcade", True, "overcast"), ("past the shops", False, "low light"),
)  # fmt: skip
_TEST = (
    ("figure eight", True, "after rain"), ("along the arcade", False, "low light"),
    ("back and forth", False, "sunny"), ("past the shops", True, "morning"),
)  # fmt: skip


def plan_recordings(params: CourtyardParams) -> list[Plan]:
    """Routes and weathers in turn; the second recording loses track, the third jumps.

    Of a single recording both happen to that one.
    """
    chosen = [("train", *_TRAIN[i % len(_TRAIN)]) for i in range(params.train)]
    chosen += [("test", *_TEST[i % len(_TEST)]) for i in range(params.test)]
    loses, jumps = min(1, len(chosen) - 1), min(2, len(chosen) - 1)
    plans = []
    for number, (split, route, backwards, weather) in enumerate(chosen):
        within = number if split == "train" else number - params.train
        mishaps = Mishaps(
            0.35 * params.duration_s if number == loses else None,
            0.72 * params.duration_s if number == jumps else None,
        )
        id_ = f"{split}-{within + 1:02d}"
        plans.append(Plan(id_, split, number, route, backwards, weather, mishaps))
    return plans


def plan_motion(plan: Plan, params: CourtyardParams, seed: int) -> Motion:
    """How the camera moves in a recording."""
    rng = np.random.default_rng([seed, 2, plan.number])
    return walk(rng, plan.route, params.duration_s, backwards=plan.backwards)


def simulate(
    folder: Path,
    params: CourtyardParams | None = None,
    seed: int = 0,
    *,
    workers: int | None = None,
    tick: Callable[[], object] | None = None,
) -> Scene:
    """Render the courtyard's recordings and write them as a scene.

    The same parameters and seed give the same files on one machine, whatever the number of
    workers; another OpenGL driver or version of NumPy may round a pixel otherwise.

    Args:
        folder: The scene's folder; made if needed.
        params: What is recorded.
        seed: Of everything random.
        workers: Processes that render, a recording each at a time; None for one a core.
        tick: Called about once a frame, for progress; `params.frames` times a recording.

    Raises:
        MissingExtraError: moderngl is not installed.
        RenderingError: This machine cannot render.
        FormatError: There is a scene already, or it cannot be written.
    """
    params = params or CourtyardParams()
    if seed < 0:
        raise ParameterError(f"seed: expected a number of at least 0, got {seed}")
    if workers is not None and workers < 1:
        raise ParameterError(f"workers: expected at least 1, got {workers}")
    create_context().release()  # what is missing shows before anything is written
    plans = plan_recordings(params)
    scene = Scene.create(
        folder, "Simulated courtyard", is_outdoor=True, world=World(origin=devices.ORIGIN)
    )
    place = world.build(seed, params.texture_px_per_m)
    for plan in _record_all(scene, place, plans, params, seed, workers, tick or (lambda: None)):
        scene = scene.with_recording(plan.id_, plan.split)
    scene.save()
    return scene


def record(
    scene: Scene,
    renderer: Renderer,
    plan: Plan,
    params: CourtyardParams,
    seed: int,
    tick: Callable[[], object] = lambda: None,
) -> None:
    """Write one recording, with its ground truth, into a scene.

    Args:
        scene: Where.
        renderer: Has the place loaded, and as many people as the recording has.
        plan: What.
        params: How.
        seed: As of `simulate`.
        tick: Called after every frame.
    """
    rng = np.random.default_rng([seed, 3, plan.number])
    motion = plan_motion(plan, params, seed)
    times = (np.arange(params.frames, dtype=np.float64) + 0.5) / params.rate_hz
    world_from_cam = motion.world_from_cam(times)
    track = devices.track_frames(rng, times, world_from_cam, plan.mishaps)
    info = RecordingInfo(
        device="simulated phone", tracker="simulated",
        source=f"vioapr simulate courtyard, seed {seed}",
        notes=(f"weather: {plan.weather}", f"route: {plan.route}"),
    )  # fmt: skip
    weather = WEATHERS[plan.weather]
    renderer.set_weather(weather, seed=seed * 1000 + plan.number)
    photographer = Photographer(rng, renderer, weather, params.camera)
    crowd = Crowd(rng, params.people)
    with RecordingWriter(scene.recording_folder(plan.id_), info) as writer:
        for row, time_s in enumerate(times):
            camera_m = world_from_cam.translation_m[row]
            image = photographer.take(motion, time_s, crowd.at(time_s, camera_m))
            state = Tracking(track.tracking[row])
            vio = None if state == Tracking.LOST else track.vio_from_cam.at(row)
            writer.add_frame(time_s, f"{row:06d}.jpg", image, state, vio, params.camera)
            tick()
        _write_instruments(writer, rng, motion, params.duration_s)
    scene.write_gt(plan.id_, Trajectory.from_arrays(times, *world_from_cam))
    if plan.number == 0:
        Image.fromarray(view_from_above(renderer)).save(scene.folder / FROM_ABOVE, quality=90)


def view_from_above(renderer: Renderer) -> NDArray[np.uint8]:
    """The place from high above its middle, north up, `FROM_ABOVE_WIDTH_M` of ground across."""
    width, height = renderer.size_px
    focal = width * _FROM_ABOVE_HEIGHT_M / FROM_ABOVE_WIDTH_M
    camera = Intrinsics(width, height, focal, focal, width / 2, height / 2)
    down = Rigid3(np.array([0, 0, _FROM_ABOVE_HEIGHT_M]), np.array([1.0, 0.0, 0.0, 0.0]))
    return renderer.render(down, camera, Shot((1.0, 1.0, 1.0)))


def _write_instruments(
    writer: RecordingWriter, rng: np.random.Generator, motion: Motion, duration_s: float
) -> None:
    imu = devices.measure_imu(rng, motion, duration_s)
    for row in zip(imu.timestamp_s, imu.accel_m_s2, imu.gyro_rad_s, strict=True):
        writer.add_imu(*row)
    gnss = devices.measure_gnss(rng, motion, duration_s)
    for fix in zip(*vars(gnss).values(), strict=True):
        writer.add_gnss(*fix)
    heading = devices.measure_heading(rng, motion, duration_s)
    for measured in zip(*vars(heading).values(), strict=True):
        writer.add_heading(*measured)


def make_renderer(place: world.World, params: CourtyardParams, seed: int) -> Renderer:
    """A renderer of the place, with people to put into it."""
    size_px = (params.width_px, params.height_px)
    renderer = Renderer(place, size_px, is_oversampled=params.oversampled)
    renderer.add_figures(figure_meshes(np.random.default_rng([seed, 4]), params.people))
    return renderer


def _record_all(
    scene: Scene,
    place: world.World,
    plans: list[Plan],
    params: CourtyardParams,
    seed: int,
    workers: int | None,
    tick: Callable[[], object],
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
    with few_threads(count), ProcessPoolExecutor(
        count, context, _start_worker, (scene, place, params, seed, frames_done)
    ) as pool:  # fmt: skip
        pending: set[Future[str | None]] = {pool.submit(_work, plan) for plan in plans}
        while pending:
            done, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
            while shown < frames_done.value:
                tick()
                shown += 1
            for problem in filter(None, (future.result() for future in done)):
                pool.shutdown(cancel_futures=True)
                raise VioAprError(problem)
    yield from plans


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
