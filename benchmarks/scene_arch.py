"""The clamped-hinged arch of 215 degrees under a crown load (DaDeppo and Schmidt, 1975): shapes and limit load.

Its hinge is a ball clip; beyond it lies a short free tail without weight. The load is a point mass at the crown in a
field of 1 m/s^2. Radius and bending stiffness in its plane are 1.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from figures import Figures, heading

import cable_shape as cs

ANGLE = math.radians(215.0)
TAIL = 0.02
LIMIT, PUBLISHED = 8.972483987505157, 8.97  # of the second variation, three digits in print
STIFF = 50.0  # out of its plane, and in twist: what matters is that it is more than 1
CABLE = cs.Cable(ANGLE + TAIL, 0.0, (STIFF, 1.0), STIFF, rest_curvature=(0.0, 1.0, 0.0))
ROUGH, FINE = 0.25, 0.002  # steps of the load


def foot(side: float) -> cs.Pose:
    """Where the arc begins (-1) and where it is hinged (+1); the frame turns about y along the arc."""
    angle = side * 0.5 * ANGLE
    frame = (0.0, math.sin(0.25 * math.pi + 0.5 * angle), 0.0, math.cos(0.25 * math.pi + 0.5 * angle))
    return cs.Pose((math.sin(angle), 0.0, math.cos(angle)), frame)


def scene(load: float) -> cs.Scene:
    """The hinge, and the load at the crown."""
    masses = [cs.PointMass(0.5 * ANGLE, load)] if load > 0.0 else []
    return cs.Scene(clips=[cs.Clip(ANGLE, foot(1.0))], masses=masses)


def raised(load: float, *, points: int = 41) -> tuple[cs.Predictor, cs.CableShape]:
    """The arch after its load has grown to `load` in steps."""
    predictor = cs.Predictor(CABLE, model="cosserat", gravity=(0.0, 0.0, -1.0), scene=scene(0.0), points=points)
    shape = predictor.predict(foot(-1.0), None)
    for t in np.linspace(0.0, load, math.ceil(load / ROUGH) + 1)[1:]:
        predictor.scene = scene(float(t))
        shape = predictor.predict(foot(-1.0), None)
    return predictor, shape


def limit_load() -> float:
    """The load at which the arch has fallen through, loads growing by FINE."""
    load = 8.5
    predictor, shape = raised(load)
    while shape.status is cs.Status.OK and load < 9.5:
        load += FINE
        predictor.scene = scene(load)
        shape = predictor.predict(foot(-1.0), None)
    return load if shape.status is cs.Status.SNAPPED else math.nan


def print_arch(figures: Figures, folder: Path) -> None:
    """Ours beside the references."""
    heading("Clamped-hinged arch under a crown load")
    for path in sorted(folder.glob("published/arch_215_load_*.json")):
        values = json.loads(path.read_text())
        load = values["point_masses"][0]["mass"]
        _, shape = raised(load)
        error = np.linalg.norm(shape.positions - values["solution"]["r"], axis=1).mean() / shape.length
        force = np.abs(shape.force[0] - values["solution"]["force_start"]).max()
        print(f"{path.stem}: {shape.status.name}, force at the clamp {force:.1e} N off")
        figures.at_most(f"arch under {load:g} EI/R^2: mean error / L", error, 1e-5)
    load = limit_load()
    print(f"limit load P R^2/EI: ours {load:.3f}, exact {LIMIT:.4f}, in print {PUBLISHED}")
    figures.at_most("limit load of the arch: off the exact one", 100.0 * abs(load / LIMIT - 1.0), 1.0, "{:.2f}", " %")
