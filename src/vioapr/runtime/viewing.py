"""Show a walk while it is localized: in a browser (viser), or as a rerun file."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np

from vioapr.errors import MissingExtraError, UnwritableError
from vioapr.files.atomic import replacing
from vioapr.files.images import read_rgb
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3
from vioapr.runtime.localizer import Located
from vioapr.runtime.walk import WalkFrames

STATUS_RGB: dict[Status, tuple[int, int, int]] = {
    Status.UNLOCALIZED: (120, 120, 120),
    Status.TRACKED: (86, 180, 233),
    Status.KEYFRAME: (0, 158, 115),
    Status.OPTIMIZED: (230, 159, 0),
    Status.PREDICTED: (204, 121, 167),
}
"""Okabe and Ito's colours, which colour-blind people can tell apart."""

_GT_RGB = (60, 60, 60)
_FOV_RAD, _ASPECT = 1.0, 4 / 3
_THUMBNAIL_STEP = 8
"""Of an image, one row and one column in this many are shown in its frustum."""


class BrowserView:
    """A page with the walk so far: trajectory, frusta by status, uncertainty, ground truth."""

    def __init__(self, frames: WalkFrames, say: Callable[[str], object]) -> None:
        """Serve the page on this machine only.

        Args:
            frames: The walk.
            say: Prints a line.

        Raises:
            MissingExtraError: viser is not installed.
        """
        try:
            import viser
        except ImportError:
            raise MissingExtraError("showing a walk in a browser", "viser", "viser") from None
        self.server: Any = viser.ViserServer(host="127.0.0.1", verbose=False)
        self._frames, self._say, self._row = frames, say, 0
        self._last: np.ndarray | None = None
        self.server.scene.set_up_direction("+z")
        if frames.gt is not None and len(frames.gt) > 1:
            path = np.stack([frames.gt.position_m[:-1], frames.gt.position_m[1:]], axis=1)
            self.server.scene.add_line_segments("/gt", path, _GT_RGB)
        say(f"view: http://127.0.0.1:{self.server.get_port()}")

    def add(self, located: Located) -> None:
        """Show a frame's answer."""
        row, scene = self._row, self.server.scene
        self._row += 1
        if located.status == Status.UNLOCALIZED:
            self._last = None
            return
        rgb, place = STATUS_RGB[located.status], located.world_from_cam.translation_m
        at = {"position": place, "wxyz": located.world_from_cam.quat_xyzw[[3, 0, 1, 2]]}
        path = self._frames.images[row]
        thumbnail = None if path is None else read_rgb(path)[::_THUMBNAIL_STEP, ::_THUMBNAIL_STEP]
        scene.add_camera_frustum(
            f"/frames/{row}", _FOV_RAD, _ASPECT, color=rgb, image=thumbnail, **at
        )
        if self._last is not None:
            step = np.stack([self._last, place])[None]
            scene.add_line_segments(f"/path/{row}", step, rgb)
        if located.sigma_position_axes_m is not None:
            scale = tuple(located.sigma_position_axes_m.tolist())
            scene.add_icosphere("/uncertainty", 1.0, rgb, scale=scale, opacity=0.3, position=place)
        self._last = place

    def finish(self) -> None:
        """Keep the page until the user interrupts."""
        self._say("the page stays until you press Ctrl-C")
        with suppress(KeyboardInterrupt):  # which is how this ends
            self.server.sleep_forever()


class RerunFile:
    """A file for the rerun viewer."""

    def __init__(self, frames: WalkFrames, path: Path, *, overwrite: bool = True) -> None:
        """Begin the file.

        Raises:
            MissingExtraError: rerun-sdk is not installed.
            UnwritableError: Its folder does not exist.
        """
        try:
            import rerun  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise MissingExtraError("writing a rerun file", "rerun-sdk", "rerun") from None
        if not path.resolve().parent.is_dir():
            raise UnwritableError(path, "cannot be written: its folder does not exist")
        self._rerun, self._frames, self._row = rerun, frames, 0
        self._stream = rerun.RecordingStream("vioapr")
        # A walk that is interrupted leaves no half of a file, and an earlier one stays.
        self._replaced = ExitStack()
        self._stream.save(self._replaced.enter_context(replacing(path, overwrite=overwrite)))
        self._log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        if frames.gt is not None:
            path_m = rerun.LineStrips3D([frames.gt.position_m], colors=[_GT_RGB])
            self._log("world/gt", path_m, static=True)

    def _log(self, name: str, *what: Any, static: bool = False) -> None:
        self._rerun.log(name, *what, static=static, recording=self._stream)

    def add(self, located: Located) -> None:
        """Log a frame's answer."""
        rerun, row = self._rerun, self._row
        self._row += 1
        seconds = float(self._frames.timestamp_s[row] - self._frames.timestamp_s[0])
        rerun.set_time("walk", duration=seconds, recording=self._stream)
        self._log("status", rerun.TextLog(located.status.label))
        for name, pose in (
            ("world/fused", located.world_from_cam),
            ("world/apr", located.apr_world_from_cam),
        ):
            if pose.is_known:
                self._log_camera(name, pose, STATUS_RGB[located.status])
        if located.sigma_position_axes_m is not None and located.status:
            ellipsoid = rerun.Ellipsoids3D(
                centers=[located.world_from_cam.translation_m],
                half_sizes=[located.sigma_position_axes_m],
            )
            self._log("world/uncertainty", ellipsoid)
        image = self._frames.images[row]
        if image is not None:
            self._log("world/fused/image", rerun.EncodedImage(path=image))

    def _log_camera(self, name: str, pose: Rigid3, rgb: tuple[int, int, int]) -> None:
        rerun = self._rerun
        turn = rerun.Quaternion(xyzw=pose.quat_xyzw)
        self._log(name, rerun.Transform3D(translation=pose.translation_m, quaternion=turn))
        self._log(f"{name}/place", rerun.Points3D([[0.0, 0.0, 0.0]], colors=[rgb]))

    def finish(self) -> None:
        """Write what is left, and put the file in place."""
        self._stream.flush()
        self._replaced.close()
