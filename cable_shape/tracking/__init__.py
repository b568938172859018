"""Cables as a camera sees them: :class:`cable_shape.Tracker`."""
