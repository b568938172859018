"""A perfectly flexible cable under panel-wise constant load, in closed form.

Within a panel the force n = a - f s, exerted by the far side, is linear in the stress-free arc length s, and the
tangent is n/|n|. Split along the load, n = c + x e with e = f/|f|, c across it: x runs from x0 to x1 = x0 - |f| h and
m = |n| = sqrt(c.c + x^2). All integrals over the panel follow from D = asinh(x0/|c|) - asinh(x1/|c|), for which
tanh(D/2) = (x0 - x1) / (m0 + m1) holds without cancellation.
"""

import math

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.frames import align, darboux, roll, straight, transport

FOUND, FAILED, OVERSTRETCHED = 0, 1, 2
#: Entries of the result.
ITERATIONS, RESIDUAL, DEFECT, ENERGY, ROLL, CHORD, RESULTS = 0, 1, 2, 3, 4, 5, 6

#: Below this |f| h / (m0 + m1) a panel is integrated by Simpson's rule, exact to rounding there.
_LIGHT = 1e-4
#: c.c is not taken below this fraction of (|f| h)^2 in the derivative, which is infinite for a cable folded on itself.
_FOLDED = 1e-18
#: Below this x the series of log(sinh x / x) is used, exact to rounding there.
_SMALL = 0.05
_MOST_ITERATIONS = 60
_GAUSS_X = np.array((-0.9061798459386640, -0.5384693101056831, 0.0, 0.5384693101056831, 0.9061798459386640))
_GAUSS_W = np.array(
    (0.2369268850561891, 0.4786286704993665, 0.5688888888888889, 0.4786286704993665, 0.2369268850561891)
)


@kernel
def span(ax, ay, az, fx, fy, fz, h, give, derivative, out):
    """The vector from the beginning of a panel to the point at `h`, as three numbers.

    a [N], f [N/m]: n = a - f s. h [m]. give [1/N]: 1 / EA. derivative: whether to add d span / d a to `out` (3, 3).
    """
    bx, by, bz = ax - fx * h, ay - fy * h, az - fz * h
    m0, m1 = math.sqrt(ax * ax + ay * ay + az * az), math.sqrt(bx * bx + by * by + bz * bz)
    load = math.sqrt(fx * fx + fy * fy + fz * fz)
    weight, stretch = load * h, give * h
    sx, sy, sz = 0.5 * (ax + bx) * stretch, 0.5 * (ay + by) * stretch, 0.5 * (az + bz) * stretch
    if derivative:
        out[0, 0] += stretch
        out[1, 1] += stretch
        out[2, 2] += stretch
    if weight <= _LIGHT * (m0 + m1):
        if m0 == 0.0:
            return sx, sy, sz
        cx, cy, cz = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
        m = math.sqrt(cx * cx + cy * cy + cz * cz)
        p, q, r = h / (6.0 * m0), 4.0 * h / (6.0 * m), h / (6.0 * m1)
        if derivative:
            k = h / m
            tx, ty, tz = cx / m, cy / m, cz / m
            _add(out, k, tx, ty, tz, 1.0 - tx * tx, 1.0 - ty * ty, 1.0 - tz * tz)
        return sx + p * ax + q * cx + r * bx, sy + p * ay + q * cy + r * by, sz + p * az + q * cz + r * bz
    ex, ey, ez = fx / load, fy / load, fz / load
    x0 = ax * ex + ay * ey + az * ez
    x1 = x0 - weight
    cx, cy, cz = ax - x0 * ex, ay - x0 * ey, az - x0 * ez
    across = cx * cx + cy * cy + cz * cz
    d = 0.0
    if across > 0.0:
        d = _difference(across, x0, x1, m0, m1, weight)
    along = (m0 - m1) / load
    side = d / load
    if derivative:
        across = max(across, _FOLDED * weight * weight)
        m0, m1 = math.sqrt(across + x0 * x0), math.sqrt(across + x1 * x1)
        j = _difference(across, x0, x1, m0, m1, weight) / load  # int 1/|n|
        a3 = (x0 / m0 - x1 / m1) / load  # int c.c/|n|^3
        mixed = (1.0 / m1 - 1.0 / m0) / load  # int x/|n|^3
        u, v, w = 1.0 / across, mixed, j - a3
        for i in range(3):
            ei, ci = (ex, ey, ez)[i], (cx, cy, cz)[i]
            for k in range(3):
                ek, ck = (ex, ey, ez)[k], (cx, cy, cz)[k]
                out[i, k] += (j if i == k else 0.0) - a3 * u * ci * ck - v * (ci * ek + ei * ck) - w * ei * ek
    return sx + cx * side + ex * along, sy + cy * side + ey * along, sz + cz * side + ez * along


@kernel
def _add(out, k, tx, ty, tz, xx, yy, zz):
    """Adds k (I - t t^T)."""
    out[0, 0] += k * xx
    out[1, 1] += k * yy
    out[2, 2] += k * zz
    out[0, 1] -= k * tx * ty
    out[1, 0] -= k * tx * ty
    out[0, 2] -= k * tx * tz
    out[2, 0] -= k * tx * tz
    out[1, 2] -= k * ty * tz
    out[2, 1] -= k * ty * tz


@kernel
def _difference(across, x0, x1, m0, m1, weight):
    """asinh(x0/c) - asinh(x1/c), c = sqrt(across), without cancellation."""
    ratio = weight / (m0 + m1)
    if ratio < 0.5:
        return 2.0 * math.atanh(ratio)
    first = across / (m0 + x0) if x0 > 0.0 else m0 - x0
    second = across / (m1 - x1) if x1 < 0.0 else m1 + x1
    return math.log((m0 + m1 + weight) / (first + second))


@kernel
def _log_sinhc(x):
    """log(sinh x / x) and its derivative, x > 0."""
    if x < _SMALL:
        y = x * x
        return y * (1.0 / 6.0 - y * (1.0 / 180.0 - y / 2835.0)), x * (1.0 / 3.0 - y * (1.0 / 45.0 - 2.0 * y / 945.0))
    e = math.exp(-2.0 * x)
    return x + math.log1p(-e) - math.log(2.0 * x), (1.0 + e) / (1.0 - e) - 1.0 / x


@kernel
def uniform(chord, load, length, force):
    """The force at the start of the inextensible catenary under a uniform load, in closed form; False if there is none.

    chord : (3,) [m]; load : (3,) [N/m]; force : (3,) [N], out.
    """
    w = math.sqrt(load @ load)
    if not w > 0.0:
        return False
    e = load / w
    drop = chord @ e
    across = chord - drop * e
    level = math.sqrt(across @ across)
    free = (length - drop) * (length + drop)
    if not free > 0.0:
        return False
    coth, pull = 1.0, 0.0
    if level > 0.0:
        excess = 0.5 * math.log(free) - math.log(level)
        if not excess > 1e-15:
            return False
        # log(sinh x / x) = excess; convex, and sinh x / x >= 1 + x^2/6 bounds x from above
        x = math.sqrt(6.0 * math.expm1(min(excess, 300.0)))
        for _ in range(60):
            value, slope = _log_sinhc(x)
            step = (value - excess) / slope
            x -= step
            if abs(step) <= 1e-15 * x:
                break
        coth = 1.0 / math.tanh(x)
        pull = 0.5 * w / x  # horizontal force / level distance
    force[:] = 0.5 * w * (length + drop * coth) * e + pull * across
    return True


@kernel
def closure(force, panels, give, out):
    """(3,) the vector from start to end for the force at the start; adds its derivative to `out` (3, 3).

    panels : (k, 7) length [m], load (3) [N/m], concentrated load at its beginning (3) [N].
    """
    a = force.copy()
    r = np.zeros(3)
    for k in range(panels.shape[0]):
        h = panels[k, 0]
        a -= panels[k, 4:7]
        x, y, z = span(a[0], a[1], a[2], panels[k, 1], panels[k, 2], panels[k, 3], h, give, True, out)
        r[0] += x
        r[1] += y
        r[2] += z
        a -= h * panels[k, 1:4]
    return r


@kernel
def equilibrium(chord, panels, mean, length, give, force):
    """Finds the force at the start; (iterations, defect [m]).

    Newton's method starts from the closed form for the mean load. Where that fails, as for a cable that folds on itself
    between heavy masses, it follows a cable that stretches easily to the one that was asked for.
    """
    distance = math.sqrt(chord @ chord)
    sag = math.sqrt(mean @ mean) * length
    if not uniform(chord, mean, length, force):
        # at least as long as the cable: pulled straight
        strain = max(distance / length - 1.0, 0.0)
        pull = strain / give if give > 0.0 else 0.0
        force[:] = 0.5 * length * mean
        if distance > 0.0:
            force += max(pull, sag) * chord / distance
    first = force.copy()
    iterations, defect = _newton(chord, panels, length, give, force)
    if defect <= 1e-9 * length or not sag > 0.0:
        return iterations, defect
    for i in range(3):
        force[i] = first[i]
    soft = 1.0 / sag
    for _ in range(14):
        more, _rest = _newton(chord, panels, length, give + soft, force)
        iterations += more
        soft *= 0.1
    more, defect = _newton(chord, panels, length, give, force)
    return iterations + more, defect


@kernel
def _newton(chord, panels, length, give, force):
    """Newton's method on the closure, damped, from `force` and into it; (iterations, defect [m]).

    The closure is the gradient of a convex function (the complementary energy), so that the direction always descends.
    """
    derivative = np.zeros((3, 3))
    gap = chord - closure(force, panels, give, derivative)
    defect = math.sqrt(gap @ gap)
    iterations = 1
    while defect > 1e-14 * length and iterations < _MOST_ITERATIONS:
        step = _solved(derivative, gap)
        part, better = 1.0, False
        while part > 1e-9:
            trial = force + part * step
            derivative[:] = 0.0
            ahead = chord - closure(trial, panels, give, derivative)
            remains = math.sqrt(ahead @ ahead)
            iterations += 1
            if remains < (1.0 - 1e-4 * part) * defect:
                better = True
                break
            part *= 0.4
        if not better:
            break
        for i in range(3):
            force[i] = trial[i]
        gap = ahead
        defect = remains
    return iterations, defect


@kernel
def _solved(matrix, right):
    """x of matrix x = right for a symmetric positive definite (3, 3) matrix, made so if it is not quite."""
    ridge = 1e-15 * (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) + 1e-300
    a, b, c = matrix[0, 0] + ridge, matrix[0, 1], matrix[0, 2]
    l1, l2 = b / a, c / a
    d = max(matrix[1, 1] + ridge - l1 * b, ridge)
    e = matrix[1, 2] - l2 * b
    l3 = e / d
    f = max(matrix[2, 2] + ridge - l2 * c - l3 * e, ridge)
    x = np.empty(3)
    y1 = right[1] - l1 * right[0]
    x[2] = (right[2] - l2 * right[0] - l3 * y1) / f
    x[1] = y1 / d - l3 * x[2]
    x[0] = right[0] / a - l1 * x[1] - l2 * x[2]
    return x


@kernel
def solve(start, end, free, tip, panels, mean, length, give, gravity_load, points, tolerance, buffer, result):
    """The cable between two places, or hanging from one.

    Parameters
    ----------
    start, end : (7,)
        Position [m] and quaternion; of the end only if not `free`, when `tip` (3,) [N] pulls there.
    panels : (k, 7)
        See :func:`closure`.
    mean : (3,) [N/m]
        All load divided by the length.
    give : float [1/N]
        1 / EA.
    gravity_load : (3,) [N/m]
        Weight, for the energy.
    buffer, result : out
        See ``cable_shape.shape`` and the names above.
    """
    n = points
    chord = end[:3] - start[:3]
    result[CHORD] = math.sqrt(chord @ chord) if not free else 0.0
    force = np.empty(3)
    if free:
        for i in range(3):
            force[i] = tip[i]
        for k in range(panels.shape[0]):
            force += panels[k, 0] * panels[k, 1:4] + panels[k, 4:7]
        iterations, defect = 1, 0.0
    else:
        if give == 0.0 and result[CHORD] >= length:
            result[ROLL] = straight(start, end, length, n, buffer)
            return OVERSTRETCHED
        iterations, defect = equilibrium(chord, panels, mean, length, give, force)
    result[ITERATIONS], result[DEFECT], result[RESIDUAL] = iterations, defect, defect / length
    if not defect <= tolerance:
        result[ROLL] = straight(start, end, length, n, buffer)
        return FAILED
    result[ENERGY] = _lay_out(start, force, panels, length, give, gravity_load, n, buffer)
    if not free:
        buffer[4 * n - 3 : 4 * n] = end[:3]
        result[ROLL] = roll(buffer[8 * n - 4 : 8 * n], end[3:7])
    return FOUND


@kernel
def _lay_out(start, force, panels, length, give, gravity_load, n, buffer):
    """Fills the buffer from the force at the start; elastic energy and that of the distributed weight [J]."""
    tangents, bend = np.empty((3, n)), np.empty((3, n))
    none = np.empty((3, 3))
    step = length / (n - 1.0)
    r, a = start[:3].copy(), force.copy()
    begin, energy, m = 0.0, 0.0, 0
    tx, ty, tz = 0.0, 0.0, 0.0
    count = panels.shape[0]
    for k in range(count):
        h, fx, fy, fz = panels[k, 0], panels[k, 1], panels[k, 2], panels[k, 3]
        a -= panels[k, 4:7]
        while m < n and (m * step < begin + h * (1.0 - 1e-12) or k == count - 1):
            s = min(h, max(0.0, m * step - begin))
            x, y, z = span(a[0], a[1], a[2], fx, fy, fz, s, give, False, none)
            nx, ny, nz = a[0] - fx * s, a[1] - fy * s, a[2] - fz * s
            size = math.sqrt(nx * nx + ny * ny + nz * nz)
            if size > 0.0:
                tx, ty, tz = nx / size, ny / size, nz / size
            elif m == 0:
                tx, ty, tz = 0.0, 0.0, -1.0
            tangents[0, m], tangents[1, m], tangents[2, m] = tx, ty, tz
            along = fx * tx + fy * ty + fz * tz
            inverse = 1.0 / size if size > 0.0 else 0.0
            bend[0, m], bend[1, m], bend[2, m] = (
                (along * tx - fx) * inverse,
                (along * ty - fy) * inverse,
                (along * tz - fz) * inverse,
            )
            buffer[m] = m * step
            buffer[n + 3 * m], buffer[n + 3 * m + 1], buffer[n + 3 * m + 2] = r[0] + x, r[1] + y, r[2] + z
            buffer[11 * n + 3 * m], buffer[11 * n + 3 * m + 1], buffer[11 * n + 3 * m + 2] = nx, ny, nz
            m += 1
        energy += _panel_energy(r, a, fx, fy, fz, h, give, gravity_load)
        x, y, z = span(a[0], a[1], a[2], fx, fy, fz, h, give, False, none)
        r[0] += x
        r[1] += y
        r[2] += z
        a -= h * panels[k, 1:4]
        begin += h
    buffer[n - 1] = length
    buffer[14 * n :] = 0.0
    frames = buffer[4 * n : 8 * n]
    frames[0:4] = start[3:7]
    align(frames, tangents[0, 0], tangents[1, 0], tangents[2, 0])
    transport(tangents, np.zeros(n), step, frames)
    darboux(bend, frames, buffer[8 * n : 11 * n])
    return energy


@kernel
def _panel_energy(r, a, fx, fy, fz, h, give, gravity_load):
    """[J], of stretch and of the weight of one panel, by Gauss's rule, split where the cable turns."""
    load = fx * fx + fy * fy + fz * fz
    turn = (a[0] * fx + a[1] * fy + a[2] * fz) / load if load > 0.0 else 0.0
    edges = np.array((0.0, turn, h)) if 0.0 < turn < h else np.array((0.0, h))
    none = np.empty((3, 3))
    energy = 0.0
    for i in range(edges.size - 1):
        for part in range(4):
            width = (edges[i + 1] - edges[i]) / 4.0
            for j in range(5):
                s = edges[i] + width * (part + 0.5 * (1.0 + _GAUSS_X[j]))
                x, y, z = span(a[0], a[1], a[2], fx, fy, fz, s, give, False, none)
                nx, ny, nz = a[0] - fx * s, a[1] - fy * s, a[2] - fz * s
                down = gravity_load[0] * (r[0] + x) + gravity_load[1] * (r[1] + y) + gravity_load[2] * (r[2] + z)
                energy += 0.5 * width * _GAUSS_W[j] * (0.5 * give * (nx * nx + ny * ny + nz * nz) - down)
    return energy
