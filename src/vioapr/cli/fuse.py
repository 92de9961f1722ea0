"""`vioapr fuse`: one walk from files to a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from vioapr.cli.calibrated import (
    calibrated_params,
    pair_of_files,
    require_chain,
    warn_of_misfit,
)
from vioapr.cli.console import progress, say, warn_of_tracks
from vioapr.cli.method_params import MethodParams, params_for
from vioapr.cli.streams import InputFile, OutputFile
from vioapr.cli.tracks import read_track
from vioapr.errors import ParameterError
from vioapr.files.outputs import check_outputs
from vioapr.formats import tum
from vioapr.formats.base import ReadOptions, TimeUnit
from vioapr.formats.body_from_cam import AUTO, turn_to_camera
from vioapr.formats.pair_checks import Track
from vioapr.formats.stated_sigmas import path_beside, read_sigmas, read_sigmas_beside
from vioapr.formats.walk_checks import check_walk
from vioapr.fusion.calibrated import read_calibration
from vioapr.fusion.fused_walk import write_fused_csv
from vioapr.fusion.methods import DEFAULT_METHOD, METHODS, get_method
from vioapr.fusion.offline import View, fuse_walk
from vioapr.fusion.pairing import check_pairing, pair_frames
from vioapr.fusion.smoothing import smooth_walk
from vioapr.plurals import count_of
from vioapr.report.formatting import format_statuses
from vioapr.trajectory import DEFAULT_TOLERANCE_S
from vioapr.work.results import replacing_output


def fuse(
    apr: InputFile,
    vio: InputFile,
    out: OutputFile,
    method: str = DEFAULT_METHOD,
    tum_out: Annotated[OutputFile | None, tyro.conf.arg(name="tum")] = None,
    view: View = "retrospective",
    offline: bool = False,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
    apr_format: str | None = None,
    vio_format: str | None = None,
    apr_sigma: InputFile | None = None,
    calibration: InputFile | None = None,
    vio_from_cam: Annotated[str | None, tyro.conf.arg(metavar="auto|FILE")] = None,
    time_unit: TimeUnit | None = None,
    strict: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    params: tyro.conf.OmitArgPrefixes[MethodParams] = MethodParams(),  # noqa: B008
) -> None:
    """Fuse a walk's predicted poses with its tracked ones into a robust pose for every frame.

    Both files may be of any format that `vioapr inspect` knows, gzipped or not, with one
    clock. The map's poses come out in the axes in which the predictions came in.

    Args:
        apr: Poses that a regressor (or any absolute localizer) predicted: world_from_cam, m.
        vio: Poses that the phone tracked: vio_from_cam, m, in a world of its own.
        out: CSV to write, a row a frame: timestamp_s,status,x,y,z,qx,qy,qz,qw and, where the
            method has them, sigma_position_m,sigma_orientation_deg. Unlocalized frames have
            nan.
        method: How to fuse: chain, vio-apr (the paper's), apr, vio, pose-filter,
            mapnet-pgo or pose-graph.
        tum_out: TUM file to write too, with the localized frames.
        view: retrospective: predictions that later prove right count as keyframes, as in the
            paper's tables. live: what was known when each frame arrived.
        offline: Use the future too: the best trajectory after the walk (chain only).
        tolerance_s: Largest difference of timestamps between a prediction and its VIO pose, s.
            VIO is interpolated at the other predictions, where its frames are near in time.
        apr_format: Format of the predictions, if it is not recognized.
        vio_format: Format of the VIO poses, if it is not recognized.
        apr_sigma: What the regressor states of each prediction's error, a CSV with columns
            timestamp_s,sigma_position_m,sigma_orientation_deg (default: the file beside the
            predictions whose name ends in .sigma.csv instead, if there is one). For method
            chain.
        calibration: What `vioapr calibrate` found on walks with this tracker and this regressor,
            for method chain; a flag wins over what it says.
        vio_from_cam: For a tracker that gives poses of an IMU's body (VINS, OpenVINS, Basalt,
            Kimera, Aria), or images turned since: how its camera is mounted, so that vio_from_cam
            can be had. auto estimates it by the predictions; FILE holds the constant transform
            body_from_cam: 4x4 numbers, EuRoC's sensor.yaml, Kalibr's camchain, or the
            calibration of OpenVINS, VINS-Fusion, ORB-SLAM3 or Basalt.
        time_unit: Unit of both files' times; by default found from their values.
        strict: Refuse what is otherwise fused with a warning, and write nothing.
        overwrite: Replace the files to write if they exist; never one that is read.
        params: Parameters of the methods.

    Example:
        vioapr fuse --apr apr.tum --vio vio.csv --out fused.csv
    """
    chosen, chosen_params = get_method(method), params_for(method, params)
    if apr_sigma is not None and not chosen.uses_apr_sigma:
        users = ", ".join(one.name for one in METHODS.values() if one.uses_apr_sigma)
        raise ParameterError(f"`apr_sigma`: method {method} has no use for it, only {users} has")
    inputs = [apr, vio, apr_sigma or path_beside(apr), calibration]
    if vio_from_cam not in (None, AUTO):
        inputs.append(Path(vio_from_cam))
    check_outputs([out, tum_out], inputs, overwrite=overwrite)
    pair = None
    if calibration is not None:
        require_chain([method])
        pair = pair_of_files(read_calibration(calibration), apr, vio, strict=strict)
        chosen_params = calibrated_params(pair, chosen_params)
    options = ReadOptions(time_unit=time_unit, strict=strict)
    predictions = read_track(apr, apr_format, options, "apr_format")
    tracked = read_track(vio, vio_format, options, "vio_format")
    if vio_from_cam is not None:
        tracked, how = turn_to_camera(tracked, vio_from_cam, predictions, tolerance_s)
        say(f"{vio}: {how}")
    tracks = Track(str(apr), "apr", predictions), Track(str(vio), "vio", tracked)
    warn_of_tracks(check_walk(tracks[:1], tracks[1:], tolerance_s=tolerance_s), strict=strict)
    if apr_sigma is None:
        sigmas = read_sigmas_beside(apr, predictions)
    else:
        sigmas = read_sigmas(apr_sigma, predictions)
    frames = pair_frames(predictions, tracked, tolerance_s, apr_sigmas=sigmas)
    warn_of_tracks(check_pairing(frames, len(predictions), tolerance_s), strict=strict)
    with progress(f"fusing by {method}", len(frames)) as tick:
        if offline:
            fused = smooth_walk(chosen, chosen_params, frames, tick=tick)
        else:
            fused = fuse_walk(chosen, chosen_params, frames, view=view, tick=tick)
    if pair is not None:
        warn_of_misfit(pair, frames.inputs, fused.world_from_cam, fused.status, strict=strict)
    write_fused_csv(out, fused, overwrite=overwrite)
    say(f"{out}: {format_statuses(fused)}")
    if tum_out is None:
        return
    if fused.is_localized.any():
        with replacing_output(tum_out, overwrite=overwrite) as partial:
            tum.write(partial, fused.to_trajectory())
        say(f"{tum_out}: {count_of(fused.is_localized.sum(), 'localized frame')}")
    else:
        say(f"{tum_out}: not written, no frame was localized")
