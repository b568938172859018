"""Where cables that swing come near each other, or themselves: the rows of pairs of `props`.

Cables are looked at as straight pieces first (`distance.cable_near`), with what is near by lying along one cable, or
about a junction, left out as at rest. From there Newton's method finds the two points whose distance is least, on the
cubics between nodes. Where cables lie along each other there is no such place: the first point stays, and the second is
where the other cable is square to the way there. Such rows are half an element apart.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import NONE
from cable_shape.kernels.contact.points import GAP, on_curve, place_for
from cable_shape.kernels.distance.cable_near import HALF_CIRCLE, SPOT, TURN, is_joined, spots
from cable_shape.kernels.network.compiled import inline, part, viewing
from cable_shape.kernels.network.momentum import Momentum
from cable_shape.kernels.network.motion import N_PROPS, PAIRS, PROP, PROPS, Motion
from cable_shape.kernels.network.props import (
    COUNTER,
    DRY,
    ELEMENT,
    GRIP,
    HOLDER,
    LEVEL,
    NORMAL,
    OTHER,
    PAIRED,
    PARTNER,
    PUSH,
    SHARE,
    STUCK,
    WEIGHTS,
    WHICH,
    place_of,
    weigh,
)
from cable_shape.kernels.network.swinging import is_loose
from cable_shape.kernels.network.tables import Floats, Model, Plan, Solution
from cable_shape.kernels.network.walls import along
from cable_shape.kernels.rod_algebra import Vector, add, dot, get3, put3, scale, subtract, take3

#: A row of what may touch: two cables, or one twice; least distance of their centrelines [m]; of one, least cable
#: between two points that do [m]; `cable_near.is_joined` 4 [m].
ONE, TWO, KEEP, SHORTEST, JOINED, TOUCHING = 0, 1, 2, 3, 4, 8
#: A pair of points: their distance [m]; arc lengths [m]; element and share of it of each; normal out of the second 3.
APART, ARC, PLACE, OUT, MEETING = 0, 1, 3, 7, 10
MOST = 256  # of those of two cables
#: Straight pieces of an element, one for so many times the distance to be kept, no more than so many; and by how much
#: of the length of a single piece an element that bends by 1 rad is beside it.
LONG, MOST_PIECES, BULGE = 4.0, 4, 0.125
#: Steps of Newton's method, and how far one may go, in elements; it ends where one is as short as the last number.
STEPS, FAR, SAME = 12, 0.5, 1e-10
#: Of second derivatives of half the squared distance by both arc lengths: smaller is that of cables along each other.
ALONG = 0.03
#: [m], so much nearer pairs may come, and so many times what they go past each other, before they would have a row.
MARGIN, SOONER = 5e-3, 2.0
#: Cosine of the angle between the way from one point to the other and a cable that is square to it.
SQUARE, ASLANT = 0.05, 0.5
#: Of how far apart they are looked for: pairs nearer to each other, along both cables, than that are one.
SAME_PLACE = 0.45
#: Of the distance to be kept: points so near are a pair although they are not the nearest.
CLOSE = 1.2
#: Of the length, in a second: so fast they come apart that overlap.
APART_AGAIN = 0.1


@inline
def piece_count(plan: Plan, model: Model, row: Floats) -> tuple[int, float]:
    """How many straight pieces an element of the cables of a row is, and how long the longest element is [m]."""
    longest = 0.0
    for side in range(2):
        cable = int(row[ONE + side])
        for e in range(plan.first[plan.cables[cable]], plan.first[plan.cables[cable + 1]]):
            longest = max(longest, model.h[e])
    return int(min(max(math.ceil(longest / (LONG * row[KEEP])), 1.0), float(MOST_PIECES))), longest


@kernel
def pieces_of(
    plan: Plan, model: Model, places: Floats, tangents: Floats, cable: int, pieces: int
) -> tuple[Array, Array]:  # fmt: skip
    """Arc lengths (n,) [m] and points (n, 3) of a cable, with so many straight pieces an element."""
    a, b = plan.first[plan.cables[cable]], plan.first[plan.cables[cable + 1]]
    n = pieces * (b - a) + 1
    s, points = np.empty(n), np.empty((n, 3))
    for e in range(a, b):
        node, h = plan.left[e], model.h[e]
        for k in range(pieces + 1):
            x, i = k / pieces, pieces * (e - a) + k
            s[i] = model.s[node] + h * x
            put3(points, i, 0, place_at(plan, model, places, tangents, e, x))
    return s, points


@inline
def place_at(plan: Plan, model: Model, places: Floats, tangents: Floats, e: int, x: float) -> Vector:
    """[m], the cubic of element e at the share x."""
    node = plan.left[e]
    return on_curve(
        model.h[e], x, get3(places, node), get3(places, node + 1), get3(tangents, node), get3(tangents, node + 1)
    )  # fmt: skip


@inline
def rates_at(
    plan: Plan, model: Model, places: Floats, tangents: Floats, e: int, x: float
) -> tuple[Vector, Vector]:  # fmt: skip
    """Its first and second derivative by arc length."""
    node, h, y = plan.left[e], model.h[e], 1.0 - x
    way, p, q = (
        subtract(get3(places, node + 1), get3(places, node)),
        get3(tangents, node),
        get3(tangents, node + 1),
    )
    first = add(scale(6.0 * x * y / h, way), add(scale(y * (1.0 - 3.0 * x), p), scale(x * (3.0 * x - 2.0), q)))
    second = add(scale((6.0 - 12.0 * x) / (h * h), way), scale((6.0 * x - 4.0) / h, p))
    return first, add(second, scale((6.0 * x - 2.0) / h, q))


@inline
def shifted(plan: Plan, model: Model, cable: int, e: int, x: float, by: float) -> tuple[int, float]:
    """Element and share a way `by` [m] further on along a cable, no further than the next element, or its end."""
    a, b = plan.first[plan.cables[cable]], plan.first[plan.cables[cable + 1]]
    x += by / model.h[e]
    if x < 0.0 and e > a:
        return e - 1, min(max(1.0 + x * model.h[e] / model.h[e - 1], 0.0), 1.0)
    if x > 1.0 and e < b - 1:
        return e + 1, min(max((x - 1.0) * model.h[e] / model.h[e + 1], 0.0), 1.0)
    return e, min(max(x, 0.0), 1.0)


@viewing
def at_end(plan: Plan, cable: int, e: int, x: float) -> bool:
    """Whether that is an end of the cable."""
    a, b = plan.first[plan.cables[cable]], plan.first[plan.cables[cable + 1]]
    return (e == a and x == 0.0) or (e == b - 1 and x == 1.0)


@viewing
def approach(
    plan: Plan, model: Model, places: Floats, tangents: Floats, row: Floats, meeting: Floats, stays: bool
) -> bool:  # fmt: skip
    """Moves a pair of points to where they are nearest; False if they are not the nearest of their surroundings.

    Such as all but touch stay where they were. row: of what may touch. stays: the first point does, as where cables lie
    along each other.
    """
    one, two = int(row[ONE]), int(row[TWO])
    e, x, f, y = int(meeting[PLACE]), meeting[PLACE + 1], int(meeting[PLACE + 2]), meeting[PLACE + 3]
    first, at, second, to = e, x, f, y
    far, lies, begun = FAR * min(model.h[e], model.h[f]), False, math.inf
    for k in range(STEPS):
        w = subtract(place_at(plan, model, places, tangents, e, x), place_at(plan, model, places, tangents, f, y))
        t, c = rates_at(plan, model, places, tangents, e, x)
        u, d = rates_at(plan, model, places, tangents, f, y)
        g, q, tt, uu, B = dot(w, t), -dot(w, u), dot(t, t), dot(u, u), -dot(t, u)
        A, C = tt + dot(w, c), uu - dot(w, d)
        if k == 0:
            begun = dot(w, w)
            lies = stays or (not (A > 0.0 and A * C - B * B > ALONG) and tt * uu - B * B < ALONG)
        if not (A > 0.0 and C > 0.0 and A * C - B * B > 0.5 * ALONG):
            A, C = tt, uu
        det = A * C - B * B
        go, on = (0.0, -q / C) if lies or not det > 0.0 else ((q * B - g * C) / det, (g * B - q * A) / det)
        go, on = min(max(go, -far), far), min(max(on, -far), far)
        if at_end(plan, one, e, x) and (go < 0.0) == (x == 0.0) and go != 0.0:
            go, on = 0.0, min(max(-q / C, -far), far)
        elif at_end(plan, two, f, y) and (on < 0.0) == (y == 0.0) and on != 0.0:
            on, go = 0.0, 0.0 if lies else min(max(-g / A, -far), far)
        if abs(go) + abs(on) < SAME:
            break
        e, x = shifted(plan, model, one, e, x, go)
        f, y = shifted(plan, model, two, f, y, on)
    w = subtract(place_at(plan, model, places, tangents, e, x), place_at(plan, model, places, tangents, f, y))
    t, _ = rates_at(plan, model, places, tangents, e, x)
    u, _ = rates_at(plan, model, places, tangents, f, y)
    size = max(math.sqrt(dot(w, w)), 1e-300)
    slants, other = abs(dot(w, t)) / size, abs(dot(w, u)) / size
    found = size <= 1.01 * math.sqrt(begun)
    found = found and (other <= SQUARE or (at_end(plan, two, f, y) and slants < SQUARE))
    if not (found and (slants <= (ASLANT if lies else SQUARE) or at_end(plan, one, e, x))):
        e, x, f, y = first, at, second, to
        w = subtract(place_at(plan, model, places, tangents, e, x), place_at(plan, model, places, tangents, f, y))
        size = math.sqrt(dot(w, w))
        if not 0.0 < size < CLOSE * row[KEEP]:
            return False
    n = scale(1.0 / size, w)
    meeting[APART] = size
    meeting[ARC], meeting[ARC + 1] = model.s[plan.left[e]] + x * model.h[e], model.s[plan.left[f]] + y * model.h[f]
    meeting[PLACE], meeting[PLACE + 1], meeting[PLACE + 2], meeting[PLACE + 3] = e, x, f, y
    meeting[OUT], meeting[OUT + 1], meeting[OUT + 2] = n
    return True


@viewing
def keep_off(
    plan: Plan, model: Model, places: Floats, tangents: Floats, touching: Floats, reach: float, before: Floats,
    before_tangents: Floats,
) -> bool:  # fmt: skip
    """Whether no cables that may touch are within `reach` [m] of what is to be kept, for all are single and straight
    enough; nor have gone through themselves since `before`.

    The slope of a cubic is between those of its Bezier points. If all have at least a part c along the way from end to
    end, points are as far apart as c times the cable between them: as on half a circle if c is more than 2 / pi, and
    else those between which it turns so far that they may count as near. No way between two shapes that both go on in
    one direction goes through itself.
    """
    for k in range(touching.shape[0]):
        cable = int(touching[k, ONE])
        if int(touching[k, TWO]) != cable:
            return False
        to = end_to_end(plan, places, cable)
        along = ways_along(plan, model, places, tangents, cable, to)
        if not (along > 0.0 and ways_along(plan, model, before, before_tangents, cable, to) > 0.0):
            return False
        if along <= HALF_CIRCLE * (1.0 + SAME):
            pieces, step = piece_count(plan, model, touching[k])
            within = touching[k, KEEP] + reach + 2.0 * BULGE * step / pieces**2
            if along * shortest_turn(plan, model, places, tangents, cable) <= within:
                return False
    return True


@inline
def end_to_end(plan: Plan, places: Floats, cable: int) -> Vector:
    """A unit vector from the start of a cable to its end, 0 if there is none."""
    j, k = plan.cables[cable], plan.cables[cable + 1]
    way = subtract(get3(places, plan.first[k] + k - 1), get3(places, plan.first[j] + j))
    size = math.sqrt(dot(way, way))
    return scale(1.0 / size, way) if size > 0.0 else NONE


@inline
def slope_between(model: Model, places: Floats, tangents: Floats, node: int, e: int) -> Vector:
    """Of the Bezier points of the slope of a cubic the one between its ends."""
    way = scale(3.0 / model.h[e], subtract(get3(places, node + 1), get3(places, node)))
    return subtract(way, add(get3(tangents, node), get3(tangents, node + 1)))


@inline
def ways_along(plan: Plan, model: Model, places: Floats, tangents: Floats, cable: int, to: Vector) -> float:
    """How far a cable goes at least along a direction, of its length."""
    least = math.inf
    for e in range(plan.first[plan.cables[cable]], plan.first[plan.cables[cable + 1]]):
        node = plan.left[e]
        least = min(least, dot(to, get3(tangents, node)), dot(to, get3(tangents, node + 1)))
        least = min(least, dot(to, slope_between(model, places, tangents, node, e)))
    return least


@inline
def shortest_turn(plan: Plan, model: Model, places: Floats, tangents: Floats, cable: int) -> float:
    """[m], at least so much of a cable is between places that count as near: it turns by `cable_near.TURN` there."""
    a, b = plan.first[plan.cables[cable]], plan.first[plan.cables[cable + 1]]
    turned = arc = 0.0
    first, shortest = a, math.inf
    for e in range(a, b):
        turned, arc = turned + bends(plan, model, places, tangents, e), arc + model.h[e]
        while turned >= TURN:  # less without the element at either end
            shortest = min(shortest, arc - model.h[first] - model.h[e])
            turned, arc = turned - bends(plan, model, places, tangents, first), arc - model.h[first]
            first += 1
    return max(shortest, 0.0)


@inline
def bends(plan: Plan, model: Model, places: Floats, tangents: Floats, e: int) -> float:
    """[rad], by how much the cubic of an element turns at most."""
    node = plan.left[e]
    between = slope_between(model, places, tangents, node, e)
    size = math.sqrt(dot(between, between))
    if size == 0.0:
        return math.pi
    between = scale(1.0 / size, between)
    total = 0.0
    for k in range(2):
        way = subtract(between, get3(tangents, node + k))
        square = dot(way, way)
        total += math.sqrt(square) * (1.0 + 0.15 * square) if square < 2.0 else math.pi
    return total


@kernel
def meet(
    plan: Plan, model: Model, places: Floats, tangents: Floats, row: Array, reach: float, out: Array
) -> int:  # fmt: skip
    """Fills out (MOST, MEETING) with where two cables that may touch are within `reach` [m]; returns how many."""
    one, two = int(row[ONE]), int(row[TWO])
    pieces, step = piece_count(plan, model, row)
    s, p = pieces_of(plan, model, places, tangents, one, pieces)
    u, r = (s, p) if one == two else pieces_of(plan, model, places, tangents, two, pieces)
    a, b = plan.first[plan.cables[one]], plan.first[plan.cables[two]]
    joined, found, meeting = row[JOINED:].reshape(2, 2), np.empty((MOST, SPOT)), np.empty(MEETING)
    aside = beside_of(step, row)
    count = spots(p, s, r, u, one == two, row[SHORTEST], joined, reach + 2.0 * BULGE * step / pieces**2, aside, found)
    kept = 0
    for k in range(count):
        for side in range(2):
            first, arcs = (a, s) if side == 0 else (b, u)
            i = 0
            while i < arcs.shape[0] - 2 and arcs[i + 1] <= found[k, 1 + side]:
                i += 1
            e = first + i // pieces
            meeting[PLACE + 2 * side] = e
            share = (found[k, 1 + side] - model.s[plan.left[e]]) / model.h[e]
            meeting[PLACE + 2 * side + 1] = min(max(share, 0.0), 1.0)
        if not approach(plan, model, places, tangents, row, meeting, False) or meeting[APART] > reach:
            continue
        if one == two and meeting[ARC + 1] - meeting[ARC] < row[SHORTEST]:
            continue
        if is_joined(meeting[ARC], s[s.shape[0] - 1], meeting[ARC + 1], u[u.shape[0] - 1], joined):
            continue
        kept = keep(meeting, SAME_PLACE * aside, out, kept)
    return kept


@inline
def beside_of(step: float, row: Floats) -> float:
    """[m], how far apart pairs are at least, of cables of a row with elements up to `step` [m] long."""
    return max(0.5 * step, 2.0 * row[KEEP])


@kernel
def keep(meeting: Array, aside: float, out: Array, count: int) -> int:
    """Puts a pair of points among those of `out`, unless a nearer one is beside it; returns how many there are."""
    left = 0
    for k in range(count):
        beside = abs(out[k, ARC] - meeting[ARC]) < aside and abs(out[k, ARC + 1] - meeting[ARC + 1]) < aside
        if beside and out[k, APART] <= meeting[APART]:
            return count
    for k in range(count):
        beside = abs(out[k, ARC] - meeting[ARC]) < aside and abs(out[k, ARC + 1] - meeting[ARC + 1]) < aside
        if not beside:
            out[left] = out[k]
            left += 1
    out[left] = meeting
    return left + 1


@kernel
def find_pairs(
    plan: Plan, model: Model, motion: Motion, memory: Momentum, touching: Array, whole: Array, rough: Array,
    reach: float, dt: float, had: int,
) -> None:  # fmt: skip
    """Adds the pairs of points that may come to touch, within `reach` [m] in a part dt [s], the nearest if not all.

    They come after all other points.
    had: how many of `points.put_aside` there are; forces go on from those. Cables that overlap come apart by and by.
    """
    was, props = part(motion.aside, 0, (PROPS + PAIRS, PROP)), motion.props
    first, found = int(motion.par[N_PROPS]), np.empty((MOST, MEETING))
    for k in range(touching.shape[0]):
        keep_off = touching[k, KEEP]
        count = meet(plan, model, memory.place, memory.tangent, touching[k], keep_off + reach, found)
        for j in range(count):
            gap, e, f = found[j, APART] - keep_off, int(found[j, PLACE]), int(found[j, PLACE + 2])
            if gap > MARGIN + SOONER * (closing(plan, memory, e, found[j, PLACE + 1], f, found[j, PLACE + 3], dt)):
                continue
            i = place_for(motion, first, first + PAIRS, gap)
            if i < 0:
                continue
            for c in range(PROP):
                props[i, c] = 0.0
            props[i, HOLDER], props[i, WHICH], props[i, GAP] = PAIRED, k, gap
            put_pair(model, props, i, found[j])
            n = take3(props, i, NORMAL)
            put3(props, i, STUCK, place_of(plan, props, i, memory.place, memory.tangent))
            props[i, LEVEL] = min(keep_off, found[j, APART] + APART_AGAIN * dt * whole[plan.left[e]])
            b = pressed_before(plan, model, was, had, k, found[j, ARC], found[j, ARC + 1], model.h[e])
            if b >= 0 or gap < keep_off:  # what is further away does not rub in the part in which it arrives
                props[i, GRIP] = max(rough[plan.left[e]], rough[plan.left[f]])
            if b >= 0:
                props[i, PUSH] = was[b, PUSH]
                put3(props, i, DRY, along(n, take3(was, b, DRY)))


@viewing
def parted(plan: Plan, motion: Motion, memory: Momentum, now: Solution, sol: Solution, dt: float) -> float:
    """[m], by how much more than all together nodes, and given knots, go in a part dt [s] of a step at most."""
    mass, v, a = 0.0, NONE, NONE
    for k in range(memory.mass.shape[0]):
        mass += memory.mass[k]
        v = add(v, scale(memory.mass[k], get3(memory.velocity, k)))
        a = add(a, scale(memory.mass[k], get3(memory.acceleration, k)))
    v, a, most = scale(1.0 / mass, v), scale(1.0 / mass, a), 0.0
    for k in range(memory.mass.shape[0]):
        w, b = subtract(get3(memory.velocity, k), v), subtract(get3(memory.acceleration, k), a)
        most = max(most, dt * math.sqrt(dot(w, w)) + dt * dt * math.sqrt(dot(b, b)))
    for k in range(sol.pose.shape[0]):
        if plan.vertices[k, 1] < 0 and not is_loose(plan, motion, k):
            w = subtract(subtract(take3(sol.pose, k, 0), take3(now.pose, k, 0)), scale(dt, v))
            most = max(most, math.sqrt(dot(w, w)))
    return most


@inline
def closing(plan: Plan, memory: Momentum, e: int, x: float, f: int, y: float, dt: float) -> float:
    """[m], how far the points at shares x and y of two elements go past each other in dt [s], by what chords do."""
    a, b = plan.left[e], plan.left[f]
    v = between(memory.velocity, a, x)
    w = between(memory.acceleration, a, x)
    v, w = subtract(v, between(memory.velocity, b, y)), subtract(w, between(memory.acceleration, b, y))
    return dt * math.sqrt(dot(v, v)) + dt * dt * math.sqrt(dot(w, w))


@inline
def between(rows: Floats, node: int, x: float) -> Vector:
    """The mean of a row and the next one."""
    return add(scale(1.0 - x, get3(rows, node)), scale(x, get3(rows, node + 1)))


@inline
def put_pair(model: Model, props: Floats, i: int, meeting: Floats) -> None:
    """Fills in where pair i is: its points, their weights, and the way out of the second."""
    props[i, ELEMENT], props[i, SHARE] = meeting[PLACE], meeting[PLACE + 1]
    props[i, PARTNER], props[i, OTHER] = meeting[PLACE + 2], meeting[PLACE + 3]
    weigh_pair(props, i, model.h[int(meeting[PLACE])], model.h[int(meeting[PLACE + 2])])
    put3(props, i, NORMAL, (meeting[OUT], meeting[OUT + 1], meeting[OUT + 2]))


@inline
def weigh_pair(props: Floats, i: int, h: float, other: float) -> None:
    """Fills the weights of pair i from its shares of elements so long [m]."""
    own = props[i, SHARE]
    props[i, SHARE] = props[i, OTHER]
    weigh(props, i, other)
    for c in range(4):
        props[i, COUNTER + c] = -props[i, WEIGHTS + c]
    props[i, SHARE] = own
    weigh(props, i, h)


@inline
def pressed_before(
    plan: Plan, model: Model, was: Floats, had: int, which: int, s: float, u: float, near: float
) -> int:  # fmt: skip
    """Which of the pairs before pressed nearest to these arc lengths [m], no further away than `near`; -1: none."""
    found, least = -1, near
    for k in range(had):
        if was[k, HOLDER] != PAIRED or int(was[k, WHICH]) != which or not was[k, PUSH] > 0.0:
            continue
        e, f = int(was[k, ELEMENT]), int(was[k, PARTNER])
        away = abs(model.s[plan.left[e]] + was[k, SHARE] * model.h[e] - s)
        away += abs(model.s[plan.left[f]] + was[k, OTHER] * model.h[f] - u)
        if away < least:
            found, least = k, away
    return found
