"""The HTTP interface: addresses, and what answers there; docs/reference/server.md describes it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import TypeVar

from anyio import to_thread
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from vioapr._version import __version__
from vioapr.errors import VioAprError
from vioapr.schemas.base import Record, decode
from vioapr.schemas.jobs import JobDocument
from vioapr.schemas.server import (
    BuildRequest,
    CaptureCompletion,
    ImportRequest,
    NewScene,
    ServerInfo,
)
from vioapr.server import scenes
from vioapr.server.access import Guard
from vioapr.server.content import Hashes
from vioapr.server.handovers import Handovers
from vioapr.server.jobs import Jobs
from vioapr.server.layout import ServedFolder
from vioapr.server.limits import Limits
from vioapr.server.names import is_capture_name, is_upload_name
from vioapr.server.refusals import HANDLED, Refusal, answer, refuse
from vioapr.server.transfers import Transfers, clean_parts, receive_body

STATIC = Path(__file__).parent / "static"
_JOBS_EVERY_S = 0.5
_LOG_BYTES = 1 << 20
_log = logging.getLogger("uvicorn.error")

RecordType = TypeVar("RecordType", bound=Record)


class Api:
    """Answers requests for one folder.

    Attributes:
        served: The folder.
        jobs: Verbs that run for clients.
    """

    def __init__(self, served: ServedFolder, limits: Limits) -> None:
        """Take up what is there, and remove what a killed server left half received."""
        clean_parts(served.parts)
        self.served, self._limits, self._hashes = served, limits, Hashes()
        self._captures = Transfers(served.captures, served.parts, is_capture_name, limits)
        self._uploads = Transfers(served.uploads, served.parts, is_upload_name, limits)
        self.jobs = Jobs(served.jobs, served.folder)
        self._handovers = Handovers(served, self._captures, self._uploads, self.jobs)
        self._handovers.take_up()

    async def run_jobs(self) -> None:
        """Start and watch jobs until cancelled."""
        said = ""
        while True:
            try:
                ended = await to_thread.run_sync(self.jobs.advance)
                if ended:
                    await to_thread.run_sync(self._handovers.remove_imported)
                said = ""
            except (VioAprError, OSError) as error:  # as of a full disk: it may be better soon
                if str(error) != said:
                    said = str(error)
                    _log.error("jobs cannot be run: %s", said)
            await asyncio.sleep(_JOBS_EVERY_S)

    def routes(self) -> list[Route]:
        """All addresses below `/api`."""
        files = "files/{name:path}"
        scene, recording = "/api/scenes/{id}", "/api/scenes/{id}/recordings/{recording}"
        return [
            Route("/api", self.info),
            Route("/api/scenes", self.list_scenes),
            Route("/api/scenes", self.make_scene, methods=["POST"]),
            Route(scene, self.get_scene),
            Route(f"{scene}/summary", self.get_summary),
            Route(f"{scene}/map", self.get_map),
            Route(f"{scene}/map/points", self.get_map_points),
            Route(f"{scene}/anchors", self.get_anchors),
            Route(f"{scene}/anchors", self.put_anchors, methods=["PUT"]),
            Route(f"{scene}/anchors/{files}", self.get_model),
            Route(f"{scene}/imports", self.import_upload, methods=["POST"]),
            Route(f"{scene}/build", self.get_build),
            Route(f"{scene}/build", self.build, methods=["POST"]),
            Route(f"{recording}/gt", self.get_gt),
            Route(f"{recording}/{files}", self.get_recording_file),
            Route("/api/localizers", self.list_localizers),
            Route("/api/localizers/{name:path}", self.get_localizer),
            *self._transfer_routes("/api/captures", self._captures),
            Route("/api/captures/{id}/complete", self.complete_capture, methods=["POST"]),
            *self._transfer_routes("/api/uploads", self._uploads),
            Route("/api/jobs", self.list_jobs),
            Route("/api/jobs/{id}", self.get_job),
            Route("/api/jobs/{id}/log", self.get_log),
            Route("/api/jobs/{id}/stop", self.stop_job, methods=["POST"]),
            Route("/api/jobs/{id}/again", self.run_job_again, methods=["POST"]),
        ]

    def _transfer_routes(self, address: str, transfers: Transfers) -> list[Route]:
        async def put(request: Request) -> Response:
            id_, name = _id(request), request.path_params["name"]
            return Response(status_code=await transfers.put(request, id_, name))

        def list_all(request: Request) -> Response:
            return answer([transfers.state(id_) for id_ in transfers.ids()])

        def get(request: Request) -> Response:
            return answer(transfers.state(_id(request)))

        def remove(request: Request) -> Response:
            self._handovers.require_idle(transfers, _id(request))
            transfers.remove(_id(request))
            return Response(status_code=204)

        return [
            Route(address, list_all),
            Route(f"{address}/{{id}}", get),
            Route(f"{address}/{{id}}", remove, methods=["DELETE"]),
            Route(f"{address}/{{id}}/files/{{name:path}}", put, methods=["PUT"]),
        ]

    def info(self, request: Request) -> Response:
        """Say which server this is."""
        return answer(ServerInfo(vioapr=__version__))

    def list_scenes(self, request: Request) -> Response:
        """All scenes in short."""
        ids = self.served.scene_ids()
        return answer([scenes.describe_scene(self.served, id_) for id_ in ids])

    async def make_scene(self, request: Request) -> Response:
        """Make an empty scene."""
        wanted = await self._read(request, NewScene)
        entry = await to_thread.run_sync(scenes.make_scene, self.served, wanted)
        return answer(entry, 201)

    def get_scene(self, request: Request) -> Response:
        """One scene in short."""
        self.served.scene_folder(_id(request))  # of an id that is none, an error
        return answer(scenes.describe_scene(self.served, _id(request)))

    def get_summary(self, request: Request) -> Response:
        """What a scene holds."""
        return scenes.send_summary(self.served, _id(request))

    def get_map(self, request: Request) -> Response:
        """The summary of a scene's map."""
        return scenes.send_map_summary(self.served, request, _id(request))

    def get_map_points(self, request: Request) -> Response:
        """The points of a scene's map."""
        return scenes.send_map_points(self.served, request, _id(request), self._hashes)

    def get_build(self, request: Request) -> Response:
        """What a scene's last build came to."""
        return scenes.send_build_summary(self.served, request, _id(request))

    def get_anchors(self, request: Request) -> Response:
        """A scene's content."""
        return scenes.send_anchors(self.served, request, _id(request), self._hashes)

    async def put_anchors(self, request: Request) -> Response:
        """Replace a scene's content."""
        content = await self._read_bytes(request)
        return await to_thread.run_sync(
            scenes.write_anchors, self.served, request, _id(request), content, self._hashes
        )

    def get_model(self, request: Request) -> Response:
        """A model of a scene's content."""
        name = request.path_params["name"]
        return scenes.send_model(self.served, request, _id(request), name, self._hashes)

    def get_gt(self, request: Request) -> Response:
        """A recording's ground truth."""
        return scenes.send_gt(self.served, request, _id(request))

    def get_recording_file(self, request: Request) -> Response:
        """A file of a recording."""
        name = request.path_params["name"]
        return scenes.send_recording_file(self.served, request, _id(request), name)

    def list_localizers(self, request: Request) -> Response:
        """All localizers."""
        return answer([*scenes.localizers(self.served, self._hashes)])

    def get_localizer(self, request: Request) -> Response:
        """A localizer's file."""
        name = request.path_params["name"]
        return scenes.send_localizer(self.served, request, name, self._hashes)

    async def complete_capture(self, request: Request) -> Response:
        """Make a recording of a capture."""
        wanted = await self._read(request, CaptureCompletion)
        complete = self._handovers.complete_capture
        return answer(await to_thread.run_sync(complete, _id(request), wanted))

    async def import_upload(self, request: Request) -> Response:
        """Import an upload into a scene."""
        wanted = await self._read(request, ImportRequest)
        complete = self._handovers.complete_upload
        return answer(await to_thread.run_sync(complete, _id(request), wanted), 202)

    async def build(self, request: Request) -> Response:
        """Build a localizer of a scene; a build that is under way is answered as it is."""
        wanted = await self._read(request, BuildRequest)
        return answer(await to_thread.run_sync(self._submit_build, _id(request), wanted), 202)

    def _submit_build(self, id_: str, wanted: BuildRequest) -> JobDocument:
        scene = self.served.scene(id_)
        under_way = self.jobs.find_open("build", id_)
        arguments = ["build", scene.folder.name, *(["--refine"] if wanted.refine else [])]
        return under_way or self.jobs.submit("build", arguments, scene=id_)

    def list_jobs(self, request: Request) -> Response:
        """All jobs, the newest first."""
        return answer([*self.jobs.all()])

    def get_job(self, request: Request) -> Response:
        """One job."""
        return answer(self.jobs.get(_id(request)))

    def get_log(self, request: Request) -> Response:
        """A job's log from the byte that the query's `offset` says."""
        given = request.query_params.get("offset", "0")
        if not given.isdecimal() or len(given) > 15:
            raise Refusal(400, f"offset: expected a number of bytes, got {given[:20]!r}")
        content = self.jobs.read_log(_id(request), int(given), _LOG_BYTES)
        headers = {"cache-control": "no-cache", "x-next-offset": str(int(given) + len(content))}
        return Response(content, media_type="text/plain; charset=utf-8", headers=headers)

    def stop_job(self, request: Request) -> Response:
        """Ask a job to end."""
        return answer(self.jobs.stop(_id(request)))

    def run_job_again(self, request: Request) -> Response:
        """Queue a job again."""
        return answer(self.jobs.again(_id(request)))

    async def _read_bytes(self, request: Request) -> bytes:
        content = bytearray()
        limits = self._limits
        await receive_body(request, content.extend, limits.max_json_bytes, limits.idle_s)
        return bytes(content)

    async def _read(self, request: Request, kind: type[RecordType]) -> RecordType:
        return decode("the request", await self._read_bytes(request), kind)


def _id(request: Request) -> str:
    return request.path_params["id"]


def make_app(
    served: ServedFolder,
    token: str,
    *,
    ca_pem: bytes | None = None,
    limits: Limits | None = None,
) -> ASGIApp:
    """Make the application that serves a folder.

    Args:
        served: The folder; no other server may serve it.
        token: What clients must know.
        ca_pem: Certificate of the authority that vouches for the server, for phones to install.
        limits: How much a client may ask for.
    """
    api = Api(served, limits or Limits())

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        watch = asyncio.create_task(api.run_jobs())
        yield
        watch.cancel()
        with suppress(asyncio.CancelledError):
            await watch

    def send_ca(request: Request) -> Response:
        if ca_pem is None:
            raise Refusal(404, "this server has no certificate of its own: it serves plain HTTP")
        return Response(ca_pem, media_type="application/x-x509-ca-cert")

    app = Starlette(
        routes=[
            *api.routes(),
            Route("/vioapr-ca.crt", send_ca),
            Mount("/", StaticFiles(directory=STATIC, html=True)),
        ],
        exception_handlers=dict.fromkeys(HANDLED, refuse),
        lifespan=lifespan,
    )
    return Guard(app, token)
