"""The tracks of a walk's files, read with what looks wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from vioapr.errors import SuspectTrackError, VioAprError
from vioapr.formats.base import ReadOptions
from vioapr.formats.body_from_cam import turn_to_camera
from vioapr.formats.pair_checks import Role, Track
from vioapr.formats.registry import read_with_notes
from vioapr.formats.walk_checks import check_walk
from vioapr.scene.walks import Skip, WalkFiles
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory


@dataclass(frozen=True, eq=False)
class WalkTracks:
    """The tracks of one walk.

    Attributes:
        gt: Ground truth.
        vios: The trackers' poses, by name.
        aprs: The regressors' predictions, by name.
    """

    gt: Trajectory
    vios: Mapping[str, Trajectory]
    aprs: Mapping[str, Trajectory]


@dataclass(frozen=True)
class WalkReader:
    """Reads walks, and says what looks wrong with their files.

    Attributes:
        options: Unit of time, and whether to refuse what looks wrong.
        vio_from_cam: For trackers that give poses of a body: "auto", by ground truth, or a file
            with body_from_cam; see `formats.body_from_cam`.
        say: Called with facts.
        warn: Called with warnings. Without it, tracks are not checked by each other.
        skip: Called for a tracker's or regressor's file that cannot be read and is left out; None
            refuses the walk.
    """

    options: ReadOptions = field(default_factory=ReadOptions)
    vio_from_cam: str | None = None
    say: Callable[[str], object] | None = None
    warn: Callable[[str], object] | None = None
    skip: Skip | None = None

    def read(self, walk: WalkFiles, tolerance_s: float = DEFAULT_TOLERANCE_S) -> WalkTracks:
        """Read a walk.

        Args:
            walk: Its files.
            tolerance_s: Largest difference of timestamps within a frame, s.

        Raises:
            FileError: A file is wrong.
            SuspectTrackError: A track looks wrong, and the options are strict.
            AssociationError: How the camera is mounted cannot be estimated.
        """
        gt = self._read(walk.gt)
        vios, aprs = self._read_all(walk.vios), self._read_all(walk.aprs)
        if self.vio_from_cam is not None:
            for name, vio in vios.items():
                vios[name], how = turn_to_camera(vio, self.vio_from_cam, gt, tolerance_s)
                if self.say is not None:
                    self.say(f"{walk.vios[name]}: {how}")
        if self.warn is not None or self.options.strict:
            self._check(walk, WalkTracks(gt, vios, aprs), tolerance_s)
        return WalkTracks(gt, vios, aprs)

    def report(self, text: str) -> None:
        """Warn of what looks wrong.

        Raises:
            SuspectTrackError: The options are strict.
        """
        if self.options.strict:
            raise SuspectTrackError(text)
        if self.warn is not None:
            self.warn(text)

    def _read_all(self, files: Mapping[str, Path]) -> dict[str, Trajectory]:
        """Read files by name, without those that are left out."""
        read: dict[str, Trajectory] = {}
        for name, path in files.items():
            try:
                read[name] = self._read(path)
            except VioAprError as error:
                if self.skip is None:
                    raise
                self.skip(error)
        return read

    def _read(self, path: Path) -> Trajectory:
        reading = read_with_notes(path, options=self.options)
        for text in reading.warnings:
            self.report(f"{path}: {text}")
        return reading.trajectory

    def _check(self, walk: WalkFiles, tracks: WalkTracks, tolerance_s: float) -> None:
        def given(
            role: Role, files: Mapping[str, Path], read: Mapping[str, Trajectory]
        ) -> list[Track]:
            return [Track(str(files[name]), role, track) for name, track in read.items()]

        (gt,) = given("gt", {"gt": walk.gt}, {"gt": tracks.gt})
        aprs, vios = given("apr", walk.aprs, tracks.aprs), given("vio", walk.vios, tracks.vios)
        for warning in check_walk(aprs, vios, gt, tolerance_s):
            self.report(f"{walk.set_name}/{walk.walk}: {warning}")
