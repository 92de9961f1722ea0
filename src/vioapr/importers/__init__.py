"""Importers: what other apps and data sets recorded, as recordings of a scene.

Each reads one layout of files, with the readers of `vioapr.formats`, into `Walk`s; what their
numbers say (`diagnostics`) and writing them (`write`) is the same for all.
"""
