"""Von Mises stress of a round or tubular section: the worst fibre of its surface.

With the axial force N, the shear force V, the bending moment M, the torsion T and the angle phi of a fibre, counted
from where bending pulls most,

    sigma = N / A + M r / I cos(phi),   tau = T r / J + k V / A sin(psi - phi),

psi being the angle of V. k V / A is the shear stress at the neutral axis by Jourawski's formula, along the surface: k =
4/3 for a solid section and 2 for a thin tube. The stress is sqrt(sigma^2 + 3 tau^2).
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel

#: Fibres looked at before Newton's method goes to the maximum beside the best one: the square has at most two maxima.
FIBRES = 16
ANGLES = 2.0 * math.pi * np.arange(FIBRES) / FIBRES
COSINES, SINES = np.cos(ANGLES), np.sin(ANGLES)
NEWTON_STEPS = 4
#: Numbers that describe a section: area, outer radius, I, J, k.
SECTION = 5
Loads = tuple[float, float, float, float, float, float]


@kernel(inline="always")
def section_loads(buffer: Array, points: int, i: int, section: Array) -> Loads:
    """At point i of a shape's buffer: N / A, M r / I, T r / J, k V / A, and cosine and sine of psi."""
    q, n, m = 4 * points + 4 * i, 11 * points + 3 * i, 14 * points + 3 * i
    x, y, z, w = buffer[q], buffer[q + 1], buffer[q + 2], buffer[q + 3]
    f0, f1, f2 = buffer[n], buffer[n + 1], buffer[n + 2]
    m0, m1, m2 = buffer[m], buffer[m + 1], buffer[m + 2]
    a0, a1, a2 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    b0, b1, b2 = 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)
    c0, c1, c2 = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)
    v1, v2 = a0 * f0 + a1 * f1 + a2 * f2, b0 * f0 + b1 * f1 + b2 * f2
    # bending pulls most along (-M2, M1) in the section
    p1, p2 = -(b0 * m0 + b1 * m1 + b2 * m2), a0 * m0 + a1 * m1 + a2 * m2
    shear, bending = math.sqrt(v1 * v1 + v2 * v2), math.sqrt(p1 * p1 + p2 * p2)
    both = shear * bending
    cosine, sine = (1.0, 0.0) if both == 0.0 else ((p1 * v1 + p2 * v2) / both, (p1 * v2 - p2 * v1) / both)
    area, radius, inertia, polar, factor = section[0], section[1], section[2], section[3], section[4]
    return (
        (c0 * f0 + c1 * f1 + c2 * f2) / area,
        bending * radius / inertia,
        (c0 * m0 + c1 * m1 + c2 * m2) * radius / polar,
        factor * shear / area,
        cosine,
        sine,
    )


@kernel(inline="always")
def square(loads: Loads, c: float, s: float) -> float:
    """Squared stress of the fibre whose angle has this cosine and sine."""
    sigma = loads[0] + loads[1] * c
    tau = loads[2] + loads[3] * (loads[5] * c - loads[4] * s)
    return sigma * sigma + 3.0 * tau * tau


@kernel
def worst_fibre(loads: Loads) -> float:
    """Squared stress of the most stressed fibre."""
    a, b, t, v, cosine, sine = loads
    best, at = -1.0, 0
    for i in range(FIBRES):
        value = square(loads, COSINES[i], SINES[i])
        if value > best:
            best, at = value, i
    angle, c, s = ANGLES[at], COSINES[at], SINES[at]
    for _ in range(NEWTON_STEPS):
        sigma, tau = a + b * c, t + v * (sine * c - cosine * s)
        dsigma, dtau = -b * s, -v * (sine * s + cosine * c)
        slope = sigma * dsigma + 3.0 * tau * dtau
        bend = dsigma * dsigma - sigma * b * c + 3.0 * (dtau * dtau - tau * v * (sine * c - cosine * s))
        if not bend < 0.0:
            break
        angle -= slope / bend
        c, s = math.cos(angle), math.sin(angle)
        value = square(loads, c, s)
        if not value > best:
            break
        best = value
    return best


@kernel
def von_mises(buffer: Array, points: int, section: Array, out: Array) -> None:
    """Fills out (n,) [Pa] with the stress of the worst fibre of each section."""
    for i in range(points):
        out[i] = math.sqrt(worst_fibre(section_loads(buffer, points, i, section)))


@kernel
def most_stressed(buffer: Array, points: int, begin: int, end: int, section: Array) -> tuple[int, float]:
    """Index and stress [Pa] of the most stressed section of the points from begin to end - 1.

    Sections are passed over by an upper bound from the size of force and moment alone, then by one from their parts;
    only what is left is searched fibre by fibre.
    """
    area, radius, inertia, polar, factor = section[0], section[1], section[2], section[3], section[4]
    # |cos a cos b + m sin a sin b| <= max(1, m) for the shares cos a of force and cos b of moment that make sigma
    p, q, ratio = 1.0 / area, radius / inertia, inertia / polar
    of_force, of_moment = max(1.0, 3.0 * factor * factor) * p * p, max(1.0, 3.0 * ratio * ratio) * q * q
    of_both = 2.0 * max(1.0, 3.0 * factor * ratio) * p * q
    bounds = np.empty(points)
    worst, highest = begin, -1.0
    for i in range(begin, end):
        n, m = 11 * points + 3 * i, 14 * points + 3 * i
        force = buffer[n] * buffer[n] + buffer[n + 1] * buffer[n + 1] + buffer[n + 2] * buffer[n + 2]  # squared
        moment = buffer[m] * buffer[m] + buffer[m + 1] * buffer[m + 1] + buffer[m + 2] * buffer[m + 2]
        bounds[i] = of_force * force + of_both * math.sqrt(force * moment) + of_moment * moment
        if bounds[i] > highest:
            worst, highest = i, bounds[i]
    best = worst_fibre(section_loads(buffer, points, worst, section))
    for i in range(begin, end):
        if bounds[i] > best and i != worst:
            loads = section_loads(buffer, points, i, section)
            sigma, tau = abs(loads[0]) + loads[1], abs(loads[2]) + loads[3]
            if sigma * sigma + 3.0 * tau * tau > best:
                value = worst_fibre(loads)
                if value > best:
                    best, worst = value, i
    return worst, math.sqrt(best)
