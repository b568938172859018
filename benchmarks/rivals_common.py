"""What the workers of `scripts/bench rivals` share; they run in the rivals' own environment, so without cable_shape.

A worker reads problems and settings as JSON from its standard input and writes what it measured to its output.

Both simulators are laid out alike: N joints in the cable's length, so N + 1 links of length / N, of which the first and
the last are centred on the grips, half of them outside, and held there. So both are of second order in 1 / N.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import thread_time
from typing import Any, Protocol

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

#: Settled: within this part of its last error of that error, and from then on.
SETTLED = 0.1
#: At rest: the error changes by less than this part of it in the last tenth of a run.
AT_REST = 0.02
#: Short runs are timed again until they sum to so many seconds, and at most so often; the least time counts.
ENOUGH, MOST = 0.3, 30
GRAVITY = 9.81

Setting = Mapping[str, float]


@dataclass(frozen=True)
class Rod:
    """A problem: an isotropic rod, its clamped ends, the first guess of its frames, and its exact shape."""

    length: float
    linear_density: float
    bending_stiffness: float
    twisting_stiffness: float
    tension: float
    start: tuple[np.ndarray, Rotation]
    end: tuple[np.ndarray, Rotation]
    guess: Slerp
    exact: CubicSpline

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Rod:
        """From JSON."""
        numbers = ("length", "linear_density", "bending_stiffness", "twisting_stiffness", "tension")
        ends = [(np.array(values[side][:3]), Rotation.from_quat(values[side][3:])) for side in ("start", "end")]
        guess = Slerp(values["guess_at"], Rotation.from_quat(values["guess"]))
        exact = CubicSpline(values["exact_at"], np.array(values["exact"]))
        return cls(*(values[name] for name in numbers), *ends, guess, exact)

    def links(self, joints: int) -> Rotation:
        """Frames of the links in the first guess."""
        return self.guess(np.linspace(0.0, self.length, joints + 1))

    def off(self, places: np.ndarray) -> float:
        """Mean distance of the joints from the exact shape / length."""
        joints = len(places)
        at = (np.arange(joints) + 0.5) * (self.length / joints)
        return float(np.linalg.norm(places - self.exact(at), axis=1).mean()) / self.length


@dataclass(frozen=True)
class Swing:
    """The end of a rod at rest goes `way` (3,) [m] in a time `whole` [s]; where the rod is at `times` (k,) [s]."""

    way: np.ndarray
    whole: float
    times: tuple[float, ...]
    exact: tuple[CubicSpline, ...]

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Swing:
        """From JSON."""
        exact = tuple(CubicSpline(values["exact_at"], np.array(line)) for line in values["exact"])
        return cls(np.array(values["way"]), values["whole"], tuple(values["times"]), exact)

    def share(self, time: float) -> float:
        """Of the way, at a time [s]: three times differentiable."""
        x = min(time / self.whole, 1.0)
        return x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)


class Simulation(Protocol):
    """One simulator with one rod, at its first guess."""

    def step(self, count: int) -> None:
        """So many time steps."""

    def joints(self) -> np.ndarray:
        """(N, 3) places of the joints [m]."""


@dataclass(frozen=True)
class Settled:
    """An equilibrium: its error / length, steps until it stays within SETTLED of that, and their time [s]."""

    error: float
    steps: int
    seconds: float


def settle(
    make: Callable[[], Simulation], error: Callable[[np.ndarray], float], limit: int, every: int, repeats: int
) -> Settled | None:
    """Runs a simulation for `limit` steps, looking at every so many; then times fresh ones to where it had settled.

    Nothing but time steps is timed: no set-up and no test of having settled. None: not at rest by then, or diverged.
    """
    simulation = make()
    errors = []
    for _ in range(max(limit // every, 20)):
        simulation.step(every)
        errors.append(error(simulation.joints()))
        if not errors[-1] < 10.0:
            return None
    seen = np.array(errors)
    last = seen[-1]
    if np.ptp(seen[-len(seen) // 10 :]) > AT_REST * last:
        return None
    away = np.flatnonzero(np.abs(seen - last) > SETTLED * last)
    steps = every * (int(away[-1]) + 2 if away.size else 1)
    times: list[float] = []
    while len(times) < repeats or (repeats > 1 and sum(times) < ENOUGH and len(times) < MOST):
        simulation = make()
        began = thread_time()
        simulation.step(steps)
        times.append(thread_time() - began)
    return Settled(float(last), steps, min(times, default=math.nan))


def follow(make: Callable[[], Simulation], dt: float, rod: Rod, swing: Swing, repeats: int) -> Settled | None:
    """Of a swing the mean error over its times, its steps [dt], and what these took at least; None: it diverged."""
    counts = np.diff(np.round(np.array((0.0, *swing.times)) / dt).astype(int))
    at = rod.length / len(make().joints())
    error, times = 0.0, []
    for _ in range(repeats):
        simulation, error, spent = make(), 0.0, 0.0
        for count, exact in zip(counts.tolist(), swing.exact, strict=True):
            began = thread_time()
            simulation.step(count)
            spent += thread_time() - began
            places = simulation.joints()
            off = np.linalg.norm(places - exact((np.arange(len(places)) + 0.5) * at), axis=1)
            error += float(off.mean()) / rod.length / len(counts)
        times.append(spent)
    return Settled(error, int(counts.sum()), min(times)) if error < 1.0 else None


def serve(
    make: Callable[[Rod, int, Setting], tuple[Callable[[], Simulation], int, int]],
    version: str,
    swinging: Callable[[Rod, int, Setting, Swing], tuple[Callable[[], Simulation], float]],
) -> None:
    """Answers one request: of each job its settling, or its swing.

    make: gives simulations, the limit, and how often to look; swinging: those at rest, without damping, whose end goes,
    and their time step [s].
    """
    request = json.load(sys.stdin)
    rods = {name: Rod.of(values) for name, values in request["problems"].items()}
    answers = []
    for job in request["jobs"]:
        rod, joints = rods[job["problem"]], job["joints"]
        if "swing" in request:
            swing = Swing.of(request["swing"])
            found = follow(*swinging(rod, joints, job["setting"], swing), rod, swing, request["repeats"])
            answers.append(None if found is None else vars(found))
            continue
        fresh, limit, every = make(rod, joints, job["setting"])
        found = settle(fresh, rod.off, limit, every, request["repeats"])
        answers.append(None if found is None else vars(found))
    json.dump({"version": version, "answers": answers}, sys.stdout)
