"""Content at map coordinates, drawn into a walk's pictures by several estimates of the pose."""
