"""All margins of one cable and one cycle in one compiled call, with the time until each limit is reached.

An array costs more to hand over than most of what is done here, so that all that is remembered from cycle to cycle is
one flat array, for m bodies with k = 7 + m:

    warn               distance [m]
    soft               unit of the eigenvalue [N]
    eigen    (3,)      see `margins.MEMORY`
    twists   (12,)     how fast the ends move; before, now (14,): their frames, see `kernels.safety.speed`
    swing    (35,)     see :mod:`cable_shape.kernels.swing`
    turn               the row of `history` that is this cycle's
    rows     (k, 5)    see :mod:`cable_shape.kernels.safety.loads_used`; the last one is that of the inertia
    told     (5, k)    transposed, and only what can be told: first loads and stability, then bodies, then inertia
    history  (2, k)    distance of a body, mu of stability, USED of all else, in this cycle and in the one before; NaN
                       where there is none
    moving   (m,)      1 if that body may move by itself, else 0
    pieces   (p, 12)   what the cable is made of and its limits, see `margins.measure_loads`
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import swing
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network import respond
from cable_shape.kernels.network.sliding import new_slides
from cable_shape.kernels.network.tables import LENGTH, N_KNOTS, N_RINGS
from cable_shape.kernels.rod_algebra import inlined
from cable_shape.kernels.safety.loads_used import (
    ARC_LENGTH,
    BODIES,
    COLUMNS,
    LIMIT,
    PIECE,
    STABILITY,
    TIME,
    USED,
    VALUE,
    measure_bodies,
    measure_loads,
    remember,
    tell_stability,
)
from cable_shape.kernels.safety.speed import follow

WARN, SOFT, EIGEN, TWISTS, BEFORE, NOW, SWING = 0, 1, 2, 5, 17, 31, 45
TURN = SWING + swing.SIZE
HEAD = TURN + 1
#: What is said of the cycle, to be added: grips hold both ends; the loads are known, which they are not on the line of
#: an overstretched cable; the factors are to be made anew; the shape is the last one; it is unstable; this is a new
#: cycle, not the last one once more; rows are the same bodies in every cycle; some of the knots are contacts.
HELD, LOADED, FRESH, AGAIN, UNSTABLE, NEW, LISTED, TOUCHED = 1, 2, 4, 8, 16, 32, 64, 128
#: [s], what is further away is not being approached.
LONGEST_TIME = 3600.0
#: Bodies nearer than this [m] have no direction to them.
TOUCHING = 1e-9


@inlined
def parts(memory: Array, bodies: int) -> tuple[Array, Array, Array, Array, Array]:
    """Rows, told, history, moving, pieces."""
    k = BODIES + bodies + 1
    a, b, c = HEAD + COLUMNS * k, HEAD + 2 * COLUMNS * k, HEAD + 2 * (COLUMNS + 1) * k
    return (
        memory[HEAD:a].reshape(k, COLUMNS),
        memory[a:b].reshape(COLUMNS, k),
        memory[b:c].reshape(2, k),
        memory[c : c + bodies],
        memory[c + bodies :].reshape(-1, PIECE),
    )


@kernel
def time_left(left: float, rate: float) -> float:
    """[s] until what is left is used up; infinite when it is not being used up, NaN when the rate is not known."""
    if rate * LONGEST_TIME > left:
        return left / rate
    return math.nan if math.isnan(rate) else math.inf


@kernel
def approach(
    ints: Array, floats: Array, sols: Array, space: Array, flags: int, twists: Array, bodies: Array, moving: Array,
    rows: Array,
) -> None:  # fmt: skip
    """Puts into the column TIME of each body how fast the cable nears it [m/s]; it stays NaN where not known."""
    at, length = np.empty(bodies.shape[0]), floats[LENGTH]
    count = 0
    for b in range(bodies.shape[0]):
        may_move = flags & LISTED != 0 and moving[b] != 0.0
        if TOUCHING < abs(bodies[b, 0]) < math.inf and 0.0 <= bodies[b, 1] <= length and not may_move:
            at[count] = bodies[b, 1]
            rows[BODIES + b, TIME] = 0.0
            count += 1
    if count == 0:
        return
    moves, v = np.zeros((ints[N_KNOTS], 6)), np.empty((count, 3))
    moves[0, :] = twists[:6]
    moves[-1, :] = twists[6:]
    respond.at_rest(ints, sols)
    respond.still(ints, space)
    respond.move_knots(ints, floats, sols, space, moves)
    respond.answer(ints, floats, sols, space, moves)
    respond.velocities(ints, floats, sols, space, at[:count], v)
    count = 0
    for b in range(bodies.shape[0]):
        if rows[BODIES + b, TIME] == 0.0:
            speed = 0.0
            for i in range(3):
                speed += (bodies[b, 5 + i] - bodies[b, 2 + i]) * v[count, i]
            rows[BODIES + b, TIME] = speed / bodies[b, 0]
            count += 1


@kernel
def tell(rows: Array, now: Array, before: Array, seconds: float, listed: bool, told: Array) -> int:
    """Turns speeds in the column TIME of bodies into times, takes all others from the cycle `before`, and fills `told`.

    before, now (k,): see `history`. seconds: between them, NaN if not known. Returns the sum of 2^row over the rows
    before those of bodies that can be told, and 2^BODIES if inertia can.
    """
    count = which = 0
    for row in range(rows.shape[0]):
        used, limit, value, time = rows[row, USED], rows[row, LIMIT], rows[row, VALUE], rows[row, TIME]
        inertia, stability = row == rows.shape[0] - 1, row == STABILITY
        body = row >= BODIES and not inertia
        now[row] = math.nan if math.isnan(used) else value if body or stability else used
        if math.isnan(used):
            continue
        rate = (now[row] - before[row]) / seconds if listed or not body else math.nan
        if used >= 1.0:
            time = 0.0
        elif body:
            time = time_left(value - limit, -rate if math.isnan(time) else time)
        elif inertia:
            time = math.nan
        elif stability:
            time = time_left(value, -2.0 * rate)
        else:
            time = time_left(1.0 - used, rate)
        told[USED, count], told[LIMIT, count], told[VALUE, count] = used, limit, value
        told[ARC_LENGTH, count], told[TIME, count] = rows[row, ARC_LENGTH], time
        count += 1
        if not body:
            which += 1 << (BODIES if inertia else row)
    return which


@kernel
def begin(memory: Array, bodies: int, flags: int, seconds: float) -> int:
    """Takes over where the ends are in a new cycle, and returns its row of `history`, in which nothing is known yet."""
    if flags & NEW:
        follow(memory[BEFORE:NOW], memory[NOW:SWING], flags & HELD != 0, seconds, memory[TWISTS:BEFORE])
        memory[TURN] = 1.0 - memory[TURN]
    history = parts(memory, bodies)[2]
    turn = int(memory[TURN])
    history[turn, :] = math.nan
    return turn


@kernel
def tell_inertia(
    state: Array, twists: Array, flags: int, seconds: float, buffer: Array, points: int, row: Array
) -> None:  # fmt: skip
    """Fills the row of the inertia, if a limit of it is asked for and the motion of the ends is known for long enough.

    A stamp again repeats the answer; a jump of the grips, or a gap, makes all motion before forgotten.
    """
    if math.isnan(state[swing.LIMIT]):
        return
    if flags & NEW:
        if math.isnan(twists[0]):
            state[: swing.MEMORY] = 0.0
            state[swing.RATIO] = state[swing.PERIOD] = math.nan
        else:
            state[swing.RATIO], state[swing.WHERE], state[swing.PERIOD] = swing.follow(
                state[: swing.MEMORY], twists, seconds, buffer, points, flags & HELD != 0,
                state[swing.GRAVITY : swing.LEVER], state[swing.LEVER], state[swing.RATE],
            )  # fmt: skip
    if not math.isnan(state[swing.RATIO]):
        row[USED], row[LIMIT] = state[swing.RATIO] / state[swing.LIMIT], state[swing.LIMIT]
        row[VALUE], row[ARC_LENGTH] = state[swing.RATIO], state[swing.WHERE] * buffer[points - 1]


@kernel
def measure(
    memory: Array, buffer: Array, points: int, bodies: Array, ints: Array, floats: Array, sols: Array, space: Array,
    mode: Array, steps: int, flags: int, seconds: float,
) -> int:  # fmt: skip
    """Fills `told` for a shape's buffer, and returns what it tells, see `tell`; bodies (m, 8) as in `measure_bodies`.

    ints, floats, sols, space: of a network of rods, see `network.tables`; ints empty: the model knows no stability.
    mode, steps: see `respond.softest_mode`. seconds: since the last cycle, NaN where it is none to compare with.
    """
    turn = begin(memory, bodies.shape[0], flags, seconds)
    rows, told, history, moving, pieces = parts(memory, bodies.shape[0])
    twists, eigen = memory[TWISTS:BEFORE], memory[EIGEN:TWISTS]
    measure_loads(buffer, points, pieces, flags & HELD != 0, flags & LOADED != 0, rows)
    rows[STABILITY, :] = rows[-1, :] = math.nan
    if flags & LOADED:
        tell_inertia(memory[SWING:TURN], twists, flags, seconds, buffer, points, rows[-1])
    measure_bodies(bodies, memory[WARN], rows)
    if ints.shape[0] > 0:
        if not flags & AGAIN:
            found = np.empty(2)
            run = new_slides(ints, True)
            respond.softest_mode(ints, floats, sols, space, run, mode, steps, flags & FRESH != 0, found)
            remember((found[0], found[1]), memory[SOFT], eigen)
        tell_stability(flags & UNSTABLE != 0, eigen, rows)
        alone = ints[N_RINGS] == 0 and flags & TOUCHED == 0
        if bodies.shape[0] > 0 and alone and not math.isnan(twists[0]):
            approach(ints, floats, sols, space, flags, twists, bodies, moving, rows)
    return tell(rows, history[turn], history[1 - turn], seconds, flags & LISTED != 0, told)
