"""Running an exported localizer with onnxruntime alone.

Its face: `localizer` (frame by frame), `walk` (a recorded walk), `viewing` and `bench`.
"""
