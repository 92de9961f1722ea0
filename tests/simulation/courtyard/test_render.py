"""What is drawn where: worlds of one bright square, whose place in the picture is known."""

import numpy as np
import pytest

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.frames import Intrinsics
from vioapr.simulation.courtyard.mesh import box, join, patch
from vioapr.simulation.courtyard.render import Figure, Renderer, Shot
from vioapr.simulation.courtyard.weather import OVERCAST, SUNNY
from vioapr.simulation.courtyard.world import Material, World
from vioapr.simulation.handheld import looking

pytestmark = pytest.mark.usefixtures("rendering")

SIZE = (160, 120)
CAMERA = Intrinsics(160, 120, 130.0, 120.0, 83.0, 57.0)
# Looks along the world's +y.
LEVEL = Rigid3(np.zeros(3), looking(np.array(np.pi / 2)))


def plain(value, shape=(4, 4)):
    return Material(np.full((*shape, 3), value, dtype=np.uint8), (1.0, 1.0))


def renderer_of(meshes, **materials):
    world = World(
        {"dark": plain(2), "bright": plain(255), "cloth": plain(255), **materials},
        meshes,
        np.zeros((0, 3)),
    )
    renderer = Renderer(world, SIZE, vignetting=0.0)
    renderer.set_weather(OVERCAST)
    return renderer


def square_at(centre, side=0.12):
    """A small upright square that faces -y."""
    x, y, z = centre
    return patch((x - side / 2, y, z - side / 2), (side, 0, 0), (0, 0, side))


def centroid_px(image, background):
    """Middle of what differs from the background; a pixel's own middle is at a half."""
    weight = np.abs(image.astype(float) - background.astype(float)).sum(axis=-1)
    weight[weight < 0.15 * weight.max()] = 0
    rows, columns = np.indices(weight.shape) + 0.5
    return np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()


WALL = patch((-30, 12, -30), (60, 0, 0), (0, 0, 60), cell_m=30)


@pytest.mark.slow
@pytest.mark.parametrize(
    "point", [(0.0, 4.0, 0.0), (-1.6, 4.0, 1.1), (1.9, 5.0, -1.5), (2.0, 9.0, 3.0)]
)
def test_a_point_is_drawn_where_it_projects_to(point):
    tilted = quaternion.multiply(
        quaternion.from_rotvec(np.array([0.06, -0.04, 0.05])), LEVEL.quat_xyzw
    )
    world_from_cam = Rigid3(np.array([0.2, -0.3, 0.1]), tilted)
    wall_only = renderer_of({"dark": WALL}).render(world_from_cam, CAMERA)
    with_square = renderer_of({"dark": WALL, "bright": square_at(point)}).render(
        world_from_cam, CAMERA
    )
    x, y, z = world_from_cam.inverse().apply(np.array(point))
    expected = np.array([CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy])
    np.testing.assert_allclose(centroid_px(with_square, wall_only), expected, atol=0.5)


@pytest.mark.slow
def test_up_is_up_and_right_is_right():
    wall_only = renderer_of({"dark": WALL}).render(LEVEL, CAMERA)
    marked = renderer_of({"dark": WALL, "bright": square_at((2.0, 6.0, 1.5))})
    column, row = centroid_px(marked.render(LEVEL, CAMERA), wall_only)
    assert column > CAMERA.cx + 30
    assert row < CAMERA.cy - 20


@pytest.mark.slow
def test_the_nearer_thing_hides_the_farther():
    screen = patch((-5, 3, -5), (10, 0, 0), (0, 0, 10))
    hidden = renderer_of({"dark": join([WALL, screen]), "bright": square_at((0, 6, 0), 1.0)})
    without = renderer_of({"dark": join([WALL, screen])})
    np.testing.assert_array_equal(hidden.render(LEVEL, CAMERA), without.render(LEVEL, CAMERA))


def test_texture_coordinates_start_at_the_lower_left():
    pixels = np.full((64, 64, 3), 2, dtype=np.uint8)
    pixels[40:, :24] = 255  # the picture's lower left
    wall = patch((-1, 4, -1), (2, 0, 0), (0, 0, 2))
    image = renderer_of({"sign": wall}, sign=Material(pixels, (2.0, 2.0))).render(LEVEL, CAMERA)
    left, low = slice(CAMERA.cx - 25, CAMERA.cx - 15), slice(CAMERA.cy + 15, CAMERA.cy + 25)
    right, high = slice(CAMERA.cx + 15, CAMERA.cx + 25), slice(CAMERA.cy - 25, CAMERA.cy - 15)
    left, low, right, high = (slice(int(s.start), int(s.stop)) for s in (left, low, right, high))
    assert image[low, left].mean() > image[low, right].mean() + 80
    assert image[low, left].mean() > image[high, left].mean() + 80


def test_a_box_shades_the_ground_behind_it_in_the_sun():
    ground = patch((-10, -10, -1.5), (20, 0, 0), (0, 20, 0), cell_m=1.0)
    post = box((-0.3, 5.0, -1.5), (0.3, 5.6, 1.5))
    renderer = renderer_of({"bright": ground, "dark": post})
    renderer.set_weather(SUNNY)
    toward = -SUNNY.sun_direction / SUNNY.sun_direction[2]
    shaded = np.array([0.0, 5.3, 1.0]) + 2.5 * toward  # the shadow of a point within the post
    lit = shaded * [-1, 1, 1]
    values = []
    for x, y, z in (LEVEL.inverse().apply(shaded), LEVEL.inverse().apply(lit)):
        column, row = int(CAMERA.fx * x / z + CAMERA.cx), int(CAMERA.fy * y / z + CAMERA.cy)
        values.append(renderer.render(LEVEL, CAMERA, Shot((0.2,) * 3))[row, column].mean())
    assert values[0] < 0.7 * values[1]


def test_exposure_brightens_and_white_balance_colours():
    renderer = renderer_of({"bright": WALL})
    dark, bright, warm = (
        renderer.render(LEVEL, CAMERA, Shot(gain)).mean(axis=(0, 1))
        for gain in ((0.1,) * 3, (0.3,) * 3, (0.3, 0.3, 0.1))
    )
    assert (bright > dark + 20).all()
    assert warm[2] < bright[2] - 20


def test_noise_is_seeded():
    renderer = renderer_of({"bright": WALL})
    images = [
        renderer.render(LEVEL, CAMERA, Shot((0.2,) * 3, noise=0.03, seed=seed))
        for seed in (1, 1, 2)
    ]
    np.testing.assert_array_equal(images[0], images[1])
    assert 1 < np.abs(images[0].astype(float) - images[2]).mean() < 40


def test_turning_blurs_along_the_turn():
    """A camera that turns to the left smears a square sideways, not upwards."""
    renderer = renderer_of({"dark": WALL, "bright": square_at((0, 4, 0), 0.5)})
    sharp, blurred = (
        renderer.render(LEVEL, CAMERA, Shot(turned_rad=(0.0, angle, 0.0))) for angle in (0.0, 0.15)
    )

    def extent(image, axis, share):
        profile = image.astype(float).sum(axis=(axis, 2))
        return (profile > profile.min() + share * np.ptp(profile)).sum()

    assert extent(blurred, 0, 0.1) > extent(sharp, 0, 0.1) + 8
    assert abs(extent(blurred, 1, 0.5) - extent(sharp, 1, 0.5)) <= 1


def test_people_stand_where_they_are_put():
    renderer = renderer_of({"dark": WALL})
    renderer.add_figures([square_at((0, 0, 0), 0.3)])
    placed = np.eye(4)
    placed[:3, 3] = [1.0, 5.0, 0.5]
    with_figure = renderer.render(LEVEL, CAMERA, figures=[Figure(0, placed)])
    column, row = centroid_px(with_figure, renderer.render(LEVEL, CAMERA))
    assert column == pytest.approx(CAMERA.fx * 1.0 / 5.0 + CAMERA.cx, abs=0.5)
    assert row == pytest.approx(CAMERA.cy - CAMERA.fy * 0.5 / 5.0, abs=0.5)
