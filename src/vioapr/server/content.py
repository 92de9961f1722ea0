"""Files that clients fetch: by the hash of their content, so that what a phone has is not sent."""

from __future__ import annotations

import threading
from pathlib import Path

from starlette.requests import Request
from starlette.responses import FileResponse, Response

from vioapr.errors import FileMissingError
from vioapr.files.digests import digest_of

_MEDIA_TYPES = {
    ".onnx": "application/octet-stream",
    ".json": "application/json",
    ".csv": "text/csv",
    ".tum": "text/plain",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".png": "image/png",
    ".glb": "model/gltf-binary",
    ".gltf": "model/gltf+json",
}


class Hashes:
    """The SHA-256 of files, kept as long as size, time and inode stay the same."""

    def __init__(self) -> None:
        """Know none yet."""
        self._known: dict[Path, tuple[tuple[int, int, int], str]] = {}
        self._change = threading.Lock()

    def of(self, path: Path) -> str:
        """The hash of a file, in hexadecimal.

        Raises:
            FileMissingError: It is not there.
        """
        try:
            found = path.stat()
            mark = (found.st_size, found.st_mtime_ns, found.st_ino)
            with self._change:
                known = self._known.get(path)
            if known is not None and known[0] == mark:
                return known[1]
            sha256 = digest_of(path)
        except OSError:
            raise FileMissingError(path.name, "expected a file, found none of this name") from None
        with self._change:
            self._known[path] = mark, sha256
        return sha256


def send_file(request: Request, path: Path, sha256: str | None = None) -> Response:
    """Answer with a file.

    Args:
        request: Its header `If-None-Match` says what the client has.
        path: The file.
        sha256: Of its content, which becomes its ETag; None for files that never change.

    Raises:
        FileMissingError: It is not there.
    """
    if not path.is_file():
        raise FileMissingError(path.name, "expected a file, found none of this name")
    headers = {"cache-control": "no-cache"}
    if sha256 is not None:
        headers["etag"] = f'"{sha256}"'
        given = {tag.strip() for tag in request.headers.get("if-none-match", "").split(",")}
        if headers["etag"] in given:
            return Response(status_code=304, headers=headers)
    kind = _MEDIA_TYPES.get(path.suffix.lower(), "application/octet-stream")
    return FileResponse(path, headers=headers, media_type=kind)
