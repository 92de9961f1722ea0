"""Scenes and recordings on disk: what a phone captured of a place, checked and summarized.

Its face: `scene`, `recording` and `frames` (reading), `writer`, `check`, `summary`, `walks`
(the files of walks to fuse), and `predictions` (writing what a model predicts into walks).
"""
