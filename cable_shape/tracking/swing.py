"""How a cable swings on from look to look, to first order about its rest between the grips: :func:`swung`.

A place of the cable is x = x0 - C x'', x0 where it would be at rest, C how far places give as they accelerate (the
rod's own answer to its inertia). So the acceleration a = x'' is that of vibrations about what the grips ask for,

    a'' = -1/C (a - x0'') - 2 z sqrt(1/C) a',

each with damping z and shaken by noise, so that in the long run it spreads by what was seen of it lately.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.checks import Array

#: [1], damping of vibrations; [rad/s], of rates at first; [m/s^2], spread of accelerations where the grips are.
DAMPED, QUICK, AT_GRIPS = 0.5, 8.0, 0.3
#: [s^2], least and most square of a vibration's period over 2 pi.
_LEAST, _MOST = 1e-5, 1.0


def swung(
    dt: float, swing: float, gives: Array, forced: Array, inner: Array, masses: Array
) -> tuple[Array, Array, Array]:
    """Over dt [s], of accelerations and their rates (6 rows,): transition, covariance of what comes, and the goal.

    swing [m/s^2]: how far they spread in the long run, a lighter place further; gives (rows, 3, rows, 3) [s^2]: C;
    forced (rows, 3): x0''; inner (i,): places that vibrate; masses (rows,): by which C is symmetric.
    """
    rows = len(gives)
    whole = 3 * rows
    at: Any = (3 * inner[:, None] + np.arange(3)).ravel()
    weights = np.repeat(masses[inner] / masses[inner].mean(), 3)
    roots = np.sqrt(weights)
    own = roots[:, None] * gives.reshape(whole, whole)[np.ix_(at, at)] / roots
    squares, modes = np.linalg.eigh(0.5 * (own + own.T))
    w = 1.0 / np.sqrt(np.clip(squares, _LEAST, _MOST))  # rad/s
    d, z = w * math.sqrt(1.0 - DAMPED**2), DAMPED * w
    c, s, e = np.cos(d * dt), np.sin(d * dt) / d, np.exp(-z * dt)
    aa, ab, ba, bb = e * (c + z * s), e * s, -e * s * w**2, e * (c - z * s)
    va, vb = swing**2, swing**2 * w**2
    qaa = va - aa**2 * va - ab**2 * vb
    qab = -aa * ba * va - ab * bb * vb
    qbb = vb - ba**2 * va - bb**2 * vb
    change, added = np.zeros((2 * whole, 2 * whole)), np.zeros((2 * whole, 2 * whole))
    a, b = at, whole + at
    for i, j, x, y in ((a, a, aa, qaa), (a, b, ab, qab), (b, a, ba, qab), (b, b, bb, qbb)):
        change[np.ix_(i, j)] = (modes * x) @ modes.T * (roots / roots[:, None])
        added[np.ix_(i, j)] = (modes * y) @ modes.T / (roots * roots[:, None])
    held = np.setdiff1d(np.arange(whole), at)
    added[held, held] = AT_GRIPS**2
    added[whole + held, whole + held] = 1.0
    return change, added, np.concatenate((forced.ravel(), np.zeros(whole)))
