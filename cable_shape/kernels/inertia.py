"""What a moving cable adds to its load: the force -density a(s), with a(s) linear between the rows of a table."""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel

Array = Any


@kernel
def add_inertia(s: Array, table: Array, density: float, load: Array) -> None:
    """Adds the inertial load beyond s to `load` (N, 9), see `rod_mesh.element_loads`.

    s (N + 1,) [m]: nodes, among them every place where the table has a kink, so that the internal force stays a
    parabola in each element; table (m, 3) [m/s^2]: acceleration, uniform in arc length; density [kg/m].
    """
    elements, rows = load.shape[0], table.shape[0]
    cell = s[elements] / (rows - 1)
    beyond = np.zeros((rows, 3))  # integral of a from each row to the end
    for j in range(rows - 2, -1, -1):
        for i in range(3):
            beyond[j, i] = beyond[j + 1, i] + 0.5 * cell * (table[j, i] + table[j + 1, i])
    for e in range(elements):
        for k in range(3):
            x = s[e] + 0.5 * k * (s[e + 1] - s[e])
            j = min(int(x / cell), rows - 2)
            t = x / cell - j
            for i in range(3):
                at_x = table[j, i] + t * (table[j + 1, i] - table[j, i])
                rest = beyond[j + 1, i] + 0.5 * (1.0 - t) * cell * (at_x + table[j + 1, i])
                load[e, 3 * k + i] -= density * rest
