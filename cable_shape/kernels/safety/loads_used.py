"""What the margins of one shape are.

Rows: STRETCH, TENSION, BEND, TWIST, STRESS, STABILITY, then one for each body; columns USED, LIMIT, VALUE, ARC_LENGTH,
TIME. What cannot be told has USED = NaN; TIME is filled by :mod:`cable_shape.kernels.safety.margin_watch`.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.safety.loads import chord_of, most_loaded

STRETCH, TENSION, BEND, TWIST, STRESS, STABILITY, BODIES = 0, 1, 2, 3, 4, 5, 6
USED, LIMIT, VALUE, ARC_LENGTH, TIME, COLUMNS = 0, 1, 2, 3, 4, 5
#: Numbers of a piece of a cable: arc lengths from and to, section as in `kernels.safety.stress`, limits.
P_FROM, P_TO, P_SECTION, P_LIMITS, PIECE = 0, 1, 2, 7, 12
#: Numbers that the stability of the next shape depends on: the eigenvalue in units of `soft` (NaN: none yet), its arc
#: length, and whether the mode has been neutral from the beginning (1) or not (0).
MEMORY = 3
#: Modes that are softer than this from the beginning, in the units of mu, are neutral (a cable that may swing freely)
#: and not on the way to a snap.
NEUTRAL = 1e-4


@kernel
def measure_loads(buffer: Array, points: int, pieces: Array, held: bool, slack: bool, rows: Array) -> None:
    """Fills the rows from STRETCH to STRESS, each from the piece of the cable that uses most of its limit.

    pieces (p, PIECE): arc lengths from and to [m], section, and limits in the order of the rows, NaN for none; the
    whole cable's stretch is judged by the first. held: grips hold both ends. slack: the loads are known; they are not
    on the line of an overstretched cable.
    """
    step = buffer[points - 1] / (points - 1)
    for row in range(STABILITY):
        rows[row, USED], rows[row, LIMIT], rows[row, TIME] = math.nan, pieces[0, P_LIMITS + row], math.nan
    if held:
        chord = chord_of(buffer, points)
        rows[STRETCH, USED], rows[STRETCH, VALUE] = chord / pieces[0, P_LIMITS + STRETCH], chord
        rows[STRETCH, ARC_LENGTH] = buffer[points - 1]
    if not slack:
        return
    for p in range(pieces.shape[0]):
        begin = max(0, math.ceil(pieces[p, P_FROM] / step - 1e-9))
        end = points if p == pieces.shape[0] - 1 else min(points, math.floor(pieces[p, P_TO] / step + 1e-9) + 1)
        if end <= begin:
            continue
        limits = pieces[p, P_LIMITS:]
        i, tension, j, bending, k, twist, m, stress = most_loaded(buffer, points, begin, end, pieces[p, P_SECTION:])
        used = 0.0 if tension < 0.0 and not math.isnan(limits[TENSION]) else tension / limits[TENSION]
        take(rows, TENSION, used, limits[TENSION], tension, i * step)
        take(rows, BEND, bending * limits[BEND], limits[BEND], 1.0 / bending, j * step)
        take(rows, TWIST, twist / limits[TWIST], limits[TWIST], twist, k * step)
        take(rows, STRESS, stress / limits[STRESS], limits[STRESS], stress, m * step)


@kernel
def take(rows: Array, row: int, used: float, limit: float, value: float, at: float) -> None:
    """Makes this the row if nothing is there yet, or less is used."""
    if math.isnan(rows[row, USED]) or used > rows[row, USED]:
        rows[row, USED], rows[row, LIMIT], rows[row, VALUE], rows[row, ARC_LENGTH] = used, limit, value, at


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
def remember(found: tuple[float, float], soft: float, memory: Array) -> None:
    """Takes over an eigenvalue [N], in units of `soft`, and its arc length."""
    mu = found[0] / soft
    first = math.isnan(memory[0])
    memory[2] = 1.0 if abs(mu) < NEUTRAL and (first or memory[2] == 1.0) else 0.0
    memory[0], memory[1] = mu, found[1]


@kernel
def tell_stability(unstable: bool, memory: Array, rows: Array) -> None:
    """Fills the row STABILITY from what is remembered; unstable: the shape is known to be."""
    mu = -abs(memory[0]) if unstable else memory[0]
    rows[STABILITY, VALUE], rows[STABILITY, LIMIT], rows[STABILITY, ARC_LENGTH] = mu, 0.0, memory[1]
    if memory[2] == 0.0:
        rows[STABILITY, USED] = 1.0 / (1.0 + mu) if mu >= 0.0 else 1.0 - mu
