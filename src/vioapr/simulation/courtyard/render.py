"""The renderer: a world, a weather, a camera and people in; a photograph out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry.rigid import Rigid3
from vioapr.scene.frames import Intrinsics
from vioapr.simulation.courtyard import shaders
from vioapr.simulation.courtyard.bake import bake_light
from vioapr.simulation.courtyard.context import create_context
from vioapr.simulation.courtyard.drawing import (
    ChunkList,
    Drawable,
    cut,
    load_texture,
    split_by_gloss,
)
from vioapr.simulation.courtyard.mesh import Mesh
from vioapr.simulation.courtyard.projection import (
    clip_from_cam,
    matrix_bytes,
    ray_from_image,
    sun_clip_from_world,
)
from vioapr.simulation.courtyard.weather import Weather, paint_sky
from vioapr.simulation.courtyard.world import World

SHADOW_PX = 1280
"""Side of the map of shadows: 4 cm a pixel, so that edges are as soft as the sun's are."""
FIGURE_MATERIAL = "cloth"
"""The material of people."""
_FIGURE_REACH_M = 2.5
_BLUR_PX = 0.7
"""Least movement of the picture while the shutter is open that is worth blurring."""


@dataclass(frozen=True)
class Shot:
    """The settings of one picture.

    Attributes:
        gain: Exposure times white balance, a factor for each of red, green and blue.
        turned_rad: Rotation vector of the camera while the shutter was open, cam axes.
        noise: Of the sensor, a share of white.
        seed: Of that noise.
    """

    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    turned_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noise: float = 0.0
    seed: int = 0


class Figure(NamedTuple):
    """A person in a picture: which mesh of `Renderer.add_figures`, and world_from_model (4, 4)."""

    mesh: int
    world_from_model: NDArray[np.float64]


class Renderer:
    """Renders pictures of one world at one size."""

    def __init__(
        self,
        world: World,
        size_px: tuple[int, int],
        *,
        is_oversampled: bool = False,
        vignetting: float = 0.22,
    ) -> None:
        """Load a world and bake its light.

        Args:
            world: What to render.
            size_px: Width and height of the pictures.
            is_oversampled: Whether every pixel is the mean of four; otherwise only edges are
                smoothed, which is a third of the work.
            vignetting: How much darker the corners are than the middle, a share.

        Raises:
            MissingExtraError: moderngl is not installed.
            RenderingError: This machine cannot render.
        """
        self.context = create_context()
        self.context.front_face = "cw"  # the projection has y downwards
        self.size_px, self._vignetting = size_px, vignetting
        self._is_oversampled = is_oversampled
        self._programs: dict[tuple[str, ...], Any] = {}
        self._weather: Weather | None = None
        self._world = world
        self._make_targets()
        corners = self.context.buffer(np.array([-1, -1, 3, -1, -1, 3], dtype=np.float32))
        self._corners = [(corners, "2f", "corner")]
        self._textures = {
            name: load_texture(self.context, material) for name, material in world.materials.items()
        }
        raw = [self._load(name, mesh) for name, mesh in world.meshes.items()]
        baked = bake_light(world, lambda matrix, size: self._depth_map(raw, matrix, size))
        self._chunks = ChunkList(
            (self._load(name, piece.mesh), piece)
            for name, mesh in baked.items()
            for piece in map(cut, split_by_gloss(mesh))
        )
        self._figures: list[Drawable] = []

    def add_figures(self, meshes: Sequence[Mesh]) -> None:
        """Load meshes of people, which `render` places."""
        with self.context:
            self._figures += [self._load(FIGURE_MATERIAL, mesh) for mesh in meshes]

    def set_weather(self, weather: Weather, seed: int = 0) -> None:
        """Light the world: sky, sun and shadows. The seed draws the clouds."""
        self._weather = weather
        disc = np.sqrt(paint_sky(np.random.default_rng([seed, 7]), weather) / 2)
        pixels = (np.clip(disc, 0, 1) * 255 + 0.5).astype(np.uint8)
        sun = sun_clip_from_world(weather.sun_direction)
        with self.context:
            self._sky_disc = self.context.texture(pixels.shape[1::-1], 3, pixels.tobytes())
            self._draw_depths(self._shadow, self._chunks.drawables, sun)
        half = np.diag([0.5, 0.5, 0.5, 1.0])
        half[:3, 3] = 0.5
        shadow_from_world = half @ sun
        shadow_from_world[2, 3] -= 0.0012  # no surface shades itself
        ambient = sum(weather.sky) + sum(weather.bounce)
        share = ambient / (ambient + sum(weather.sun) * weather.sun_direction[2])
        self._light = {
            "shadow_from_world": matrix_bytes(shadow_from_world),
            "sun_direction": weather.sun_direction, "sun_light": weather.sun,
            "sky_light": weather.sky, "bounce_light": weather.bounce,
            "lamp_light": weather.lamps, "horizon": weather.horizon,
            "haze_per_m": weather.haze_per_m, "wetness": weather.wetness,
            # Colours are stored as square roots, and so is what a shadow leaves of them.
            "remaining": float(np.sqrt(share)), "picture": 0, "shadow_map": 1, "sky_disc": 2,
        }  # fmt: skip

    def render(
        self,
        world_from_cam: Rigid3,
        camera: Intrinsics,
        shot: Shot | None = None,
        figures: Sequence[Figure] = (),
    ) -> NDArray[np.uint8]:
        """Take a picture.

        Args:
            world_from_cam: Where the camera is; OpenCV axes.
            camera: Its focal lengths and principal point; the upper left pixel's middle is
                (0.5, 0.5).
            shot: How it is exposed.
            figures: Who stands in view.

        Returns:
            Shape (height, width, 3), rows from the top.
        """
        cam_from_world = world_from_cam.inverse().to_matrix()
        view = {
            "clip_from_world": matrix_bytes(clip_from_cam(camera, self.size_px) @ cam_from_world),
            "world_from_model": matrix_bytes(np.eye(4)),
            "camera_m": np.asarray(world_from_cam.translation_m),
        }
        with self.context as gl:  # there may be other renderers
            self._raw.use()
            self._raw.clear(0, 0, 0, 1, depth=1.0)
            gl.enable_only(gl.DEPTH_TEST | gl.CULL_FACE)
            self._shadow_texture.use(1)
            self._sky_disc.use(2)
            self._draw_world({**self._light, **view}, view["camera_m"], camera)
            self._draw_figures({**self._light, **view}, figures)
            self._draw_sky(world_from_cam, camera)
            return self._develop(camera, shot or Shot())

    def release(self) -> None:
        """Give back the context's memory."""
        self.context.release()

    @property
    def _daylight(self) -> Weather:
        assert self._weather is not None, "set_weather comes first"
        return self._weather

    def _draw_world(self, values: dict[str, Any], camera_m: NDArray, camera: Intrinsics) -> None:
        gl = self.context
        clip_from_world = np.frombuffer(values["clip_from_world"], np.float32).reshape(4, 4).T
        ready: set[Any] = set()
        for chunk in self._chunks.in_view(clip_from_world, camera_m):
            program = self._scene_program(chunk.drawable)
            if program not in ready:
                _set(program, values)
                ready.add(program)
            if chunk.drawable.is_cutout:
                gl.disable(gl.CULL_FACE)
            chunk.drawable.texture.use(0)
            chunk.drawable.array(program).render(vertices=chunk.count, first=chunk.first)
        gl.enable(gl.CULL_FACE)

    def _draw_figures(self, values: dict[str, Any], figures: Sequence[Figure]) -> None:
        """People, and their shadows on the ground: their meshes, flattened along the rays."""
        gl, cast = self.context, self._program("CAST")
        clip_from_world = np.frombuffer(values["clip_from_world"], np.float32).reshape(4, 4).T
        placed = []
        for figure in figures:  # those who may be in view, themselves or by their shadow
            x, y, _, depth_m = clip_from_world @ figure.world_from_model[:, 3]
            beyond = depth_m + 3 * _FIGURE_REACH_M
            if depth_m > -_FIGURE_REACH_M and max(abs(x), abs(y)) < beyond:
                placed.append(figure)
        if not placed:
            return
        program = self._scene_program(self._figures[0])
        _set(program, values)
        self._figures[0].texture.use(0)
        for mesh, world_from_model in placed:
            _set(program, {"world_from_model": matrix_bytes(world_from_model)})
            self._figures[mesh].array(program).render()
        if not self._daylight.has_sun:
            return
        _set(cast, values)
        gl.disable(gl.CULL_FACE)
        gl.enable(gl.BLEND)
        gl.blend_func = gl.ZERO, gl.SRC_COLOR
        for mesh, world_from_model in placed:
            # A second layer at the same depth fails the test, so that none darkens twice.
            _set(cast, {"world_from_model": matrix_bytes(world_from_model)})
            self._figures[mesh].array(cast).render()
        gl.disable(gl.BLEND)

    def _draw_sky(self, world_from_cam: Rigid3, camera: Intrinsics) -> None:
        gl, program = self.context, self._program("SKY")
        rays = np.asarray(world_from_cam.to_matrix())[:3, :3] @ ray_from_image(camera, self.size_px)
        _set(program, {"world_from_ray": matrix_bytes(rays), "sky_disc": 2})
        gl.disable(gl.CULL_FACE)
        gl.depth_func = "<="
        gl.vertex_array(program, self._corners).render()
        gl.depth_func = "<"

    def _develop(self, camera: Intrinsics, shot: Shot) -> NDArray[np.uint8]:
        """Develop the raw picture as lens and sensor would: blur, exposure, vignetting, noise."""
        moved_px = np.linalg.norm(shot.turned_rad) * float(np.asarray(camera.fx))
        fine = ["OVERSAMPLED"] if self._is_oversampled else []
        program = self._program("CAMERA", *(["BLUR"] if moved_px > _BLUR_PX else fine))
        width, height = self.size_px
        self._developed.use()
        self.context.enable_only(self.context.NOTHING)
        self._raw_texture.use(0)
        _set(program, {
            "scene": 0, "size_px": self.size_px, "focal": (camera.fx, camera.fy),
            "centre": (camera.cx, camera.cy), "turned_rad": shot.turned_rad, "gain": shot.gain,
            "vignetting": self._vignetting, "noise": shot.noise,
            "seed": int(shot.seed) * 2654435761 % 2**32,
        })  # fmt: skip
        self.context.vertex_array(program, self._corners).render()
        pixels = np.frombuffer(self._developed.read(components=3, alignment=1), dtype=np.uint8)
        return pixels.reshape(height, width, 3)

    def _make_targets(self) -> None:
        gl, size = self.context, self.size_px
        scale = 2 if self._is_oversampled else 1
        raw_size = (scale * size[0], scale * size[1])
        self._raw_texture = gl.texture(raw_size, 4)
        self._raw_texture.repeat_x = self._raw_texture.repeat_y = False
        self._raw = gl.framebuffer(self._raw_texture, gl.depth_renderbuffer(raw_size))
        self._developed = gl.framebuffer(gl.renderbuffer(size, 4))
        self._shadow_texture = gl.depth_texture((SHADOW_PX, SHADOW_PX))
        self._shadow_texture.compare_func = "<="
        self._shadow_texture.repeat_x = self._shadow_texture.repeat_y = False
        self._shadow = gl.framebuffer(depth_attachment=self._shadow_texture)

    def _load(self, name: str, mesh: Mesh) -> Drawable:
        return Drawable(self.context, mesh, self._world.materials[name], self._textures[name])

    def _scene_program(self, drawable: Drawable) -> Any:
        """The program with the fewest features that draws a drawable in this weather."""
        features = []
        if drawable.is_cutout:
            features.append("CUTOUT")
        elif drawable.is_glossy or self._daylight.wetness > 0:
            features.append("GLOSS")
        if self._daylight.has_sun:
            features.append("SUN")
        return self._program("SCENE", *features)

    def _program(self, *key: str) -> Any:
        """A program by its name and features, compiled when first needed."""
        if key not in self._programs:
            vertex, fragment = shaders.PROGRAMS[key[0]]
            self._programs[key] = self.context.program(
                vertex_shader=shaders.variant(vertex, *key[1:]),
                fragment_shader=shaders.variant(fragment, *key[1:]),
            )
        return self._programs[key]

    def _draw_depths(
        self, target: Any, drawables: Iterable[Drawable], clip_from_world: NDArray
    ) -> None:
        """Draw depths alone, as a light sees the world."""
        gl = self.context
        target.use()
        target.clear(depth=1.0)
        gl.enable_only(gl.DEPTH_TEST)
        values = {"clip_from_world": matrix_bytes(clip_from_world), "picture": 0}
        for drawable in drawables:
            program = self._program("DEPTH", *(["CUTOUT"] if drawable.is_cutout else []))
            _set(program, values)
            drawable.texture.use(0)
            drawable.array(program).render()

    def _depth_map(
        self, drawables: Iterable[Drawable], clip_from_world: NDArray, size_px: int
    ) -> NDArray[np.float32]:
        """Depths from 0 to 1 as a light sees them, (size, size), rows upwards."""
        texture = self.context.depth_texture((size_px, size_px))
        target = self.context.framebuffer(depth_attachment=texture)
        self._draw_depths(target, drawables, clip_from_world)
        depths = np.frombuffer(texture.read(alignment=1), dtype=np.float32)
        target.release()
        texture.release()
        return depths.reshape(size_px, size_px)


def _set(program: Any, values: dict[str, Any]) -> None:
    """Set uniforms; those that the program does not have are passed over."""
    for name, value in values.items():
        uniform = program.get(name, None)
        if uniform is None:
            continue
        if isinstance(value, bytes):
            uniform.write(value)
        elif isinstance(value, np.ndarray):
            uniform.value = tuple(value.tolist())
        else:
            uniform.value = value
