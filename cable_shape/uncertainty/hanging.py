"""The tubes of tails, from how the spans answer that they hang from: what those of cables and of harnesses share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from cable_shape.checks import Array
from cable_shape.pose import Grip, Pose
from cable_shape.prediction.tails import Tail, held_frame
from cable_shape.shape import CableShape

#: Of the keywords of predictors, those that their tails have, too.
TAIL_OPTIONS = ("gravity", "points", "scene", "robot_links", "gripping_links")


def turned_by(grip: Grip, side: str, span: CableShape, twists: Array, answers: Array, ways: Array) -> Array:
    """(6, m): velocity and angular velocity of the frame from which a tail hangs at an end, for each of m errors.

    twists (6, m): those of the cable's end in its grip. Where that lets it turn, the tail goes with the tangent of the
    span, whose points answer what varies as `ways` (k, m) by `answers` (n, 3, k).
    """
    if grip.kind == "clamped":
        return twists
    near = answers[:3] if side == "start" else answers[:-4:-1]
    moves = near @ ways
    apart = span.arc_length[1] if side == "start" else -span.arc_length[1]
    turned = (4.0 * moves[1] - 3.0 * moves[0] - moves[2]) / (2.0 * apart)  # of the tangent, of second order
    along = span.tangents[0 if side == "start" else -1]
    return np.concatenate((twists[:3], np.cross(along, turned, axisb=0, axisc=0)))


def hanging(beside: Iterable[tuple[Tail, Grip, CableShape]], links: Mapping[str, Pose] | None) -> list[Array | None]:
    """(n, 3) [m] of the tails that spans beside the predicted one have in these grips; None without a usable shape."""
    places: list[Array | None] = []
    for tail, grip, span in beside:
        found = tail.predict(held_frame(grip, span, tail.side), links) if span.status else None
        places.append(found.positions if found is not None and found.status else None)
    return places


def tail_answers(tail: Tail, points: int, errors: int) -> Array:
    """(n, 3, 6): how the tail just predicted moves with the frame that holds it; zero where nothing of that varies."""
    if not errors:
        return np.empty((points, 3, 6))
    return np.ascontiguousarray(tail.predictor.sensitivity()[:, :, :6])
