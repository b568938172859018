"""Cables that touch, held at the points where they do, from one equilibrium to the next: :class:`Group`."""

from __future__ import annotations

import math
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.models.crossing_state import Held, end_frames
from cable_shape.models.crossing_step import Spot, Step, crossing_step
from cable_shape.models.span_search import FAR
from cable_shape.problem import Problem
from cable_shape.shape import CableShape

SETTLED = 0.02  #: of the tolerance: a smaller step is the last one
FARTHEST = 0.6  #: of the distance to be kept, that two points come nearer in one iteration
GROWTH = 0.3  #: of the cables' distance: by how much overlapping ones are pushed apart at a time
_FAST, _SLOW = 12, 80  #: iterations along a branch, and in search of one
_SHIFTED = 3  #: iterations along a branch that may go downhill first
_KICK = 0.1  #: of the distance to be kept
_SMALLEST = 1e-3  #: of a step


@final
class Group:
    """`spots`, and the rods of the cables that have any; `frames` (k, 2, 7) are the ends of the last equilibrium."""

    def __init__(self, problems: list[Problem], shapes: list[CableShape], frames: Array, spots: list[Spot]) -> None:
        """From the shapes of all the cables with their ends in `frames`."""
        self.problems = problems
        self.frames = frames.copy()
        self.spots = spots
        self.rods: dict[int, Held] = {}
        self.stable = True
        self._far = FAR
        self._rows: list[tuple[int, int]] = []  # of every point: cable, number there
        self._last: tuple[Array, Array, Array] | None = None  # frames, arcs and places before
        arcs: dict[int, list[float]] = {}
        for spot in spots:
            for side, cable in enumerate(spot.cables):
                arcs.setdefault(cable, []).append(float(spot.arcs[side]))
        for cable, own in arcs.items():
            self.rods[cable] = Held(problems[cable], shapes[cable], np.sort(own), frames[cable])
        taken: dict[int, list[float]] = {cable: sorted(own) for cable, own in arcs.items()}
        for spot in spots:
            a, b = (taken[cable].index(spot.arcs[side]) for side, cable in enumerate(spot.cables))
            spot.points = (a, b)
            self._rows += [(spot.cables[0], a), (spot.cables[1], b)]
        self._unit = min(SETTLED * rod.tolerance for rod in self.rods.values())

    def keep(self) -> tuple[Any, ...]:
        """What :meth:`restore` takes to come back here; valid until the mesh changes."""
        held = {cable: rod.keep() for cable, rod in self.rods.items()}
        return self.frames.copy(), [spot.copy() for spot in self.spots], held, self._last, self.stable

    def restore(self, kept: tuple[Any, ...]) -> None:
        """Back to where `keep` was called."""
        frames, spots, held, self._last, self.stable = kept
        self.frames, self.spots = frames.copy(), [spot.copy() for spot in spots]
        for cable, state in held.items():
            self.rods[cable].restore(state)

    def go(self, frames: Array, *, search: bool = False) -> bool:
        """The equilibrium with the ends in `frames`, on the branch of the last one, or in a `search` any; False: none.

        Where it was not found, the group is to be restored.
        """
        before = self._where()
        self._far = math.inf if search else FAR
        arcs, places = self._predicted(frames)
        if not self._solve(frames, arcs, places, again=False):
            arcs, places = before
            if not self._solve(frames, arcs, places, again=False):
                return False
        shifts, kicked = 0, False
        for _ in range(_SLOW if search else _FAST):
            self._put(arcs, places)
            step = self._step()
            self.stable = step.stable
            shifts += not step.stable
            if shifts > _SHIFTED and not search:
                return False
            if max(np.abs(step.places).max(), np.abs(step.arcs).max()) <= self._unit:
                if step.stable or not search or kicked:
                    return self._finish(frames, arcs + step.arcs, places + step.places, step.press, before)
                kicked = True
                size = float(np.abs(step.softest).max())
                step.places[:] = _KICK * self.spots[0].reach / size * step.softest
            fraction = self._bounded(step)
            while not self._solve(frames, arcs + fraction * step.arcs, places + fraction * step.places, again=True):
                fraction *= 0.25
                if fraction < _SMALLEST:
                    return False
            arcs, places = arcs + fraction * step.arcs, places + fraction * step.places
            for spot, press in zip(self.spots, step.press.tolist(), strict=True):
                spot.press = press
        return False

    def refined(self) -> bool:
        """New meshes where they are too coarse or too fine; False if the equilibrium is lost on them."""
        for _ in range(3):
            changed = [rod.refined() for rod in self.rods.values()]
            if False in changed:
                return False
            if True not in changed:
                return True
            self._last = None
            if not self.go(self.frames):
                return False
        return True

    def touches(self, cable: int) -> list[tuple[float, int, Array, Array, float]]:
        """Of a cable, in ascending arc length: arc length, the other cable, the point on it, its normal, the force."""
        found = []
        for spot in self.spots:
            if spot.press <= 0.0:
                continue
            for side, sign in ((0, 1.0), (1, -1.0)):
                if spot.cables[side] == cable:
                    other, normal = spot.cables[1 - side], sign * spot.normal
                    point = spot.places[1 - side] + 0.5 * self.problems[other].cable.diameter * normal
                    found.append((float(spot.arcs[side]), other, point, normal, spot.press))
        return sorted(found, key=lambda row: row[0])

    # -- the parts of a solve

    def _where(self) -> tuple[Array, Array]:
        return np.array([spot.arcs for spot in self.spots]), np.array([spot.places for spot in self.spots])

    def _put(self, arcs: Array, places: Array) -> None:
        for spot, s, y in zip(self.spots, arcs, places, strict=True):
            spot.arcs, spot.places = s.copy(), y.copy()

    def _predicted(self, frames: Array) -> tuple[Array, Array]:
        """Arc lengths and places: as the ends went on before, or else with what the ends do."""
        arcs, places = self._where()
        motion = frames - self.frames
        if self._last is not None:
            past = self.frames - self._last[0]
            square = float((past * past).sum())
            if square > 1e-16:
                pace = min(max(float((past * motion).sum()) / square, 0.0), 2.0)
                return arcs + pace * (arcs - self._last[1]), places + pace * (places - self._last[2])
        return arcs, places + self._carried(motion, arcs)

    def _carried(self, motion: Array, arcs: Array) -> Array:
        """(k, 2, 3) [m], how the mean of a spot's two cables moves if each moves linearly between its ends."""
        out = np.zeros((len(self.spots), 2, 3))
        for c, spot in enumerate(self.spots):
            for side, cable in enumerate(spot.cables):
                x = arcs[c, side] / self.problems[cable].cable.length
                out[c] += 0.5 * ((1.0 - x) * motion[cable, 0, :3] + x * motion[cable, 1, :3])
        return out

    def _solve(self, frames: Array, arcs: Array, places: Array, *, again: bool) -> bool:
        """All the rods with their points there."""
        for cable, rod in self.rods.items():
            own = [i for i, (c, _) in enumerate(self._rows) if c == cable]
            order = sorted(own, key=lambda i: self._rows[i][1])
            s, y = arcs.reshape(-1)[order], places.reshape(-1, 3)[order]
            if (np.diff(s) <= 0.0).any() or not rod.solve(frames[cable], s, y, again=again, far=self._far):
                return False
        return True

    def _step(self) -> Step:
        """Newton's step from the rods' present solutions."""
        count = len(self._rows)
        force, tangent = np.zeros((count, 3)), np.zeros((count, 3))
        dforce, dtangent = np.zeros((count, 3, count, 4)), np.zeros((count, 3, count, 4))
        for rod in self.rods.values():
            rod.respond()
        for i, (cable, at) in enumerate(self._rows):
            rod = self.rods[cable]
            force[i], tangent[i] = rod.force[at], rod.tangent[at]
            for j, (other, to) in enumerate(self._rows):
                if other == cable:
                    dforce[i, :, j], dtangent[i, :, j] = rod.dforce[at, :, to], rod.dtangent[at, :, to]
        return crossing_step(self.spots, force, tangent, dforce, dtangent)

    def _bounded(self, step: Step) -> float:
        """The fraction of a step that neither runs past anything nor turns a normal round."""
        fraction = 1.0
        for cable, rod in self.rods.items():
            change = np.zeros(len(rod.arcs))
            for i, (c, at) in enumerate(self._rows):
                if c == cable:
                    change[at] = step.arcs.reshape(-1)[i]
            fraction = min(fraction, rod.room(rod.arcs, change))
        for c, spot in enumerate(self.spots):
            relative = float(np.linalg.norm(step.places[c, 0] - step.places[c, 1]))
            allowed = max(spot.distance - spot.reach, 0.0) + FARTHEST * spot.reach
            fraction = min(fraction, allowed / relative if relative > allowed else 1.0)
        return fraction

    def _finish(self, frames: Array, arcs: Array, places: Array, press: Array, before: tuple[Array, Array]) -> bool:
        """The last small step, with output."""
        if not self._solve(frames, arcs, places, again=True):
            return False
        self._last = (self.frames, *before)
        self.frames = frames.copy()
        self._put(arcs, places)
        for spot, p in zip(self.spots, press.tolist(), strict=True):
            spot.press = p
        return True


def all_frames(problems: list[Problem]) -> Array:
    """(k, 2, 7), of the ends of all the cables."""
    return np.array([end_frames(problem) for problem in problems])
