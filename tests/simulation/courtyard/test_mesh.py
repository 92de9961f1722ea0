import numpy as np
import pytest

from vioapr.scene.frames import Intrinsics
from vioapr.simulation.courtyard.bake import lamp_light
from vioapr.simulation.courtyard.drawing import ChunkList, cut, split_by_gloss
from vioapr.simulation.courtyard.facades import arch_meshes, wall_mesh
from vioapr.simulation.courtyard.mesh import box, join, lathe, patch, rod
from vioapr.simulation.courtyard.noise import fractal, step
from vioapr.simulation.courtyard.openings import Opening
from vioapr.simulation.courtyard.projection import clip_from_cam


def area_and_volume(mesh):
    """Of the triangles, and of what they enclose if they close."""
    a, b, c = np.moveaxis(mesh.position_m[mesh.triangles].astype(float), 1, 0)
    cross = np.cross(b - a, c - a)
    return np.linalg.norm(cross, axis=1).sum() / 2, (a * cross).sum() / 6


def test_a_box_closes_and_its_faces_look_outwards():
    area, volume = area_and_volume(box((1, 2, 3), (2, 4, 6), faces="nsewtb"))
    assert area == pytest.approx(2 * (2 + 3 + 6))
    assert volume == pytest.approx(6)


def test_a_patch_is_cut_into_cells_and_measured_in_metres():
    mesh = patch((0, 0, 0), (3, 0, 0), (0, 0, 2), cell_m=1.0, uv_m=(10.0, 20.0))
    assert len(mesh.triangles) == 12
    np.testing.assert_allclose(mesh.normal[0], [0, -1, 0])
    np.testing.assert_allclose(mesh.uv_m.max(axis=0), [13, 22])


def test_a_lathe_of_a_step_is_a_cylinder():
    mesh = lathe([(0, 0), (1, 0), (1, 2), (0, 2)], sides=64)
    assert area_and_volume(mesh)[1] == pytest.approx(2 * np.pi, rel=0.01)


def test_a_rod_goes_from_its_start_to_its_end():
    mesh = rod((1, 1, 1), (4, 5, 1), (0.1, 0.1))
    along = (mesh.position_m - [1, 1, 1]) @ np.array([0.6, 0.8, 0.0])
    assert (along.min(), along.max()) == pytest.approx((0, 5), abs=1e-5)


def test_moving_turns_counterclockwise_seen_from_above():
    mesh = patch((1, 0, 0), (1, 0, 0), (0, 0, 1)).moved((0, 0, 5), yaw_deg=90)
    np.testing.assert_allclose(mesh.position_m[0], [0, 1, 5], atol=1e-6)
    np.testing.assert_allclose(mesh.normal[0], [1, 0, 0], atol=1e-6)


def test_joined_meshes_keep_their_triangles():
    pieces = [box((x, 0, 0), (x + 1, 1, 1), faces="nsewtb") for x in (0, 3)]
    assert area_and_volume(join(pieces))[1] == pytest.approx(2)


def test_matte_and_glossy_parts_make_up_the_whole():
    mesh = join(
        [
            patch((0, 0, 0), (1, 0, 0), (0, 0, 1)),
            box((5, 0, 0), (6, 1, 1), faces="nsewtb", gloss=0.5),
        ]
    )
    matte, glossy = split_by_gloss(mesh)
    assert (len(matte.triangles), len(glossy.triangles)) == (2, 12)
    assert (matte.gloss == 0).all()
    assert (glossy.gloss > 0).all()


class _Thing:
    is_cutout = False


def test_only_what_may_be_seen_is_drawn_nearest_first():
    """Three boxes ahead, behind and farther ahead of a camera that looks along +z."""
    things = [_Thing() for _ in range(3)]
    boxes = [box((-1, -1, z), (1, 1, z + 1)) for z in (8, -8, 4)]
    chunks = ChunkList(zip(things, map(cut, boxes), strict=True))
    camera = Intrinsics(64, 48, 50, 50, 32, 24)
    seen = chunks.in_view(clip_from_cam(camera, (64, 48)), np.zeros(3))
    assert [chunk.drawable for chunk in seen] == [things[2], things[0]]


def test_cutting_keeps_all_triangles_and_bounds_them():
    tiles = [patch((x, y, 0), (1, 0, 0), (0, 1, 0)) for x in range(0, 40, 2) for y in range(24)]
    mesh = join(tiles)
    pieces = cut(mesh)
    assert len(pieces.runs) > 4
    assert sum(count for _, count in pieces.runs) == 3 * len(mesh.triangles)
    for (first, count), low, high in zip(pieces.runs, pieces.low_m, pieces.high_m, strict=True):
        rows = pieces.mesh.triangles.ravel()[first : first + count]
        corners = pieces.mesh.position_m[rows]
        np.testing.assert_array_equal(corners.min(axis=0), low)
        np.testing.assert_array_equal(corners.max(axis=0), high)


@pytest.mark.parametrize("slope", [0.2, 1.0, 1.6])
def test_noise_has_the_asked_for_spectrum(slope):
    field = fractal(np.random.default_rng(0), (1024, 1024), slope=slope)
    assert field.std() == pytest.approx(1, rel=0.05)
    spectrum = np.abs(np.fft.fft2(field))
    waves = np.hypot(*np.meshgrid(np.fft.fftfreq(1024, 1 / 1024), np.fft.fftfreq(1024, 1 / 1024)))
    low, high = (spectrum[(waves > a) & (waves < b)].mean() for a, b in ((11, 13), (38, 42)))
    # Amplitude falls as frequency ** -slope: from 12 to 40 waves across the picture.
    assert np.log(low / high) / np.log(40 / 12) == pytest.approx(slope, abs=0.15)


def test_a_step_rises_and_falls():
    np.testing.assert_allclose(step(np.array([0.0, 1.0, 2.0]), 0.0, 2.0), [0, 0.5, 1])
    np.testing.assert_allclose(step(np.array([0.0, 1.0, 2.0]), 2.0, 0.0), [1, 0.5, 0])


def test_a_wall_is_open_where_its_openings_are():
    openings = [Opening(1.0, 0.5, 1.2, 2.0), Opening(4.0, 0.0, 1.0, 2.5, "door")]
    area, _ = area_and_volume(wall_mesh((6.0, 4.0), openings))
    assert area == pytest.approx(6 * 4 - 1.2 * 2 - 2.5, rel=1e-6)


def test_above_an_arch_the_wall_goes_on():
    """Between a half circle of 2 m and its square: 2 - pi / 2 square metres, but for the pieces."""
    pieces = join(arch_meshes(Opening(0.0, 0.0, 2.0, 3.0, "gate", depth_m=0.5, arched=True), 60))
    front = (pieces.position_m[pieces.triangles][..., 1] == 0).all(axis=1)
    a, b, c = np.moveaxis(pieces.position_m[pieces.triangles[front]].astype(float), 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(2 - np.pi / 2, rel=0.01)


def test_lamps_light_what_faces_them_by_the_square_of_the_distance():
    points = np.array([[0.0, 0, 0], [0, 0, -6], [0, 0, 0]])
    normals = np.array([[0.0, 0, 1], [0, 0, 1], [1, 0, 0]])
    near, far, aside = lamp_light(points, normals, np.array([[0.0, 0, 3.0]]))
    assert near / far == pytest.approx((9**2 + 1) / (3**2 + 1))
    assert aside == pytest.approx(0.05 * near)
