"""How far a moving cable is from the equilibrium that is predicted: load of its inertia, and how fast it swings."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel

#: Words of the memory: filtered twists of both ends (12), their derivatives (12), the largest ratio that still lasts,
#: and how long the motion has been seen [s].
MEMORY, LASTING, SEEN = 26, 24, 25
#: What else one cable's motion is judged by: gravity (3,) [m/s^2], lever [m] and bending rate [1/s^2] as in `follow`,
#: the limit of the ratio (NaN: not judged); and what was found last: the ratio (NaN: not known), at which end, the
#: period.
GRAVITY, LEVER, RATE, LIMIT, RATIO, WHERE, PERIOD, SIZE = 26, 29, 30, 31, 32, 33, 34, 35
#: [s], time constant of both filters; nothing is told before twice that.
SMOOTH = 0.05
#: No gripper gives a cable so many times its weight; the input has jumped.
JUMP = 10.0
#: Where both ends' loads are that near to each other, the start's is told.
_EVEN = 1e-6
#: Below this fraction of its greatest distance from the start the ends of a cable are at one place.
_CLOSED = 1e-3


@kernel
def swing_rate(buffer: Array, points: int, held: bool, gravity: Array) -> float:
    """[1/s^2], square of the angular frequency of the shape as a rigid pendulum about the line through its ends.

    Of a cable with a free end about the horizontal through its start across it. 0 for one that stands above that line.
    """
    gx, gy, gz = gravity[0], gravity[1], gravity[2]
    first, last = points, points + 3 * (points - 1)
    x0, y0, z0 = buffer[first], buffer[first + 1], buffer[first + 2]
    ex, ey, ez = buffer[last] - x0, buffer[last + 1] - y0, buffer[last + 2] - z0
    chord, length = math.sqrt(ex * ex + ey * ey + ez * ez), buffer[points - 1]
    if held and chord > _CLOSED * length:
        ex, ey, ez = ex / chord, ey / chord, ez / chord
        along = gx * ex + gy * ey + gz * ez
        gx, gy, gz = gx - along * ex, gy - along * ey, gz - along * ez
    else:
        ex, ey, ez = 0.0, 0.0, 0.0
    torque = inertia = 0.0
    for i in range(points):
        j = points + 3 * i
        x, y, z = buffer[j] - x0, buffer[j + 1] - y0, buffer[j + 2] - z0
        along = x * ex + y * ey + z * ez
        x, y, z = x - along * ex, y - along * ey, z - along * ez
        weight = 0.5 if i == 0 or i == points - 1 else 1.0
        torque += weight * (x * gx + y * gy + z * gz)
        inertia += weight * (x * x + y * y + z * z)
    return torque / inertia if torque > 0.0 and inertia > 0.0 else 0.0


@kernel
def load_ratio(
    memory: Array, twists: Array, seconds: float, lever: float, length: float, gravity: float
) -> tuple[float, int]:
    """Load of the cable's inertia to its weight now, and at which end (0, 1) it is greater; filters the `memory`.

    At an end the load is |a| + lever (|alpha| + omega^2), everywhere that of the ends' approach, |v1 - v0|^2 / length.
    twists (12,): of the two ends, mean of the last `seconds`. lever [m]: so far a clamp swings the cable along.
    """
    memory[SEEN] += seconds
    share = -math.expm1(-seconds / SMOOTH)
    first = max(share, seconds / memory[SEEN])  # of the velocities: in the beginning their mean
    settled = memory[SEEN] > 2.0 * SMOOTH
    for i in range(12):
        change = first * (twists[i] - memory[i])
        memory[i] += change
        if settled:
            memory[12 + i] += share * (change / seconds - memory[12 + i])
    most, where = 0.0, 0
    apart = 0.0
    for end in range(2):
        v, a = 6 * end, 12 + 6 * end
        straight = math.sqrt(memory[a] ** 2 + memory[a + 1] ** 2 + memory[a + 2] ** 2)
        turning = math.sqrt(memory[a + 3] ** 2 + memory[a + 4] ** 2 + memory[a + 5] ** 2)
        spinning = memory[v + 3] ** 2 + memory[v + 4] ** 2 + memory[v + 5] ** 2
        load = straight + lever * (turning + spinning)
        if load > (1.0 + _EVEN) * most:
            most, where = load, end
    for i in range(3):
        apart += (memory[6 + i] - memory[i]) ** 2
    return (most + apart / length) / gravity, where


@kernel
def follow(
    memory: Array, twists: Array, seconds: float, buffer: Array, points: int, held: bool, gravity: Array, lever: float,
    bending_rate: float,
) -> tuple[float, int, float]:  # fmt: skip
    """The ratio that still lasts, at which end it is made now, and the period [s] with which the cable swings.

    bending_rate [1/s^2]: square of the angular frequency of its own stiffness alone. A ratio dies away by a factor of e
    in a period. NaN in the beginning, and after a jump, which empties the memory.
    """
    size = math.sqrt(gravity[0] ** 2 + gravity[1] ** 2 + gravity[2] ** 2)
    ratio, where = load_ratio(memory, twists, seconds, lever, buffer[points - 1], size)
    if not ratio < JUMP:
        memory[:] = 0.0
        return math.nan, 0, math.nan
    if memory[SEEN] <= 2.0 * SMOOTH:
        return math.nan, 0, math.nan
    rate = swing_rate(buffer, points, held, gravity) + bending_rate
    period = 2.0 * math.pi / math.sqrt(rate) if rate > 0.0 else math.inf
    memory[LASTING] = max(ratio, memory[LASTING] * math.exp(-seconds / period))
    return memory[LASTING], where, period
