"""The clamped-hinged arch of 215 degrees under a crown load: a clip, a point mass and a limit point at once."""

import numpy as np
from scene_arch import ANGLE, foot, raised, scene

import cable_shape as cs


def test_the_arch_stands_below_its_limit_load_and_falls_above():
    """P R^2 / EI = 8.97 (DaDeppo and Schmidt, 1975)."""
    predictor, shape = raised(8.9)
    assert shape.status is cs.Status.OK
    predictor.scene = scene(9.06)
    fallen = predictor.predict(foot(-1.0), None)
    assert fallen.status is cs.Status.SNAPPED
    assert fallen.positions[20, 2] < -0.3 < shape.positions[20, 2]


def test_without_load_the_arch_is_its_rest_shape():
    _, shape = raised(0.0)
    angle = shape.arc_length - 0.5 * ANGLE
    inside = angle <= 0.5 * ANGLE
    circle = np.stack((np.sin(angle), 0.0 * angle, np.cos(angle)), axis=1)
    assert np.abs(shape.positions - circle)[inside].max() < 1e-5 * shape.length
    assert np.abs(shape.bend_radius[inside] - 1.0).max() < 1e-4
    assert np.abs(shape.force).max() < 1e-4  # of EI / R^2
