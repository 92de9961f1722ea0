"""Which recordings of a large scene its pictures show."""

import numpy as np

from vioapr.report.scene_preview import route_map
from vioapr.scene.scene import Scene
from vioapr.schemas.scene import World
from vioapr.trajectory import Trajectory


def test_a_few_recordings_of_every_split_stand_for_all(tmp_path):
    scene = Scene.create(tmp_path / "yard", "yard", is_outdoor=True, world=World())
    ids = {"train": [f"train-{k:02}" for k in range(20)], "test": ["test-1", "test-2"]}
    for split, names in ids.items():
        for id_ in names:
            scene.recording_folder(id_).mkdir(parents=True)
            scene.write_gt(id_, Trajectory(np.arange(2.0), np.eye(3)[:2], np.eye(4)[[3, 3]]))
            scene = scene.with_recording(id_, split)
    legend = route_map(scene).legends[0]
    shown = [text.get_text() for text in legend.get_texts()]
    assert shown[0] == "train-00"
    assert shown[7:] == ["train-19", "test-1", "test-2"]
    assert legend.get_title().get_text().startswith("10 of 22 recordings")
