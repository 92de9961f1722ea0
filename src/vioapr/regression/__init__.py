"""Absolute pose regressors: networks that predict a camera's pose from one image.

    scene ──► cache ──► batches (crop, jitter) ──► network ──► loss
                                                      └──► checkpoint ──► predict ──► apr_*.tum

To train: `choose_frames` and `prepare_run` of `run.py`, then `train` of `training.py`. To
predict: `load_predictor` and `predict_walks` of `prediction.py`. Configurations are
`RegressorSpec` (`vioapr.schemas.regressor`) and `TrainingParams` (`params.py`); both, and
`params.py`, are there without PyTorch.

- `networks/`: PoseNet, MS-Transformer and a small one for phones.
- `cache.py`, `data.py`, `augmentation.py`, `batches.py`: images to learn from.
- `losses.py`: the losses.
- `run.py`, `training.py`, `distributed.py`: a run, and its loop on one or more devices.
- `watch.py`: what a training tells those who watch it, without PyTorch.
- `state.py`, `checkpoint.py`: the files of a run, to resume from and to predict with.
- `prediction.py`: poses of images and recordings, and how good they are.
"""
