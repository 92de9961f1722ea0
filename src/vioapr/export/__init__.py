"""From a trained regressor and a fusion method to the ONNX files that phones run.

Its face: `exporter`; `quantize` gives it images to calibrate on.
"""
