"""The clamped-hinged arch of 215 degrees under a crown load (DaDeppo and Schmidt, 1975): shapes and limit load.

A clip, a point mass and a limit point at once. Its hinge is a ball clip; beyond it lies a short free tail without
weight. The load is a point mass at the crown in a field of 1 m/s^2. Radius and bending stiffness in its plane are 1.
"""

import json
import math

import numpy as np
import pytest
from references import label, references

import cable_shape as cs

ANGLE = math.radians(215.0)
TAIL = 0.02
LIMIT = 8.972483987505157  # of the second variation; 8.97 in print
STIFF = 50.0  # out of its plane, and in twist: what matters is that it is more than 1
CABLE = cs.Cable(ANGLE + TAIL, 0.0, (STIFF, 1.0), STIFF, rest_curvature=(0.0, 1.0, 0.0))
STEP = 0.25  # of the load


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
    for t in np.linspace(0.0, load, math.ceil(load / STEP) + 1)[1:]:
        predictor.scene = scene(float(t))
        shape = predictor.predict(foot(-1.0), None)
    return predictor, shape


def test_the_arch_stands_below_its_limit_load_and_falls_above():
    predictor, shape = raised(0.995 * LIMIT)
    assert shape.status is cs.Status.OK
    predictor.scene = scene(1.005 * LIMIT)
    fallen = predictor.predict(foot(-1.0), None)
    assert fallen.status is cs.Status.SNAPPED
    assert fallen.positions[20, 2] < -0.3 < shape.positions[20, 2]


@pytest.mark.parametrize("path", references("arch_*", "published"), ids=label)
def test_the_arch_under_load_is_the_reference(path):
    values = json.loads(path.read_text())
    _, shape = raised(values["point_masses"][0]["mass"], points=len(values["solution"]["s"]))
    assert np.linalg.norm(shape.positions - values["solution"]["r"], axis=1).mean() < 1e-5 * shape.length
    assert np.abs(shape.force[0] - values["solution"]["force_start"]).max() < 1e-5


def test_without_load_the_arch_is_its_rest_shape():
    _, shape = raised(0.0)
    angle = shape.arc_length - 0.5 * ANGLE
    inside = angle <= 0.5 * ANGLE
    circle = np.stack((np.sin(angle), 0.0 * angle, np.cos(angle)), axis=1)
    assert np.abs(shape.positions - circle)[inside].max() < 1e-5 * shape.length
    assert np.abs(shape.bend_radius[inside] - 1.0).max() < 1e-4
    assert np.abs(shape.force).max() < 1e-4  # of EI / R^2
