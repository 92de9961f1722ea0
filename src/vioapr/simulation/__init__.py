"""Walks that nobody took: simulated trackers and regressors, and a rendered courtyard."""
