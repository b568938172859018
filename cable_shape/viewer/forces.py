"""Forces as arrows: what clips and bodies do to the cable."""

from __future__ import annotations

from typing import Any, final

import numpy as np
import rerun as rr

from cable_shape.cable.cable import STANDARD_GRAVITY, Cable
from cable_shape.checks import Array
from cable_shape.shape import CableShape
from cable_shape.viewer import colour as colours

#: The longest arrow / length of the cable; it stands for the weight of the cable or the largest force, if that is more.
LONGEST = 0.15
MOST_LABELS = 6


@final
class Forces:
    """Writes the arrows of one cable to an entity, which is cleared when there are none."""

    def __init__(self, entity: str, cable: Cable) -> None:
        self.entity = entity
        self._cable = cable
        self._shown = False

    def of(self, shape: CableShape) -> list[Any] | None:
        """What to write for a shape: arrows on the cable, or that they go; None: nothing."""
        if not shape.status or not (len(shape.supports) or len(shape.touches)):
            was, self._shown = self._shown, False
            return [rr.Clear(recursive=True)] if was else None
        self._shown = True
        origins, forces = arrows(shape)
        sizes = np.linalg.norm(forces, axis=1)
        unit = max(self._cable.linear_density * STANDARD_GRAVITY * shape.length, float(sizes.max()), 1e-9)
        return [
            rr.Arrows3D(
                origins=origins,
                vectors=forces * (LONGEST * shape.length / unit),
                colors=colours.FORCE,
                radii=0.35 * self._cable.diameter,
                labels=[f"{size:.2g} N" for size in sizes] if len(sizes) <= MOST_LABELS else None,
            )
        ]


def arrows(shape: CableShape) -> tuple[Array, Array]:
    """Where forces act on the cable, (k, 3) [m], world, and the forces, (k, 3) [N], world."""
    at = np.array([*(clip.arc_length for clip in shape.clips), *(contact.arc_length for contact in shape.contacts)])
    origins = np.stack([np.interp(at, shape.arc_length, shape.positions[:, i]) for i in range(3)], axis=1)
    held = [-clip.force for clip in shape.clips]
    return origins, np.array(held + [contact.force * contact.normal for contact in shape.contacts])
