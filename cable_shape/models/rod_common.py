"""What the rod's models share, plain, in clips and in contact: the straight line, and sensitivities about grippers."""

from __future__ import annotations

import math
from time import perf_counter

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.frames import straight
from cable_shape.pose import Grip
from cable_shape.problem import Problem
from cable_shape.shape import CableShape, Status
from cable_shape.solve.answers import about_gripper

MODEL = "cosserat"


def straight_line(
    problem: Problem,
    buffer: Array,
    first: Array,
    last: Array,
    status: Status,
    detail: str,
    iterations: int,
    began: float,
) -> CableShape:
    """The straight line from frame `first` (7,) to `last` (7,), for want of a shape; `buffer` becomes its own."""
    roll = straight(first, last, problem.cable.length, problem.points, buffer)
    return CableShape(
        buffer,
        problem.points,
        length=problem.cable.length,
        model=MODEL,
        status=status,
        detail=detail,
        error_estimate=math.inf,
        residual=math.inf,
        iterations=iterations,
        solve_time=perf_counter() - began,
        roll_error=float(roll),
    )


def turn_about(at: str, problem: Problem, out: Array) -> None:
    """Changes sensitivities (n, 3, 12) about the cable's ends into those about the grippers' origins, if asked."""
    if at == "cable":
        return
    if at != "gripper":
        raise ArgumentError.of("at", at, "it must be 'cable' or 'gripper'", "Choose one of these.")
    for column, end in ((0, problem.start), (6, problem.end)):
        if isinstance(end, Grip):
            about_gripper(end, out[:, :, column : column + 6])
