"""One prediction described by a file: :class:`Case`, and the answer to compare it with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.pose import FreeEnd, Grip
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape


@final
@dataclass(frozen=True, slots=True)
class Reference:
    """A trusted shape to compare with: positions (m, 3) [m], world, at `arc_length` (m,) [m]."""

    arc_length: Array
    positions: Array


@final
@dataclass(frozen=True, slots=True)
class Case:
    """The arguments of one :func:`cable_shape.predict`, under a name.

    `options` holds those that were given of model, gravity, points, tolerance and distributed_load.
    """

    name: str
    cable: Cable
    start: Grip
    end: Grip | FreeEnd
    scene: Scene | None
    options: Mapping[str, Any]
    reference: Reference | None = None

    def predict(self, **changes: Any) -> CableShape:
        """Solves it; `changes` replace options of the file."""
        from cable_shape.prediction.predictor import predict

        return predict(self.cable, self.start, self.end, scene=self.scene, **{**self.options, **changes})
