"""Scenes and recordings on disk: what a phone captured of a place, checked and summarized.

Its face: `scene`, `recording` and `frames` (reading), `writer`, `check`, `summary`, and `walks`
(the files of walks to fuse).
"""
