"""Many points of a study at once, where cable, grips and clips vary by their tolerances: :class:`Beside`.

The cable in the middle of all distributions is solved from nothing; every point starts from it, in compiled code
(:mod:`cable_shape.kernels.safety.sample_rows`), on the same mesh. What is not reached so is solved by itself.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from cable_shape import checks
from cable_shape.cable.case_parts import pose_of
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.kernels.network import beside, drive, material, tables
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.kernels.network.respond import softest_mode
from cable_shape.kernels.safety import follow_rows, sample_rows
from cable_shape.kernels.safety import loads_used as margins
from cable_shape.planning.study_case import Case
from cable_shape.planning.study_vary import Axis
from cable_shape.planning.study_walk import Rows, follows, judged_by, predictor_of
from cable_shape.pose import FreeEnd, Grip, Pose, multiply, rotate
from cable_shape.scene.scene_parts import clip_names
from cable_shape.shape import Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import CLIP_SPACING

_NUMBERS = ("length", "linear_density", "bending_stiffness", "twisting_stiffness", "axial_stiffness")
#: Places that may vary together.
_PLACES = re.compile(
    rf"cable\.({'|'.join(_NUMBERS)})|(start|end)\.(position|quaternion)\.([xyzw0-3])"
    r"|scene\.clips\.([^.]+)\.(arc_length|position\.([xyz0-2]))"
)
#: Inverse iterations for the softest mode of a point, from that of the middle.
MODE_STEPS = 12
#: Meshes that are tried for the middle, so that there is room for the points around.
MESHES = 4
_COMPONENT = {**{c: i for i, c in enumerate("xyzw")}, **{str(i): i for i in range(4)}}


@final
class Beside:
    """The points around one shape. Made by `beside_of`; several threads may ask it."""

    def __init__(self, case: Case, values: Mapping[str, Any], names: Sequence[str], network: Network) -> None:
        self.case, self.names, self.network = case, tuple(names), network
        self.places = [_PLACES.fullmatch(name) for name in names]
        problem = network.problem
        self.clips = clip_names(problem.clips)
        self.poses = {side: _told_pose(values, side) for side in ("start", "end") if isinstance(case.held[side], Grip)}
        told = values["cable"]
        self.twist_follows = told.get("twisting_stiffness") is None
        self.clipped = np.concatenate((network.arcs[:1], network.points, network.arcs[1:-1]))
        network.refresh()
        mode = np.random.default_rng(0).normal(size=(len(network.nodes), 3))
        state = network.ints, network.floats, network.sols, network.work
        softest_mode(*state, np.empty(0), mode, follow_rows.STEPS_AT_FIRST, False, np.empty(2))
        stays = np.concatenate((network.arcs, network.stops))
        self.order = np.argsort(stays)
        self.stays = stays[self.order]
        self.middle = sample_rows.Middle(network.bare, *state, mode, 0, self.stays, problem.tolerance)

    def rows(self, points: Array, stability: bool = False) -> Rows:
        """The shapes of points (r, axes), an instant each; those that were not reached are not converged."""
        case, problem = self.case, self.network.problem
        assert not isinstance(case.cable, Harness)
        rows = Rows(case.cable.cable, case.scene, None, len(points), problem.points, self.clips)
        numbers, ends, clips = self._numbers(points), self._ends(points), self._clips(points)
        rows.length = numbers["length"]
        good = np.flatnonzero(ends[1] & self._possible(numbers, clips[0]))
        asked = sample_rows.Rows(
            self._models(numbers)[good],
            self._stays(numbers["length"], clips[0])[good],
            np.concatenate((ends[0][:, :1], clips[1], ends[0][:, 1:]), axis=1)[good],
            self._pieces(rows, numbers)[good],
            self._soft(numbers)[good],
        )
        masses = self.network.masses(case.held["end"])
        masses[masses[:, 0] == self.network.length, 0] *= 2.0  # a plug: the end is nearest, however long
        judged = judged_by(rows, isinstance(case.held["end"], Grip), masses)
        whole = good.size == len(points)
        arrays = rows.buffers, rows.infos, rows.loads, rows.tables, rows.margins
        found = follow_rows.Found(*(arrays if whole else [a[good] for a in arrays]))
        codes = np.empty(good.size, np.int64)
        middle = self.middle._replace(steps=MODE_STEPS if stability else 0)
        sample_rows.solve_rows(middle, asked, judged, found, codes)
        for a, b in zip(arrays, found, strict=True):
            if not whole:
                a[good] = b
        rows.status[good[codes == CONVERGED]] = Status.OK.value
        return rows

    # -- what differs

    def _numbers(self, points: Array) -> dict[str, Array]:
        """The cable's numbers, (r,) each."""
        cable = self.network.problem.cable
        made = {
            "length": cable.length,
            "linear_density": cable.linear_density,
            "bending_stiffness": cable.mean_bending_stiffness,
            "twisting_stiffness": cable.twisting_stiffness,
            "axial_stiffness": math.inf if cable.axial_stiffness is None else cable.axial_stiffness,
        }
        out = {name: np.full(len(points), value) for name, value in made.items()}
        for place, column in zip(self.places, points.T, strict=True):
            if place is not None and place[1]:
                out[place[1]] = column
        if self.twist_follows and "cable.twisting_stiffness" not in self.names:
            out["twisting_stiffness"] = out["bending_stiffness"] * (
                cable.twisting_stiffness / cable.mean_bending_stiffness
            )
        return out

    def _bending(self, numbers: dict[str, Array]) -> Array:
        """(r, 2) [N m^2]."""
        cable = self.network.problem.cable
        ratio = np.array(cable.bending_stiffness) / cable.mean_bending_stiffness
        return numbers["bending_stiffness"][:, None] * ratio

    def _soft(self, numbers: dict[str, Array]) -> Array:
        """(r,) [N], the smallest stiffness / length^2."""
        least = np.minimum(self._bending(numbers).min(axis=1), numbers["twisting_stiffness"])
        return np.asarray(least / numbers["length"] ** 2)

    def _models(self, numbers: dict[str, Array]) -> Array:
        """(r, size), with one element a span."""
        network, problem = self.network, self.network.problem
        whole = np.tile(network.held, (len(numbers["length"]), 1))
        bare = network.parts
        soft = self._soft(numbers)
        stiff = np.column_stack((self._bending(numbers), numbers["twisting_stiffness"]))
        whole[:, tables.BASE_SHIFT] *= soft / network.softest
        whole[:, tables.SOFTEST], whole[:, tables.STIFFEST] = soft, stiff.max(axis=1)
        whole[:, tables.LENGTH] = numbers["length"]
        whole[:, bare.breaks] *= (numbers["length"] / network.length)[:, None]
        weight = numbers["linear_density"][:, None] * problem.gravity
        whole[:, bare.heavy] = weight
        pieces = whole[:, bare.piece].reshape(len(whole), -1, tables.PIECE)
        more = (weight - problem.cable.linear_density * problem.gravity)[:, None]
        for side in (material.K_LEFT, material.K_RIGHT):
            pieces[:, :, side : side + 3] = stiff[:, None]
            load = side + material.LOAD_LEFT
            pieces[:, :, load : load + 3] += more
        pieces[:, :, material.COMPLIANCE + 2] = (1.0 / numbers["axial_stiffness"])[:, None]
        whole[:, bare.piece] = pieces.reshape(len(whole), -1)
        return whole

    def _stays(self, length: Array, arcs: Array) -> Array:
        """(r, a) [m]: where the supports, at arcs (r, clips), masses and kinks of the cable are."""
        network = self.network
        masses = np.isin(network.stops, network.points)
        kinks = np.where(masses, 1.0, (length / network.length)[:, None]) * network.stops
        every = np.column_stack((np.zeros(len(length)), arcs, length, kinks))
        return np.ascontiguousarray(every[:, self.order])

    def _pieces(self, rows: Rows, numbers: dict[str, Array]) -> Array:
        """(r, 1, PIECE), what margins are measured by."""
        out = np.tile(rows.pieces, (len(rows), 1, 1))
        longer = numbers["length"] / rows.cable.length
        out[:, 0, margins.P_TO] *= longer
        pull = 0.0 if rows.cable.max_tension is None else rows.cable.max_tension
        out[:, 0, margins.P_LIMITS + margins.STRETCH] = numbers["length"] * (1.0 + pull / numbers["axial_stiffness"])
        return out

    def _ends(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """(r, 2, 7) frames of the cable at both ends, at a free end that of the start; whether they are poses."""
        out, good = np.empty((len(points), 2, 7)), np.ones(len(points), np.bool_)
        for i, side in enumerate(("start", "end")):
            if side not in self.poses:
                out[:, i] = out[:, 0]
                continue
            pose, offset = self.poses[side], self._offset(side)
            table = np.tile(pose, (len(points), 1))
            for place, column in zip(self.places, points.T, strict=True):
                if place is not None and place[2] == side:
                    table[:, _COMPONENT[place[4]] + (0 if place[3] == "position" else 3)] = column
            size = np.linalg.norm(table[:, 3:], axis=1)
            good &= np.abs(size - 1.0) <= checks.QUATERNION_TOLERANCE
            q = (table[:, 3:] / size[:, None]).T
            out[:, i, :3] = table[:, :3] + rotate(q, offset[:3]).T
            out[:, i, 3:] = multiply(q, offset[3:]).T
        return out, good

    def _offset(self, side: str) -> Array:
        """(7,), the cable's frame in that of what holds it."""
        pose = Pose(self.poses[side][:3], self.poses[side][3:])
        return (pose.inverse() * Pose.trusted(self.case.frames[side][0])).array

    def _clips(self, points: Array) -> tuple[Array, Array]:
        """Arc lengths (r, clips) and poses (r, clips, 7) of the clips."""
        network = self.network
        arcs = np.tile(network.arcs[1:-1], (len(points), 1))
        knots = np.tile(network.knots[1:-1], (len(points), 1, 1))
        for place, column in zip(self.places, points.T, strict=True):
            if place is None or not place[5]:
                continue
            clip = self.clips.index(place[5]) if place[5] in self.clips else int(place[5])
            if place[6] == "arc_length":
                arcs[:, clip] = column
            else:
                knots[:, clip, _COMPONENT[place[7]]] = column
        return arcs, knots

    def _possible(self, numbers: dict[str, Array], arcs: Array) -> NDArray[np.bool_]:
        """(r,): whether there is such a cable, its clips on it in their order, and masses where they were."""
        length = numbers["length"]
        out = np.all([x > 0.0 for name, x in numbers.items() if name != "linear_density"], axis=0)
        out &= (numbers["linear_density"] >= 0.0) & (self.network.points.max(initial=0.0) < length)
        every = np.column_stack((np.zeros(len(length)), arcs, length))
        return np.asarray(out & (np.diff(every, axis=1) >= CLIP_SPACING * length[:, None]).all(axis=1))


def _told_pose(values: Mapping[str, Any], side: str) -> Array:
    """(7,), as told; the quaternion is a unit one."""
    told = {key: values[side][key] for key in ("position", "quaternion", "turns") if values[side].get(key) is not None}
    return pose_of(side, told).array


def beside_of(case: Case, values: Mapping[str, Any], axes: Sequence[Axis]) -> Beside | None:
    """The points around the `case` in the middle of all axes, which `values` say; None if they are not for it.

    They are if all are drawn from distributions, vary what compiled code can vary, at one instant, and the case has a
    stable shape.
    """
    if not axes or not all(axis.law and _PLACES.fullmatch(axis.name) for axis in axes):
        return None
    if isinstance(case.cable, Harness) or case.instants != 1 or case.robot is not None or "motion" in values:
        return None
    told = values["cable"]
    pair = not isinstance(told.get("bending_stiffness"), (int, float))
    if "youngs_modulus" in told or (pair and any(axis.name == "cable.bending_stiffness" for axis in axes)):
        return None
    predictor = predictor_of(case)
    if not follows(case, predictor):
        return None
    problem = predictor.problem
    network = Network(problem)
    start, end = case.held["start"], case.held["end"]
    assert isinstance(start, Grip)
    first = start.at(Pose.trusted(case.frames["start"][0]))
    last = end if isinstance(end, FreeEnd) else end.at(Pose.trusted(case.frames["end"][0]))
    shape = cosserat.solve(problem.move(first, last), network)
    network.tolerance = beside.SHARE * problem.tolerance  # only now: what begins on a finer mesh may be another branch
    for _ in range(MESHES):
        good = network.info[drive.I_ESTIMATE] + network.info[drive.I_DOUBT] <= network.tolerance
        if good or shape.status is not Status.OK or not network.next_mesh():
            break
        network.history = 1
        shape = cosserat.solve(problem, network)
    if shape.status is not Status.OK or network.rolls or network.history == 0:
        return None
    return Beside(case, values, [axis.name for axis in axes], network)
