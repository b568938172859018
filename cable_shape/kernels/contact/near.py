"""Which nodes of a cable touch which bodies: gaps, normals and curvatures at the nodes.

    near  (N+1, 67) of a node: contact force p [N] | gap to the nearest body [m] | its outward normal 3 | curvature of
                    its surface 9 | place 3 | change of place in the last step 3 | contact force corrected [N] | 1: its
                    contact has just ended | push of another cable [N] | direction from there 3 | how far that is [m] |
                    the push corrected [N] | of a second body: contact force, gap, normal 3, curvature 9, force
                    corrected | what friction remembers 15 | of a third body: contact force, gap, normal 3, force
                    corrected | turn of the normal from the node on to where the cable would run if there were room 3
    on    (N+1, 6)  row of the body that the node is pressed on, -1: none | row of the nearest body, -1: none near |
                    2 i or 2 i + 1 at pair i, -1: of none, see `link` | 1: the pair's cables touch | row of a second
                    body that the node is pressed on | row of a third one, which together with both leaves it no way

A cable cannot come nearer to a body faster than along its arc length, so that a node at the distance d rules out all
nodes within d of it.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.distance.distance import HALF_SPACE, MESH, SPHERES
from cable_shape.kernels.distance.spheres import FLAT
from cable_shape.kernels.distance.surface import at_least, outward, reach_of, touch
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    apply,
    cross,
    dot,
    get4,
    get9,
    put3,
    put9,
    rotation,
    scale,
    take3,
    tapply,
)
from cable_shape.kernels.rod_element import relative

NEAR, ON = 67, 6  # columns of `near` and `on`
PRESS, GAP, NORMAL, CURVED, SPOT, STEP, EXACT, ENDED = 0, 1, 2, 5, 14, 17, 20, 21
PUSH, TOWARD, APART, PUSHED = 22, 23, 26, 27
SECOND_PRESS, SECOND_GAP, SECOND_NORMAL, SECOND_CURVED, SECOND_EXACT = 28, 29, 30, 33, 42
RUB, WAS, HELD, ARC, FIRM, SLIPS, MATE = 43, 46, 49, 52, 53, 54, 55
LIMIT, OFF = 56, 57  # of friction [N], and by how much mu times the push was off it
THIRD_PRESS, THIRD_GAP, THIRD_NORMAL, THIRD_EXACT = 58, 59, 60, 63
TILT = 64
LINK, LINKED, SECOND, THIRD = 2, 3, 4, 5
BARE, ACTIVE, WAITS = -1, 1, 2
CLOSED = 0.1  # volume that three unit normals span: with less they are next to one plane, where two hold a node
FLATTEST = 1e-3  # of the square of the sine between two normals at a node: as far as flatter corners count
MARGIN = 0.03  # [m] bodies further from a node than this are not looked at
GRIP_EXCLUSION = 0.05  # [m] of arc length at either end, within which what grips the cable is no body to it
NONE = (0.0, 0.0, 0.0)
# from which a contact runs: curvature of the body times the length of two elements, of the gap times that of the cable
SHARP, ROUND = 0.6, 0.05
STANDS = -1.0  # in place of the latter: nothing runs


@kernel
def look(
    s: Array, near: Array, on: Array, thick: Array, first_node: int, last_node: int, bodies: Array, frames: Array,
    triangles: Array, nodes: Array, sunk: float, stack: Array,
) -> None:  # fmt: skip
    """Gaps of a cable's nodes between first_node and last_node, its ends; normal and curvature where a body is near or
    pressed on.

    sunk [m]: how much smaller than they are bodies are taken to be. The normals from before go where the change of
    place was.
    """
    for k in range(first_node, last_node + 1):
        near[k, GAP] = math.inf
        on[k, 1] = BARE
        put3(near, k, STEP, take3(near, k, NORMAL))
    for b in range(bodies.shape[0]):
        body, frame = bodies[b], frames[b]
        kind = int(body[0])
        endless, plain = kind == HALF_SPACE, kind not in (MESH, SPHERES)
        exclusion = GRIP_EXCLUSION if bodies[b, 12] != 0.0 else 0.0
        k = first_node + 1
        while k < last_node:
            if s[k] < exclusion or s[k] > s[last_node] - exclusion or on[k, SECOND] == b or on[k, THIRD] == b:
                k += 1
                continue
            held, spot = on[k, 0] == b, take3(near, k, SPOT)
            if not held and on[k, 1] != BARE:  # another body is near
                least = at_least(body, frame, spot) - thick[k] + sunk
                if near[k, GAP] <= least <= MARGIN:
                    k += 1
                    continue
            if plain and (endless or not held):  # of no curvature, or none that matters
                (d, n), H = outward(body, frame, spot), FLAT
            else:
                d, n, H = touch(
                    body, frame, triangles, nodes, spot, take3(near, k, STEP) if held else NONE, held, stack
                )
            gap = d - thick[k] + sunk
            if gap < near[k, GAP] and (held or (gap < MARGIN and (on[k, 0] == BARE or gap < -1e-5))):
                near[k, GAP] = gap
                on[k, 1] = b
                put3(near, k, NORMAL, n)
                put9(near, k, CURVED, H)
            if gap > MARGIN and not endless and on[k, 1] == BARE:
                near[k, GAP] = min(near[k, GAP], gap)
            k += 1
            if gap > MARGIN:
                at = s[k - 1]
                while k < last_node and s[k] < at + gap - MARGIN and on[k, 0] != b:
                    if not endless and on[k, 1] == BARE:
                        near[k, GAP] = min(near[k, GAP], gap - s[k] + at)
                    k += 1
    for k in range(first_node + 1, last_node):
        if on[k, 1] == BARE:
            on[k, 0] = on[k, SECOND] = on[k, THIRD] = BARE
            near[k, PRESS] = near[k, SECOND_PRESS] = near[k, THIRD_PRESS] = 0.0
            let_go(near, k)
        b = on[k, SECOND]
        if b != BARE:
            side = take3(near, k, SECOND_NORMAL)
            d, n, H = touch(bodies[b], frames[b], triangles, nodes, take3(near, k, SPOT), side, True, stack)
            near[k, SECOND_GAP] = d - thick[k] + sunk
            put3(near, k, SECOND_NORMAL, n)
            put9(near, k, SECOND_CURVED, H)
        b = on[k, THIRD]
        if b != BARE:
            side = take3(near, k, THIRD_NORMAL)
            d, n, _ = touch(bodies[b], frames[b], triangles, nodes, take3(near, k, SPOT), side, True, stack)
            near[k, THIRD_GAP] = d - thick[k] + sunk
            put3(near, k, THIRD_NORMAL, n)


@viewing
def tangent_of(q: Array, k: int) -> Vector:
    """Third axis of the frame of node k."""
    x, y, z, w = q[k, 0], q[k, 1], q[k, 2], q[k, 3]
    return (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))


@viewing
def pressed(near: Array, k: int, normal: int) -> Vector:
    """[N], of the bodies on node k; normal: column with the first one's direction."""
    own = add(scale(near[k, PRESS], add(take3(near, k, normal), take3(near, k, TILT))), take3(near, k, RUB))
    own = add(own, scale(near[k, SECOND_PRESS], take3(near, k, SECOND_NORMAL)))
    return add(own, scale(near[k, THIRD_PRESS], take3(near, k, THIRD_NORMAL)))


@viewing
def let_go(near: Array, k: int) -> None:
    """Takes off what a body pulls node k by along its surface; what it has been is remembered until the end of the
    step, should it come back."""
    put3(near, k, RUB, NONE)


@viewing
def shares(near: Array, on: Array, k: int, v: Vector) -> Vector:
    """The parts of a vector along the normals of the bodies that press on node k, 0 of those that there are not."""
    n, m, o = take3(near, k, NORMAL), take3(near, k, SECOND_NORMAL), take3(near, k, THIRD_NORMAL)
    if on[k, SECOND] == BARE:
        return dot(v, n), 0.0, 0.0
    if on[k, THIRD] != BARE:
        f = 1.0 / dot(n, cross(m, o))
        return f * dot(v, cross(m, o)), f * dot(v, cross(o, n)), f * dot(v, cross(n, m))
    c, a, b = dot(n, m), dot(v, n), dot(v, m)
    f = 1.0 / max(1.0 - c * c, FLATTEST)
    return f * (a - c * b), f * (b - c * a), 0.0


@viewing
def way_out(near: Array, on: Array, k: int, a: float, b: float, c: float) -> Vector:
    """The least way that goes a, b and c along the normals of the bodies that press on node k."""
    n, m, o = take3(near, k, NORMAL), take3(near, k, SECOND_NORMAL), take3(near, k, THIRD_NORMAL)
    if on[k, SECOND] == BARE:
        return scale(a, n)
    if on[k, THIRD] != BARE:
        f = 1.0 / dot(n, cross(m, o))
        return add(scale(f * a, cross(m, o)), add(scale(f * b, cross(o, n)), scale(f * c, cross(n, m))))
    cosine = dot(n, m)
    f = 1.0 / max(1.0 - cosine * cosine, FLATTEST)
    return add(scale(f * (a - cosine * b), n), scale(f * (b - cosine * a), m))


@viewing
def turning(q: Array, h: Array, near: Array, k: int, flex: Array) -> Vector:
    """Darboux vector at node k [1/m].

    Between the middles of both elements it is linear but for the bend that the contact's force makes.
    """
    left, right = relative(get4(q, k - 1), get4(q, k))[0], relative(get4(q, k), get4(q, k + 1))[0]
    a, b = h[k - 1], h[k]
    f = 1.0 / (a + b)
    u = add(scale(2.0 * f * b / a, left), scale(2.0 * f * a / b, right))
    force = add(pressed(near, k, NORMAL), scale(near[k, PUSH], take3(near, k, TOWARD)))
    N = tapply(rotation(get4(q, k)), force)
    bend = -0.5 * f * a * b * flex[k]
    return add(u, (-bend * N[1], bend * N[0], 0.0))


@viewing
def is_knot(on: Array, k: int) -> bool:
    """Whether a body or another cable presses on node k, or may in the next step."""
    return bool(on[k, 0] != BARE or on[k, LINK] != BARE)


@viewing
def sharpness(q: Array, near: Array, k: int) -> float:
    """Curvature of the body along the cable at a contact [1/m]."""
    t = tangent_of(q, k)
    return dot(t, apply(get9(near, k, CURVED), t))


@viewing
def parting(q: Array, h: Array, near: Array, k: int, flex: Array) -> tuple[float, float]:
    """Second derivative of the distance along the cable at a contact [1/m], and the body's part of it."""
    sharp = sharpness(q, near, k)
    u = turning(q, h, near, k, flex)
    return sharp + dot(take3(near, k, NORMAL), apply(rotation(get4(q, k)), (u[1], -u[0], 0.0))), sharp


@viewing
def along_cable(q: Array, h: Array, near: Array, on: Array, k: int, least: float, flex: Array) -> float:
    """Second derivative of the distance along the cable at a contact that runs along it [1/m]; 0 if it does not.

    On a body that is not sharp a contact runs if it has no neighbour; one of a pair goes where that goes. least [1/m]:
    second derivative from which on; STANDS: none runs.
    """
    if on[k, LINK] != BARE or on[k, SECOND] != BARE or least < 0.0:
        return 0.0
    edge = sharpness(q, near, k) * (h[k - 1] + h[k]) > SHARP
    if not edge and (on[k - 1, 0] != BARE or on[k + 1, 0] != BARE):
        return 0.0
    second, sharp = parting(q, h, near, k, flex)
    if edge:
        return max(second, 0.3 * sharp)
    return second if second > least else 0.0


@viewing
def allowed(near: Array, on: Array, bodies: Array, thick: Array) -> float:
    """The fraction of the last step that carries no node further than its gap and 0.6 of a body's thickness."""
    fraction = 1.0
    for k in range(near.shape[0]):
        b = on[k, 1]
        move = take3(near, k, STEP)
        if b == BARE:
            size = math.sqrt(dot(move, move))
            if size > near[k, GAP] + 0.6 * thick[k]:
                fraction = min(fraction, (near[k, GAP] + 0.6 * thick[k]) / size)
            continue
        n = take3(near, k, NORMAL)
        way = -dot(move, n)
        limit = max(near[k, GAP], 0.0) + 0.6 * (thick[k] + reach_of(bodies[b]))
        if way > limit:
            fraction = min(fraction, limit / way)
        size = math.sqrt(dot(move, move))
        if on[k, 0] == BARE and size > limit + MARGIN:
            fraction = min(fraction, (limit + MARGIN) / size)
    return fraction


@viewing
def lean(near: Array, k: int, fraction: float) -> None:
    """Turns the normal at node k with the surface under the step, to first order."""
    put3(near, k, NORMAL, leant(near, k, fraction))


@viewing
def leant(near: Array, k: int, fraction: float) -> Vector:
    """The normal at node k as the surface under the step turns it, to first order."""
    H, n = get9(near, k, CURVED), take3(near, k, NORMAL)
    if H == FLAT:
        return n
    n = add(n, scale(fraction, apply(H, take3(near, k, STEP))))
    return scale(1.0 / math.sqrt(dot(n, n)), n)
