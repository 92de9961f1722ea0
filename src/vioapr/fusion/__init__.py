"""Fusion of absolute pose predictions with odometry: methods, streaming and offline.

Its face: `fuse` (a walk in one call), `localizer` (frame by frame), `methods` (all of them),
`offline` and `smoothing` (many walks), `fused_walk` (results and their file), `types`.
"""
