"""From fused walks to errors, and to tables of them.

Its face: `accuracy` (a walk in one call), `cases` and `tables` (many walks and methods),
`metrics`, and `vio_tracks`, `vio_quality` and `vio_tables` for a tracker alone.
"""
