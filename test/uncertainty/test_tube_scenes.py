"""How many drawn cables the tube holds where clips and masses are on the cable, too."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.uncertainty.tube_watch import TubeWatch

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.004)
ENDS = cs.Pose((0.0, 0.0, 1.0), ALONG_X), cs.Pose((0.75, 0.1, 1.05), ALONG_X)
SHIFT, TURN, SOFTER, LONGER = 2e-4, 2e-3, 0.05, 5e-4
KNOWN = cs.Uncertainty({"bending_stiffness": SOFTER, "length": LONGER}, (SHIFT, TURN), (SHIFT, TURN))


def scene_of(what: str) -> cs.Scene:
    """A clip a little off the hanging cable, or a mass."""
    if what == "mass":
        return cs.Scene(masses=[cs.PointMass(0.3, 0.02)])
    shape = cs.predict(CABLE, *ENDS, model="cosserat", points=101)
    pose = cs.Pose(shape.positions[40] + (0.0, 0.01, 0.02), shape.quaternions[40])
    return cs.Scene(clips=[cs.Clip(0.4, pose, what)])


@pytest.mark.parametrize("what", ["fixed", "ball", "slide", "mass"])
def test_the_tube_holds_as_many_cables_as_it_says(what: str) -> None:
    options = {"scene": scene_of(what), "points": 61}
    predictor = cs.Predictor(CABLE, model="cosserat", **options)
    shape = predictor.predict(*ENDS)
    tube = TubeWatch(CABLE, KNOWN, **options).tube(predictor, shape, ENDS)
    assert tube is not None
    rng = np.random.default_rng(2)
    lines = []
    for _ in range(600):
        factor = math.exp(SOFTER * rng.normal())
        cable = CABLE.replace(
            length=1.0 + LONGER * rng.normal(),
            bending_stiffness=0.004 * factor,
            twisting_stiffness=CABLE.twisting_stiffness * factor,
        )
        poses = [
            cs.Pose(
                pose.position + SHIFT * rng.normal(size=3),
                (Rotation.from_rotvec(TURN * rng.normal(size=3)) * Rotation.from_quat(pose.quaternion)).as_quat(),
            )
            for pose in ENDS
        ]
        found = cs.predict(cable, *poses, model="cosserat", **options)
        assert found.status
        lines.append(found.positions.copy())
    off = np.array(lines) - shape.positions
    along = np.einsum("kni,ni->kn", off, shape.tangents)
    away = np.sqrt(np.maximum((off**2).sum(axis=2) - along**2, 0.0))
    inside = (away <= tube.radius).mean(axis=0)[tube.radius > 1e-5]  # a clip holds the cable where it is
    assert len(inside) > 50
    assert 0.93 < inside.mean() < 0.97
    assert inside.min() > 0.92
    assert inside.max() < 0.98
