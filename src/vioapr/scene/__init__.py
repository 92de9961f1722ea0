"""Scenes and recordings on disk: what a phone captured of a place, checked and summarized."""
