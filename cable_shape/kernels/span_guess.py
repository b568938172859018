"""Where Newton's method starts for a cable in clips: every span hangs, or is a Bezier curve of the right length.

A clip that leaves the tangent free gets that of its neighbours' chord, or, where the spans hang, the mean of those of
the two spans hanging alone.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    add,
    dot,
    get3,
    put3,
    scale,
    subtract,
    take3,
)
from cable_shape.kernels.rod_guess import (
    bezier_tangents,
    carry_frames,
    hanging_force,
    hanging_tangents,
    natural_frames,
    norm,
    perpendicular,
    tangent,
)
from cable_shape.kernels.span_drive import take4
from cable_shape.kernels.span_work import TRIAL, mesh_parts, slot

HANGING, CURVED, WAVY = 0, 1, 2
WEAK = 1e-3  # of a span's own load, at a tip that carries none: it has a direction nevertheless


@kernel
def taut(frames: Array, arcs: Array, forces: int, most: float) -> bool:
    """Whether the chord of a span is at least the fraction `most` of its length."""
    for j in range(forces):
        x, y, z = frames[j + 1, 0] - frames[j, 0], frames[j + 1, 1] - frames[j, 1], frames[j + 1, 2] - frames[j, 2]
        if math.sqrt(x * x + y * y + z * z) >= most * (arcs[j + 1] - arcs[j]):
            return True
    return False


@kernel
def layer_of(par: Array, span: Array, load: Array, length: float, force: Array) -> float:
    """Boundary layer [m] of a span that hangs from two pins, and the force at its end into force (3,)."""
    free = np.zeros(2)
    up = (0.0, 0.0, 1.0)
    return hanging_force(span, load, length, par[5], 0.5 * (par[0] + par[1]), up, up, free, force)


@kernel
def directions(
    par: Array, frames: Array, mask: Array, loads: Array, lengths: Array, forces: int, kind: int, T: Array
) -> None:  # fmt: skip
    """Fills T (m+1, 3), the tangents at the supports. loads (m, 3) [N/m]: mean load of each span."""
    spans = lengths.shape[0]
    force = np.zeros(3)
    before = (0.0, 0.0, 0.0)
    for j in range(spans + 1):
        after = before
        if j < forces:
            chord = frames[j + 1, 0:3] - frames[j, 0:3]
            after = (chord[0], chord[1], chord[2])
            if kind == HANGING:
                layer_of(par, chord, loads[j], lengths[j], force)
                after = add((force[0], force[1], force[2]), scale(lengths[j], get3(loads, j)))
                after = scale(1.0 / max(norm(after), 1e-300), after)
        t = add(before, after) if 0 < j < forces else (after if j == 0 else before)
        size = norm(t)
        known = size > 1e-6 * max(norm(after), 1e-300)
        put3(T, j, 0, scale(1.0 / size, t) if known else perpendicular((0.0, 0.0, 1.0)))
        if mask[j, 0] == 0.0:
            put3(T, j, 0, tangent(take4(frames, j)))
        before = after
        if kind == HANGING and j < forces:
            before = scale(1.0 / max(norm(force), 1e-300), (force[0], force[1], force[2]))


@kernel
def guess(
    par: Array, mesh: Array, sol: Array, where: Array, mask: Array, elements: int, forces: int, kind: int, sag: float
) -> None:  # fmt: skip
    """Fills the trial's rotations and forces for its supports.

    kind: HANGING; CURVED: Bezier curves, tilted by `sag` to the side of the load; WAVY: to either side in turn.
    """
    spans = where.shape[0] - 1
    s, h, load, rest, _ = mesh_parts(mesh, elements)
    q, lam, frames, _, _ = slot(sol, elements, spans, TRIAL)
    loads, lengths, T, t = np.empty((spans, 3)), np.empty(spans), np.empty((spans + 1, 3)), np.empty((elements + 1, 3))
    for j in range(spans):
        a, b = where[j], where[j + 1]
        lengths[j] = s[b] - s[a]
        for i in range(3):
            loads[j, i] = (load[a, i] - load[b - 1, 6 + i]) / lengths[j]
    directions(par, frames, mask, loads, lengths, forces, kind, T)
    bend = 0.5 * (par[0] + par[1])
    force, held = np.zeros(3), np.ones(2)
    for j in range(spans):
        a, b = where[j], where[j + 1]
        local = s[a : b + 1] - s[a]
        t0, t1, f = get3(T, j), get3(T, j + 1), get3(loads, j)
        # at an end that is pinned the cable leaves as it likes
        held[0] = 0.0 if j == 0 and mask[0, 0] != 0.0 else 1.0
        held[1] = 0.0 if j + 1 == spans and mask[spans, 0] != 0.0 else 1.0
        tip = take3(load, b - 1, 6)
        if j >= forces:
            put3(lam, j, 0, (0.0, 0.0, 0.0))
            if norm(tip) < WEAK * norm(f) * lengths[j]:
                tip = scale(WEAK * lengths[j], f)
            if norm(tip) > 0.0:
                for i in range(3):
                    force[i] = tip[i]
                hanging_tangents(local, loads[j], force, bend, t0, t1, held, t[a : b + 1])
            else:
                for k in range(a, b + 1):
                    put3(t, k, 0, t0)
            continue
        span = frames[j + 1, 0:3] - frames[j, 0:3]
        if kind == HANGING:
            hanging_force(span, loads[j], lengths[j], par[5], bend, t0, t1, held, force)
            hanging_tangents(local, loads[j], force, bend, t0, t1, held, t[a : b + 1])
            put3(lam, j, 0, subtract((force[0], force[1], force[2]), tip))
        else:
            c = (span[0], span[1], span[2])
            chord = norm(c)
            along = scale(1.0 / chord, c) if chord > 0.0 else perpendicular(t0)
            down = subtract(f, scale(dot(f, along), along))
            size = norm(down)
            down = scale(1.0 / size, down) if size > 0.0 else perpendicular(along)
            t0 = t0 if held[0] != 0.0 else along
            t1 = t1 if held[1] != 0.0 else along
            side = -sag if kind == WAVY and j % 2 == 1 else sag
            bezier_tangents(local, span, t0, t1, scale(side, down), t[a : b + 1])
            put3(lam, j, 0, scale(-0.5, add(take3(load, a, 0), tip)))
    for j in range(spans + 1):
        if mask[j, 0] == 0.0:
            put3(t, where[j], 0, get3(T, j))
    frames_along(s, h, rest, t, frames, where, mask, forces, kind, q)


@kernel
def frames_along(
    s: Array, h: Array, rest: Array, t: Array, frames: Array, where: Array, mask: Array, forces: int, kind: int,
    q: Array,
) -> None:  # fmt: skip
    """Rotations along the tangents t, without twist but for what supports that hold the roll ask for."""
    spans = where.shape[0] - 1
    ends = np.empty((2, 3))
    begin = 0
    for j in range(1, spans + 1):
        if mask[j, 2] != 0.0 and j < spans:
            continue
        a, b = where[begin], where[j]
        for i in range(4):
            if begin == 0:
                q[a, i] = frames[0, 3 + i]
            q[b, i] = frames[j, 3 + i]
        if q[a, 0] * q[b, 0] + q[a, 1] * q[b, 1] + q[a, 2] * q[b, 2] + q[a, 3] * q[b, 3] < 0.0:
            for i in range(4):
                q[b, i] = -q[b, i]
        ends[0, :], ends[1, :] = mask[begin], mask[j]
        carry_frames(s[a : b + 1] - s[a], t[a : b + 1], ends, q[a : b + 1])
        begin = j
    if forces < spans and kind != HANGING:
        a = where[spans - 1]
        natural_frames(h[a:], rest[a:], q[a:])
