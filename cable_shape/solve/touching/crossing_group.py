"""Cables that touch, held at the points where they do, from one equilibrium to the next: :class:`Group`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.shape import CableShape, Status
from cable_shape.solve.problem import Problem
from cable_shape.solve.search import FAR
from cable_shape.solve.touching.crossing_state import Held, twists
from cable_shape.solve.touching.crossing_step import Ground, Spot, Step, Way, crossing_step
from cable_shape.solve.touching.crossing_touch import HeldAmong

ITSELF = "itself"  #: the body's name, where a cable touches itself
FARTHEST = 0.6  #: of the distance to be kept, that two points come nearer in one iteration
GROWTH = 0.3  #: of the cables' distance: by how much overlapping ones are pushed apart at a time
_FAST, _SLOW = 12, 80  #: iterations along a branch, and in search of one
_SHIFTED = 3  #: iterations along a branch that may go downhill first
_KICK = 0.1  #: of the distance to be kept
_SMALLEST = 1e-3  #: of a step
_UNBALANCED = 1e-3  #: of the largest force at a point: what may be left of it at the end
_LIGHT = 0.1  #: of a cable's weight and stiffness / length^2: forces below are not told apart so finely
_MESHES = 3  #: in turn, for one equilibrium


@final
class Group:
    """`spots`, and the rods of the cables that have any; `frames` (n, 7) are those of the last equilibrium.

    They are those of the ends of all the cables in turn, and of the links that carry bodies, as :func:`all_frames` has
    them.
    """

    def __init__(
        self, names: Sequence[str], problems: list[Problem], shapes: list[CableShape], frames: Array, spots: list[Spot]
    ) -> None:
        """From the shapes of all the cables between these frames."""
        self._names = tuple(names)
        self.problems = problems
        self.frames = frames.copy()
        self.spots = spots
        self.rods: dict[int, Held | HeldAmong] = {}
        self.stable = True
        self._far = FAR
        self._rows: list[tuple[int, int]] = []  # of every point: cable, number there
        self._solved = False
        arcs: dict[int, list[float]] = {}
        for spot in spots:
            for side, cable in enumerate(spot.cables):
                arcs.setdefault(cable, []).append(float(spot.arcs[side]))
        for cable, own in arcs.items():
            given = problems[cable], shapes[cable], np.sort(own), self._ends(frames, cable)
            self.rods[cable] = HeldAmong(*given, self._links(frames)) if problems[cable].bodies else Held(*given)
        taken: dict[int, list[float]] = {cable: sorted(own) for cable, own in arcs.items()}
        for spot in spots:
            a, b = (taken[cable].index(spot.arcs[side]) for side, cable in enumerate(spot.cables))
            spot.points = (a, b)
            self._rows += [(spot.cables[0], a), (spot.cables[1], b)]
        self._unit = min(rod.settled for rod in self.rods.values())

    @property
    def coarse(self) -> bool:
        """Whether a rod's error is above its tolerance, and its mesh not to be made better."""
        return any(rod.coarse for rod in self._among)

    @property
    def buried(self) -> bool:
        """Whether a grip or a clip is inside a body now."""
        return any(rod.buried() for rod in self._among)

    @property
    def _among(self) -> list[HeldAmong]:
        """The rods that may touch bodies."""
        return [rod for rod in self.rods.values() if isinstance(rod, HeldAmong)]

    def keep(self) -> tuple[Any, ...]:
        """What :meth:`restore` takes to come back here; without bodies valid until the mesh changes."""
        held: dict[int, Any] = {cable: rod.keep() for cable, rod in self.rods.items()}
        return self.frames.copy(), [spot.copy() for spot in self.spots], held, self._solved, self.stable

    def restore(self, kept: tuple[Any, ...]) -> None:
        """Back to where `keep` was called."""
        frames, spots, held, self._solved, self.stable = kept
        self.frames, self.spots = frames.copy(), [spot.copy() for spot in spots]
        for cable, state in held.items():
            self.rods[cable].restore(state)

    def go(self, frames: Array, *, search: bool = False) -> bool:
        """The equilibrium with the ends in `frames`, on the branch of the last one, or in a `search` any; False: none.

        Where it was not found, the group is to be restored.
        """
        try:
            return self._go(frames, search)
        except np.linalg.LinAlgError:  # where two cables lie along each other, no points are nearest
            return False

    def _go(self, frames: Array, search: bool) -> bool:
        """As `go`, which see."""
        before = self._where()
        self._far = math.inf if search else FAR
        arcs, places = self._predicted(frames)
        if not self._solve(frames, arcs, places, again=False):
            arcs, places = before
            if not self._solve(frames, arcs, places, again=False):
                return False
        shifts, kicked = 0, False
        way: Way | None = None
        for _ in range(_SLOW if search else _FAST):
            self._put(arcs, places)
            self._look()
            for rod in self.rods.values():
                rod.respond()
            slope = math.nan if way is None else self._slope(way)
            if way is None or not way.overshot(slope):
                step = self._step()
                self.stable = step.stable
                shifts += not step.stable
                if shifts > _SHIFTED and not search:
                    return False
                kick = False
                if max(np.abs(step.places).max(), np.abs(step.arcs).max()) <= self._unit:
                    if step.stable or not search or kicked:
                        arcs, places = arcs + step.arcs, places + step.places
                        if not self._finish(frames, arcs, places, step):
                            return False
                        if self._balanced():
                            return True
                        way = None  # nodes have come to touch a body or ceased to
                        continue
                    kick = kicked = True
                    size = float(np.abs(step.softest).max())
                    step.places[:] = _KICK * self.spots[0].reach / size * step.softest
                self._press(step)
                way = Way(step, arcs, places, self._bounded(step))
                way.tangents = self._tangents()
                if not kick:
                    way.slope = self._slope(way)
            while not self._solve(frames, *way.end, again=True):
                way.fraction *= 0.25
                if way.fraction < _SMALLEST:
                    return False
            arcs, places = way.end
        return False

    def refined(self) -> bool:
        """New meshes where they are too coarse or too fine; False if the equilibrium is lost on them."""
        renewed: set[int] = set()
        for _ in range(_MESHES):
            changed = False
            for cable, rod in self.rods.items():
                outcome = None if isinstance(rod, HeldAmong) and rod.stale else rod.refined()
                if outcome is False:
                    return False
                if isinstance(rod, HeldAmong) and outcome is None and rod.lacking and cable not in renewed:
                    rod.renew(self.shape(cable, Status.OK, "", 0.0))
                    renewed.add(cable)
                    outcome = True
                changed = changed or outcome is True
            if not changed:
                return True
            if not self.go(self.frames):
                return False
        return True

    def shape(self, cable: int, status: Status, detail: str, began: float) -> CableShape:
        """A cable's shape with all its contacts, so graded; `began`: when its solve did."""
        rod = self.rods[cable]
        bodies, rows = list(rod.names), []
        for spot in self.spots:
            for side, sign in ((0, 1.0), (1, -1.0)):
                if spot.cables[side] != cable:
                    continue
                arc, place, other = float(spot.arcs[side]), spot.places[side], spot.cables[1 - side]
                for ground in spot.grounds[side]:
                    if ground.press > 0.0:
                        point = place - 0.5 * self.problems[cable].cable.diameter * ground.normal
                        rows.append((arc, ground.body, *point, *ground.normal, ground.press))
                if spot.press > 0.0:
                    name, normal = ITSELF if other == cable else self._names[other], sign * spot.normal
                    if name not in bodies:
                        bodies.append(name)
                    point = spot.places[1 - side] + 0.5 * self.problems[other].cable.diameter * normal
                    rows.append((arc, bodies.index(name), *point, *normal, spot.press))
        touches = np.array(sorted(rows, key=lambda row: row[0])).reshape(-1, 9)
        return rod.shape(status, detail, touches, tuple(bodies), began)

    # -- the parts of a solve

    def _where(self) -> tuple[Array, Array]:
        return np.array([spot.arcs for spot in self.spots]), np.array([spot.places for spot in self.spots])

    def _put(self, arcs: Array, places: Array) -> None:
        for spot, s, y in zip(self.spots, arcs, places, strict=True):
            spot.arcs, spot.places = s.copy(), y.copy()

    def _look(self) -> None:
        """Which bodies the points are near."""
        for spot in self.spots:
            near: list[list[Ground]] = [[], []]
            for side, cable in enumerate(spot.cables):
                rod = self.rods[cable]
                if isinstance(rod, HeldAmong):
                    near[side] = rod.grounds(float(spot.arcs[side]), spot.places[side], spot.grounds[side])
            spot.grounds = near[0], near[1]

    def _press(self, step: Step) -> None:
        """Takes over a step's forces."""
        pushes = iter(step.pushes.tolist())
        for spot, press in zip(self.spots, step.press.tolist(), strict=True):
            spot.press = press
            low, high = ([replace(ground, press=next(pushes)) for ground in side] for side in spot.grounds)
            spot.grounds = low, high

    def _ends(self, frames: Array, cable: int) -> Array:
        """(2, 7), those of a cable's ends."""
        return frames[2 * cable : 2 * cable + 2]

    def _links(self, frames: Array) -> Array:
        """(m, 7), those of the links that carry bodies."""
        return frames[2 * len(self.problems) :]

    def _predicted(self, frames: Array) -> tuple[Array, Array]:
        """Arc lengths and places: by the step that the motion of the ends asks for, at first as they carry them."""
        arcs, places = self._where()
        motion = frames - self.frames
        if not self._solved:
            return arcs, places + self._carried(motion, arcs)
        force, tangent = np.zeros((len(self._rows), 3)), np.zeros((len(self._rows), 3))
        moved = {}
        for cable, rod in self.rods.items():
            rod.respond()
            moved[cable] = rod.under_motion(twists(self._ends(self.frames, cable), self._ends(frames, cable)))
        for i, (cable, at) in enumerate(self._rows):
            force[i], tangent[i] = moved[cable][0][at], moved[cable][1][at]
        step = self._step(force, tangent)
        way = Way(step, arcs, places, self._bounded(step))
        return way.end

    def _carried(self, motion: Array, arcs: Array) -> Array:
        """(k, 2, 3) [m], how the mean of a spot's two cables moves if each moves linearly between its ends."""
        out = np.zeros((len(self.spots), 2, 3))
        for c, spot in enumerate(self.spots):
            for side, cable in enumerate(spot.cables):
                x = arcs[c, side] / self.problems[cable].cable.length
                start, end = self._ends(motion, cable)[:, :3]
                out[c] += 0.5 * ((1.0 - x) * start + x * end)
        return out

    def _solve(self, frames: Array, arcs: Array, places: Array, *, again: bool) -> bool:
        """All the rods with their points there."""
        for cable, rod in self.rods.items():
            own = [i for i, (c, _) in enumerate(self._rows) if c == cable]
            order = sorted(own, key=lambda i: self._rows[i][1])
            s, y = arcs.reshape(-1)[order], places.reshape(-1, 3)[order]
            ends, links = self._ends(frames, cable), self._links(frames)
            if (np.diff(s) <= 0.0).any() or not rod.solve(ends, s, y, again=again, far=self._far, links=links):
                return False
        return True

    def _forces(self) -> Array:
        """(2 k, 3) [N], those that hold the points."""
        return np.array([self.rods[cable].force[at] for cable, at in self._rows])

    def _tangents(self) -> Array:
        """(2 k, 3), at the points."""
        return np.array([self.rods[cable].tangent[at] for cable, at in self._rows])

    def _step(self, force: Array | float = 0.0, tangent: Array | float = 0.0) -> Step:
        """Newton's step from the rods' present solutions; force, tangent (2 k, 3): what else they change by."""
        count = len(self._rows)
        dforce, dtangent = np.zeros((count, 3, count, 4)), np.zeros((count, 3, count, 4))
        for i, (cable, at) in enumerate(self._rows):
            rod = self.rods[cable]
            for j, (other, to) in enumerate(self._rows):
                if other == cable:
                    dforce[i, :, j], dtangent[i, :, j] = rod.dforce[at, :, to], rod.dtangent[at, :, to]
        return crossing_step(self.spots, self._forces() + force, self._tangents() + tangent, dforce, dtangent)

    def _unmet(self, force: Array) -> Array:
        """(k, 2, 3) [N], what of the forces (2 k, 3) that hold the points contacts do not exert."""
        left = force.reshape(-1, 2, 3).copy()
        for c, spot in enumerate(self.spots):
            for side, sign in ((0, 1.0), (1, -1.0)):
                left[c, side] -= sign * spot.press * spot.normal
                for ground in spot.grounds[side]:
                    left[c, side] -= ground.press * ground.normal
        return left

    def _balanced(self) -> bool:
        """Whether the contacts exert what holds the points in the last solutions."""
        force = np.array([self.rods[cable].reaction[at] for cable, at in self._rows])
        size = max(float(np.abs(force).max()), _LIGHT * max(rod.weight for rod in self.rods.values()))
        return float(np.abs(self._unmet(force)).max()) <= _UNBALANCED * size

    def _slope(self, way: Way) -> float:
        """[J], how the energy changes along a way where the points are now, contacts carrying what it ends with."""
        left = self._unmet(self._forces())
        across = way.step.places - way.tangents.reshape(-1, 2, 3) * way.step.arcs[:, :, None]
        return float((left * across).sum())

    def _bounded(self, step: Step) -> float:
        """The fraction of a step that neither runs past anything nor turns a normal round."""
        fraction = 1.0
        for cable, rod in self.rods.items():
            change = np.zeros(len(rod.arcs))
            for i, (c, at) in enumerate(self._rows):
                if c == cable:
                    change[at] = step.arcs.reshape(-1)[i]
            fraction = min(fraction, rod.room(change))
        for c, spot in enumerate(self.spots):
            relative = float(np.linalg.norm(step.places[c, 0] - step.places[c, 1]))
            allowed = max(spot.distance - spot.reach, 0.0) + FARTHEST * spot.reach
            fraction = min(fraction, allowed / relative if relative > allowed else 1.0)
            for side, cable in enumerate(spot.cables):
                rod = self.rods[cable]
                if isinstance(rod, HeldAmong):
                    fraction = min(fraction, rod.bounded(step.places[c, side], spot.grounds[side]))
        return fraction

    def _finish(self, frames: Array, arcs: Array, places: Array, step: Step) -> bool:
        """The last small step, with output."""
        if not self._solve(frames, arcs, places, again=True):
            return False
        self._solved = True
        self.frames = frames.copy()
        self._put(arcs, places)
        self._press(step)
        return True
