"""The reference shapes without clips, how they are reached, and how far a shape is from them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from cable_shape.command.reference_case import reference_case
from cable_shape.pose import FreeEnd, Pose
from cable_shape.shape import CableShape
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

ALONG_X = Rotation.from_quat((0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)))  # d3 = x, d2 = y
STEPS = 20
Values = dict[str, Any]


def load(folder: Path, kind: str = "shape") -> list[Values]:
    """The cases of one kind, by name; those held in clips, which no model of this version knows, are left out."""
    cases = [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]
    return [values for values in cases if values.get("kind", "shape") == kind and not values.get("clips")]


def reach(values: Values) -> tuple[CableShape, Network]:
    """The shape of a case with several near ones: along its approach, under a growing load, or from beside it."""
    if values["end"] is None:
        return under_growing_load(values)
    if values["name"].startswith(("elastica", "localised")):
        return beside(values)
    return along_approach(values)


def under_growing_load(values: Values) -> tuple[CableShape, Network]:
    """A free end whose loads, and the weight, grow from zero."""
    case = reference_case(values)
    options = {"points": 41, "scene": case.scene}
    assert isinstance(case.end, FreeEnd)
    state = Network(Problem(case.cable, gravity=values["gravity"], **options))
    for t in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        problem = Problem(case.cable, gravity=t * np.array(values["gravity"]), **options)
        end = FreeEnd(case.end.mass, t * case.end.force, t * case.end.moment)
        shape = cosserat.solve(problem.move(case.start, end), state)
    return shape, state


def along_approach(values: Values) -> tuple[CableShape, Network]:
    """The shape at the end of a case's approach; from nothing where it has none."""
    case = reference_case(values)
    options = {"points": 41, "scene": case.scene, "gravity": values["gravity"]}
    if "approach" not in values:
        problem = Problem(case.cable, **options).move(case.start, case.end)
        state = Network(problem)
        return cosserat.solve(problem, state), state
    path, length = values["approach"], case.cable.length
    origin, goal = np.array(values["start"]["position"]), np.array(values["end"]["position"])
    first = origin + np.array((0.97 * length, 0.0, 0.0))
    state = None
    for t in np.linspace(0.0, 1.0, STEPS + 1):
        start = Rotation.from_rotvec(t * np.array(path["start_rotvec"])) * ALONG_X
        twist = Rotation.from_rotvec((0.0, 0.0, t * path["end_twist"]))
        end = Rotation.from_rotvec(t * np.array(path["end_rotvec"])) * ALONG_X * twist
        cable = case.cable.replace(rest_curvature=t * np.array(case.cable.rest_curvature))
        problem = Problem(cable, **options)
        problem.move(Pose(origin, start.as_quat()), Pose((1 - t) * first + t * goal, end.as_quat()))
        state = state or Network(problem)
        shape = cosserat.solve(problem, state)
    return shape, state


def beside(values: Values, tolerance: float | None = None) -> tuple[CableShape, Network]:
    """The shape found from a start beside the answer: the frames of the solution, interpolated and disturbed."""
    case, solution = reference_case(values), values["solution"]
    options = {} if tolerance is None else {"tolerance": tolerance}
    problem = Problem(case.cable, points=41, gravity=values["gravity"], **options).move(case.start, case.end)

    def frames(s: np.ndarray) -> np.ndarray:
        between = Slerp(solution["s"], Rotation.from_quat(solution["q_xyzw"]))(np.clip(s, 0.0, solution["s"][-1]))
        bump = 0.02 * np.sin(math.pi * s / s[-1])[:, None] * np.array((1.0, 0.6, 0.3))
        q = (Rotation.from_rotvec(bump) * between).as_quat()
        q[1:] *= np.cumprod(np.sign((q[1:] * q[:-1]).sum(axis=1)))[:, None]
        return q

    state = Network(problem)
    return cosserat.solve_beside(problem, state, frames, solution["n"][-1]), state


def error_of(positions: np.ndarray, values: Values) -> float:
    """Mean distance at equal arc length / length; where the plane is free, after the best turn about the chord."""
    expected = np.array(values["solution"]["r"])
    length = values["cable"]["length"]
    direct = np.linalg.norm(positions - expected, axis=1).mean() / length
    chord = expected[-1] - expected[0]
    if not values["name"].startswith(("elastica", "postbuckled")) or not np.any(chord):
        return float(direct)
    axis = chord / np.linalg.norm(chord)
    if values["end"] is None:
        axis = Rotation.from_quat(values["start"]["quaternion_xyzw"]).apply((0.0, 0.0, 1.0))
    a, b = positions - expected[0], expected - expected[0]
    flat_a, flat_b = a - np.outer(a @ axis, axis), b - np.outer(b @ axis, axis)
    angle = math.atan2((np.cross(flat_a, flat_b) @ axis).sum(), (flat_a * flat_b).sum())
    turned = Rotation.from_rotvec(angle * np.asarray(axis)).apply(a)
    return float(min(direct, np.linalg.norm(turned - b, axis=1).mean() / length))
