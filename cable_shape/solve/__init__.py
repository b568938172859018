"""From a problem to a shape: one solver for networks of rods."""
