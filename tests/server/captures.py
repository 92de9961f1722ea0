"""A phone's captures, made small: what the page would put, file by file."""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass, field

import numpy as np
from tests.scene.scenes import jpeg

from vioapr.geometry.frames import y_up_from_z_up
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.capture_logs import (
    FRAMES_HEADER,
    GNSS_HEADER,
    HEADING_HEADER,
    IMU_HEADER,
)
from vioapr.simulation.handheld import looking

TOKEN = "a-token-of-the-tests"
AUTH = {"authorization": f"Bearer {TOKEN}"}


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@dataclass
class Capture:
    """Files by name, and what they must become.

    Attributes:
        files: Content by name.
        timestamp_s: Shape (n,).
        vio_from_cam: Shape (n,), NaN where lost.
        tracking: Labels of `frames.csv`.
    """

    timestamp_s: np.ndarray
    vio_from_cam: Rigid3
    tracking: list[str]
    files: dict[str, bytes] = field(default_factory=dict)

    @property
    def hashes(self) -> dict[str, str]:
        return {name: sha256(content) for name, content in self.files.items()}


def make_capture(count: int = 12, lost: tuple[int, ...] = (5,), new_from: int = 8) -> Capture:
    """A walk in portrait, some frames lost, a new tracking world later; sensors of a phone."""
    times = 1700000000.25 + 0.2 * np.arange(count)
    steps = np.arange(count)
    positions = np.stack([0.1 * steps, np.sin(steps), 0.02 * steps], axis=1)
    truth = y_up_from_z_up(Rigid3(positions, looking(0.1 * steps, np.zeros((count, 3)))))
    x, y, z, w = truth.quat_xyzw.T
    arcam = truth._replace(quat_xyzw=np.stack([-w, -z, y, x], axis=1))  # as contract.md has it
    is_lost = np.isin(steps, lost)
    rows, states = [], []
    for k in range(count):
        pose = "," * 6
        if not is_lost[k]:
            pose = ",".join(repr(float(v)) for v in (*arcam.translation_m[k], *arcam.quat_xyzw[k]))
        state = "lost" if is_lost[k] else "limited" if k == 2 else "normal"
        world = int(k >= new_from)
        rows.append(f"{times[k]:.6f},{k:06d}.jpg,{state},{pose},12,16,20.0,21.0,6.0,8.0,{world}")
        states.append("reset" if k == new_from else state)
    capture = Capture(times, truth, states)
    for part in (truth.translation_m, truth.quat_xyzw):
        part[is_lost] = np.nan
    half = count // 2
    for number, chosen in enumerate((rows[:half], rows[half:])):
        text = "\n".join([FRAMES_HEADER, *chosen]) + "\n"
        capture.files[f"frames-{number:05d}.csv"] = text.encode()
    # Upright phone: gravity along the device's +y, by W3C's sign.
    imu = [f"{times[0] + 0.01 * k:.6f},0.0,9.81,0.0,{k},0.0,{-k},0" for k in range(20)]
    capture.files["imu-00000.csv"] = "\n".join([IMU_HEADER, *imu, "170000"]).encode()
    gnss = [f"{times[3]:.6f},48.1,11.5,,4.5,"]
    capture.files["gnss-00000.csv"] = "\n".join([GNSS_HEADER, *gnss, ""]).encode()
    heading = [f"{times[1]:.6f},90.0,90.0,0.0,", f"{times[2]:.6f},10.0,0.0,0.0,"]
    capture.files["heading-00000.csv"] = "\n".join([HEADING_HEADER, *heading, ""]).encode()
    for k in range(count):
        capture.files[f"images/{k:06d}.jpg"] = jpeg(12, 16, shade=k)
    head = '{"format": "vioapr capture", "version": 1, "device": "Pixel 8", "tracker": "WebXR"}'
    capture.files["capture.json"] = head.encode()
    return capture


def put(client, id_: str, name: str, content: bytes, kind: str = "captures", **headers):
    given = {"x-sha256": sha256(content), **AUTH, **headers}
    return client.put(f"/api/{kind}/{id_}/files/{name}", content=content, headers=given)


def put_all(client, id_: str, files: dict[str, bytes], kind: str = "captures") -> None:
    for name, content in files.items():
        assert put(client, id_, name, content, kind).status_code == 201, name


def wait_for_job(client, id_: str, timeout_s: float = 60.0) -> dict:
    end_s = time.monotonic() + timeout_s
    while time.monotonic() < end_s:
        found = client.get(f"/api/jobs/{id_}", headers=AUTH).json()["job"]
        if found["state"] not in ("queued", "running"):
            return found
        time.sleep(0.1)
    raise AssertionError(f"job {id_} has not ended")


def rotation_errors_rad(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Angles between unit quaternions, shapes (n, 4), which may differ in sign."""
    apart = [np.linalg.norm(found - sign * wanted, axis=1) for sign in (1.0, -1.0)]
    return 2 * np.minimum(*apart)
