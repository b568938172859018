"""Arc length of a gradient cable: panels graded to its boundary layers, Gauss quadrature, and its inverse.

A panel is a part of one piece (between concentrated loads), and knows its distances to both ends of that piece, so
that points in the thinnest boundary layer keep their digits. On each panel the speed |x'| is the polynomial through
its values at 10 Gauss points.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.gradient_basis import (
    HIGH4,
    LOW4,
    MU,
    MU2,
    PAIR6,
    REAL6,
    ROW,
    SERIES6,
    SPLIT6,
    C,
    differentiate,
)

NODES = 10
AHEAD = 8
MAX_PANELS = 1024

#: Widest panel, as a fraction of the cable.
WIDEST = 0.15
#: First panel of a boundary layer and its neighbours: multiples of the decay length, and their ratio.
FIRST, GROWTH = 2.5, 2.6
#: Decay lengths after which a boundary layer has passed.
PASSED = 30.0
#: Last step of Newton's method, in t: the error that is left is about its square.
_QUADRATIC = 1e-5

_X, _W = np.polynomial.legendre.leggauss(NODES)
#: Gauss points on [-1, 1], and weights for a panel of width 1.
POINT = _X
WEIGHT = 0.5 * _W
#: Two highest Legendre coefficients of the polynomial through the values at the Gauss points.
TAIL = np.stack([(k + 0.5) * _W * np.polynomial.legendre.legval(_X, np.eye(NODES)[k]) for k in (NODES - 2, NODES - 1)])
_POWERS = np.linalg.inv(np.vander(_X, NODES, increasing=True)).T  # coefficients = values @ _POWERS, of t in [-1, 1]
_SIGNS = (-1.0) ** np.arange(NODES)
#: Of that polynomial's integral from t = -1: values @ INTEGRAL are the coefficients of t, t^2 ..., values @ BEFORE is
#: the constant; values @ AT_ENDS is the polynomial itself at t = -1 and 1.
INTEGRAL = np.ascontiguousarray(_POWERS / np.arange(1, NODES + 1))
BEFORE = INTEGRAL @ _SIGNS
AT_ENDS = np.ascontiguousarray(np.stack((_POWERS @ _SIGNS, _POWERS.sum(axis=1)), axis=1))


@kernel
def lay_out(mode, par, edges, panels):
    """Panels for this mode and these pieces.

    panels : (4, MAX_PANELS)
        Out: distance of its beginning from the start of the piece, of its end from the end of the piece, width, piece.

    Returns the number of panels; 0 if there is no room for them.
    """
    thin, thick = 1.0, 1.0
    if mode == HIGH4:
        thin = thick = 1.0 / par[MU]
    elif mode == PAIR6:
        thin = thick = 1.0 / par[MU]
    elif mode == REAL6:
        thin, thick = 1.0 / par[MU2], 1.0 / par[MU]
    elif mode == SPLIT6:
        thin, thick = 1.0 / par[MU2], 0.1
    count = 0
    for p in range(len(edges) - 1):
        length = edges[p + 1] - edges[p]
        graded = 0.0
        width = FIRST * thin
        layers = 0
        if mode != LOW4 and mode != SERIES6:
            while graded + width < 0.4 * length and graded < PASSED * thick and width < WIDEST:
                graded += width
                width *= GROWTH
                layers += 1
        middle = length - 2.0 * graded
        parts = max(1, math.ceil(middle / WIDEST))
        if count + 2 * layers + parts > MAX_PANELS:
            return 0
        begin, width = 0.0, FIRST * thin
        for k in range(layers):
            for side in range(2):
                i = count + k if side == 0 else count + 2 * layers + parts - 1 - k
                panels[0, i] = begin if side == 0 else length - begin - width
                panels[1, i] = length - begin - width if side == 0 else begin
                panels[2, i] = width
                panels[3, i] = p
            begin += width
            width *= GROWTH
        for k in range(parts):
            i = count + layers + k
            panels[0, i] = graded + middle * k / parts
            panels[1, i] = graded + middle * (parts - 1 - k) / parts
            panels[2, i] = middle / parts
            panels[3, i] = p
        count += 2 * layers + parts
    return count


@kernel(fastmath={"contract"})
def put(panels, i, edges, t, first, last, points):
    """Points of panel `i` at t in [-1, 1] into ``points[:, first:last]``: u, distances from the ends of the piece."""
    p = int(panels[3, i])
    half, before, behind = 0.5 * panels[2, i], panels[0, i], panels[1, i]
    near = before < behind
    origin = edges[p] - 0.5 + before if near else edges[p + 1] - 0.5 - behind
    for k in range(first, last):
        a, b = half * (1.0 + t[k]), half * (1.0 - t[k])
        points[0, k] = origin + a if near else origin - b
        points[1, k], points[2, k] = before + a, behind + b


@kernel
def put_nodes(panels, count, edges, nodes):
    """Gauss points of all panels into `nodes` (3, NODES count): u and distances from the ends of the piece."""
    t = np.empty(NODES * count)
    for i in range(count):
        for j in range(NODES):
            t[NODES * i + j] = POINT[j]
        put(panels, i, edges, t, NODES * i, NODES * (i + 1), nodes)


@kernel
def integral(values, panels, count):
    """Of values at the nodes of all panels."""
    total = 0.0
    for i in range(count):
        part = 0.0
        for j in range(NODES):
            part += WEIGHT[j] * values[NODES * i + j]
        total += part * panels[2, i]
    return total


@kernel(fastmath={"contract"})
def field(rows, wide, points, phi, first, last, out):
    """Values of rows (k, ROW) at points `first` to `last` into `out` (k, n); `wide`: four mode functions, not two."""
    u = points[0, first:last]
    p0, p1, p2, p3 = phi[0, first:last], phi[1, first:last], phi[2, first:last], phi[3, first:last]
    for k in range(len(rows)):
        a0, a1, a2, a3 = rows[k, 0], rows[k, 1], 0.5 * rows[k, 2], rows[k, 3] / 6.0
        w0, w1, w2, w3 = rows[k, 4], rows[k, 5], rows[k, 6], rows[k, 7]
        x = out[k, first:last]
        if wide:
            for i in range(last - first):
                cubic = a0 + u[i] * (a1 + u[i] * (a2 + u[i] * a3))
                x[i] = cubic + (w0 * p0[i] + w1 * p1[i]) + (w2 * p2[i] + w3 * p3[i])
        else:
            for i in range(last - first):
                x[i] = a0 + u[i] * (a1 + u[i] * (a2 + u[i] * a3)) + (w0 * p0[i] + w1 * p1[i])


@kernel
def derivatives(mode, par, rows, out):
    """Rows (3, ROW) of the derivative of the vector x from its rows."""
    for k in range(3):
        differentiate(mode, par, rows[k], out[k])


@kernel(fastmath={"contract"})
def speeds(mode, par, rows, points, phi, first, last, direction, slope, speed, over):
    """Speed |x'| at points, and its excess over the progress along `direction`.

    |x'| - x' . e = |x' - (x' . e) e|^2 / (|x'| + x' . e): no digits are lost on a taut cable.

    Parameters
    ----------
    rows : (3, ROW)
        Of x.
    direction : (3,)
        Unit vector e along the chord; zero to get the arc length itself.
    slope : (3, n), speed, over : (n,)
        Out: x', |x'| and |x'| - x' . e.
    """
    d = np.empty((3, ROW))
    derivatives(mode, par, rows, d)
    field(d, par[C] > 0.0, points, phi, first, last, slope)
    ex, ey, ez = direction[0], direction[1], direction[2]
    xs, ys, zs = slope[0, first:last], slope[1, first:last], slope[2, first:last]
    vs, excess = speed[first:last], over[first:last]
    for k in range(last - first):
        x, y, z = xs[k], ys[k], zs[k]
        v = math.sqrt(x * x + y * y + z * z)
        p = x * ex + y * ey + z * ez
        dx, dy, dz = x - p * ex, y - p * ey, z - p * ez
        across = (dx * dx + dy * dy + dz * dz) / max(v + max(p, 0.0), 1e-300)
        vs[k] = v
        excess[k] = across if p > 0.0 else v - p


@kernel
def tails(speed, panels, count, tail):
    """How much arc length the two highest Legendre coefficients of the speed stand for, panel by panel; the sum."""
    total = 0.0
    for i in range(count):
        a, b = 0.0, 0.0
        for j in range(NODES):
            a += TAIL[0, j] * speed[NODES * i + j]
            b += TAIL[1, j] * speed[NODES * i + j]
        tail[i] = panels[2, i] * (0.1 * abs(a) + abs(b)) / NODES
        total += tail[i]
    return total


@kernel
def split(tail, panels, count, limit):
    """Divides every panel whose tail is above `limit` in 2 to 4, as its decay with the width suggests.

    Returns the new number of panels; the same number if there is nothing to do or no room.
    """
    more = 0
    for i in range(count):
        more += _parts(tail[i], panels[2, i], limit) - 1
    if more == 0 or count + more > MAX_PANELS:
        return count
    k = count + more - 1
    for i in range(count - 1, -1, -1):
        left, right, width, piece = panels[0, i], panels[1, i], panels[2, i], panels[3, i]
        parts = _parts(tail[i], width, limit)
        for j in range(parts - 1, -1, -1):
            panels[0, k] = left + width * (j / parts)
            panels[1, k] = right + width * ((parts - 1 - j) / parts)
            panels[2, k], panels[3, k] = width / parts, piece
            k -= 1
    return count + more


@kernel
def _parts(tail, width, limit):
    """Into how many parts a panel is divided."""
    if not tail > limit or width < 1e-14:
        return 1
    ratio = tail / limit
    return 2 if ratio < 2.0**NODES else (3 if ratio < 3.0**NODES else 4)


@kernel
def measured(speed, panels, count, power, start):
    """Arc length within each panel as a polynomial in t in [-1, 1], 0 at t = -1, and at the beginning of each panel.

    power : (count, NODES + 3), start : (count + 1,)
        Out. `power` has NODES + 1 coefficients, then dt / d(arc length / panel's length) at both ends.
    """
    total = 0.0
    for i in range(count):
        half = 0.5 * panels[2, i]
        before, length, slope0, slope1 = 0.0, 0.0, 0.0, 0.0
        for k in range(1, NODES + 1):
            power[i, k] = 0.0
        for j in range(NODES):
            v = half * speed[NODES * i + j]
            before += BEFORE[j] * v
            length += 2.0 * WEIGHT[j] * v
            slope0 += AT_ENDS[j, 0] * v
            slope1 += AT_ENDS[j, 1] * v
            for k in range(NODES):
                power[i, k + 1] += INTEGRAL[j, k] * v
        power[i, 0] = before
        power[i, NODES + 1] = length / slope0 if slope0 > 0.0 else 2.0
        power[i, NODES + 2] = length / slope1 if slope1 > 0.0 else 2.0
        start[i] = total
        total += length
    start[count] = total
    return total


@kernel(fastmath={"contract"})
def invert(power, i, step, origin, first, last, length, moved, t):
    """t in [-1, 1] where the arc length within panel `i`, from 0 to `length`, is step k - origin, first <= k < last.

    Up to four steps of Newton's method from the quintic through middle and ends, for all at once; more, within a
    bracket, for those that need it. `moved` is scratch; up to AHEAD - 1 entries more than there are points are
    overwritten in both. Returns the largest defect.
    """
    # divided differences of t by y, the fraction of the arc length, at 0, 0, m, m, 1, 1
    d0, d1, m = power[i, NODES + 1], power[i, NODES + 2], power[i, 0] / length
    left, right, slope = 1.0 / m, 1.0 / (1.0 - m), length / power[i, 1]
    e0, e1, e2, e3 = (left - d0) * left, (slope - left) * left, (right - slope) * right, (d1 - right) * right
    f0, f1, f2 = (e1 - e0) * left, e2 - e1, (e3 - e2) * right
    g0 = f1 - f0
    h0 = f2 - f1 - g0
    c0, c1, c2, c3, c4, c5 = power[i, 0], power[i, 1], power[i, 2], power[i, 3], power[i, 4], power[i, 5]
    c6, c7, c8, c9, c10 = power[i, 6], power[i, 7], power[i, 8], power[i, 9], power[i, 10]
    count = (last - first + AHEAD - 1) // AHEAD * AHEAD  # whole groups, for vector instructions
    out, moved, scale = t[first : first + count], moved[:count], 1.0 / length
    for k in range(count):
        y = (step * (first + k) - origin) * scale
        z = y - m
        x = -1.0 + y * (d0 + y * (e0 + z * (f0 + z * (g0 + (y - 1.0) * h0))))
        out[k] = min(1.0, max(-1.0, x))
    largest, near = 0.0, 0
    for _ in range(4):
        for k in range(count):
            x, target = out[k], step * (first + k) - origin
            # Horner's scheme for the polynomial and its derivative
            p = c9 + x * c10
            q = c10
            q = p + x * q
            p = c8 + x * p
            q = p + x * q
            p = c7 + x * p
            q = p + x * q
            p = c6 + x * p
            q = p + x * q
            p = c5 + x * p
            q = p + x * q
            p = c4 + x * p
            q = p + x * q
            p = c3 + x * p
            q = p + x * q
            p = c2 + x * p
            q = p + x * q
            p = c1 + x * p
            q = p + x * q
            p = c0 + x * p
            moved[k] = (p - target) / q
            out[k] = x - moved[k]
        largest, near = 0.0, 0
        for k in range(last - first):
            largest = max(largest, abs(moved[k]))
            near += 1 if abs(moved[k]) < _QUADRATIC and abs(out[k]) < 1.0 + 1e-9 else 0
        if largest < _QUADRATIC:
            break
    worst = min(largest, _QUADRATIC) ** 2 * length
    if near == last - first:
        for k in range(last - first):
            out[k] = min(1.0, max(-1.0, out[k]))
        return worst
    for k in range(last - first):
        if abs(moved[k]) < _QUADRATIC and abs(out[k]) < 1.0 + 1e-9:
            out[k] = min(1.0, max(-1.0, out[k]))
        else:
            out[k], defect = _bracketed(power, i, step * (first + k) - origin)
            worst = max(worst, defect)
    return worst


@kernel
def _bracketed(power, i, target):
    """`invert` for one value by Newton's method within a bracket; returns t and the defect."""
    low, high, t, defect = -1.0, 1.0, 0.0, 0.0
    for _ in range(80):
        value, slope = power[i, NODES], 0.0
        for k in range(NODES - 1, -1, -1):
            slope = slope * t + value
            value = value * t + power[i, k]
        defect = value - target
        if defect > 0.0:
            high = t
        else:
            low = t
        before = t
        t = t - defect / slope if slope > 0.0 else low - 1.0
        if not low < t < high:
            t = 0.5 * (low + high)
        if abs(t - before) < 1e-13:
            break
    return t, abs(defect)
