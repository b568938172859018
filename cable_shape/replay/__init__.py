"""A bag in; a bag, a recording, a table and a report out: start at :mod:`cable_shape.replay.run`."""
