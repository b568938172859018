"""Cycle reports to rerun, in a process of its own: start at :mod:`cable_shape.viewer.process`."""
