"""What the margins cost: the part of a cycle that they take, beside the prediction itself."""

from __future__ import annotations

import numpy as np
from figures import Figures, heading
from scipy.spatial.transform import Rotation

import cable_shape as cs

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(
    length=1.2,
    linear_density=0.1,
    bending_stiffness=0.01,
    twisting_stiffness=0.008,
    min_bend_radius=0.05,
    max_tension=20.0,
    max_twist_rate=6.0,
)
NEAR = (
    cs.Obstacle("ball", cs.Sphere(0.05), cs.Pose((0.4, 0.05, -0.32))),
    cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.33))),
    cs.Obstacle("box", cs.Box((0.1, 0.1, 0.1)), cs.Pose((0.6, -0.1, -0.3))),
)
#: name, cable, bodies around it
SETTINGS = (
    ("limits of load, stability", CABLE, ()),
    ("the same, stress", CABLE.replace(allowable_stress=1e8), ()),
    ("the same, three bodies near", CABLE.replace(allowable_stress=1e8), NEAR),
)
ASKED_US = 20.0
PERIOD = 5_000_000  # ns


def ends(k: int) -> tuple[cs.Pose, cs.Pose]:
    """Cycle k of a smooth motion."""
    turn = Rotation.from_rotvec((0.0, 0.3 * np.sin(k / 100.0), 0.06 * np.sin(k / 100.0)))
    place = (0.7 + 0.1 * np.sin(k / 70.0), 0.2 * np.sin(k / 90.0), 0.1 * np.cos(k / 80.0))
    return cs.Pose((0.0, 0.0, 0.0), ALONG_X), cs.Pose(place, (turn * Rotation.from_quat(ALONG_X)).as_quat())


def print_margins(figures: Figures, cycles: int = 2000) -> None:
    """Median times of a cycle's phases."""
    heading("Margins: what they add to a cycle, without a predicted snap")
    print(f"{'':30s} {'margins':>8s} {'predict':>8s} {'clearance':>9s} {'warnings':>8s}  [us, medians]")
    measured = {}
    for name, cable, bodies in SETTINGS:
        cycle = cs.Cycle(cable, scene=cs.Scene(obstacles=bodies), model="cosserat", snap_horizon=0.0)
        times: dict[str, list[float]] = {}
        for k in range(cycles):
            for phase, seconds in cycle.step({"cable": ends(k)}, k * PERIOD).times.items():
                times.setdefault(phase, []).append(1e6 * seconds)
        m, p, c, w = (float(np.median(times[phase])) for phase in ("margins", "predict", "clearance", "warnings"))
        print(f"{name:30s} {m:8.1f} {p:8.1f} {c:9.1f} {w:8.1f}")
        measured[name] = m
    for name, m in measured.items():
        figures.at_most(f"margins, {name}", m, ASKED_US, "{:.1f}", " us")
