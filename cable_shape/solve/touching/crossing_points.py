"""The points at which a cable is held where it touches another one, or itself: :class:`HeldPoints`."""

from __future__ import annotations

import copy
from typing import Any, Generic, TypeVar

import numpy as np

from cable_shape.checks import Array
from cable_shape.pose import Pose
from cable_shape.scene.scene import Clip
from cable_shape.shape import CableShape
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching.touch_state import TouchState

_REACH = 0.4  #: of the way from a held point to the next one, a mass or an end, that it may go in one step

State = TypeVar("State", Network, TouchState)


class HeldPoints(Generic[State]):
    """Of a cable held at k points, what does not depend on whether it touches bodies, too.

    `problem` is a copy of the one that was given, its clips those and the points. After ``respond``: `force` (k, 3)
    [N], world, on the cable at its points; `tangent` (k, 3); and their derivatives `dforce`, `dtangent` (k, 3, k, 4)
    in the points' places and arc lengths.
    """

    state: State

    def __init__(self, problem: Problem, arcs: Array, kind: str) -> None:
        """arcs (k,) [m], ascending; kind: of the clips that hold them."""
        self.problem = copy.copy(problem)
        self.problem.cache = {}
        self.problem.clips, self._at = with_points(problem.clips, arcs, kind)
        self._clips = np.setdiff1d(np.arange(len(self.problem.clips)), self._at - 1)
        self._supports: Array = np.empty((0, 7))
        k = len(arcs)
        self.force, self.tangent = np.zeros((k, 3)), np.zeros((k, 3))
        self.dforce, self.dtangent = np.zeros((k, 3, k, 4)), np.zeros((k, 3, k, 4))

    @property
    def arcs(self) -> Array:
        """(k,) [m], of the points."""
        return np.asarray(self._held_arcs[self._at])

    @property
    def _held_arcs(self) -> Array:
        """(m+1,) [m], of all the supports."""
        return self.state.bounds()

    @property
    def weight(self) -> float:
        """[N], weight + EI / L^2 of the cable: what its forces are measured by."""
        cable = self.problem.cable
        return float(np.linalg.norm(self.problem.load.mean(axis=0))) * cable.length + (
            cable.mean_bending_stiffness / cable.length**2
        )

    def take(self, problem: Problem) -> None:
        """The ends and links where they are now."""
        self.problem.start, self.problem.end, self.problem.links = problem.start, problem.end, problem.links
        self._supports = self.state.aim(problem.start, problem.end)

    def room(self, change: Array) -> float:
        """The fraction of a change of the points' arc lengths that keeps them in order, and between their stops."""
        return room(np.concatenate((self.state.stops, self._held_arcs)), self.arcs, change)

    def _placed(self, frames: Array, places: Array) -> Array:
        """(m+1, 7), of all the supports: the ends in `frames` (2, 7), the points in `places` (k, 3)."""
        out = self._supports.copy()
        out[0], out[-1] = frames
        out[self._at, :3] = places
        return out


def with_points(clips: tuple[Clip, ...], arcs: Array, kind: str) -> tuple[tuple[Clip, ...], Any]:
    """The clips, and points held by clips of a kind at `arcs` (k,) [m], in order; which supports the points are."""
    points = [Clip(arc, Pose(), kind) for arc in arcs.tolist()]
    every = sorted((*clips, *points), key=lambda clip: clip.arc_length)
    numbers = [1 + i for i, clip in enumerate(every) if any(clip is point for point in points)]
    return tuple(every), np.array(numbers, dtype=np.int64)


def room(stops: Array, arcs: Array, change: Array) -> float:
    """The fraction of a change of `arcs` (k,) that takes none too near to the next stop, themselves included."""
    stops = np.unique(stops)
    fraction = 1.0
    for at, by in zip(arcs.tolist(), change.tolist(), strict=True):
        i = int(np.searchsorted(stops, at))
        way = stops[i + 1] - at if by > 0.0 else at - stops[i - 1]
        if abs(by) > _REACH * way:
            fraction = min(fraction, _REACH * way / abs(by))
    return fraction


def positions_at(shape: CableShape, arcs: Array) -> Array:
    """(k, 3) [m], of the material points at arc lengths (k,)."""
    return np.stack([np.interp(arcs, shape.arc_length, column) for column in shape.positions.T], axis=1)


def directions(quaternions: Array) -> Array:
    """(k, 3), d3 of frames (k, 4)."""
    x, y, z, w = quaternions.T
    return np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
