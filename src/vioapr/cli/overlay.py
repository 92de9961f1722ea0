"""`vioapr overlay`: content at map coordinates, drawn into a walk's pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from vioapr.cli.console import explain, progress, say
from vioapr.cli.streams import InputFile, OutputFile
from vioapr.cli.tracks import read_track
from vioapr.errors import ParameterError
from vioapr.files.outputs import check_outputs
from vioapr.files.text import read_text, write_text
from vioapr.formats.base import ReadOptions
from vioapr.fusion.fused_walk import POSE_COLUMNS, read_fused_csv
from vioapr.plurals import count_of
from vioapr.report.overlay.content import place_anchors
from vioapr.report.overlay.files import OverlayParams, check_ending, write_overlay
from vioapr.report.overlay.walk import read_overlay_walk
from vioapr.scene.recording import Recording
from vioapr.scene.scene import RECORDINGS_FOLDER, SCENE_FILE, Scene
from vioapr.schemas.anchors import AnchorsDocument
from vioapr.schemas.base import decode, encode
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory


def overlay(
    recording: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RECORDING")],
    poses: InputFile,
    out: Path,
    raw: InputFile | None = None,
    gt: InputFile | None = None,
    anchors: InputFile | None = None,
    save_anchors: OutputFile | None = None,
    focal_px: float | None = None,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    params: tyro.conf.OmitArgPrefixes[OverlayParams] = OverlayParams(),  # noqa: B008
) -> None:
    """Draw content at map coordinates into a walk's pictures: by raw poses, fused ones, the truth.

    Content that is drawn by a wrong pose appears beside its place. A white outline shows where it
    belongs, labels say how far it is off. What is in front of content in the real world does not
    hide it.

    Args:
        recording: Folder of a recording with images.
        poses: The fused poses: what `vioapr fuse` or `vioapr localize` wrote, or any trajectory
            file, world_from_cam.
        out: Picture to write: .png, a sheet of some frames; .gif or .mp4, a film
            (pip install 'vioapr[video]' for .mp4).
        raw: The predictions that were fused, in any trajectory format; between them the tracker
            carries the last one on. By default the one file apr_*.tum of this recording that
            `vioapr predict` left in SCENE/walks, or `vioapr build` in SCENE/build/walks.
        gt: The truth, in any trajectory format; by default the scene's, if it has one.
        anchors: The content (docs/reference/schemas.md: AnchorsDocument); by default, markers
            stand where the cameras look.
        save_anchors: File to write the default content to, to begin your own with.
        focal_px: Focal length where the recording does not say it, pixels.
        tolerance_s: Largest difference of timestamps between a frame and its pose, s.
        overwrite: Replace the files to write if they exist; never one that is read.
        params: What is shown.

    Example:
        vioapr overlay yard/recordings/test-01 --poses fused.csv --out overlay.png
    """
    check_ending(out)
    if anchors is not None and save_anchors is not None:
        raise ParameterError("expected either `anchors` or `save_anchors`: one reads, one writes")
    opened = Recording.open(recording)
    scene = scene_of(recording)
    raw = raw or find_predictions(scene, opened.id)
    gt_path = gt or (scene.gt_path(opened.id) if scene is not None else None)
    inputs = [poses, raw, gt_path, anchors, recording, *(scene.tables() if scene else ())]
    check_outputs([out, save_anchors], inputs, overwrite=overwrite)
    truth = scene.gt(opened.id) if scene is not None else None
    if gt is not None:
        truth = read_track(gt, None, ReadOptions(), "gt")
    predicted = None if raw is None else read_track(raw, None, ReadOptions(), "raw")
    walk = read_overlay_walk(opened, read_poses(poses), predicted, truth, focal_px, tolerance_s)
    if anchors is not None:
        content = decode(anchors, read_text(anchors), AnchorsDocument).anchors
    else:
        content = place_anchors(walk)
    shown = write_overlay(out, walk, content, params, progress, overwrite=overwrite)
    if save_anchors is not None:
        name = "" if scene is None else scene.name
        document = AnchorsDocument(scene=name, anchors=content)
        write_text(save_anchors, encode(document), overwrite=overwrite)
        say(f"{save_anchors}: {count_of(len(content), 'anchor')}")
    say(f"{out}: {count_of(shown, 'frame')}, {count_of(len(content), 'anchor')}")
    if raw is None:
        explain("note: no column of raw poses, as --raw names no predictions")


def scene_of(recording: Path) -> Scene | None:
    """The scene that a recording's folder lies in, if any."""
    real = recording.resolve()
    if real.parent.name == RECORDINGS_FOLDER and (real.parents[1] / SCENE_FILE).exists():
        return Scene.open(real.parents[1])
    return None


def find_predictions(scene: Scene | None, id_: str) -> Path | None:
    """The one file of a recording's predictions in a scene's walks, if any.

    Raises:
        ParameterError: There are several.
    """
    if scene is None:
        return None
    folders = ("walks/*", "build/walks/*")  # of `vioapr predict`, and of `vioapr build`
    found = sorted(
        path for folder in folders for path in scene.folder.glob(f"{folder}/{id_}/apr_*.tum")
    )
    if len(found) > 1:
        names = ", ".join(map(str, found))
        raise ParameterError(f"`raw`: expected to be told which predictions were fused: {names}")
    return found[0] if found else None


def read_poses(path: Path) -> Trajectory:
    """Read fused poses: a fused CSV's localized frames, or a trajectory in any format."""
    if read_text(path).startswith(",".join(POSE_COLUMNS)):
        fused = read_fused_csv(path)
        if not fused.is_localized.any():
            raise ParameterError(f"{path}: expected localized frames, found none")
        return fused.to_trajectory()
    return read_track(path, None, ReadOptions(), "poses")
