"""One prediction as a file: start at :mod:`cable_shape.cases.case`."""
