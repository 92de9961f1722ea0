"""The whole localizer as one ONNX file: export, its contract, and the runtime that runs it."""
