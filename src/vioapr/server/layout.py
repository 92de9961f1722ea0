"""Where the server keeps what it needs, in the folder that it serves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vioapr.errors import FileMissingError, FormatError
from vioapr.files.text import require_folder
from vioapr.scene.scene import SCENE_FILE, Scene, check_id

STATE_FOLDER = ".vioapr-server"
ANCHORS_FILE = "anchors.json"


@dataclass(frozen=True)
class ServedFolder:
    """A folder of scenes.

    Attributes:
        folder: Where it is; every scene is a folder in it.
    """

    folder: Path

    @staticmethod
    def open(folder: Path) -> ServedFolder:
        """See that a folder can be served.

        Raises:
            FileMissingError: It is not there.
            FormatError: It is a file, or a scene itself.
        """
        require_folder(folder, "a folder of scenes")
        if (folder / SCENE_FILE).exists():
            parent = folder.resolve().parent
            raise FormatError(
                folder, f"expected a folder of scenes, found one scene: serve {parent}, around it"
            )
        return ServedFolder(folder)

    @property
    def state(self) -> Path:
        """The server's own files."""
        return self.folder / STATE_FOLDER

    @property
    def captures(self) -> Path:
        """A folder a capture."""
        return self.state / "captures"

    @property
    def uploads(self) -> Path:
        """A folder an upload of another app's export."""
        return self.state / "uploads"

    @property
    def parts(self) -> Path:
        """Files that are being received; what a crash leaves here is worth nothing."""
        return self.state / "parts"

    @property
    def jobs(self) -> Path:
        """A folder a job."""
        return self.state / "jobs"

    @property
    def token_file(self) -> Path:
        """What clients must know to do anything."""
        return self.state / "token"

    def scene_ids(self) -> list[str]:
        """Ids of the scenes, in order."""
        found = (path.parent.name for path in self.folder.glob(f"*/{SCENE_FILE}"))
        return sorted(name for name in found if not name.startswith("."))

    def scene_folder(self, id_: str) -> Path:
        """Where a scene is or will be.

        Raises:
            ParameterError: The id is none.
        """
        return self.folder / check_id(id_)

    def scene(self, id_: str) -> Scene:
        """Open a scene.

        Raises:
            FileMissingError: There is none of this id.
            FileError: It is broken.
        """
        folder = self.scene_folder(id_)
        if not (folder / SCENE_FILE).exists():
            raise FileMissingError(id_, "expected a scene, found none of this id")
        return Scene.open(folder)
