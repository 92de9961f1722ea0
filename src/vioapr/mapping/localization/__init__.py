"""Poses of pictures in a map by its own points: SIFT, retrieval, matches, PnP with RANSAC.

    map/ or known poses ──► point map (one file) ──► localizer ──► apr_map.tum

To predict: `open_point_map` of `scene_map.py`, then `localize_walks` of `prediction.py`.

- `params.py`: what a user can choose.
- `cameras.py`: cameras of images, as COLMAP models them.
- `posed_images.py`: images of known poses, of recordings or of a COLMAP model.
- `triangulation.py`: points from images of known poses.
- `point_map.py`: what a localizer needs of a map, as one file.
- `sources.py`: what a scene's point map is made from.
- `scene_map.py`: a scene's point map, made if it is not there.
- `localizer.py`: the pose of one image.
- `uncertainty.py`: how exact it is, stated.
- `checking.py`: what the map adds to that, by its own images, each left out.
- `prediction.py`: recordings, and files as `evaluate` takes them.
"""
