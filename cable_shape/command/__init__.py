"""The command `cable-shape`: start at :mod:`cable_shape.command.cli`."""
