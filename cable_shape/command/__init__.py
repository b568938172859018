"""The command `cable-shape`: start at :mod:`cable_shape.command.cli`."""

#: `doctor` or `status` found something; wrong input or a result that must not be used; not all of a recording was read.
EXIT_UNWELL, EXIT_ERROR, EXIT_PARTIAL, EXIT_INTERRUPTED = 1, 2, 3, 130
