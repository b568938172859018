"""What the speed of a cable does to its shape: :func:`settled` finds damping and shape that go together.

Where a cable has a retardation time tau [s] its moment is m + M, m that of its stiffness and

    M = tau R K R^T dw/ds   (across t = R d3),   w = t x dv/ds + q t

(Kelvin and Voigt), w the angular velocity of the sections of a cable with velocities v, q their spin. As M is a known
vector, the balance of moments m' + M' + t x n = 0 is that of a cable at rest under the load

    f = d/ds (1 - t t) d/ds (t x M)

(of a straight beam -tau EI d4v/ds4) between ends that hold the direction of the cable: what M does to n and to the
moments in the grips moves nothing. What M would twist is left out: cables twist little. The spin is that of a start
that does not spin and of sections that do not twist. Drag is a load, too, of `Problem`.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from cable_shape.cable.pieces import cable_at
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd
from cable_shape.shape import CableShape, Status
from cable_shape.solve.network import Network
from cable_shape.solve.problem import NAMED_TOLERANCE, Problem

#: Rounds of shape and damping, at most; so many are kept, to find the next.
_MOST_ROUNDS, _KEPT = 20, 5
#: Points of a shape from which damping is told, at least.
FEWEST_POINTS = 51


def settled(problem: Problem, state: Network, solve: Callable[[Problem], CableShape]) -> CableShape:
    """The shape under the damping that it has itself; `solve` gives one under given damping.

    Begins with the damping of the last solution, and ends with that of `state.problem`.
    """
    _check(problem)
    lag = state.problem.lag if state.history > 0 else None
    before: Array | None = None
    tried: list[tuple[Array, Array]] = []  # damping, and by how much that of the shape differs from it
    close = max(problem.tolerance, NAMED_TOLERANCE * problem.cable.length)
    for _ in range(_MOST_ROUNDS):
        shape = solve(problem.damped(lag))
        if not shape.status:
            return shape
        if before is not None and float(np.abs(shape.positions - before).max()) <= close:
            shape.error_estimate += close
            return shape
        before = shape.positions.copy()
        now = lag_of(shape, problem)
        if lag is None or lag.shape != now.shape:
            lag = np.zeros_like(now)
        tried = [*tried[1 - _KEPT :], (lag, now - lag)]
        lag = _next(tried)
    shape.status = Status.NOT_CONVERGED
    shape.detail = "No shape was found that goes with the damping that it has. Is the velocity in m/s?"
    return shape


def _check(problem: Problem) -> None:
    """Refuses what damping is not told of."""
    if problem.points < FEWEST_POINTS:
        bound = f"a cable with a retardation time needs at least {FEWEST_POINTS} to tell how fast its curvature changes"
        raise ArgumentError.of("points", problem.points, bound, "Ask for more, or give no velocity.")
    for side, end in (("start", problem.start), ("end", problem.end)):
        kind = "free" if isinstance(end, FreeEnd) else end.kind
        if kind not in ("clamped", "swivel"):
            bound = "a cable with a retardation time that moves needs ends that hold its direction"
            raise ArgumentError.of(f"{side}.kind", kind, bound, "Write 'clamped' or 'swivel', or give no velocity.")


def _next(tried: list[tuple[Array, Array]]) -> Array:
    """The damping to try after these, by Anderson's method: the mix of them that leaves the least difference."""
    lag, left = tried[-1]
    if len(tried) == 1:
        return lag + left
    moves = np.stack([(b[0] - a[0]).ravel() for a, b in pairwise(tried)], axis=1)
    gains = np.stack([(b[1] - a[1]).ravel() for a, b in pairwise(tried)], axis=1)
    share = np.linalg.lstsq(gains, left.ravel(), rcond=1e-6)[0]
    return np.asarray(lag + left - ((moves + gains) @ share).reshape(lag.shape))


def lag_of(shape: CableShape, problem: Problem) -> Array:
    """(m, 3) [1/(m^3 s)]: the load of damping, for each s N m^2 of retardation time and stiffness, uniform along it."""
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation

    cable, velocity = problem.cable, problem.velocity
    assert velocity is not None
    s, length = shape.arc_length, shape.length
    places = np.linspace(0.0, length, len(velocity))
    curve = CubicSpline(places, velocity)
    d1, d2, t = np.moveaxis(Rotation.from_quat(shape.quaternions).as_matrix(), 2, 0)
    turning = np.gradient(t, s, axis=0, edge_order=2)
    crooked = np.cross(turning, curve(s, 1))
    twisting = -np.einsum("ij,ij->i", crooked, t)
    spin = np.concatenate(((0.0,), np.cumsum(0.5 * np.diff(s) * (twisting[1:] + twisting[:-1]))))
    change = crooked + np.cross(t, curve(s, 2)) + spin[:, None] * turning
    parts = [cable_at(cable, x) for x in s.tolist()] if cable.sections else [cable] * len(s)
    moment = np.zeros_like(t)
    for axis, d in enumerate((d1, d2)):
        share = np.array([one.retardation_time * one.bending_stiffness[axis] for one in parts])
        moment += (share * np.einsum("ij,ij->i", change, d))[:, None] * d
    moment /= problem.slowed_by(cable)[1]
    across = np.stack([np.interp(places, s, x) for x in np.cross(t, moment).T], axis=1)
    step = places[1]
    middles = np.stack([np.interp(places[:-1] + 0.5 * step, s, x) for x in t.T], axis=1)
    slope = np.diff(across, axis=0) / step
    slope -= np.einsum("ij,ij->i", slope, middles)[:, None] * middles
    inner = np.diff(slope, axis=0) / step
    return np.concatenate((inner[:1], inner, inner[-1:]))
