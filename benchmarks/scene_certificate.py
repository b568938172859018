"""A certificate of shapes in contact from their own numbers, in numpy: nothing of the solver's code takes part.

From point to point n' = -w but for the forces of contacts and clips, which jump, and m' = n x r'; contacts push, along
the normal of their body, where the cable is on it, and rub along it by no more than friction holds; no point is inside
a body; and on the way from the shape before no body or cable is passed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

import cable_shape as cs

Array = np.ndarray

DEEP = 3e-4  # m, beside the error estimate: what a cable may seem to be inside a body, or a contact off one
CONE = 1e-3  # of the largest push: friction beyond its limit, which is that of the push before corrections
BALANCE = 1e-5  # of the largest force or the weight
MOMENT = 1e-3  # of the largest moment, by Hermite's rule on the shape's points ...
LAYER = 1.5  # ... where the shortest boundary layer is so many times as long as they are apart
MIDDLE = 0.5  # of half a body's thickness and the cable's: deeper inside is on the way through
MET = 0.4  # of the distance to be kept: nearer cables are on the way through each other
LOOKS, MOST_LOOKS = 24, 400  # at shapes between two
ASIDE = (1.1e-9, 0.7e-9, 1.3e-9)  # m, of one of two lines, so that no points of both stand in one place by symmetry


def distances(solid: object, pose: cs.Pose, points: Array) -> Array:
    """(n,) signed distances [m] of points (n, 3) from a solid, negative inside."""
    return signed(solid, (points - pose.position) @ Rotation.from_quat(pose.quaternion).as_matrix())


def signed(solid: object, p: Array) -> Array:
    """The same of points in the solid's own frame, which may change."""
    if isinstance(solid, cs.HalfSpace):
        return p[:, 2]
    if isinstance(solid, cs.Sphere):
        return np.linalg.norm(p, axis=1) - solid.radius
    if isinstance(solid, cs.Capsule):
        p[:, 2] -= np.clip(p[:, 2], -0.5 * solid.length, 0.5 * solid.length)
        return np.linalg.norm(p, axis=1) - solid.radius
    if isinstance(solid, cs.Cylinder):
        out = np.stack((np.hypot(p[:, 0], p[:, 1]) - solid.radius, np.abs(p[:, 2]) - 0.5 * solid.length))
    elif isinstance(solid, cs.Box):
        out = (np.abs(p) - 0.5 * np.asarray(solid.size)).T
    else:
        raise TypeError(f"no distance from {solid!r} is known here")
    return np.linalg.norm(np.maximum(out, 0.0), axis=0) + np.minimum(out.max(axis=0), 0.0)


def thickness(solid: object) -> float:
    """[m] half the least thickness of a solid."""
    if isinstance(solid, cs.HalfSpace):
        return float("inf")
    if isinstance(solid, cs.Cylinder):
        return min(solid.radius, 0.5 * solid.length)
    if isinstance(solid, cs.Box):
        return 0.5 * min(solid.size)
    return float(solid.radius)  # type: ignore[attr-defined]


def outward(solid: object, pose: cs.Pose, point: Array) -> Array:
    """(3,) unit normal of a solid's distance at a point, by differences."""
    step = 1e-6 * np.eye(3)
    return (distances(solid, pose, point + step) - distances(solid, pose, point - step)) / 2e-6


def between(shape: cs.CableShape, arcs: Array) -> Array:
    """(k, 3) positions at arc lengths, by Hermite's interpolation."""
    s, r, t = shape.arc_length, shape.positions, shape.tangents
    i = np.clip(np.searchsorted(s, arcs, side="right") - 1, 0, len(s) - 2)
    h = (s[i + 1] - s[i])[:, None]
    x = ((arcs - s[i])[:, None]) / h
    return (
        (1.0 + 2.0 * x) * (1.0 - x) ** 2 * r[i]
        + x * (1.0 - x) ** 2 * h * t[i]
        + x**2 * (3.0 - 2.0 * x) * r[i + 1]
        - x**2 * (1.0 - x) * h * t[i + 1]
    )


def judged(
    cable: cs.Cable, scene: cs.Scene, shape: cs.CableShape, clips: Array, beside: Mapping[str, cs.Cable] | None = None
) -> tuple[str, ...]:
    """What is wrong with a usable shape; clips (k, 4 or more): arc length and force on each clip.

    beside: all cables that it may touch, by name.
    """
    wrong = []
    allowed = DEEP + shape.error_estimate
    radius = 0.5 * cable.diameter
    bodies = {body.name: body for body in scene.obstacles}
    line = between(shape, np.linspace(0.0, shape.length, 4 * shape.points))
    for body in bodies.values():
        gap = float(distances(body.solid, body.pose, line).min()) - radius
        if gap < -allowed:
            wrong.append(f"inside: {body.name} by {-1e3 * gap:.2f} mm")
    largest = max((contact.force for contact in shape.contacts), default=0.0)
    for contact in shape.contacts:
        if not contact.force > 0.0:
            wrong.append(f"pull: {contact.body} {contact.force:.3g} N")
        own = between(shape, np.array([contact.arc_length]))[0]
        if contact.body in bodies:
            body = bodies[contact.body]
            off = float(distances(body.solid, body.pose, own[None])[0]) - radius
            along = float(outward(body.solid, body.pose, own) @ contact.normal)
            if abs(off) > allowed:
                wrong.append(f"off: contact with {contact.body} is {1e3 * off:.2f} mm off")
            if along < 0.98:
                wrong.append(f"normal: {contact.body} {along:.3f}")
        other = bodies.get(contact.body) or (beside or {}).get(contact.body, cable)
        rubs = contact.tangential_force
        limit, size = max(cable.friction, other.friction) * contact.force, float(np.linalg.norm(rubs))
        if size > 1.01 * limit + CONE * largest or abs(rubs @ contact.normal) > 1e-6 * largest:
            wrong.append(f"cone: {size:.3g} N along {contact.body}, {limit:.3g} N can be held")
    wrong += balance(cable, shape, clips)
    return tuple(wrong)


def balance(cable: cs.Cable, shape: cs.CableShape, clips: Array) -> list[str]:
    """Of forces from end to end, and of forces and moments between the points where nothing acts."""
    wrong = []
    s, n, m, t = shape.arc_length, shape.force, shape.moment, shape.tangents
    weight = np.array((0.0, 0.0, -9.81 * cable.linear_density))
    pushed = [
        (contact.arc_length, contact.force * contact.normal + contact.tangential_force) for contact in shape.contacts
    ]
    pushed += [(row[0], -row[1:4]) for row in clips]
    size = max(float(np.linalg.norm(n, axis=1).max()), float(np.linalg.norm(weight)) * shape.length)
    left = n[-1] - n[0] + weight * shape.length + sum((force for _, force in pushed), np.zeros(3))
    if np.linalg.norm(left) > BALANCE * size + 1e-9:
        wrong.append(f"force: {np.linalg.norm(left):.3g} N of {size:.3g} N are left over")
    h = np.diff(s)
    clear = np.ones(len(h), dtype=bool)
    for at, _ in pushed:
        clear &= (at < s[:-1] - 1e-9) | (at > s[1:] + 1e-9)
    jumps = np.linalg.norm(np.diff(n, axis=0) + weight * h[:, None], axis=1)[clear]
    if jumps.size and jumps.max() > BALANCE * size + 1e-9:
        wrong.append(f"jump: {jumps.max():.3g} N of {size:.3g} N where nothing acts")
    bend = float(np.linalg.norm(m, axis=1).max())
    slope = np.cross(n, t)  # Hermite's rule: m'' = n' x t + n x t'
    k = shape.curvature
    frames = Rotation.from_quat(shape.quaternions)
    turn = np.cross(frames.apply(k), t)
    second = np.cross(-weight, t) + np.cross(n, turn)
    rule = 0.5 * h[:, None] * (slope[:-1] + slope[1:]) + h[:, None] ** 2 / 12.0 * (second[:-1] - second[1:])
    off = np.linalg.norm(np.diff(m, axis=0) - rule, axis=1)[clear]
    layer = math.sqrt(cable.mean_bending_stiffness / max(float(np.linalg.norm(n, axis=1).max()), 1e-12))
    if off.size and layer > LAYER * h[0] and off.max() > MOMENT * bend:
        wrong.append(f"moment: {off.max() / bend:.2g} of the largest")
    return wrong


def passed(scene: cs.Scene, radius: float, before: cs.CableShape, after: cs.CableShape) -> str:
    """Which body is passed on the straight way from a shape to the next; empty if none is."""
    arcs = np.linspace(0.0, after.length, 4 * after.points)
    a, b = between(before, arcs), between(after, arcs)
    for body in scene.obstacles:
        middle = MIDDLE * (thickness(body.solid) + radius)
        far = float(np.linalg.norm(b - a, axis=1).max())
        if far < middle:
            continue
        for x in np.linspace(0.0, 1.0, looks(far, middle)):
            if distances(body.solid, body.pose, (1.0 - x) * a + x * b).min() - radius < -middle:
                return f"through: {body.name}"
    return ""


def crossed(
    pair: tuple[cs.CableShape, cs.CableShape], after: tuple[cs.CableShape, cs.CableShape], reach: float, own: bool
) -> bool:
    """Whether two cables have gone through each other, or one through itself (own). Ends do not count.

    Of two, signed crossings on the straight way are counted: for ends that do not go round each other their sum is the
    same on every way, so if it is not 0 all lead through, and if it is 0 there is one that does not, though the
    straight one may go through and back. Of one cable no such number is known: the straight way must be free.
    """
    lines = []
    for then, now in zip(pair, after, strict=True):
        arcs = np.linspace(0.0, now.length, 2 * now.points)
        inner = (arcs > 4.0 * reach) & (arcs < now.length - 4.0 * reach)
        lines.append((arcs[inner], between(then, arcs)[inner], between(now, arcs)[inner]))
    (s, a, a_now), (_, b, b_now) = lines
    if not own:
        return sum(crossings(a, a_now, b, b_now)) != 0
    near = np.abs(s[:, None] - s[None, :]) < np.pi * reach
    way = 2.0 * float(np.linalg.norm(a_now - a, axis=1).max())
    for x in np.linspace(0.0, 1.0, looks(way, MET * reach)):
        p = (1.0 - x) * a + x * a_now
        apart = cdist(p, p)
        apart[near] = np.inf
        least = float(apart.min())
        if least < MET * reach:
            return True
        if least - (1.0 - x) * way > MET * reach:
            return False
    return False


def looks(way: float, middle: float) -> int:
    """How often a way [m] is looked at, so that it leads no further than half of `middle` [m] from look to look."""
    return int(np.clip(2 + np.ceil(2.0 * way / middle), LOOKS, MOST_LOOKS))


def crossings(a: Array, a_now: Array, b: Array, b_now: Array) -> list[int]:
    """The signs with which lines a (n, 3) and b (m, 3), moved straight, go through each other.

    Two pieces meet when they and what is between them are in one plane, at a zero of a cubic in time.
    """
    boxes = []
    for then, now in ((a, a_now), (b + ASIDE, b_now + ASIDE)):
        corners = np.stack((then[:-1], then[1:], now[:-1], now[1:]))
        boxes.append((corners, corners.min(axis=0), corners.max(axis=0)))
    (p, low, high), (q, other_low, other_high) = boxes
    i, j = np.nonzero(((low[:, None] <= other_high[None]) & (other_low[None] <= high[:, None])).all(axis=2))
    p, q = p[:, i], q[:, j]

    def at(x: float | Array) -> tuple[Array, Array, Array]:
        """(k, 3) of both pieces, and from the first to the second."""
        start, other = p[0] + x * (p[2] - p[0]), q[0] + x * (q[2] - q[0])
        return p[1] + x * (p[3] - p[1]) - start, q[1] + x * (q[3] - q[1]) - other, other - start

    def volume(x: float | Array) -> Array:
        """(k,)"""
        e, f, w = at(x)
        return np.asarray((np.cross(e, f) * w).sum(axis=1))

    times = np.array((0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0))
    cubics = np.linalg.solve(np.vander(times), np.stack([volume(x) for x in times]))
    _, second, first, zeroth = cubics  # between its Bernstein coefficients is all that a cubic takes on
    hull = np.stack((zeroth, zeroth + first / 3.0, zeroth + (2.0 * first + second) / 3.0, cubics.sum(axis=0)))
    signs = []
    for k in np.nonzero((hull.min(axis=0) <= 0.0) & (hull.max(axis=0) >= 0.0))[0]:
        cubic = cubics[:, k]
        zeros = np.roots(cubic)
        for x in zeros.real[(zeros.imag == 0.0) & (zeros.real >= 0.0) & (zeros.real <= 1.0)]:
            e, f, w = (row[k] for row in at(x))
            (y, z), *_ = np.linalg.lstsq(np.stack((e, -f), axis=1), w, rcond=None)
            if 0.0 <= y < 1.0 and 0.0 <= z < 1.0:
                signs.append(int(np.sign(np.polyval(np.polyder(cubic), x))))
    return signs
