"""Running an exported localizer with onnxruntime alone."""
