"""Random forks whose arms are led over each other, judged apart: overlap, passing, balance, shares of status."""

from __future__ import annotations

import numpy as np
from figures import Figures, heading
from harness_random import balance
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs
from cable_shape.kernels.distance import passing

STEPS = 60
_ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
_DEEPEST = 2e-4  # m, between points as between rows


def _leaving(yaw: float) -> cs.Pose:
    """Frame of an end that leaves a junction along x at an angle [rad]."""
    turn = _ALONG_X.inv() * Rotation.from_euler("z", yaw) * _ALONG_X
    return cs.Pose(quaternion=turn.as_quat())


def _posed(place: np.ndarray, yaw: float) -> cs.Pose:
    return cs.Pose(place, (Rotation.from_euler("z", yaw) * _ALONG_X).as_quat())


def fork(rng: np.random.Generator) -> tuple[cs.Harness, list[dict[str, cs.Pose]]]:
    """A stem that forks into two or three arms, and its ends as these are led over each other, up or down."""
    arms = int(rng.integers(2, 4))
    cable = cs.Cable(
        float(rng.uniform(0.3, 0.6)), 0.05, 10.0 ** rng.uniform(-3.0, -1.5), diameter=float(rng.uniform(0.004, 0.012))
    )
    yaws = np.linspace(1.0, -1.0, arms) * rng.uniform(0.35, 0.9)
    names = [f"arm{i}" for i in range(arms)]
    frames = {f"{name}.start": _leaving(yaw) for name, yaw in zip(names, yaws, strict=True)}
    harness = cs.Harness(
        dict.fromkeys(("stem", *names), cable), [cs.Junction("fork", ("stem.end", *frames), frames=frames)]
    )
    length = cable.length
    start = rng.uniform(0.1, 0.3, arms)
    aside = -np.sign(yaws) * rng.uniform(0.1, 0.3, arms) * length  # each ends on the other side
    high = (np.sort(rng.uniform(0.0, 0.3, arms))[::-1] + start) * length * np.arange(arms)
    low = rng.uniform(-0.2, 0.2, arms) * length
    stem = cs.Pose((-0.95 * length, 0.0, 0.0), _ALONG_X.as_quat())
    ways = []
    for x in np.linspace(0.0, 1.0, STEPS):
        ends = {"stem.start": stem}
        for i, name in enumerate(names):
            height = (1.0 - x) * high[i] + x * low[i]
            ends[f"{name}.end"] = _posed(np.array((0.8 * length, aside[i], height)), -yaws[i])
        ways.append(ends)
    return harness, ways


def _places(shape: cs.CableShape) -> np.ndarray:
    fine = np.linspace(0.0, shape.length, 2001)
    return np.column_stack([np.interp(fine, shape.arc_length, x) for x in shape.positions.T])


def _overlap(shape: cs.HarnessShape) -> float:
    """[m], by how much arms overlap at most, away from where they leave the junction."""
    deepest, names = 0.0, [name for name in shape.segments if name != "stem"]
    for i, name in enumerate(names):
        for other in names[:i]:
            a, b = (_places(shape.segments[one]) for one in (name, other))
            reach = shape.harness.segments[name].diameter
            first = int(6.0 * reach / shape.segments[name].length * 2000)
            deepest = max(deepest, reach - float(cKDTree(a[first:]).query(b[first:])[0].min()))
    return deepest


def _passed(before: cs.HarnessShape, now: cs.HarnessShape) -> bool:
    """Whether an arm came through another one: a signed count on the straight way that is not 0."""
    names = [name for name in now.segments if name != "stem"]
    out = np.empty((passing.MOST_CROSSINGS, passing.CROSSING))
    for i, name in enumerate(names):
        for other in names[:i]:
            (a, a_now), (b, b_now) = ([one.segments[k].positions for one in (before, now)] for k in (name, other))
            count = passing.crossings(a, a_now, b, b_now, 0, out)
            if out[:count, 1].sum() != 0.0:
                return True
    return False


def print_touching(figures: Figures, motions: int) -> None:
    """Shares and certificates of so many motions."""
    heading(f"{motions} random forks whose arms are led over each other, {STEPS} steps each")
    told: dict[str, int] = {}
    wrong = touched = 0
    for seed in tqdm(range(motions), leave=False, disable=None):
        harness, ways = fork(np.random.default_rng(seed))
        predictor = cs.Predictor(harness, scene=cs.Scene(contact="solve"))
        before = None
        for ends in ways:
            shape = predictor.predict(ends)
            told[shape.status.name] = told.get(shape.status.name, 0) + 1
            if not shape.usable:
                continue
            touched += any(len(one.contacts) for one in shape.segments.values())
            strongest = max(float(np.abs(one.force).max()) for one in shape.segments.values())
            wrong += balance(shape)[0] > 1e-6 + 1e-4 * strongest or _overlap(shape) > _DEEPEST
            wrong += before is not None and _passed(before, shape)
            before = shape
    print(", ".join(f"{name} {number}" for name, number in sorted(told.items())), f"{touched} with contacts")
    steps = motions * STEPS
    none = steps - sum(told.get(status.name, 0) for status in cs.Status if status)
    figures.at_most("arms on each other: steps that overlap, pass or are out of balance", wrong, 0, "{:.0f}")
    figures.at_most("arms on each other: steps without a usable shape", 100.0 * none / steps, 1.0, "{:.2f}", " %")
