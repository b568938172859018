"""A curve between two nodes through values, first and second derivatives: what is given out follows it.

It is the quintic. In an element longer than the boundary layer l = sqrt(EI/|n|) exp(-s/l) and exp(-(h-s)/l), which
solve the equations of a taut rod, take the place of the two highest powers: what is left of the layer at a node then
ends within the layer, where the quintic would swing far out.
"""

from __future__ import annotations

import math

from cable_shape.kernels.rod_algebra import Vector, inlined
from cable_shape.kernels.rod_between import Node

#: (element / boundary layer)^2 from which it is long
STIFF = 4.0
#: see `layers`
Layer = tuple[float, float, float, float]
#: coefficients
Curve = tuple[float, float, float, float, float, float]


@inlined
def layers(rate: float) -> Layer:
    """Of an element `rate` boundary layers long: rate, exp(-rate), and two numbers that its curves share.

    Zero for a short one, whose interpolation is by powers alone.
    """
    if rate * rate < STIFF:
        return 0.0, 0.0, 0.0, 0.0
    e = math.exp(-rate)
    p = rate * rate - 4.0 * rate + 6.0 - e * (2.0 * rate + 6.0)
    q = 2.0 * rate - 6.0 + e * (rate * rate + 4.0 * rate + 6.0)
    f = 1.0 / (p * p - q * q)
    return rate, e, f * p, f * q


@inlined
def curve(h: float, a: float, da: float, dda: float, b: float, db: float, ddb: float, layer: Layer) -> Curve:
    """Coefficients in x = 0 .. 1 of the curve with these values and derivatives in s at both ends.

    Of the powers of x, the last two of exp(-rate x) and exp(-rate (1 - x)) if the element is long.
    """
    c1, c2 = h * da, 0.5 * h * h * dda
    r, d = h * db, b - a
    t = 0.5 * h * h * ddb
    if layer[0] == 0.0:
        p, r, t = d - c1 - c2, r - c1 - 2.0 * c2, t - c2
        return a, c1, c2, 10.0 * p - 4.0 * r + t, -15.0 * p + 7.0 * r - 2.0 * t, 6.0 * p - 3.0 * r + t
    rate, e = layer[0], layer[1]
    # what the second derivatives have beyond those of the cubic through values and slopes
    u, v = 2.0 * c2 - (6.0 * d - 4.0 * c1 - 2.0 * r), 2.0 * t + 6.0 * d - 2.0 * c1 - 4.0 * r
    f, g = layer[2] * u - layer[3] * v, layer[2] * v - layer[3] * u
    a, c1, r, d = a - f - e * g, c1 + rate * (f - e * g), r + rate * (e * f - g), d + (1.0 - e) * (f - g)
    return a, c1, 3.0 * d - 2.0 * c1 - r, c1 + r - 2.0 * d, f, g


@inlined
def functions(x: float, layer: Layer) -> tuple[float, float]:
    """The two last functions of a `curve` at x."""
    if layer[0] == 0.0:
        return x * x * x * x, x * x * x * x * x
    return math.exp(-layer[0] * x), math.exp(-layer[0] * (1.0 - x))


@inlined
def middle_functions(layer: Layer) -> tuple[float, float]:
    """The same at x = 1/2."""
    if layer[0] == 0.0:
        return 0.0625, 0.03125
    middle = math.sqrt(layer[1])
    return middle, middle


@inlined
def at(c: Curve, x: float, first: float, last: float) -> float:
    """A curve's value; `first` and `last` are its two last functions there."""
    return c[0] + x * (c[1] + x * (c[2] + x * c[3])) + c[4] * first + c[5] * last


@inlined
def middle_slope(c: Curve, layer: Layer) -> float:
    """A curve's derivative at x = 1/2."""
    slope = c[1] + c[2] + 0.75 * c[3]
    if layer[0] == 0.0:
        return slope + 0.5 * c[4] + 0.3125 * c[5]
    return slope + layer[0] * math.sqrt(layer[1]) * (c[5] - c[4])


@inlined
def curves(
    h: float, a: Vector, da: Vector, dda: Vector, b: Vector, db: Vector, ddb: Vector, layer: Layer
) -> tuple[Curve, Curve, Curve]:
    """`curve` of a vector."""
    return (
        curve(h, a[0], da[0], dda[0], b[0], db[0], ddb[0], layer),
        curve(h, a[1], da[1], dda[1], b[1], db[1], ddb[1], layer),
        curve(h, a[2], da[2], dda[2], b[2], db[2], ddb[2], layer),
    )


@inlined
def spins(h: float, a: Node, b: Node, layer: Layer) -> tuple[Curve, Curve, Curve, Curve]:
    """`curve` of the rotation."""
    p, dp, ddp = a[0], a[2], a[3]
    q, dq, ddq = b[0], b[2], b[3]
    return (
        curve(h, p[0], dp[0], ddp[0], q[0], dq[0], ddq[0], layer),
        curve(h, p[1], dp[1], ddp[1], q[1], dq[1], ddq[1], layer),
        curve(h, p[2], dp[2], ddp[2], q[2], dq[2], ddq[2], layer),
        curve(h, p[3], dp[3], ddp[3], q[3], dq[3], ddq[3], layer),
    )


@inlined
def at3(c: tuple[Curve, Curve, Curve], x: float, first: float, last: float) -> Vector:
    """Three curves' values."""
    return at(c[0], x, first, last), at(c[1], x, first, last), at(c[2], x, first, last)


@inlined
def slope3(c: tuple[Curve, Curve, Curve], layer: Layer) -> Vector:
    """Three curves' derivatives at x = 1/2."""
    return middle_slope(c[0], layer), middle_slope(c[1], layer), middle_slope(c[2], layer)
