"""All margins of one cable in one compiled call.

Rows of the result: STRETCH, TENSION, BEND, TWIST, STRESS, STABILITY, then one for each body; columns USED, LIMIT,
VALUE, ARC_LENGTH, TIME. What cannot be told has USED = NaN.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.loads import most_loaded
from cable_shape.kernels.response import smallest_eigenvalue, velocities

Array = Any
STRETCH, TENSION, BEND, TWIST, STRESS, STABILITY, BODIES = 0, 1, 2, 3, 4, 5, 6
USED, LIMIT, VALUE, ARC_LENGTH, TIME, COLUMNS = 0, 1, 2, 3, 4, 5
#: Numbers that the stability of the next shape depends on: the eigenvalue in units of `soft` (NaN: none yet), its arc
#: length, and whether the mode has been neutral from the beginning (1) or not (0).
MEMORY = 3
#: Modes that are softer than this from the beginning, in the units of mu, are neutral (a cable that may swing freely)
#: and not on the way to a snap.
NEUTRAL = 1e-4
#: [s], what is further away is not being approached.
LONGEST_TIME = 3600.0
#: Bodies nearer than this [m] have no direction to them.
TOUCHING = 1e-9


@kernel
def time_left(left: float, rate: float) -> float:
    """[s] until what is left is used up; infinite when it is not being used up, NaN when the rate is not known."""
    if rate * LONGEST_TIME > left:
        return left / rate
    return math.nan if math.isnan(rate) else math.inf


@kernel
def measure_loads(
    buffer: Array, points: int, section: Array, limits: Array, held: bool, slack: bool, rows: Array
) -> None:
    """Fills the rows from STRETCH to STRESS; `limits` (5,) in that order, NaN for none.

    held: grips hold both ends. slack: the loads are known; they are not on the line of an overstretched cable.
    """
    chord, i, tension, j, bending, k, twist, m, stress = most_loaded(buffer, points, section)
    for row in range(STABILITY):
        rows[row, USED], rows[row, LIMIT], rows[row, TIME] = math.nan, limits[row], math.nan
    step = buffer[points - 1] / (points - 1)
    if held:
        rows[STRETCH, USED], rows[STRETCH, VALUE] = chord / limits[STRETCH], chord
        rows[STRETCH, ARC_LENGTH] = buffer[points - 1]
    if slack:
        rows[TENSION, USED], rows[TENSION, VALUE] = tension / limits[TENSION], tension
        rows[BEND, USED], rows[BEND, VALUE] = bending * limits[BEND], 1.0 / bending
        rows[TWIST, USED], rows[TWIST, VALUE] = twist / limits[TWIST], twist
        rows[STRESS, USED], rows[STRESS, VALUE] = stress / limits[STRESS], stress
        rows[TENSION, ARC_LENGTH], rows[BEND, ARC_LENGTH] = i * step, j * step
        rows[TWIST, ARC_LENGTH], rows[STRESS, ARC_LENGTH] = k * step, m * step
        if tension < 0.0 and not math.isnan(limits[TENSION]):
            rows[TENSION, USED] = 0.0


@kernel
def measure_bodies(bodies: Array, limit: float, rows: Array) -> None:
    """Fills a row for each body; bodies (m, 8): distance (infinite: out of reach), arc length, two witness points."""
    for b in range(bodies.shape[0]):
        row, d = BODIES + b, bodies[b, 0]
        rows[row, LIMIT], rows[row, VALUE], rows[row, ARC_LENGTH] = limit, d, bodies[b, 1]
        rows[row, TIME] = math.nan
        if d == math.inf:
            rows[row, USED] = math.nan
        elif limit > 0.0:
            rows[row, USED] = 2.0 - d / limit
        else:
            rows[row, USED] = math.inf if d < 0.0 else 0.0


@kernel
def measure_stability(
    par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int, mode: Array, steps: int, fresh: bool,
    soft: float, again: bool, unstable: bool, memory: Array, rows: Array,
) -> None:  # fmt: skip
    """Fills the row STABILITY. soft [N]: unit of the eigenvalue. again: the shape is the last one, so is the answer."""
    if not again:
        value, at = smallest_eigenvalue(par, mesh, sol, work, elements, width, mode, steps, fresh)
        mu = value / soft
        first = math.isnan(memory[0])
        memory[2] = 1.0 if abs(mu) < NEUTRAL and (first or memory[2] == 1.0) else 0.0
        memory[0], memory[1] = mu, at
    mu = -abs(memory[0]) if unstable else memory[0]
    rows[STABILITY, VALUE], rows[STABILITY, LIMIT], rows[STABILITY, ARC_LENGTH] = mu, 0.0, memory[1]
    if memory[2] == 0.0:
        rows[STABILITY, USED] = 1.0 / (1.0 + mu) if mu >= 0.0 else 1.0 - mu


@kernel
def approach(
    par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int, twists: Array, bodies: Array,
    moving: Array, rows: Array,
) -> None:  # fmt: skip
    """Puts into the column TIME of each body how fast the cable nears it [m/s]; it stays NaN where that is not known.

    moving (m,): the body may move by itself.
    """
    at = np.empty(bodies.shape[0])
    known = np.zeros(bodies.shape[0], np.bool_)
    count = 0
    for b in range(bodies.shape[0]):
        if TOUCHING < abs(bodies[b, 0]) < math.inf and 0.0 <= bodies[b, 1] <= par[19] and not moving[b]:
            known[b] = True
            at[count] = bodies[b, 1]
            count += 1
    if count == 0:
        return
    v = velocities(par, mesh, sol, work, elements, width, twists, at[:count])
    count = 0
    for b in range(bodies.shape[0]):
        if known[b]:
            speed = 0.0
            for i in range(3):
                speed += (bodies[b, 5 + i] - bodies[b, 2 + i]) * v[count, i]
            rows[BODIES + b, TIME] = speed / bodies[b, 0]
            count += 1


@kernel
def measure_times(before: Array, seconds: float, rows: Array, now: Array) -> None:
    """Turns speeds in the column TIME of bodies into times, and takes all others from the cycle `before`.

    before, now (6 + m,): distance of a body, mu of stability, USED of all else; NaN for none. seconds: between them.
    """
    for row in range(rows.shape[0]):
        used, value = rows[row, USED], rows[row, VALUE]
        body, stability = row >= BODIES, row == STABILITY
        now[row] = math.nan if math.isnan(used) else value if body or stability else used
        rate = (now[row] - before[row]) / seconds
        if used >= 1.0:
            rows[row, TIME] = 0.0
        elif body:
            known = not math.isnan(rows[row, TIME])
            rows[row, TIME] = time_left(value - rows[row, LIMIT], rows[row, TIME] if known else -rate)
        elif stability:
            rows[row, TIME] = time_left(value, -2.0 * rate)
        else:
            rows[row, TIME] = time_left(1.0 - used, rate)


@kernel
def measure(
    buffer: Array, points: int, section: Array, limits: Array, held: bool, slack: bool, bodies: Array, moving: Array,
    par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int, mode: Array, steps: int, fresh: bool,
    soft: float, again: bool, unstable: bool, memory: Array,
    twists: Array, before: Array, seconds: float, now: Array,
) -> Array:  # fmt: skip
    """(6 + m, 5), see the module; limits (6,): those of the loads, then the warning distance.

    elements 0: the model knows no stability. twists (12,), or empty where the speed of the grips is not known.
    """
    rows = np.empty((BODIES + bodies.shape[0], COLUMNS))
    measure_loads(buffer, points, section, limits, held, slack, rows)
    rows[STABILITY, :] = math.nan
    measure_bodies(bodies, limits[5], rows)
    if elements > 0:
        measure_stability(
            par, mesh, sol, work, elements, width, mode, steps, fresh, soft, again, unstable, memory, rows
        )
        if twists.shape[0] == 12:
            approach(par, mesh, sol, work, elements, width, twists, bodies, moving, rows)
    measure_times(before, seconds, rows, now)
    return rows
