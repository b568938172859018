"""What the tests of cables in clips share: the shape without clips, and clips that stand on it."""

from __future__ import annotations

import numpy as np
from rods import CABLE, END, LENGTH, START

import cable_shape as cs
from cable_shape.pose import Pose
from cable_shape.scene.scene import Clip, Scene
from cable_shape.shape import CableShape

WEIGHT = 0.981  # N/m
FREE = cs.predict(CABLE, START, END, model="cosserat", points=241, tolerance=1e-8 * LENGTH)


def on_the_free_shape(*places: tuple[int, str], shift=(0.0, 0.0, 0.0)) -> Scene:
    """Clips of these kinds at these points of the 241 of the shape without clips, all moved by `shift` [m]."""
    return Scene(
        clips=[
            Clip(FREE.arc_length[i], Pose(FREE.positions[i] + np.asarray(shift), FREE.quaternions[i]), kind)
            for i, kind in places
        ]
    )


def arrays(shape: CableShape) -> tuple[np.ndarray, ...]:
    return shape.arc_length, shape.positions, shape.quaternions, shape.curvature, shape.force, shape.moment
