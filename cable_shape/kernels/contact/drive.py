"""One solve of a cable pressed on bodies, in one compiled call: predict, Newton, judge, sample, look, accept."""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.ahead import meet_supports, predict
from cable_shape.kernels.contact.check import passes
from cable_shape.kernels.contact.errors import AMISS, SAFETY, contact_error, position_error
from cable_shape.kernels.contact.friction import FAINT, goes_on, remember
from cable_shape.kernels.contact.knots import close, from_model, place_nodes, press_on, put, walk
from cable_shape.kernels.contact.lay import laid
from cable_shape.kernels.contact.link import find_pairs, look_at_links, tie_pairs
from cable_shape.kernels.contact.near import GRIP_EXCLUSION, NORMAL, ROUND
from cable_shape.kernels.contact.pair_friction import remember_pairs
from cable_shape.kernels.contact.pair_system import goes_on_pairs
from cable_shape.kernels.contact.press import I_ASSEMBLIES, I_EXCESS, I_ITERATIONS, RUNNING, press, tell_pushes
from cable_shape.kernels.contact.run import any_crowded
from cable_shape.kernels.contact.tables import Bodies, Lying, Net
from cable_shape.kernels.distance.bounds import closest_points
from cable_shape.kernels.network import drive as network
from cable_shape.kernels.network.drive import BROKEN, FAR, knot_loads, sample
from cable_shape.kernels.network.graph import factor
from cable_shape.kernels.network.gripping import FROM, SLIPPED, TO, end_grips
from cable_shape.kernels.network.newton import CONVERGED, STALLED
from cable_shape.kernels.network.respond import SLIGHT
from cable_shape.kernels.network.sliding import cut_short, move_along, slides_of
from cable_shape.kernels.network.system import assemble, gradient
from cable_shape.kernels.network.tables import (
    BASE_SHIFT,
    BEFORE,
    GRIP,
    LENGTH,
    N_CABLES,
    N_KNOTS,
    NOW,
    SOFTEST,
    TRIAL,
    copy,
    copy_rows,
    model_of,
    plan_of,
    solution_of,
    solution_size,
    still_knots,
    work_of,
)
from cable_shape.kernels.rod_algebra import dot, get4, qconj, qmul, take3
from cable_shape.kernels.rod_output import all_finite

#: What `solve` tells in `info` besides `press`: residual, estimated error [m], energy [J], twist [rad], error of the
#: interpolation [m], largest turn of a frame against its prediction and of an element [rad], the part of the estimate
#: that is the contacts' [m], how far frames have turned since the factors at hand [rad], infinite: none to start from.
I_RESIDUAL, I_ESTIMATE, I_ENERGY, I_TWIST, I_INTERPOLATION, I_TURNED, I_TURN, I_CONTACTS, AGE = (
    5, 7, 8, 9, 10, 12, 13, 16, 18,
)  # fmt: skip
INFO = 20
OLDEST = 0.03  # rad: factors from further away serve no more
QUICK = 3  # iterations: after more of them the factors are too old
UNSETTLED = 8  # an equilibrium, but something is left to be done about it


@kernel
def turned(p: Array, q: Array) -> float:
    """Largest angle between the frames p and q (N+1, 4) of a node [rad]."""
    largest = 0.0
    for k in range(q.shape[0]):
        miss = qmul(qconj(get4(p, k)), get4(q, k))
        largest = max(largest, miss[0] * miss[0] + miss[1] * miss[1] + miss[2] * miss[2])
    return 2.0 * math.asin(min(1.0, math.sqrt(largest)))


@kernel
def begin(lying: Lying, net: Net, a: float) -> bool:
    """Lets cables run on through their eyelets by `a` times the last step, and turns what is held with its grips.

    False: there is no room for the network.
    """
    ints, floats, sols = net.ints, net.floats, net.sols
    near = lying.near[TRIAL]
    if not laid(net, lying, lying.on[TRIAL]):
        place_nodes(net, lying.s)
    if ints[N_CABLES] == 0:
        return False
    supports = lying.held.shape[0]
    for i in range(supports, lying.slid.shape[1]):
        lying.slid[TRIAL, i] = lying.slid[NOW, i]
    count_on(lying.slid[TRIAL, supports:])
    if net.run.shape[0] > 0 and a != 0.0:
        put(net, lying, TRIAL, near, NORMAL)
        slides, plan = slides_of(ints, net.run), plan_of(net.bare)
        friction = model_of(ints, floats).friction
        for c in range(slides.way.shape[0]):
            j = plan.rings[c, 1]
            held = j + net.cable[net.piece[j]] + 1
            sticks = friction[c] > 0.0 and lying.slid[NOW, supports + c * GRIP + SLIPPED] == 0.0
            slides.way[c] = 0.0 if sticks else a * (lying.slid[NOW, held] - lying.slid[BEFORE, held])
        move_along(ints, floats, net.run, cut_short(ints, floats, sols, net.run))
        from_model(net, lying.s, lying.h)
    meet_supports(lying, net)
    return True


@kernel
def count_on(grips: Array) -> None:
    """Has what eyelets remember (e GRIP,) count from where it ended, see `gripping`."""
    for c in range(grips.shape[0] // GRIP):
        for i in range(3):
            grips[c * GRIP + FROM + i] = grips[c * GRIP + TO + i]


@kernel
def solve(
    lying: Lying, bodies: Bodies, net: Net, before: Array, out: Array, loads: Array, info: Array, points: int,
    cables: int, history: int, most: int, far: float, weight: float, limp: bool, sunk: float, drag: float,
    running: int, horizon: float, deepest: float, fine: float, gentle: int,
) -> int:  # fmt: skip
    """Solves for what holds the cable in the trial of `lying`, to an equilibrium there: CONVERGED or UNSETTLED.

    Else STALLED, NOT_FINITE, BROKEN or FAR. history: so many solutions, 1 or 2, to start from. far [rad]: largest turn
    of a frame from its prediction that is accepted. weight to running, gentle: see `press`. out: 17 points a cable, as
    CableShape.buffer; loads (k, 7): what knots carry, as `network.drive.knot_loads` has it. cables: so many of the
    first ones touch bodies. info takes three numbers of each cable, too, see `network.drive.INFO`. before to fine: see
    `look_over`; UNSETTLED is what it says, and if it finds nothing the trial has become the solution now. A failure
    leaves the mesh to be put back.
    """
    a = predict(lying, net, history)
    there = begin(lying, net, a)
    q, near, on, h = lying.q[TRIAL], lying.near[TRIAL], lying.on[TRIAL], lying.h
    copy_rows(lying.start, q, q.shape[1])
    age = info[AGE] + turned(lying.q[NOW], q)
    factored = history > 1 and drag == 0.0 and info[I_EXCESS] == 0.0 and age < OLDEST
    info[:] = 0.0
    info[AGE] = math.inf
    if not there:
        return STALLED
    status = press(lying, bodies, net, weight, limp, sunk, most, drag, running, factored, gentle, info)
    if status != CONVERGED:
        return status
    info[I_TURNED] = turned(lying.start, q)
    if not info[I_TURNED] <= far:
        return FAR
    ints, floats, sols, space = net.ints, net.floats, net.sols, net.space
    for j in range(lying.held.shape[0]):
        lying.slid[TRIAL, j] = lying.s[lying.held[j]]
    off = position_error(net, lying.errors)
    uncorrected(lying, net)
    end_grips(ints, floats, sols)
    grip, supports = solution_of(ints, sols, TRIAL).grip, lying.held.shape[0]
    for c in range(grip.shape[0]):
        copy(lying.slid[TRIAL, supports + c * GRIP : supports + (c + 1) * GRIP], grip[c])
    par = model_of(net.bare, net.made).par
    faint = FAINT * (weight + par[SOFTEST])
    remember(lying, bodies, faint, par[LENGTH])
    remember_pairs(lying, TRIAL, faint, par[LENGTH])
    seen = np.zeros(network.INFO + 3 * lying.turns.shape[1])
    sample(ints, floats, sols, space, points, out, seen)
    knot_loads(ints, floats, space, loads[: ints[N_KNOTS]])
    tell_pushes(net, lying, near, on)
    info[I_ENERGY], info[I_TWIST] = seen[network.I_ENERGY], seen[network.INFO]
    copy(info[INFO:], seen[network.INFO :])
    for c in range(lying.turns.shape[1]):
        info[INFO + 2 * c + 1] = lying.turns[TRIAL, c]
    info[I_INTERPOLATION], info[I_RESIDUAL] = seen[network.I_INTERPOLATION], seen[network.I_RESIDUAL]
    info[I_ESTIMATE] = SAFETY * (off + info[I_INTERPOLATION])
    info[I_CONTACTS] = contact_error(net, q, near, on, h, ROUND / model_of(ints, floats).par[LENGTH], lying.flex)
    info[I_ESTIMATE] += AMISS * info[I_CONTACTS]
    least = 1.0  # cosine of half the angle
    for k in range(h.shape[0]):
        if h[k] != 0.0:
            least = min(least, abs(qmul(qconj(get4(q, k)), get4(q, k + 1))[3]))
    info[I_TURN] = 2.0 * math.acos(least)
    if not all_finite(out) or not all_finite(info[0:5]) or not all_finite(info[8:14]):
        return BROKEN
    if drag == 0.0:
        info[AGE] = 0.0 if info[I_ASSEMBLIES] > 0.0 else (age if info[I_ITERATIONS] <= QUICK else math.inf)
    if look_over(lying, bodies, cables, out, points, info, sunk, before, running, horizon, deepest, fine):
        return UNSETTLED
    accept(lying, False)
    return CONVERGED


@kernel
def uncorrected(lying: Lying, net: Net) -> None:
    """Makes the last solution what `network.drive.sample` takes for one without its discretisation error."""
    ints, floats, sols, space = net.ints, net.floats, net.sols, net.space
    near = lying.near[TRIAL]
    place_nodes(net, lying.s)
    put(net, lying, TRIAL, near, NORMAL)
    gradient(ints, floats, sols, space)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    walk(net, near)
    close(net, near)
    for i in range(net.moves.shape[0]):
        if net.moves[i] != 0:
            for c in range(3):
                lying.grips[TRIAL, i, c] = sol.pose[i, c]
    copy_rows(work.start, sol.q, 4)
    copy_rows(work.pulled, sol.lam, 3)
    copy_rows(work.place, sol.pose, 3)
    for e in range(work.moments.shape[0]):
        for c in range(3):
            work.moments[e, c], work.moments[e, 3 + c] = -work.first[e, 3 + c], work.first[e, 6 + c]


@kernel
def look_over(
    lying: Lying, bodies: Bodies, cables: int, out: Array, points: int, info: Array, sunk: float, before: Array,
    running: int, horizon: float, deepest: float, fine: float,
) -> bool:  # fmt: skip
    """Whether anything is left to be done about the trial, whose shape is `out`.

    That is a cable deeper in a body than `deepest` [m], but for `sagitta`, see `closest_points` for horizon; a body
    that it may have passed since it was at `before` (cables n, 3; n = 0: anywhere) and the bodies in `Bodies.then`;
    contacts whose part of the error [m] is above `fine` (infinite: may be), or AMISS times that in all; contacts that
    were stopped while they ran, or that have come up to a node, unless `running` says that none runs. A negative
    `deepest`: who calls will see.
    """
    if deepest < 0.0:
        return True
    if fine < math.inf and (info[I_ITERATIONS] > RUNNING or info[I_CONTACTS] > fine or info[I_ESTIMATE] > AMISS * fine):
        return True
    node = 0
    for c in range(cables):
        own = out[17 * points * c : 17 * points * (c + 1)]
        s, positions = own[:points], own[points : 4 * points].reshape(points, 3)
        radius = lying.thick[node]
        closest_points(
            positions, s, radius, horizon, GRIP_EXCLUSION, True, bodies.table, bodies.links, bodies.triangles,
            bodies.tree, bodies.measured, bodies.counts,
        )  # fmt: skip
        for m in range(bodies.measured.shape[0]):
            sag = sagitta(own, points, bodies.measured[m, 1]) if bodies.measured[m, 0] + sunk < -deepest else 0.0
            if bodies.measured[m, 0] + sunk + sag < -deepest:
                return True
        if before.shape[0] > 0 and passes(
            s, before[points * c : points * (c + 1)], positions, bodies.table, bodies.frames, bodies.then,
            bodies.triangles, bodies.tree, radius, bodies.stack,
        ):  # fmt: skip
            return True
        node += 1
        while node < lying.h.shape[0] and lying.h[node - 1] != 0.0:
            node += 1
    return bool(running > 0 and any_crowded(lying.near[TRIAL], lying.on[TRIAL], lying.q[TRIAL], lying.h, lying.flex))


@kernel
def sagitta(own: Array, points: int, arc: float) -> float:
    """[m], by how much the straight line between the two points of a shape about `arc` [m] is off the cable.

    own: the shape's numbers, as CableShape.buffer.
    """
    h = own[points - 1] / (points - 1)
    first = min(int(arc / h), points - 2)
    largest = 0.0
    for k in range(first, first + 2):
        u = take3(own[8 * points : 11 * points].reshape(points, 3), k, 0)
        largest = max(largest, dot(u, u))
    return 0.125 * h * h * math.sqrt(largest)


@kernel
def accept(lying: Lying, again: bool) -> None:
    """Makes the trial the solution now, and what was now the one before; `again`: it is the same one, solved again."""
    if not again:
        take_over(lying, BEFORE, NOW)
    take_over(lying, NOW, TRIAL)


@kernel
def take_over(lying: Lying, to: int, of: int) -> None:
    """Makes a solution a copy of another."""
    copy_rows(lying.q[to], lying.q[of], lying.q.shape[2])
    copy_rows(lying.near[to], lying.near[of], lying.near.shape[2])
    copy_rows(lying.on[to], lying.on[of], lying.on.shape[2])
    copy_rows(lying.ends[to], lying.ends[of], lying.ends.shape[2])
    copy_rows(lying.grips[to], lying.grips[of], lying.grips.shape[2])
    copy(lying.turns[to], lying.turns[of])
    copy(lying.slid[to], lying.slid[of])
    copy_rows(lying.rubs[to], lying.rubs[of], lying.rubs.shape[2])


@kernel
def refresh(lying: Lying, net: Net) -> None:
    """Assembles and factors the matrix of the solution now with its contacts; the network's solution is that one."""
    q, near, on = lying.q[NOW], lying.near[NOW], lying.on[NOW]
    ints, floats, sols, space = net.ints, net.floats, net.sols, net.space
    if not laid(net, lying, on):
        place_nodes(net, lying.s)
    put(net, lying, NOW, near, NORMAL)
    assemble(ints, floats, sols, space)
    walk(net, near)
    close(net, near)
    par = model_of(ints, floats).par
    press_on(net, q, lying.h, near, on, ROUND / par[LENGTH], lying.flex, 0.0, False)
    goes_on(net, near, on)
    find_pairs(lying, on)
    look_at_links(lying, near)
    tie_pairs(net, lying, q, near, on, False)
    goes_on_pairs(net, lying, q, near, on, NOW)
    still_knots(model_of(ints, floats))
    factor(ints, floats, space, SLIGHT * par[BASE_SHIFT])
    size = solution_size(ints)
    copy(sols[0:size], sols[2 * size : 3 * size])
