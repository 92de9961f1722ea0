"""Localization by the map's own points, in a graph without branches.

image ─► retrieval ─► ten views of the map ─┐
└────► XFeat ─► key points ───────────────┴─► matches ─► robust pose ─► again, from that pose
"""
