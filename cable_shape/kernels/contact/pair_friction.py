"""Dry friction of cables that cross each other: the law of `friction`, of what two surfaces have gone along each other.

The cables a and b touch at y_a - r_a n, with the unit normal n out of b and y_a - y_b = (r_a + r_b) n. What touched
there in the last solution, at the arc lengths s' and with the normal n', both cables have taken along since: n' is w_a
as the frame of a has turned, w_b as that of b, and the surface of a has gone over that of b by

    d = -P [ r_a w_a + r_b w_b + (s_a - s_a') t_a - (s_b - s_b') t_b ],   P = 1 - n n^T,

which is nothing where both move as one rigid body, and r_a phi across where a rolls by phi. Between asperities that
give by FIRMNESS of the length at the limit, b pulls a by t, and a pulls b by -t, at the point where they touch:

    t = t' - k d  if that is no longer than mu p: it sticks; else as long as that: it slips,

so that the centrelines carry the moments -r_a n x t and -r_b n x t besides. With the limit given, as in `friction`, t
is the gradient of a convex function of z = (theta_a, y_a, theta_b, y_b), for

    dd/dz = P C,   C = (r_a n x R_a, 1, r_b n x R_b, -1),

and C^T K C goes to the network's matrix, K = k P or, of what slips, k mu p / |t' - k d| times as much across its way.
What cables along each other carry along their line is left out. What it adds to Newton's system: `pair_system`.

What stuck is taken to stick at first, whatever that takes, and so is what slips one way in an iteration and would slip
back in the next: it sticks, between asperities that give by far less than it goes in a step.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.friction import FIRMNESS, LEAST, NOTHING, onto
from cable_shape.kernels.contact.link import STAYS, find_pairs, slopes
from cable_shape.kernels.contact.near import ACTIVE, APART, LINK, LINKED, NONE, PUSH, TOWARD, tangent_of, turning
from cable_shape.kernels.contact.tables import Lying
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.tables import TRIAL
from cable_shape.kernels.rod_algebra import (
    Matrix,
    Vector,
    add,
    apply,
    cross,
    dot,
    get4,
    mscale,
    msub,
    outer,
    put3,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
)
from cable_shape.kernels.rod_element import IDENTITY

#: Columns of `Lying.rubs`: what pulls the first cable [N], and does after the step; the last solution's normal in both
#: frames, arc lengths [m] and pull [N] along the first cable and across it; how firm [N/m]; limit [N], and by how much
#: mu times the push was off it; 1: it slips; 1: it touched then; 1: it is taken to stick, -1: to
#: slip; what the law had in the iteration before; of what slips by as much as the push tells the way, unit, else 0;
#: what the push grows by in the step besides [N]; how often it began or ended to slip; what it
#: was taken to be pulled by [N].
PULLED, NEXT, SIDES, ARCS, HELD, FIRM, LIMIT, OFF = 0, 3, 6, 12, 14, 16, 17, 18
SLIPS, KNOWN, STICKS, WAY, DRAWN, MORE, TURNS, SIZE = 19, 20, 21, 22, 25, 28, 29, 30
RUBS = 31
#: So often a pair may begin or end to slip before it has to settle, to steps [rad] no longer than that, in between.
RESTLESS, SETTLED = 3, 3e-7
#: Of what it was pulled by: what is taken to stick has to be pulled by less after the next step.
NEARER = 0.5


@viewing
def roughness(lying: Lying, i: int) -> float:
    """Coefficient of pair i, of both cables the larger one; 0 where they lie along each other."""
    a, b = lying.pairs[i, 0], lying.pairs[i, 1]
    return float(max(lying.rough[a], lying.rough[b])) if lying.pairs[i, STAYS] == 0 else 0.0


@viewing
def any_rub(lying: Lying) -> bool:
    """Whether there is friction between cables."""
    largest = 0.0
    for i in range(lying.pairs.shape[0]):
        largest = max(largest, roughness(lying, i))
    return largest > 0.0


@viewing
def forget_pulls(lying: Lying, all_of_it: bool) -> None:
    """The next limits are mu p; all of it: nor is anything known of what touched before."""
    rubs = lying.rubs[TRIAL]
    for i in range(rubs.shape[0]):
        rubs[i, LIMIT], rubs[i, STICKS] = -1.0, 0.0
        put3(rubs, i, WAY, NONE)
        put3(rubs, i, DRAWN, NONE)
        rubs[i, MORE] = rubs[i, TURNS] = 0.0
        if all_of_it:
            rubs[i, KNOWN] = 0.0
            put3(rubs, i, PULLED, NONE)
            put3(rubs, i, NEXT, NONE)


@viewing(forceinline=True)
def pulled(rubs: Array, on: Array, k: int, column: int) -> Vector:
    """[N], what the other cable of its pair pulls node k by; rubs: those of `on`; column: PULLED or NEXT."""
    t = take3(rubs, on[k, LINK] // 2, column)
    return t if on[k, LINK] % 2 == 0 else scale(-1.0, t)


@viewing
def radius(lying: Lying, i: int, side: int) -> float:
    """[m], that cable's part of the distance to be kept."""
    own, other = lying.thick[lying.pairs[i, side]], lying.thick[lying.pairs[i, 1 - side]]
    return float(lying.reach[i] * own / (own + other))


@viewing
def plane_of(lying: Lying, q: Array, i: int, n: Vector) -> tuple[Vector, Vector]:
    """Two directions square to n: next to the first cable, and across that."""
    t = tangent_of(q, lying.pairs[i, 0])
    e = subtract(t, scale(dot(t, n), n))
    e = scale(1.0 / math.sqrt(max(dot(e, e), 1e-12)), e)
    return e, cross(n, e)


@viewing
def nearest(lying: Lying, q: Array, near: Array, i: int) -> tuple[Vector, Vector]:
    """The normal where both knots of pair i have run to the nearest points, and how far they run [m], and 0.

    Square to one that is on its way there, friction would have a part along the push.
    """
    a, b = lying.pairs[i, 0], lying.pairs[i, 1]
    ra, rb, w11, w12, w22 = slopes(lying, q, near, i)
    most = lying.reach[i]
    first = min(max(-(w11 * ra + w12 * rb), -most), most)
    second = min(max(-(w12 * ra + w22 * rb), -most), most)
    way = add(scale(near[a, APART], take3(near, a, TOWARD)), scale(first, tangent_of(q, a)))
    way = subtract(way, scale(second, tangent_of(q, b)))
    size = math.sqrt(dot(way, way))
    if not size > 0.0:
        return take3(near, a, TOWARD), NONE
    return scale(1.0 / size, way), (first, second, 0.0)


@viewing
def way_of(lying: Lying, q: Array, near: Array, i: int, runs: Vector) -> Vector:
    """-d + something along n [m]; runs: see `nearest`."""
    rubs = lying.rubs[TRIAL]
    way = NONE
    for side in range(2):
        k = lying.pairs[i, side]
        ahead = lying.s[k] - rubs[i, ARCS + side]
        was = take3(rubs, i, SIDES + 3 * side)
        was = subtract(was, scale(ahead, cross(turning(q, lying.h, near, k, lying.flex), was)))
        way = add(way, scale(radius(lying, i, side), apply(rotation(get4(q, k)), was)))
        ahead += runs[side]  # the frame is that of the node as it is
        way = add(way, scale(ahead if side == 0 else -ahead, tangent_of(q, k)))
    return way


@viewing
def law(
    lying: Lying, q: Array, near: Array, i: int, share: float, faint: float, length: float
) -> tuple[Vector, Matrix, bool]:
    """What pair i's second cable pulls its first one by [N], K [N/m], and whether it slips; share: of how firm."""
    rubs = lying.rubs[TRIAL]
    limit = rubs[i, LIMIT]
    if rubs[i, KNOWN] == 0.0 or limit <= 0.0:
        return NONE, NOTHING, True
    n, runs = nearest(lying, q, near, i)
    P = msub(IDENTITY, outer(n, n))
    e, f = plane_of(lying, q, i, n)
    firm = share * max(rubs[i, FIRM], max(limit, faint) / (FIRMNESS * length))
    pull = add(scale(rubs[i, HELD], e), scale(rubs[i, HELD + 1], f))
    pull = add(pull, scale(firm, onto(P, way_of(lying, q, near, i, runs))))
    size = math.sqrt(dot(pull, pull))
    if rubs[i, STICKS] > 0.0 or (size <= limit and not (rubs[i, STICKS] < 0.0 and size > 0.0)):
        return pull, mscale(firm, P), size > limit
    part, along = limit / size, scale(1.0 / size, pull)
    return scale(part, pull), mscale(part * firm, msub(P, outer(along, along))), size > limit


@viewing
def limit_pairs(lying: Lying, near: Array, on: Array, part: float) -> tuple[float, float, float]:
    """As `friction.limits`, of the pairs that touch; a part above 1: mu p itself, see `solve_coupled`."""
    rubs = lying.rubs[TRIAL]
    told, bent = 0.0, 0.0
    left, largest = 0.0, 0.0
    for turn in range(2):
        for i in range(rubs.shape[0]):
            a = lying.pairs[i, 0]
            if on[a, LINKED] != ACTIVE or rubs[i, KNOWN] == 0.0:
                rubs[i, LIMIT] = -1.0
                continue
            limit = roughness(lying, i) * max(near[a, PUSH], 0.0)
            if rubs[i, LIMIT] < 0.0:
                rubs[i, LIMIT], rubs[i, OFF] = limit, 0.0
            off, before = limit - rubs[i, LIMIT], rubs[i, OFF]
            if turn == 0:
                told += before * (off - before)
                bent += (off - before) ** 2 if before != 0.0 else 0.0
            else:
                rubs[i, LIMIT] += min(part, 1.0) * off
                rubs[i, OFF] = off
                left, largest = max(left, abs(off)), max(largest, limit)
        if turn == 0 and bent > 0.0 and part <= 1.0:
            part = min(max(-part * told / bent, LEAST), 1.0)
    return part, left, largest


@viewing
def decide(lying: Lying, q: Array, near: Array, i: int, share: float, faint: float, length: float, step: float) -> bool:
    """Tells whether pair i is taken to stick or to slip; returns whether that has changed. WAY takes what the law has.

    What is taken to stick goes on so as long as that comes nearer to what can be held. What changes to and fro goes on
    as it is until steps are short.
    """
    rubs = lying.rubs[TRIAL]
    taken, before, slipped = rubs[i, STICKS] > 0.0, take3(rubs, i, WAY), rubs[i, SLIPS] != 0.0
    rubs[i, STICKS] = 0.0
    t, _, slips = law(lying, q, near, i, share, faint, length)
    put3(rubs, i, WAY, t)
    stuck = not slipped if before == NONE else dot(t, before) < 0.0
    if rubs[i, TURNS] > RESTLESS and step > SETTLED:
        slips = slipped
        rubs[i, STICKS] = -1.0 if slipped else 1.0
    elif slips and (stuck or taken) and share > 0.0:
        rubs[i, STICKS] = 1.0
        pull, _, _ = law(lying, q, near, i, share, faint, length)
        size = math.sqrt(dot(pull, pull))
        if taken and size > NEARER * rubs[i, SIZE]:
            rubs[i, STICKS] = 0.0
        rubs[i, SIZE] = size
    turned = rubs[i, KNOWN] != 0.0 and slipped != slips
    rubs[i, TURNS] += 1.0 if turned else 0.0
    rubs[i, SLIPS] = 1.0 if slips else 0.0
    return turned


@kernel
def remember_pairs(lying: Lying, which: int, faint: float, length: float) -> None:
    """Makes solution `which` what the next steps count from.

    faint [N]: what pairs are pressed by at least, for how firm they are.
    """
    q, near, on, rubs = lying.q[which], lying.near[which], lying.on[which], lying.rubs[which]
    find_pairs(lying, on)
    for i in range(rubs.shape[0]):
        a, mu = lying.pairs[i, 0], roughness(lying, i)
        rubs[i, KNOWN] = rubs[i, FIRM] = 0.0
        if on[a, LINKED] != ACTIVE:
            put3(rubs, i, PULLED, NONE)
            continue
        n, t = take3(near, a, TOWARD), take3(rubs, i, PULLED)
        e, f = plane_of(lying, q, i, n)
        rubs[i, KNOWN] = 1.0
        rubs[i, FIRM] = mu * max(near[a, PUSH], faint) / (FIRMNESS * length)
        rubs[i, HELD], rubs[i, HELD + 1] = dot(t, e), dot(t, f)
        for side in range(2):
            k = lying.pairs[i, side]
            put3(rubs, i, SIDES + 3 * side, tapply(rotation(get4(q, k)), n))
            rubs[i, ARCS + side] = lying.s[k]
