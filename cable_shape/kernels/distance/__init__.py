"""Distances of cables, bodies and meshes, compiled."""
