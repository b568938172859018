"""Forces as arrows: what clips and bodies do to the cable."""

from __future__ import annotations

from typing import final

import numpy as np
import rerun as rr

from cable_shape.cable.cable import STANDARD_GRAVITY, Cable
from cable_shape.checks import Array
from cable_shape.shape import CableShape
from cable_shape.viewer import colour as colours
from cable_shape.viewer.columns import Columns

#: The longest arrow / length of the cable; it stands for the weight of the cable or the largest force, if that is more.
LONGEST = 0.15
MOST_LABELS = 6
_COLOUR = np.array([colours.FORCE], dtype=np.uint8)


@final
class Forces:
    """Writes the arrows of one cable to an entity, which is cleared when there are none."""

    def __init__(self, entity: str, cable: Cable) -> None:
        self.entity = entity
        self.cable = cable
        self._shown = False

    def write(self, shape: CableShape, columns: Columns) -> None:
        """Those on a shape, at the columns' present time: arrows on the cable, or once that they go."""
        if not shape.status or not (len(shape.supports) or len(shape.touches)):
            if self._shown:
                columns.write(self.entity, rr.Clear(recursive=True))
            self._shown = False
            return
        self._shown = True
        origins, forces = arrows(shape)
        sizes = np.linalg.norm(forces, axis=1)
        unit = max(self.cable.linear_density * STANDARD_GRAVITY * shape.length, float(sizes.max()), 1e-9)
        columns.put(
            self.entity,
            rr.Arrows3D,
            origins=origins,
            vectors=forces * (LONGEST * shape.length / unit),
            colors=_COLOUR,
            radii=np.array([0.35 * self.cable.diameter]),
            labels=[f"{size:.2g} N" for size in sizes] if len(sizes) <= MOST_LABELS else [],
        )


def arrows(shape: CableShape) -> tuple[Array, Array]:
    """Where forces act on the cable, (k, 3) [m], world, and the forces, (k, 3) [N], world."""
    clips, contacts = shape.supports, shape.touches
    at = np.concatenate((clips[:, 0], contacts[:, 0]))
    origins = np.stack([np.interp(at, shape.arc_length, shape.positions[:, i]) for i in range(3)], axis=1)
    return origins, np.concatenate((-clips[:, 1:4], contacts[:, 8:9] * contacts[:, 5:8] + contacts[:, 9:12]))
