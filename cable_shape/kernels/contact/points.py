"""Where bodies may hold a swinging cable between two of its nodes: planes for points inside elements, see `props`."""

from __future__ import annotations

import math

from cable_shape.kernels.contact.check import carried
from cable_shape.kernels.contact.guard import excluded
from cable_shape.kernels.contact.near import NONE
from cable_shape.kernels.contact.tables import Bodies
from cable_shape.kernels.distance.distance import MESH
from cable_shape.kernels.distance.surface import touch
from cable_shape.kernels.network.compiled import inline, part, viewing
from cable_shape.kernels.network.momentum import Momentum, of_mass
from cable_shape.kernels.network.motion import N_PROPS, PAIRS, PROP, PROPS, Motion
from cable_shape.kernels.network.props import (
    DRY,
    ELEMENT,
    GAVE,
    GRIP,
    HOLDER,
    LEVEL,
    NORMAL,
    PAIRED,
    PUSH,
    SHARE,
    STUCK,
    place_of,
    side_of,
    sides,
    sticks,
    weigh,
)
from cable_shape.kernels.network.tables import Floats, Model, Plan
from cable_shape.kernels.network.walls import along
from cable_shape.kernels.rod_algebra import Vector, add, apply, dot, get3, put3, scale, subtract, take3

#: Of the length, in swings: a body that much nearer to a point of an element than to both its nodes has a plane there.
NEARER = 1e-5
#: Of an element: where on it a body is nearest is found so well, in so many looks.
LOOKS, GOLDEN = 7, 0.6180339887498949
#: And then by so many steps of Newton's method, which end where one is as short as that: places depend on it smoothly.
STEPS, SAME, NEXT = 6, 1e-12, 0.05
#: Of the length: that much further on along the cable an eyelet is looked for. Columns of one: place 3 [m], cable, arc
#: length [m], force on the cable 3 [N], its way in this part of a step 3 [m].
FURTHER, RING, WENT = 0.05, 11, 8
#: What `knot_of` says of ends of elements that are in no knot, and in one that is given.
INSIDE, HELD = -1, -2
GAP = 19  # column of a point: how far the body was before the step [m]


@inline
def on_curve(h: float, x: float, a: Vector, b: Vector, ta: Vector, tb: Vector) -> Vector:
    """The cubic from a to b with slopes ta and tb at the share x of it, of length h."""
    y = 1.0 - x
    r = add(scale(y * y * (1.0 + 2.0 * x), a), scale(x * x * (3.0 - 2.0 * x), b))
    return add(r, add(scale(h * x * y * y, ta), scale(-h * x * x * y, tb)))


@inline
def gap_at(
    bodies: Bodies, b: int, h: float, x: float, p: Vector, q: Vector, tp: Vector, tq: Vector, thick: float
) -> float:  # fmt: skip
    """[m], from body b to the cable at the share x of an element whose ends went with the body to p and q."""
    at = on_curve(h, x, p, q, tp, tq)
    d, _, _ = touch(bodies.table[b], bodies.frames[b], bodies.triangles, bodies.tree, at, NONE, False, bodies.stack)
    return d - thick


@inline
def put_aside(motion: Motion) -> tuple[int, Floats]:
    """Puts points aside for others to come; returns how many there were, and those."""
    had, was = int(motion.par[N_PROPS]), part(motion.aside, 0, (PROPS + PAIRS, PROP))
    for i in range(had):
        for c in range(PROP):
            was[i, c] = motion.props[i, c]
    motion.par[N_PROPS] = 0.0
    return had, was


@viewing
def find_points(
    plan: Plan, model: Model, motion: Motion, places: Floats, tangents: Floats, bodies: Bodies, thick: Floats,
    whole: Floats, rough: Floats, reach: float, nearer: float, edges: bool, room: int,
) -> None:  # fmt: skip
    """Fills the points of elements that bodies within `reach` [m] of them may hold, the nearest `room` of them.

    places, tangents (n, 3): of the nodes. A body that is nearer to a point of an element than to both of its nodes, by
    the part `nearer` of the length, has a plane there; edges: but not one that a plane at one of them has behind it.

    Forces go on from before, and so does a point that a body presses, unless its nodes are nearer to that. An end that
    nothing holds is one: where it is its own rotation tells, too, and planes that know of its forces alone would let
    Newton's method go to and fro.
    """
    had, was = put_aside(motion)
    for e in range(plan.left.shape[0]):
        node, h = plan.left[e], model.h[e]
        fat, length = thick[node], whole[node]
        if fat < 0.0:
            continue
        for b in range(bodies.table.shape[0]):
            if excluded(bodies, b, model.s[node] + 0.5 * h, length):
                continue
            then, now = bodies.then[b], bodies.frames[b]
            p, q = carried(get3(places, node), then, now), carried(get3(places, node + 1), then, now)
            tp = subtract(carried(add(get3(places, node), get3(tangents, node)), then, now), p)
            tq = subtract(carried(add(get3(places, node + 1), get3(tangents, node + 1)), then, now), q)
            middle, least = nearest_bound(bodies, b, h, p, q, tp, tq, fat)
            if middle - 0.6 * h > reach or least > reach:
                continue
            first, last = gap_at(bodies, b, h, 0.0, p, q, tp, tq, fat), gap_at(bodies, b, h, 1.0, p, q, tp, tq, fat)
            k = before_at(was, had, e, b, False)
            pressed = k >= 0 and was[k, PUSH] > 0.0
            x, gap = 0.5, math.inf
            margin = (nearer if pressed else -nearer) * length
            if least < min(first, last) + margin:
                x, gap = nearest(bodies, b, h, p, q, tp, tq, fat, middle)
            for tip in range(2):
                if tip == 1:
                    x, gap, k = 1.0, last, before_at(was, had, e, b, True)
                wanted = gap < min(first, last) + margin
                if gap > reach or not (wanted if tip == 0 else motion.loose[node + 1] != 0.0):
                    continue
                if (
                    edges
                    and not pressed
                    and (faces(bodies, b, p, q, fat, nearer * length) or faces(bodies, b, q, p, fat, nearer * length))
                ):
                    continue
                i = place_for(motion, 0, room, gap)
                if i < 0:
                    continue
                props = motion.props
                for c in range(PROP):
                    props[i, c] = 0.0
                x = x if tip == 1 else found_again(bodies, b, h, x, p, q, tp, tq)
                props[i, ELEMENT], props[i, HOLDER], props[i, SHARE], props[i, GAP] = e, b, x, gap
                weigh(props, i, h)
                at = on_curve(h, x, p, q, tp, tq)
                d, n, _ = touch(
                    bodies.table[b], bodies.frames[b], bodies.triangles, bodies.tree, at, NONE, False, bodies.stack
                )  # fmt: skip
                put3(props, i, NORMAL, n)
                props[i, LEVEL] = dot(n, at) - (d - fat)
                props[i, GRIP] = max(rough[node], bodies.rough[b])
                put3(props, i, STUCK, at)
                if k >= 0:
                    props[i, PUSH] = was[k, PUSH]
                    put3(props, i, DRY, along(n, take3(was, k, DRY)))


@inline
def faces(bodies: Bodies, b: int, p: Vector, q: Vector, thick: float, off: float) -> bool:
    """Whether q [m] is no further than `off` behind the plane between p and body b: so is then what is between both."""
    d, n, _ = touch(bodies.table[b], bodies.frames[b], bodies.triangles, bodies.tree, p, NONE, False, bodies.stack)
    return bool(d - thick + dot(n, subtract(q, p)) > -off)


@inline
def before_at(was: Floats, had: int, e: int, b: int, tip: bool) -> int:
    """Which of the points before lay between element e and body b, at the element's end or not; -1: none."""
    found = -1
    for k in range(had):
        if int(was[k, ELEMENT]) == e and int(was[k, HOLDER]) == b and (was[k, SHARE] == 1.0) == tip:
            found = k
    return found


@inline
def place_for(motion: Motion, first: int, end: int, gap: float) -> int:
    """The row for a point at this gap [m]: the next one, or, if those before `end` are taken, that of the farthest.

    Of those from `first` on; -1: none.
    """
    count = int(motion.par[N_PROPS])
    if count < end:
        motion.par[N_PROPS] = count + 1.0
        return count
    if first == end:
        return -1
    i = first
    for k in range(first + 1, end):
        i = k if motion.props[k, GAP] > motion.props[i, GAP] else i
    return i if motion.props[i, GAP] > gap else -1


@viewing
def find_rings(plan: Plan, model: Model, motion: Motion, memory: Momentum, rings: Floats, whole: Floats) -> bool:
    """Adds the points of the cable that are in eyelets (e, RING) after those on bodies; False if there is no room."""
    for ring in range(rings.shape[0]):
        at, cable = take3(rings, ring, 0), int(rings[ring, 3])
        a, b = plan.first[plan.cables[cable]], plan.first[plan.cables[cable + 1]]
        near, best, share = math.inf, a, 0.5
        for e in range(a, b):
            node = plan.left[e]
            if abs(model.s[node] + 0.5 * model.h[e] - rings[ring, 4]) > FURTHER * whole[node] + model.h[e]:
                continue
            for k in range(9):
                x = 0.125 * k
                way = subtract(curve(memory, model, node, e, x), at)
                if dot(way, way) < near:
                    near, best, share = dot(way, way), e, x
        node = plan.left[best]
        for _ in range(30):
            way = subtract(curve(memory, model, node, best, share), at)
            t = slope(memory, model, node, best, share)
            step = dot(way, t) / dot(t, t)
            share -= step
            if share < 0.0 and best > a and knot_of(plan, motion, best, 0) != HELD:
                best, node, share = best - 1, plan.left[best - 1], 1.0
            elif share > 1.0 and best < b - 1 and knot_of(plan, motion, best, 1) != HELD:
                best, node, share = best + 1, plan.left[best + 1], 0.0
            share = min(max(share, 0.0), 1.0)
            if abs(step) < 1e-12:
                break
        i = int(motion.par[N_PROPS])
        if i == PROPS:
            return False
        for c in range(PROP):
            motion.props[i, c] = 0.0
        motion.props[i, ELEMENT], motion.props[i, HOLDER], motion.props[i, SHARE] = best, -1.0 - ring, share
        motion.props[i, GRIP] = -1.0
        weigh(motion.props, i, model.h[best])
        t = slope(memory, model, node, best, share)
        t = scale(1.0 / math.sqrt(dot(t, t)), t)
        put3(motion.props, i, NORMAL, t)
        put3(motion.props, i, STUCK, at)
        put3(motion.props, i, DRY, along(t, take3(rings, ring, 5)))
        motion.par[N_PROPS] = i + 1.0
    return True


@inline
def curve(memory: Momentum, model: Model, node: int, e: int, x: float) -> Vector:
    """[m], the last place of the cable at the share x of element e."""
    return on_curve(
        model.h[e], x, get3(memory.place, node), get3(memory.place, node + 1), get3(memory.tangent, node),
        get3(memory.tangent, node + 1),
    )  # fmt: skip


@inline
def slope(memory: Momentum, model: Model, node: int, e: int, x: float) -> Vector:
    """[m], its derivative in x."""
    h, y = model.h[e], 1.0 - x
    r = scale(6.0 * x * y, subtract(get3(memory.place, node + 1), get3(memory.place, node)))
    r = add(r, scale(h * y * (1.0 - 3.0 * x), get3(memory.tangent, node)))
    return add(r, scale(h * x * (3.0 * x - 2.0), get3(memory.tangent, node + 1)))


@viewing
def note_rings(plan: Plan, model: Model, motion: Motion, rings: Floats) -> None:
    """Remembers where on the cable eyelets are, and what they hold it by, from the points of the last step."""
    for i in range(int(motion.par[N_PROPS])):
        ring = -1 - int(motion.props[i, HOLDER])
        if ring >= 0:
            e = int(motion.props[i, ELEMENT])
            rings[ring, 4] = model.s[plan.left[e]] + motion.props[i, SHARE] * model.h[e]
            put3(rings, ring, 5, take3(motion.props, i, DRY))


@inline
def nearest_bound(
    bodies: Bodies, b: int, h: float, p: Vector, q: Vector, tp: Vector, tq: Vector, thick: float
) -> tuple[float, float]:  # fmt: skip
    """[m], the gap of body b to the middle of an element, and what no gap inside it is less than.

    A convex body is behind its plane, and a cubic between its Bezier points.
    """
    at = on_curve(h, 0.5, p, q, tp, tq)
    d, n, _ = touch(bodies.table[b], bodies.frames[b], bodies.triangles, bodies.tree, at, NONE, False, bodies.stack)
    if int(bodies.table[b, 0]) >= MESH:
        return d - thick, -math.inf
    low = min(dot(n, p), dot(n, q), dot(n, p) + h / 3.0 * dot(n, tp), dot(n, q) - h / 3.0 * dot(n, tq))
    return d - thick, d - thick + low - dot(n, at)


@inline
def nearest(
    bodies: Bodies, b: int, h: float, p: Vector, q: Vector, tp: Vector, tq: Vector, thick: float, middle: float
) -> tuple[float, float]:  # fmt: skip
    """Share of an element at which a body is nearest, inside it, and the gap there [m]."""
    best, gap = 0.5, middle
    for k in range(2):
        x = 0.2 + 0.6 * k
        g = gap_at(bodies, b, h, x, p, q, tp, tq, thick)
        if g < gap:
            best, gap = x, g
    low, high = max(best - 0.3, 0.01), min(best + 0.3, 0.99)
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    f, g = gap_at(bodies, b, h, left, p, q, tp, tq, thick), gap_at(bodies, b, h, right, p, q, tp, tq, thick)
    for _ in range(LOOKS):
        if f < g:
            high, right, g = right, left, f
            left = high - GOLDEN * (high - low)
            f = gap_at(bodies, b, h, left, p, q, tp, tq, thick)
        else:
            low, left, f = left, right, g
            right = low + GOLDEN * (high - low)
            g = gap_at(bodies, b, h, right, p, q, tp, tq, thick)
    if min(f, g) < gap:
        return (left, f) if f < g else (right, g)
    return best, gap


@inline
def found_again(
    bodies: Bodies, b: int, h: float, x: float, p: Vector, q: Vector, tp: Vector, tq: Vector
) -> float:  # fmt: skip
    """Where the gap to a body no longer changes along an element, near to the share x of it; x if that is not found."""
    at, step = x, 1.0
    for _ in range(STEPS):
        y = 1.0 - at
        r = on_curve(h, at, p, q, tp, tq)
        way = subtract(q, p)
        t = add(scale(6.0 * at * y, way), scale(h * y * (1.0 - 3.0 * at), tp))
        t = add(t, scale(h * at * (3.0 * at - 2.0), tq))
        u = add(scale(6.0 - 12.0 * at, way), scale(h * (6.0 * at - 4.0), tp))
        u = add(u, scale(h * (6.0 * at - 2.0), tq))
        _, n, H = touch(
            bodies.table[b], bodies.frames[b], bodies.triangles, bodies.tree, r, NONE, False, bodies.stack
        )  # fmt: skip
        second = dot(n, u) + dot(t, apply(H, t))
        if not second > 0.0:
            return x
        step = dot(n, t) / second
        at -= step
        if not (0.0 < at < 1.0 and abs(at - x) < NEXT):
            return x
        if abs(step) < SAME:
            break
    return at if abs(step) < NEXT * NEXT else x


@viewing
def deepest(
    plan: Plan, model: Model, motion: Motion, memory: Momentum, bodies: Bodies, thick: Floats, whole: Floats
) -> float:  # fmt: skip
    """[m], how far the cable is outside of all bodies between its nodes; far ones count as h / 2."""
    least = math.inf
    for e in range(plan.left.shape[0]):
        node, h = plan.left[e], model.h[e]
        p, q = get3(motion.place, node), get3(motion.place, node + 1)
        tp, tq, fat = get3(memory.tangent, node), get3(memory.tangent, node + 1), thick[node]
        for b in range(bodies.table.shape[0] if fat >= 0.0 else 0):
            if excluded(bodies, b, model.s[node] + 0.5 * h, whole[node]):
                continue
            middle = gap_at(bodies, b, h, 0.5, p, q, tp, tq, fat)
            least = min(least, middle)
            if middle < 0.5 * h:
                least = min(least, gap_at(bodies, b, h, 0.25, p, q, tp, tq, fat))
                least = min(least, gap_at(bodies, b, h, 0.75, p, q, tp, tq, fat))
    return least


@inline
def knot_of(plan: Plan, motion: Motion, e: int, side: int) -> int:
    """The knot at the start (0) or the end (1) of an element if its place is unknown; else INSIDE, or HELD."""
    j = plan.left[e] - e
    knot = INSIDE
    if side == 0 and e == plan.first[j]:
        knot = plan.ends[j, 0]
    elif side == 1 and e == plan.first[j + 1] - 1 and motion.loose[plan.left[e] + 1] == 0.0:
        knot = plan.ends[j, 1]
    return HELD if knot >= 0 and plan.vertices[knot, 1] < 0 else knot


@inline
def heavy_at(plan: Plan, motion: Motion, memory: Momentum, knot: int, node: int) -> tuple[float, float]:
    """Mass [kg] and drag [N s/m] of a node, or of all that is in the knot for which it stands."""
    if knot < 0:
        return memory.mass[node] + memory.point[node], motion.drag[node]
    mass = drag = 0.0
    for j in range(plan.ends.shape[0]):
        for end in range(2):
            if plan.ends[j, end] == knot:
                one = plan.first[j + end] + j
                mass += memory.mass[one] + memory.point[one]
                drag += motion.drag[one]
    return mass, drag


@inline
def rates_at(plan: Plan, motion: Motion, memory: Momentum, knot: int, node: int) -> tuple[Vector, Vector, Vector]:
    """Velocity, acceleration and its jump of a node's mass, or their means in the knot for which it stands."""
    total, v, a, g = 0.0, NONE, NONE, NONE
    for k in range(plan.ends.shape[0] if knot >= 0 else 1):
        for end in range(2 if knot >= 0 else 1):
            if knot >= 0 and plan.ends[k, end] != knot:
                continue
            one = plan.first[k + end] + k if knot >= 0 else node
            mass = memory.mass[one] + memory.point[one]
            total += mass
            v = add(v, scale(mass, of_mass(motion, memory.velocity, memory.turning, one)))
            a = add(a, scale(mass, of_mass(motion, memory.acceleration, memory.bending, one)))
            g = add(g, scale(mass, get3(memory.jump, one)))
    return scale(1.0 / total, v), scale(1.0 / total, a), scale(1.0 / total, g)


@inline
def speed_of(plan: Plan, motion: Motion, memory: Momentum, i: int, free: bool) -> Vector:
    """[m/s], of a point as the masses of its nodes take it along, or those of them alone that nothing holds.

    Frames that turn have no inertia of their own: how they take a point along is no part of an impact.
    """
    speed = NONE
    for side in range(sides(motion.props, i)):
        e, end, weight, _ = side_of(motion.props, i, side)
        knot, node = knot_of(plan, motion, e, end), plan.left[e] + end
        if knot != HELD or not free:
            own, _, _ = rates_at(plan, motion, memory, knot, node)
            speed = add(speed, scale(weight, own))
    return speed


@viewing
def stop_points(
    plan: Plan, motion: Motion, memory: Momentum, before: Momentum, bodies: Bodies, rings: Floats, dt: float
) -> tuple[float, float, float]:
    """Gives points that are pressed the speed of their bodies along the normal, and all of it where they stick.

    What is in an eyelet gets the speed of that across the cable. Velocities, accelerations and their jumps become the
    nearest, by masses, that do so: energy falls, see `momentum`.

    Returns what the bodies have worked in the step and at its end, and what friction has taken [J]; the bodies' speeds
    are in the columns GAVE.
    """
    props, work, given, taken = motion.props, 0.0, 0.0, 0.0
    for i in range(int(motion.par[N_PROPS])):
        b = int(props[i, HOLDER])
        if b >= 0 and not props[i, PUSH] > 0.0:
            continue
        n, t = take3(props, i, NORMAL), take3(props, i, DRY)
        old = place_of(plan, props, i, before.place, before.tangent)
        if props[i, HOLDER] == PAIRED:
            went = NONE
        elif b >= 0:
            went = subtract(carried(old, bodies.then[b], bodies.frames[b]), old)
        else:
            went = along(n, take3(rings, -1 - b, WENT))
        way = subtract(subtract(place_of(plan, props, i, motion.place, memory.tangent), old), went)
        work += dot(add(scale(props[i, PUSH], n), t), went)
        taken -= dot(t, way) if b >= 0 else 0.0
        light, a, g = 0.0, NONE, NONE
        for side in range(sides(props, i)):
            e, end, w, _ = side_of(props, i, side)
            knot, node = knot_of(plan, motion, e, end), plan.left[e] + end
            if knot != HELD:
                mass, _ = heavy_at(plan, motion, memory, knot, node)
                _, own, jump = rates_at(plan, motion, memory, knot, node)
                light, a, g = light + w * w / mass, add(a, scale(w, own)), add(g, scale(w, jump))
        if light == 0.0:
            continue
        put3(props, i, GAVE, scale(1.0 / dt, went))
        v = subtract(speed_of(plan, motion, memory, i, False), take3(props, i, GAVE))
        if b < 0:
            v, a, g = along(n, v), along(n, a), along(n, g)
        elif not sticks(props, i):
            v, a, g = scale(dot(n, v), n), scale(dot(n, a), n), scale(dot(n, g), n)
        for side in range(sides(props, i)):
            e, end, w, _ = side_of(props, i, side)
            knot, node = knot_of(plan, motion, e, end), plan.left[e] + end
            if knot == HELD:
                own, _, _ = rates_at(plan, motion, memory, knot, node)
                given += w / light * dot(v, own)
                continue
            mass, _ = heavy_at(plan, motion, memory, knot, node)
            f = -w / (mass * light)
            hasten(plan, memory, knot, node, scale(f, v), scale(f, a), scale(f, g))
        given -= dot(v, went) / (dt * light)
    return work, given, taken


@inline
def hasten(plan: Plan, memory: Momentum, knot: int, node: int, v: Vector, a: Vector, g: Vector) -> None:
    """Adds to velocity, acceleration and its jump of a node, or of all that is in the knot for which it stands."""
    for k in range(plan.ends.shape[0] if knot >= 0 else 1):
        for end in range(2 if knot >= 0 else 1):
            if knot >= 0 and plan.ends[k, end] != knot:
                continue
            one = plan.first[k + end] + k if knot >= 0 else node
            put3(memory.velocity, one, 0, add(get3(memory.velocity, one), v))
            put3(memory.acceleration, one, 0, add(get3(memory.acceleration, one), a))
            put3(memory.jump, one, 0, add(get3(memory.jump, one), g))
