"""A cable that slides in a thick liquid, in numpy: whether one that jumped over a body may have come there by itself.

Between two shapes of a cable that jumped the straight way tells little: over a wall's edge it leads through the wall.
So a chain of points, inextensible but for what a stiff spring gives, with the cable's weight and bending stiffness, but
without twist and friction, is led with the grips from the first shape, and let slide to rest outside of all bodies.
Each step in time is a minimum of energy and drag, and carries no point further than it could get past a body unseen:
such a way exists, for a cable of this length, downhill all along. None of the solver's code takes part.

A chain knows no twist. Where it comes to rest elsewhere, a way is asked of `cs.Motion`, slowed down, and believed
only in what this file sees of it: that it ends in the shape, and passes no body from any step to the next.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scene_certificate import Array, distances, passed
from scipy.linalg import LinAlgError, solveh_banded
from scipy.spatial.transform import Rotation

import cable_shape as cs

ELEMENTS = (120, 240)  # of chains: long ones may be caught on an edge that a cable gets over
TAUT = 1e4  # stiffness against stretching, in weights a length
HARD = 300.0  # stiffness of bodies, in weights a radius
LONGEST = 0.4  # of the radius: a point's way in a step
GRIPS = 0.1  # of the same: that of grips
REST = 1e-6  # of the length: the way in a long step of what is at rest
STEPS, ITERATIONS = 3000, 60
SLOW, FAST = 1e-5, 1e3  # steps in time, in units in which the chain falls its length
DT, SUBSTEPS, MOST = 0.02, 10, 600  # s, of a motion; for each step of the grips; in which it is to come to rest
# Elements of motions (None: as they are) and their longest steps [s]: what buckles slowly does so on one mesh, and is
# held by what contacts flutter on another one.
MESHES, LONGER = ((None, DT), (120, 0.1), (160, 0.1), (200, 0.1)), 1.15
THERE = 1e-3  # of the length: so near to the shape it is there


class Chain:
    """Points (n, 3) [m] of a cable held at both ends, in a scene; at rest or on the way there."""

    def __init__(self, cable: cs.Cable, scene: cs.Scene, positions: Array) -> None:
        elements = len(positions) - 1
        self.h = cable.length / elements
        self.radius, self.length, self.scene = 0.5 * cable.diameter, cable.length, scene
        self.x = positions.copy()
        self.load = 9.81 * cable.linear_density * self.h
        self.weight = self.load * elements
        self.taut, self.hard = TAUT * self.weight / self.length * elements, HARD * self.weight / self.radius
        self.bend = float(np.mean(cable.bending_stiffness)) / self.h**3

    def hold(self, start: cs.Pose, end: cs.Pose) -> None:
        """Two points at each end are where the grips hold them."""
        for pose, near, beside, sign in ((start, 0, 1, 1.0), (end, -1, -2, -1.0)):
            ahead = Rotation.from_quat(pose.quaternion).apply((0.0, 0.0, 1.0))
            self.x[near] = pose.position
            self.x[beside] = pose.position + sign * self.h * ahead

    def slide(self, dt: float) -> tuple[float, bool]:
        """How far [m] a step in time goes, and whether it is a minimum; what goes too far is not gone."""
        then, m = self.x.copy(), self.load / (dt * self.length)
        energy, slope, band = self._energy(then, m)
        for _ in range(ITERATIONS):
            if np.abs(slope).max() < 1e-6 * self.weight:
                way = float(np.linalg.norm(self.x - then, axis=1).max())
                if way <= LONGEST * self.radius:
                    return way, True
                break
            try:
                step = solveh_banded(band, -slope.ravel(), lower=True).reshape(-1, 3)
            except LinAlgError:
                break
            part, here = min(1.0, self.radius / float(np.abs(step).max())), self.x.copy()
            for _ in range(25):
                self.x[2:-2] = here[2:-2] + part * step
                after, slope, band = self._energy(then, m)
                if after <= energy + 1e-4 * part * float((slope * step).sum()) + 1e-15 or after <= energy:
                    break
                part *= 0.5
            energy = after
        self.x = then
        return 0.0, False

    def _energy(self, then: Array, m: float) -> tuple[float, Array, Array]:
        """[J] with drag, its slope by the free points and its second derivative, lower band, without compression."""
        x, h = self.x, self.h
        n = len(x)
        slope, blocks = np.zeros((n, 3)), np.zeros((3, n, 3, 3))  # blocks[k, i]: of points i and i + k
        one = np.eye(3)
        slope[:, 2] += self.load
        away = x - then
        slope += m * away
        energy = self.load * x[:, 2].sum() + 0.5 * m * (away**2).sum()
        blocks[0] += m * one
        bow = x[:-2] - 2.0 * x[1:-1] + x[2:]
        energy += 0.5 * self.bend * (bow**2).sum()
        for i, a in enumerate((1.0, -2.0, 1.0)):
            slope[i : n - 2 + i] += a * self.bend * bow
            for j, b in enumerate((1.0, -2.0, 1.0)):
                if j >= i:
                    blocks[j - i, i : n - 2 + i] += a * b * self.bend * one
        piece = np.diff(x, axis=0)
        size = np.linalg.norm(piece, axis=1)
        t = piece / size[:, None]
        pull = self.taut * (size / h - 1.0)
        energy += 0.5 * (pull**2).sum() * h / self.taut
        slope[:-1] -= pull[:, None] * t
        slope[1:] += pull[:, None] * t
        along = t[:, :, None] * t[:, None, :]
        stiff = self.taut / h * along + (np.maximum(pull, 0.0) / size)[:, None, None] * (one - along)
        blocks[0, :-1] += stiff
        blocks[0, 1:] += stiff
        blocks[1, :-1] -= stiff
        for weights in ((1.0, 0.0), (0.5, 0.5)):
            energy += self._touch(weights, slope, blocks)
        return float(energy), slope[2:-2], _banded(blocks[:, 2:-2])

    def _touch(self, weights: tuple[float, float], slope: Array, blocks: Array) -> float:
        """[J] of bodies that push points, or points between two."""
        a, b = weights
        points = a * self.x[:-1] + b * self.x[1:]
        energy = 0.0
        for body in self.scene.obstacles:
            deep = self.radius - distances(body.solid, body.pose, points)
            k = np.flatnonzero(deep > 0.0)
            if not k.size:
                continue
            normal = _outward(body, points[k])
            push = self.hard * deep[k]
            energy += 0.5 * float((push * deep[k]).sum())
            square = self.hard * normal[:, :, None] * normal[:, None, :]
            for i, u in ((0, a), (1, b)):
                slope[k + i] -= u * push[:, None] * normal
                blocks[0, k + i] += u * u * square
            blocks[1, k] += a * b * square
        return energy


def _outward(body: cs.Obstacle, points: Array) -> Array:
    """(n, 3) unit normals of a body's distance at points, by differences."""
    columns = []
    for step in 1e-6 * np.eye(3):
        ahead = distances(body.solid, body.pose, points + step)
        columns.append(ahead - distances(body.solid, body.pose, points - step))
    normal = np.stack(columns, axis=1)
    return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])


def _banded(blocks: Array) -> Array:
    """(9, 3 n): blocks (3, n, 3, 3) of points i and i + k as a lower band."""
    n = blocks.shape[1]
    band = np.zeros((9, 3 * n))
    for k in range(3):
        for row in range(3):
            for column in range(3):
                below = 3 * k + row - column
                if below >= 0:
                    band[below, column : 3 * (n - k) : 3] = blocks[k, : n - k, column, row]
    return band


def slid(cable: cs.Cable, scene: cs.Scene, before: Array, grips: list[tuple[cs.Pose, cs.Pose]]) -> tuple[Array, bool]:
    """Where a cable slides from points `before` (n, 3) [m], evenly along it, as its grips go from pair to pair, and
    whether it is at rest there."""
    chain = Chain(cable, scene, before)
    dt = 1e-3
    count = 0
    for (a, b), (a_now, b_now) in pairwise(grips):
        way = max(float(np.linalg.norm(p.position - q.position)) for p, q in ((a, a_now), (b, b_now)))
        parts = 1 + int(way / (GRIPS * chain.radius))
        for part in np.linspace(0.0, 1.0, parts + 1)[1:]:
            chain.hold(_between(a, a_now, part), _between(b, b_now, part))
            count += 1
            way, done = chain.slide(dt)
            while not done and dt > SLOW:
                dt *= 0.2
                way, done = chain.slide(dt)
            dt = min(2.0 * dt, FAST)
    for _ in range(STEPS):
        count += 1
        way, done = chain.slide(dt)
        if done and dt >= FAST and way < REST * chain.length:
            return chain.x, True
        dt = min(2.0 * dt, FAST) if done else 0.2 * dt
        if dt < SLOW:
            break
    return chain.x, False


class Line(NamedTuple):
    """A cable as `scene_certificate.passed` takes it."""

    arc_length: Array
    positions: Array
    tangents: Array
    length: float
    points: int


def slid_there(
    cable: cs.Cable, scene: cs.Scene, before: cs.CableShape, after: cs.CableShape, grips: list[tuple[cs.Pose, cs.Pose]]
) -> bool:
    """Whether a chain comes to rest on the same side of all bodies as a shape, from the one before.

    grips: of all steps from that one to this.
    """
    chained = any(_slid_there(cable, scene, before, after, grips, elements) for elements in ELEMENTS)
    return chained or _moved_there(cable, scene, before, after, grips)


def _moved_there(
    cable: cs.Cable, scene: cs.Scene, before: cs.CableShape, after: cs.CableShape, grips: list[tuple[cs.Pose, cs.Pose]]
) -> bool:
    """Whether a motion leads to the shape, and passes no body in any of its steps."""
    return any(_moves_there(cable, scene, before, after, grips, *mesh) for mesh in MESHES)


def _moves_there(
    cable: cs.Cable, scene: cs.Scene, before: cs.CableShape, after: cs.CableShape,
    grips: list[tuple[cs.Pose, cs.Pose]], elements: int | None, longest: float,
) -> bool:  # fmt: skip
    """The same of a motion with so many elements, in steps that become as long as `longest` [s] at the end."""
    slow = cable.replace(retardation_time=10.0 * DT, drag=0.3)
    motion = cs.Motion(slow, scene, points=before.points, elements=elements)
    last, dt = motion.take_up(before, *grips[0]), DT
    parts = np.arange(1, SUBSTEPS + 1) / SUBSTEPS
    way = [
        [_between(a, b, part) for a, b in zip(one, two, strict=True)] for one, two in pairwise(grips) for part in parts
    ]
    for k, ends in enumerate(way + [list(grips[-1])] * MOST):
        shape = motion.step(*ends, dt)
        if not shape.usable or passed(scene, 0.5 * cable.diameter, last, shape):
            return False
        last = shape
        if k >= len(way):
            if np.linalg.norm(last.positions - after.positions, axis=1).max() < THERE * cable.length:
                return True
            dt = min(LONGER * dt, longest)
    return False


def _slid_there(
    cable: cs.Cable, scene: cs.Scene, before: cs.CableShape, after: cs.CableShape,
    grips: list[tuple[cs.Pose, cs.Pose]], elements: int,
) -> bool:  # fmt: skip
    """The same with so many elements."""
    arcs = np.linspace(0.0, cable.length, elements + 1)
    x, rest = slid(
        cable, scene, np.stack([np.interp(arcs, before.arc_length, p) for p in before.positions.T], 1), grips
    )
    t = np.gradient(x, arcs, axis=0)
    line = Line(arcs, x, t / np.linalg.norm(t, axis=1)[:, None], cable.length, arcs.size)
    return rest and not passed(scene, 0.5 * cable.diameter, line, after)


def _between(one: cs.Pose, other: cs.Pose, part: float) -> cs.Pose:
    """Straight from one pose to another that is near."""
    p, q = one.quaternion, other.quaternion
    q = q if float(p @ q) > 0.0 else -q
    turned = (1.0 - part) * p + part * q
    return cs.Pose((1.0 - part) * one.position + part * other.position, turned / np.linalg.norm(turned))
