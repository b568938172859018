"""What a cable remembers: its rest curvature from the shape in which it rests: :func:`rest_curvature_from`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.calibration.fit import calibrate
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.parameters import ROWS
from cable_shape.calibration.result import Calibration
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import Pose

FEWEST = 8
#: The points' own length and that of the cable differ by this fraction at most.
_LENGTHS = 0.05
_UP = (0.0, 0.0, 1.0)
_FINE = 401


def rest_curvature_from(points: ArrayLike, cable: Cable | None = None, *, d1: ArrayLike = _UP) -> Calibration:
    """The rest curvature of a cable that lies without load, of a plastic set for example, as a table along it.

    The cable lies free, on a smooth table, or floats: nothing bends it but what it remembers. With `d1` as the first
    axis of its frame at the start the curvature is told in a frame that does not twist against the material; whoever
    grips the cable later has to hold that same side of it up (or turn the grip's `offset` about d3).

    Parameters
    ----------
    points : (m, 3) array_like
        [m], on the centreline from the start grip to the end grip, in this order, m >= 8; the first and the last are at
        the ends.
    cable : Cable, optional
        What else the result's cable is. Default: one of the points' length, its other numbers without meaning.
    d1 : (3,) array_like
        World; what of it is across the cable at the start counts.

    Returns
    -------
    Calibration
        `found.cable.rest_curvature` is (5, 3); with error bars, from the scatter of the points.

    Raises
    ------
    ArgumentError
        For too few points, or points that are not as long as the cable.
    """
    remedy = "Give one row x, y, z a point, from the start grip to the end."
    if cable is not None:
        checks.instance("cable", cable, (Cable,), "Write Cable(length=..., ...).")
    seen = checks.numbers("points", points, remedy)
    if seen.ndim != 2 or seen.shape[1] != 3 or len(seen) < FEWEST:
        raise ArgumentError.of("points", f"shape {seen.shape}", f"it must be (m, 3), m >= {FEWEST}", remedy)
    if not np.isfinite(seen).all():
        raise ArgumentError.of("points", "NaN or infinity", "they must be finite", "Leave out what was not seen.")
    if (np.linalg.norm(np.diff(seen, axis=0), axis=1) == 0.0).any():
        raise ArgumentError.of("points", "a point twice", "neighbours must be apart", "Leave out one of them.")
    line, tangents, length = _smooth(seen)
    if cable is None:
        cable = Cable(length, 0.1, 0.01)
    if abs(length / cable.length - 1.0) > _LENGTHS:
        bound = f"they must be as long as the cable, {cable.length:.4g} m, to {100 * _LENGTHS:g} %"
        raise ArgumentError.of("points", f"{length:.4g} m long", bound, "Give points from grip to grip, in m.")
    frame, table = _curvature(tangents, length, checks.vector("d1", d1, 3))
    arc = np.full(len(seen), math.nan)
    arc[0], arc[-1] = 0.0, cable.length
    observation = Observation(Pose(line[0], frame), None, seen, arc)
    begin = cable.replace(rest_curvature=table)
    return calibrate([observation], begin, ("rest_curvature_along", "start_tilt", "start_offset"), gravity=(0, 0, 0))


def _smooth(seen: Array) -> tuple[Array, Array, float]:
    """A curve through the points (n, 3), smoothed as their scatter asks for, its unit tangents, its length."""
    from scipy.interpolate import make_smoothing_spline

    at = np.concatenate(((0.0,), np.cumsum(np.linalg.norm(np.diff(seen, axis=0), axis=1))))
    fine = np.linspace(0.0, at[-1], _FINE)
    curves = [make_smoothing_spline(at, seen[:, axis]) for axis in range(3)]
    line = np.stack([curve(fine) for curve in curves], axis=1)
    slopes = np.stack([curve.derivative()(fine) for curve in curves], axis=1)
    speed = np.linalg.norm(slopes, axis=1)
    step = at[-1] / (_FINE - 1)
    arc = np.concatenate(((0.0,), np.cumsum(0.5 * step * (speed[1:] + speed[:-1]))))
    even = np.linspace(0.0, arc[-1], _FINE)
    line = np.stack([np.interp(even, arc, line[:, i]) for i in range(3)], axis=1)
    tangents = np.stack([np.interp(even, arc, slopes[:, i] / speed) for i in range(3)], axis=1)
    return line, tangents / np.linalg.norm(tangents, axis=1)[:, None], float(arc[-1])


def _curvature(tangents: Array, length: float, up: Array) -> tuple[Array, Array]:
    """The frame at the start (4,), and the table (5, 3) nearest to the curvature in frames carried on without twist."""
    from scipy.spatial.transform import Rotation

    first = tangents[0]
    across = up - (up @ first) * first
    if np.linalg.norm(across) < 1e-3 * np.linalg.norm(up) or not up.any():
        raise ArgumentError.of("d1", up.tolist(), "it must not be along the cable at its start", "Give another axis.")
    d1 = across / np.linalg.norm(across)
    frame = Rotation.from_matrix(np.stack((d1, np.cross(first, d1), first), axis=1)).as_quat()
    bends = np.empty((len(tangents) - 1, 2))
    step = length / (len(tangents) - 1)
    for i in range(len(tangents) - 1):
        axis = np.cross(tangents[i], tangents[i + 1])
        size = float(np.linalg.norm(axis))
        turn = axis * (math.atan2(size, float(tangents[i] @ tangents[i + 1])) / size) if size > 0.0 else axis
        d2 = np.cross(tangents[i], d1)
        bends[i] = turn @ d1 / step, turn @ d2 / step
        d1 = Rotation.from_rotvec(turn).apply(d1)
    at = (np.arange(len(bends)) + 0.5) / len(bends)
    places = np.linspace(0.0, 1.0, ROWS)
    hats = np.stack([np.interp(at, places, row) for row in np.eye(ROWS)], axis=1)
    table = np.zeros((ROWS, 3))
    table[:, :2] = np.linalg.lstsq(hats, bends, rcond=None)[0]
    return frame, table
