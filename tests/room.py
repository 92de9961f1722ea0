"""How the simulated room is mapped in tests."""

from vioapr.mapping.params import MappingParams

QUICK = MappingParams(max_features=400, sequential=4, spatial=2, loops=4, threads=2)
"""Enough for a room."""

SMALL = 5
"""Images of a training walk where a few are enough."""
