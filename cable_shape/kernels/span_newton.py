"""Newton's method for a rod in spans: damped by inertia and step length, finished by chord steps."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.newton import CHORD_FROM as CHORDS_FROM
from cable_shape.kernels.network.newton import STEP_TOLERANCE
from cable_shape.kernels.rod_algebra import (
    add,
    apply,
    dot,
    get3,
    get4,
    get9,
    inlined,
    inverse,
    put3,
    qexp,
    qmul,
    qnormal,
    scale,
    take3,
)
from cable_shape.kernels.span_factor import FORCE, SHIFTED, backward, factor, forward
from cable_shape.kernels.span_slide import columns_of, farthest_way, load_elements, respace, settle
from cable_shape.kernels.span_system import assemble, fold, gradient
from cable_shape.kernels.span_work import joints_of, matrices, vectors

CONVERGED, STALLED, NOT_FINITE = 0, 1, 2
LARGEST_STEP = 0.6  # rad
CHORD_FROM = 0.03  # rad: below this a cable in contact goes on with the factors at hand
FIRST_SHIFT, SHIFT_GROWTH, MOST_SHIFTS = 0.02, 6.0, 16  # the first as a fraction of stiffness / length^2
SADDLE = 1e-5  # rad, a shifted step below this is no progress
KICK = 0.1  # rad
MOST_KICKS = 3
MOST_AVOIDED = 4  # shaky factors are not used so many times
SHAKY = 1e10  # largest^3 / determinant of an inverse pivot: an eigenvalue 1e5 times as small as the others


@inlined
def advance(q: Array, lam: Array, frames: Array, d: Array, joints: Array, fraction: float) -> None:
    """q exp(fraction d), and the same fraction of the steps of the spans' forces and the supports' places."""
    for k in range(q.shape[0]):
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = qnormal(qmul(get4(q, k), qexp(scale(fraction, get3(d, k)))))
    for j in range(lam.shape[0]):
        for i in range(3):
            lam[j, i] += fraction * joints[j, FORCE + i]
            frames[j + 1, i] += fraction * joints[j, SHIFTED + i]


@inlined
def change_of_moment(d: Array, h: Array, stiff: Array, first: Array, least: float) -> float:
    """Largest change of a moment by the step d, relative to the largest moment, or to `least` if that is larger."""
    moment = change = 0.0
    for e in range(h.shape[0]):
        a, b = first[e, 6] ** 2 + first[e, 7] ** 2 + first[e, 8] ** 2, 0.0
        for i in range(3):
            b += (stiff[i] * (d[e + 1, i] - d[e, i]) / h[e]) ** 2
        moment, change = max(moment, a), max(change, b)
    return math.sqrt(change) / max(math.sqrt(moment), least)


@inlined
def change_of_force(joints: Array, s: Array, full: Array, where: Array, bend: float) -> float:
    """Largest change of a span's force by the step, relative to the force there, or to bend / length^2 if larger."""
    change = 0.0
    for j in range(joints.shape[0]):
        a, b = where[j], where[j + 1]
        force = 0.0
        for e in range(a, b):
            n = take3(full, e, 3)
            force = max(force, dot(n, n))
        step, span = take3(joints, j, FORCE), s[b] - s[a]
        change = max(change, math.sqrt(dot(step, step)) / max(math.sqrt(force), bend / (span * span)))
    return change


@inlined
def shaky(P: Array, stiff: Array) -> bool:
    """Whether a pivot, whose inverses are P (N+1, 9), is so near to singular that what follows from it is rounding."""
    for k in range(P.shape[0]):
        size = 0.0
        for i in range(3):
            for j in range(3):
                size += stiff[i] * stiff[j] * P[k, 3 * i + j] ** 2
        _, det = inverse(get9(P, k, 0))
        det *= stiff[0] * stiff[1] * stiff[2]
        if not size * size * size < (SHAKY * det) ** 2:
            return True
    return False


@kernel
def balance(lam: Array, frames: Array, place: Array, sums: Array, pull: Array, given: Array) -> None:
    """Adds the supports' distances to the spans' closures, and fills the gradient in the supports' places."""
    spans = lam.shape[0]
    for j in range(spans):
        for i in range(3):
            sums[j, i] += frames[j + 1, i] - frames[j, i]
    for j in range(1, spans):
        free = int(place[j, 0])
        if free == 0:
            continue
        y = get3(frames, j)
        put3(pull, j, 0, add(apply(get9(place, j, 1), y), take3(place, j, 10)))
        move = (0.0, 0.0, 0.0)
        for i in range(free, 3):
            z = take3(place, j, 13 + 3 * i)
            move = add(move, scale(place[j, 22 + i] - dot(z, y), z))
        put3(given, j, 0, move)
        for i in range(3):
            pull[j, i] += lam[j - 1, i] - lam[j, i]


@inlined
def work_of(G: Array, d: Array, sums: Array, pull: Array, joints: Array) -> float:
    """[J] twice what a step would still save."""
    work = 0.0
    for k in range(G.shape[0]):
        work += dot(get3(G, k), get3(d, k))
    for j in range(joints.shape[0]):
        work += dot(get3(sums, j), take3(joints, j, FORCE)) + dot(get3(pull, j + 1), take3(joints, j, SHIFTED))
    return abs(work)


@inlined
def farthest(joints: Array, length: float) -> float:
    """Twice the largest step of a support's place / length, to be measured like an angle."""
    largest = 0.0
    for j in range(joints.shape[0]):
        move = take3(joints, j, SHIFTED)
        largest = max(largest, dot(move, move))
    return 2.0 * math.sqrt(largest) / length


@kernel
def kick(
    s: Array, h: Array, sums: Array, pull: Array, given: Array, where: Array, mask: Array, place: Array, forces: int,
    P: Array, Y: Array, W: Array, joints: Array, G: Array, d: Array,
) -> None:  # fmt: skip
    """Fills d with a turn of KICK rad along the softest shapes of the factored, shifted matrix: away from a saddle."""
    last = h.shape[0]
    sums[:, :3] = 0.0
    pull[:, :] = 0.0
    given[:, :] = 0.0
    for k in range(last + 1):
        x = math.pi * s[k] / s[last]
        size = 0.5 * ((h[k - 1] if k > 0 else 0.0) + (h[k] if k < last else 0.0))
        a, b, c = size * math.sin(x), size * math.sin(2.0 * x), size * math.cos(x)
        put3(G, k, 0, (0.8 * a - 0.3 * b + 0.2 * c, 0.5 * a + 0.6 * b - 0.3 * c, 0.2 * a + 0.1 * b + 0.3 * c))
    for _ in range(4):
        for j in range(where.shape[0]):
            for i in range(3):
                G[where[j], i] *= mask[j, i]
        forward(G, sums, pull, given, where, place, forces, P, Y, W, joints)
        largest = backward(where, place, forces, P, Y, W, joints, d)
        for k in range(last + 1):
            size = 0.5 * ((h[k - 1] if k > 0 else 0.0) + (h[k] if k < last else 0.0))
            for i in range(3):
                d[k, i] *= KICK / largest
                G[k, i] = size * d[k, i]
    joints[:, FORCE:] = 0.0


@kernel
def newton(
    q: Array, lam: Array, frames: Array, mesh: tuple[Array, Array, Array, Array], par: Array, where: Array,
    mask: Array, place: Array, forces: int, knots: Array, rings: Array, acts: Array, points: Array, table: Array,
    slides: tuple[Array, Array, Array, Array, Array], guard: bool, most: int, work: Array, info: Array,
) -> int:  # fmt: skip
    """Solves for q, lam, the unknown places in frames and the arc lengths at the eyelets `rings`.

    Returns CONVERGED, STALLED or NOT_FINITE; the step that remains is left in the right-hand sides, for
    `span_defect.correct` to take. mesh: s, h, load, rest, which eyelets change; slides: see `span_slide`; par: see
    `span_drive`. guard: keep to minima; without it any equilibrium is accepted. most: iterations allowed. info as in
    `network.newton`.
    """
    s, h, load, rest = mesh
    turn, push, slope, J, way = slides
    elements = h.shape[0]
    spans = lam.shape[0]
    runs = rings.shape[0] > 0
    D, U, parts, P, Y, W = matrices(work, elements)
    first, full, _, G, d, _ = vectors(work, elements)
    joints, sums, pull, given = joints_of(work, elements, spans)
    stiff, moment, length = par[0:6], par[6:9], s[elements]
    softest = min(stiff[0], stiff[1], stiff[2]) / (length * length)
    wanted = 3 * forces
    shift = largest = 0.0
    iterations = avoided = 0
    pull[:, :] = 0.0
    given[:, :] = 0.0
    while iterations < most:
        iterations += 1
        info[4] += 1.0
        fold(load, lam, where, full)
        assemble(q, full, h, rest, stiff, moment, where, mask, D, U, G, parts, first, sums)
        balance(lam, frames, place, sums, pull, given)
        # far away the last shift is the best bet; near an equilibrium only the unshifted inertia tells
        trial = shift / SHIFT_GROWTH if largest > CHORDS_FROM and shift > FIRST_SHIFT * softest else 0.0
        untested = trial > 0.0
        negative = 0
        for _ in range(MOST_SHIFTS):
            negative = factor(
                D, U, parts, sums, where, mask, place, forces, trial + par[12], h, P, Y, W, joints
            )  # fmt: skip
            if trial == 0.0 or negative == wanted:
                info[2] = negative - wanted
            if not guard:
                break
            if negative == wanted:
                if avoided == MOST_AVOIDED or not shaky(P, stiff):
                    break
                avoided += 1
            trial = max(SHIFT_GROWTH * trial, FIRST_SHIFT * softest)
        if guard and negative != wanted:
            return STALLED
        shift = trial
        if runs:
            columns_of(
                q, lam, s, rest, stiff, where, mask, place, forces, knots, rings, acts, points, table, first, P, Y, W,
                joints, turn, push, slope, J,
            )  # fmt: skip
        forward(G, sums, pull, given, where, place, forces, P, Y, W, joints)
        largest = max(backward(where, place, forces, P, Y, W, joints, d), farthest(joints, length))
        fraction = 1.0
        if runs:
            falling = settle(q, lam, where, rings, turn, push, J, 1.0, d, joints, way)
            info[2] += falling
            if guard and falling > 0:
                return STALLED
            fraction = farthest_way(s, frames, where, knots, rings, forces, par[5] == 0.0, way)
            if fraction == 0.0:
                return STALLED
            largest = longest(d, joints, way, length)
        info[0], info[1], info[3] = iterations, largest, shift
        if not math.isfinite(largest):
            return NOT_FINITE
        if shift > 0.0 and largest < SADDLE and not untested:
            if info[5] >= MOST_KICKS:
                return STALLED
            info[5] += 1.0
            kick(s, h, sums, pull, given, where, mask, place, forces, P, Y, W, joints, G, d)
            way[:] = 0.0
            largest = KICK
        before = max(largest, change_of_moment(d, h, stiff, first, softest * length))
        before = max(before, change_of_force(joints, s, full, where, max(stiff[0], stiff[1])))
        fraction = min(fraction, LARGEST_STEP / largest) if largest > 0.0 else 1.0
        advance(q, lam, frames, d, joints, fraction)
        if runs:
            respace(s, knots, where, rings, way, fraction)
            load_elements(s, acts, points, table, h, load, rest)
        since, stale = before, 0.0
        while shift == 0.0 and fraction == 1.0 and before < CHORDS_FROM and iterations < most:
            iterations += 1
            fold(load, lam, where, full)
            info[6] = gradient(q, full, h, rest, stiff, moment, where, mask, G, first, sums)
            balance(lam, frames, place, sums, pull, given)
            forward(G, sums, pull, given, where, place, forces, P, Y, W, joints)
            largest = max(backward(where, place, forces, P, Y, W, joints, d), farthest(joints, length))
            if runs:
                settle(q, lam, where, rings, turn, push, J, 1.0, d, joints, way)
                largest = longest(d, joints, way, length)
            info[0], info[1] = iterations, largest
            if not math.isfinite(largest):
                return NOT_FINITE
            if largest < STEP_TOLERANCE:
                info[14] = max(stale, min(largest / before, since)) if before > 0.0 else stale
                return CONVERGED
            if largest > 0.5 * before:
                if work_of(G, d, sums, pull, joints) < STEP_TOLERANCE**2 * softest * length:  # along a neutral mode
                    info[14] = stale
                    return CONVERGED
                break
            stale = max(stale, min(largest / before, since))
            advance(q, lam, frames, d, joints, 1.0)
            if runs:
                respace(s, knots, where, rings, way, 1.0)
                load_elements(s, acts, points, table, h, load, rest)
            before = largest
    return STALLED


@inlined
def longest(d: Array, joints: Array, way: Array, length: float) -> float:
    """The largest step: a rotation, or twice that of a place or along the cable / length."""
    largest = farthest(joints, length)
    for k in range(d.shape[0]):
        size = math.sqrt(dot(get3(d, k), get3(d, k)))
        if not size <= largest:
            largest = size
    for c in range(way.shape[0]):
        largest = max(largest, 2.0 * abs(way[c]) / length)
    return largest
