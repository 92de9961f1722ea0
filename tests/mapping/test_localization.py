"""Images localized in the points of a small simulated room whose poses are known."""

import dataclasses
import shutil

import msgspec
import numpy as np
import pytest

pytest.importorskip("pycolmap", reason="pycolmap is not installed")
pytest.importorskip("cv2", reason="OpenCV is not installed")

from vioapr.errors import FileMissingError, FormatError, MappingError, ParameterError
from vioapr.files.images import encode_image
from vioapr.formats.registry import read_trajectory
from vioapr.geometry import rigid
from vioapr.mapping.features import find_features
from vioapr.mapping.localization.checking import CheckedMap
from vioapr.mapping.localization.localizer import PointMapLocalizer
from vioapr.mapping.localization.params import LocalizationParams, PointMapParams
from vioapr.mapping.localization.point_map import PointMap
from vioapr.mapping.localization.posed_images import images_of_recordings
from vioapr.mapping.localization.prediction import (
    cameras_of_frames,
    localize_recording,
    localize_walks,
)
from vioapr.mapping.localization.scene_map import POINT_MAP_FILE, open_point_map
from vioapr.mapping.params import MappingParams
from vioapr.scene.scene import Scene
from vioapr.simulation.rooms import ROOM_CAMERA, render, textured_room, walk_arc

EVERY = PointMapParams(max_rate_hz=0.0)


@pytest.fixture(scope="module")
def posed_room(small_room, tmp_path_factory):
    """A scene with exact ground truth from elsewhere, its point map, and the true poses."""
    folder = tmp_path_factory.mktemp("posed") / "scene"
    shutil.copytree(small_room[0].folder, folder)
    scene = Scene.open(folder)
    for id_ in ("a", "b"):
        scene.write_gt(id_, small_room[1][id_], "simulator")
    return scene, open_point_map(scene, EVERY), small_room[1]


@pytest.fixture(scope="module")
def localizer(posed_room):
    return PointMapLocalizer(posed_room[1])


def errors_of(found, truth):
    poses = rigid.stack([each.world_from_cam for each in found.found])
    rows = np.searchsorted(truth.timestamp_s, np.array(found.timestamp_s) - 1e-6)
    true = truth.target_from_source.at(rows)
    return rigid.distance_m(poses, true), rigid.angle_deg(poses, true)


def test_images_are_found_where_they_were_taken(posed_room, localizer):
    scene, place, truths = posed_room
    assert place.header.source == "ground truth of a, b"
    assert len(place.header.names) == 10
    found = localize_recording(localizer, scene.recording("t"))
    assert len(found.found) == len(truths["t"])
    assert found.tilted == 0
    off_m, off_deg = errors_of(found, truths["t"])
    assert off_m.max() < 0.01
    assert off_deg.max() < 0.2
    assert all(each.inliers >= 30 and each.error_px < 1.0 for each in found.found)
    # Stated sigmas: an error of three numbers beyond 3.8 sigma would come once in 400.
    sigmas = np.array([each.sigmas for each in found.found])
    assert (off_m < 3.8 * sigmas[:, 0]).all()
    assert (off_deg < 3.8 * sigmas[:, 1]).all()
    assert sigmas[:, 0].max() < 0.02
    assert sigmas[:, 1].max() < 0.5


def test_points_are_on_the_walls(posed_room):
    points_m = posed_room[1].points_m
    room = textured_room()
    away = np.minimum(np.abs(points_m - room.low_m), np.abs(points_m - room.high_m)).min(axis=1)
    assert len(points_m) > 300
    assert np.median(away) < 0.01


def test_a_map_is_read_as_it_was_written(posed_room):
    scene, place, _ = posed_room
    again = PointMap.load(scene.folder / POINT_MAP_FILE)
    assert again.header == place.header
    for field in dataclasses.fields(PointMap):
        if field.name != "header":
            np.testing.assert_array_equal(getattr(again, field.name), getattr(place, field.name))


@pytest.mark.slow
def test_a_map_is_made_once_and_again_where_something_changes(posed_room, tmp_path):
    scene = posed_room[0]
    path = scene.folder / POINT_MAP_FILE
    before = path.stat().st_mtime_ns
    open_point_map(scene, EVERY)
    assert path.stat().st_mtime_ns == before
    copy = Scene.open(shutil.copytree(scene.folder, tmp_path / "copy"))
    (copy.folder / POINT_MAP_FILE).write_bytes(b"no map")
    assert open_point_map(copy, EVERY).header == posed_room[1].header
    fewer = open_point_map(copy, PointMapParams(max_rate_hz=1.0))
    assert len(fewer.header.names) == 6
    assert fewer.header.key != posed_room[1].header.key
    assert [p.name for p in (copy.folder / "models" / "map").glob("[!.]*")] == ["points.npz"]


def test_pictures_of_elsewhere_are_not_localized(posed_room, localizer, tmp_path):
    """Another room, noise, and one colour."""
    camera = images_of_recordings(posed_room[0], ["a"], 0.0)[0].camera
    rng = np.random.default_rng(0)
    poses = walk_arc(2, 0, 80, 1.3, 1.4).target_from_source
    other = [render(textured_room(7), ROOM_CAMERA, poses.at(row)) for row in range(2)]
    noise = rng.integers(0, 256, (240, 320), dtype=np.uint8)
    for number, pixels in enumerate([*other, noise, np.full_like(noise, 90)]):
        path = tmp_path / f"{number}.png"
        path.write_bytes(encode_image(path.name, pixels))
        assert localizer.localize(path, camera) is None


def test_an_image_that_is_left_out_does_not_help_itself(posed_room):
    """With one view to match with, that is the image itself, or else the next one."""
    place = posed_room[1]
    localizer = PointMapLocalizer(place, LocalizationParams(views=1))
    image = next(
        image
        for image in images_of_recordings(posed_room[0], ["a"], 0.0)
        if image.name == place.header.names[3]
    )
    features = find_features(image.path, MappingParams())
    with_itself = localizer.localize_features(features, image.camera)
    without = localizer.localize_features(features, image.camera, slice(3, 4))
    assert with_itself.inliers > without.inliers > 30
    assert rigid.distance_m(without.world_from_cam, image.world_from_cam) < 0.02
    everything = slice(0, len(place.header.names))
    assert localizer.localize_features(features, image.camera, everything) is None


def test_points_without_a_part_of_the_map_are_where_they_were(posed_room):
    """Placed by the observations of the other images; not where these are too few."""
    scene, place, _ = posed_room
    images = images_of_recordings(scene, ["a", "b"], 0.0)
    features = {image.name: find_features(image.path, MappingParams()) for image in images}
    points = {}
    for row, name in enumerate(place.header.names):
        own = slice(place.first[row], place.first[row + 1])
        places = {bytes(found): k for k, found in enumerate(features[name].descriptors)}
        points[name] = np.full(len(features[name].keypoints), -1, dtype=np.int64)
        rows = [places[bytes(found)] for found in place.descriptor[own]]
        points[name][rows] = place.point[own]
    checked = CheckedMap(place, images, features, points)
    everything, part = checked.points_without(slice(0, 0)), checked.points_without(slice(0, 5))
    assert np.isfinite(everything).all(axis=1).mean() > 0.95
    off_m = np.linalg.norm(everything - place.points_m, axis=1)
    assert np.nanmedian(off_m) < 0.002
    is_seen_twice = np.bincount(place.point[place.first[5] :], minlength=len(off_m)) >= 2
    is_placed = np.isfinite(part).all(axis=1)
    assert not is_placed[~is_seen_twice].any()
    assert is_placed[is_seen_twice].mean() > 0.8
    assert 0.0 < np.nanmedian(np.linalg.norm(part - place.points_m, axis=1)) < 0.01


def test_more_inliers_than_there_are(posed_room):
    strict = PointMapLocalizer(posed_room[1], LocalizationParams(min_inliers=100_000))
    assert localize_recording(strict, posed_room[0].recording("t")).predictions is None


def test_a_pose_that_vio_says_is_tilted_is_refused(posed_room, localizer, tmp_path):
    """The recording's tracking world is laid on its side."""
    copy = Scene.open(shutil.copytree(posed_room[0].folder, tmp_path / "copy"))
    path = copy.recording_folder("t") / "frames.csv"
    header, *lines = path.read_text().splitlines()
    names = header.split(",")
    for number, line in enumerate(lines):
        fields = dict(zip(names, line.split(","), strict=True))
        fields |= {"qx": "0", "qy": "0", "qz": "0", "qw": "1"}
        lines[number] = ",".join(fields.values())
    path.write_text("\n".join([header, *lines]) + "\n")
    found = localize_recording(localizer, copy.recording("t"))
    # Camera axes have y down: with no rotation, the tracker says that all pictures are overhead.
    assert (found.tilted, len(found.found)) == (len(lines), 0)


def test_intrinsics_that_are_not_known(posed_room, tmp_path):
    """The map's camera of the same size serves; without one, the frame is named."""
    copy = Scene.open(shutil.copytree(posed_room[0].folder, tmp_path / "copy"))
    path = copy.recording_folder("t") / "frames.csv"
    lines = path.read_text().splitlines()
    for number in range(1, len(lines)):
        lines[number] = ",".join([*lines[number].split(",")[:10], *[""] * 6])
    path.write_text("\n".join(lines) + "\n")
    place, recording = posed_room[1], copy.recording("t")
    assert cameras_of_frames(place, recording)[0] == place.header.cameras[0]
    assert place.header.cameras[0].params == (220.0, 220.0, 160.0, 120.0)
    image = recording.image_path(0)
    image.write_bytes(encode_image(image.name, np.zeros((100, 200), dtype=np.uint8)))
    with pytest.raises(
        FormatError, match=r"frames\.csv:2: expected a focal length.*200x100.*focal"
    ):
        cameras_of_frames(place, recording)


def test_cameras_are_shared_as_in_the_map(posed_room, tmp_path):
    """A lens that is stabilized moves the principal point; a map may have one camera for all."""
    copy = Scene.open(shutil.copytree(posed_room[0].folder, tmp_path / "copy"))
    path = copy.recording_folder("a") / "frames.csv"
    header, *lines = path.read_text().splitlines()
    for number, line in enumerate(lines):
        fields = line.split(",")
        fields[14] = str(150.0 + 10 * (number % 3))  # cx: 150, 160, 170, 150, 160
        lines[number] = ",".join(fields)
    path.write_text("\n".join([header, *lines]) + "\n")
    place, recording = posed_room[1], copy.recording("a")
    own = cameras_of_frames(place, recording)
    assert [camera.params[2] for camera in own.values()] == [150, 160, 170, 150, 160]
    shared = msgspec.structs.replace(place.header, shares_cameras=True)
    together = cameras_of_frames(dataclasses.replace(place, header=shared), recording)
    assert [camera.params[2] for camera in together.values()] == [160] * 5


def test_broken_pictures_cost_themselves_alone(posed_room, localizer, tmp_path):
    copy = Scene.open(shutil.copytree(posed_room[0].folder, tmp_path / "copy"))
    recording = copy.recording("t")
    recording.image_path(0).write_bytes(b"")
    ticks = []
    found = localize_recording(localizer, recording, lambda: ticks.append(1))
    assert len(found.found) == len(recording.frames) - 1
    assert len(ticks) == len(recording.frames)


def test_walks_are_written_kept_and_counted(posed_room, tmp_path):
    scene, place, truths = posed_room
    (first,) = localize_walks(place, scene, ["t"], tmp_path, "map")
    assert (first.images, first.localized, first.is_kept) == (2, 2, False)
    poses = read_trajectory(tmp_path / "t" / "apr_map.tum")
    np.testing.assert_allclose(poses.position_m, truths["t"].position_m, atol=0.01)
    table = np.loadtxt(tmp_path / "t" / "apr_map.sigma.csv", delimiter=",", skiprows=1)
    assert table.shape == (2, 3)
    (again,) = localize_walks(place, scene, ["t"], tmp_path, "map")
    assert again.is_kept
    # Where another map, which may replace them, finds nothing, no old predictions stay.
    none = LocalizationParams(min_inliers=100_000)
    (third,) = localize_walks(place, scene, ["t"], tmp_path, "map", params=none, overwrite=True)
    assert (third.localized, third.can_be_evaluated) == (0, False)
    assert not list((tmp_path / "t").glob("apr_map*"))


def test_a_scene_without_map_or_ground_truth(room):
    with pytest.raises(MappingError, match="make it with vioapr map"):
        open_point_map(room[0])


def test_bad_parameters():
    with pytest.raises(ParameterError, match="max_rate_hz: expected at least 0, got -1"):
        PointMapParams(max_rate_hz=-1.0)
    with pytest.raises(ParameterError, match="`map_images` names the images of a map"):
        PointMapParams(map_images=".")


def test_ground_truth_without_intrinsics(tmp_path, room):
    scene = Scene.open(shutil.copytree(room[0].folder, tmp_path / "copy"))
    scene.write_gt("a", room[1]["a"], "simulator")
    path = scene.recording_folder("a") / "frames.csv"
    lines = path.read_text().splitlines()
    lines[1] = ",".join([*lines[1].split(",")[:10], *[""] * 6])
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(FormatError, match=r"frames\.csv:2: expected a focal length"):
        open_point_map(scene)


@pytest.mark.slow
def test_a_scene_that_was_mapped(mapped_room, copy_of):
    """The map's own features and points serve; if they are gone, they are made by its poses."""
    mapped, _, _ = mapped_room
    scene = copy_of(mapped)
    truth = scene.gt("t")
    keys = []
    for is_whole in (True, False):
        if not is_whole:
            shutil.rmtree(scene.folder / ".mapping")
            (scene.folder / POINT_MAP_FILE).unlink()
        place = open_point_map(scene)
        keys.append(place.header.key)
        found = localize_recording(PointMapLocalizer(place), scene.recording("t"))
        assert len(found.found) == 4
        off_m, off_deg = errors_of(found, truth)
        assert off_m.max() < 0.03
        assert off_deg.max() < 0.5
    assert keys[0] == keys[1]


@pytest.mark.slow
def test_a_colmap_model_by_its_folder(mapped_room, copy_of, tmp_path):
    scene = copy_of(mapped_room[0])
    model = shutil.copytree(scene.map_folder, tmp_path / "model" / "sparse")
    shutil.rmtree(scene.map_folder)
    place = open_point_map(scene, PointMapParams(map=model))
    assert not place.header.is_gravity_aligned
    found = localize_recording(PointMapLocalizer(place), scene.recording("t"))
    assert errors_of(found, scene.gt("t"))[0].max() < 0.03
    images = scene.folder / "recordings"
    images.rename(tmp_path / "elsewhere")
    with pytest.raises(MappingError, match="name their folder with `map_images`"):
        open_point_map(scene, PointMapParams(map=model))
    params = PointMapParams(map=model, map_images=tmp_path / "elsewhere")
    assert open_point_map(scene, params).header.names == place.header.names
    with pytest.raises(FileMissingError, match="expected an image of the map"):
        open_point_map(scene, PointMapParams(map=model, map_images=tmp_path))
