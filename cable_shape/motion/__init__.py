"""Cables as they swing: :class:`cable_shape.Motion`."""
