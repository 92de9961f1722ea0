"""One recording of the courtyard, from its plan to its folder in a scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.files.images import encode_image
from vioapr.files.text import write_bytes
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.recording import RecordingInfo
from vioapr.simulation.courtyard import devices, world
from vioapr.simulation.courtyard.people import Crowd, figure_meshes
from vioapr.simulation.courtyard.photography import Photographer
from vioapr.simulation.courtyard.plan import CourtyardParams, Plan, plan_motion
from vioapr.simulation.courtyard.render import Renderer, Shot
from vioapr.simulation.courtyard.weather import WEATHERS
from vioapr.simulation.trackers import TrackerErrors, track_frames
from vioapr.trajectory import Trajectory
from vioapr.work.progress import Tick, ignore

TRACKER = TrackerErrors(tilt_error_deg=0.1)
"""How the phone's tracker errs."""
FROM_ABOVE = "from_above.jpg"
"""A picture of the place from above, beside `scene.toml`."""
FROM_ABOVE_WIDTH_M = 46.0
_FROM_ABOVE_HEIGHT_M = 60.0


def record(
    scene: Scene,
    renderer: Renderer,
    plan: Plan,
    params: CourtyardParams,
    seed: int,
    tick: Tick = ignore,
) -> None:
    """Write one recording, with its ground truth, into a scene.

    Args:
        scene: The scene; its folder exists.
        renderer: Has the place loaded, and as many people as the recording has.
        plan: Which recording.
        params: Its length, rate and camera.
        seed: As of `simulate`.
        tick: Called once a frame.

    Raises:
        AlreadyExistsError: There is such a recording already.
        UnwritableError: It cannot be written.
    """
    rng = np.random.default_rng([seed, 3, plan.number])
    motion = plan_motion(plan, params, seed)
    times = (np.arange(params.frames, dtype=np.float64) + 0.5) / params.rate_hz
    world_from_cam = motion.world_from_cam(times)
    tracked = track_frames(rng, times, world_from_cam, TRACKER, plan.tracker_events)
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
            state = Tracking(tracked.tracking[row])
            vio = None if state == Tracking.LOST else tracked.vio_from_cam.at(row)
            writer.add_frame(time_s, f"{row:06d}.jpg", image, state, vio, params.camera)
            tick()
        imu = devices.measure_imu(rng, motion, params.duration_s)
        for measured in zip(*vars(imu).values(), strict=True):
            writer.add_imu(*measured)
        gnss = devices.measure_gnss(rng, motion, params.duration_s)
        for measured in zip(*vars(gnss).values(), strict=True):
            writer.add_gnss(*measured)
        heading = devices.measure_heading(rng, motion, params.duration_s)
        for measured in zip(*vars(heading).values(), strict=True):
            writer.add_heading(*measured)
    scene.write_gt(
        plan.id_, Trajectory.from_arrays(times, *world_from_cam), "simulator", info.source
    )
    if plan.number == 0:
        picture = encode_image(FROM_ABOVE, view_from_above(renderer))
        write_bytes(scene.folder / FROM_ABOVE, picture)


def view_from_above(renderer: Renderer) -> NDArray[np.uint8]:
    """The place from high above its middle, north up, `FROM_ABOVE_WIDTH_M` of ground across."""
    width, height = renderer.size_px
    focal = width * _FROM_ABOVE_HEIGHT_M / FROM_ABOVE_WIDTH_M
    camera = Intrinsics(width, height, focal, focal, width / 2, height / 2)
    down = Rigid3(np.array([0, 0, _FROM_ABOVE_HEIGHT_M]), np.array([1.0, 0.0, 0.0, 0.0]))
    return renderer.render(down, camera, Shot((1.0, 1.0, 1.0)))


def make_renderer(place: world.World, params: CourtyardParams, seed: int) -> Renderer:
    """A renderer of the place, with people to put into it."""
    size_px = (params.width_px, params.height_px)
    renderer = Renderer(place, size_px, is_oversampled=params.oversampled)
    renderer.add_figures(figure_meshes(np.random.default_rng([seed, 4]), params.people))
    return renderer
