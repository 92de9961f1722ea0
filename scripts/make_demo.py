"""Makes what `vioapr demo` ships with: a test walk of the courtyard and a localizer of the place.

    python benchmarks/regressors.py courtyard FOLDER --models mobile   # simulates and trains
    python scripts/make_demo.py FOLDER

Writes src/vioapr/demo; docs/demo.md says more.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from dataclasses import replace
from pathlib import Path

from vioapr.cli.demo import LOCALIZER, SCENE
from vioapr.cli.main import main as vioapr
from vioapr.scene.scene import Scene

PACKAGE = Path(__file__).parent.parent / "src" / "vioapr" / "demo"
RECORDING = "test-01"
PRECISION = "int8w"
MOST_MB = 12.0
LEFT_OUT = shutil.ignore_patterns("imu.csv")  # large, and no method here uses it


def copy_scene(scene: Scene, folder: Path) -> None:
    """The scene with one test recording."""
    shipped = replace(scene, folder=folder, splits={"train": (), "test": (RECORDING,)})
    recordings = (one.recording_folder(RECORDING) for one in (scene, shipped))
    shutil.copytree(*recordings, ignore=LEFT_OUT)
    shipped.gt_path(RECORDING).parent.mkdir()
    shutil.copy(scene.gt_path(RECORDING), shipped.gt_path(RECORDING))
    shipped.save()


def main() -> None:
    """Replace the shipped files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("folder", type=Path, help="what benchmarks/regressors.py left")
    folder = parser.parse_args().folder
    if PACKAGE.exists():
        shutil.rmtree(PACKAGE)
    PACKAGE.mkdir()
    copy_scene(Scene.open(folder / "courtyard"), PACKAGE / SCENE)
    localizer = PACKAGE / LOCALIZER
    arguments = ("export", folder / "mobile", "--out", localizer, "--precision", PRECISION)
    if code := vioapr([str(word) for word in arguments]):
        sys.exit(code)
    size_mb = sum(path.stat().st_size for path in PACKAGE.rglob("*") if path.is_file()) / 1e6
    print(f"{PACKAGE}: {size_mb:.1f} MB, at most {MOST_MB:g}")
    sys.exit(size_mb > MOST_MB)


if __name__ == "__main__":
    main()
