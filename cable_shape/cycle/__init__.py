"""Every control cycle: poses in, a report out; start at :mod:`cable_shape.cycle.cycle`."""
