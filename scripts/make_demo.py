"""Makes what `vioapr demo` ships with: a test walk of the courtyard and a localizer of the place.

    python benchmarks/regressors.py courtyard FOLDER --models mobile   # simulates and trains
    python scripts/make_demo.py FOLDER
    python scripts/make_demo.py --fusion-only   # the same network with today's fusion

Writes src/vioapr/recipes/data; docs/guide/demo.md says more.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from vioapr.cli.main import main as vioapr
from vioapr.export.refit import replace_fusion
from vioapr.fusion.methods import DEFAULT_METHOD, get_method
from vioapr.recipes.demo import ARCHIVE_FILE, LOCALIZER_FILE, RECORDING, SCENE_FOLDER, pack_folder
from vioapr.scene.scene import Scene

PACKAGE = Path(__file__).parent.parent / "src" / "vioapr" / "recipes" / "data"
PRECISION = "int8w"
MOST_MB = 12.0
LEFT_OUT = shutil.ignore_patterns("imu.csv")  # large, and no method here uses it


def copy_scene(scene: Scene, folder: Path) -> None:
    """Copy the scene with one test recording."""
    shipped = replace(scene, folder=folder, splits={"train": (), "test": (RECORDING,)})
    recordings = (one.recording_folder(RECORDING) for one in (scene, shipped))
    shutil.copytree(*recordings, ignore=LEFT_OUT)
    shipped.gt_path(RECORDING).parent.mkdir()
    shutil.copy(scene.gt_path(RECORDING), shipped.gt_path(RECORDING))
    shipped.save()


def main() -> None:
    """Replace the shipped files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("folder", type=Path, nargs="?", help="what benchmarks/regressors.py left")
    parser.add_argument("--fusion-only", action="store_true", help="keep network and walk")
    given = parser.parse_args()
    archive, localizer = PACKAGE / ARCHIVE_FILE, PACKAGE / LOCALIZER_FILE
    if given.fusion_only:
        method = get_method(DEFAULT_METHOD)
        refit = replace_fusion(localizer.read_bytes(), method, method.params_type())
        localizer.write_bytes(refit.content)
        return
    if given.folder is None:
        parser.error("expected a folder, or --fusion-only")
    folder = given.folder
    with TemporaryDirectory() as temporary:
        shipped = Path(temporary) / SCENE_FOLDER
        copy_scene(Scene.open(folder / "courtyard"), shipped)
        pack_folder(shipped, archive)
    arguments = ("export", folder / "mobile", "--out", localizer, "--precision", PRECISION,
                 "--overwrite")  # fmt: skip
    if code := vioapr([str(word) for word in arguments]):
        sys.exit(code)
    size_mb = sum(path.stat().st_size for path in (archive, localizer)) / 1e6
    print(f"{PACKAGE}: {size_mb:.1f} MB, at most {MOST_MB:g}")
    sys.exit(size_mb > MOST_MB)


if __name__ == "__main__":
    main()
