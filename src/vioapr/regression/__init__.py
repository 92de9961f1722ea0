"""Absolute pose regressors: networks that guess a camera's pose from one image.

    scene ──► cache ──► batches (crop, jitter) ──► network ──► loss
                                                      └──► checkpoint ──► predict ──► apr_*.tum

- `networks/`: PoseNet, MS-Transformer and a small one for phones.
- `losses.py`, `augmentation.py`, `cache.py`, `data.py`: what they learn from.
- `training.py`: the loop; `checkpoint.py`: what it leaves behind.
- `prediction.py`: a trajectory file of a recording's poses, as every other stage reads it.
"""
