"""Whether a moving cable may be taken for one at rest: :class:`QuasistaticWatch`.

Told is the load of the cable's inertia as a fraction of its weight, from the motion of the grips: what a prediction
leaves out of its loads. A cable that was accelerated swings on; the ratio dies away by a factor of e in a period of the
cable as a pendulum about the line through its grips, which its stiffness makes quicker:

    omega^2 = g integral(depth) / integral(distance^2) + beta^2 EI / (w / g L^4),  beta that of a straight beam.

The first term is Rayleigh's for a cable that keeps its shape, a per cent or two too large for one that hangs deeply;
that both add up is Southwell's rule, which is a little too small.
"""

from __future__ import annotations

import math
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable import Cable
from cable_shape.checks import Array
from cable_shape.kernels import swing
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.problem import GRAVITY
from cable_shape.report import Margin, WarningKind
from cable_shape.shape import CableShape

#: Ratio of the loads from which a warning is given by default.
LIMIT = 0.25
#: beta of a straight beam, by the number of ends that turn freely; and with one end free.
_BEAM = (22.3733, 15.4182, 9.8696)
_CANTILEVER = 3.5160


@final
class QuasistaticWatch:
    """The ratio of inertial load to weight of one cable, from cycle to cycle.

    limit: of the ratio, above 0. Without gravity or density there is no ratio.
    """

    def __init__(self, cable: Cable, gravity: ArrayLike = GRAVITY, limit: float = LIMIT) -> None:
        self.limit = checks.number("quasistatic_limit", limit, above=0.0)
        self._cable = cable
        self._gravity: Array = checks.vector("gravity", gravity, 3, "m/s^2")
        size = float(np.linalg.norm(self._gravity))
        self._known = size > 0.0 and cable.linear_density > 0.0
        if self._known:
            weight = cable.linear_density * size
            self._lever = min((cable.mean_bending_stiffness / weight) ** (1.0 / 3.0), 0.5 * cable.length)
        self._memory: Array = np.zeros(swing.MEMORY)
        self.period = math.nan
        self._ratio, self._at = 0.0, 0.0

    def reset(self) -> None:
        """Forgets all motion."""
        self._memory[:] = 0.0
        self.period = math.nan  # s, of the last shape
        self._ratio, self._at = 0.0, 0.0

    def margin(
        self,
        shape: CableShape,
        twists: Array | None,
        seconds: float,
        start: Pose | Grip,
        end: Pose | Grip | FreeEnd | None,
    ) -> Margin | None:
        """The margin of a shape; None where it is not known.

        twists (12,): of the ends, mean over the last `seconds`, velocity [m/s] and angular velocity [rad/s]; None:
        not known, and all before is forgotten, as after a jump of the grips. `seconds` = 0, a stamp again, repeats the
        answer.
        """
        if not self._known or not shape.status:
            return None
        if twists is None:
            self.reset()
            return None
        if seconds > 0.0:
            held = isinstance(end, (Pose, Grip))
            rate = bending_rate(self._cable, start, end)
            found = swing.follow(
                self._memory, twists, seconds, shape.buffer, shape.points, held, self._gravity, self._lever, rate
            )
            self._ratio, where, self.period = found
            self._at = float(where) * shape.length
        if math.isnan(self._ratio):
            return None
        used = self._ratio / self.limit
        time = 0.0 if used >= 1.0 else math.nan
        return Margin(WarningKind.QUASISTATIC, used, self.limit, self._ratio, self._at, "", time)


def swing_period(
    cable: Cable, shape: CableShape, start: Pose | Grip, end: Pose | Grip | FreeEnd | None, gravity: ArrayLike = GRAVITY
) -> float:
    """[s], with which a cable of this shape swings about the line through its ends; see the module."""
    held = isinstance(end, (Pose, Grip))
    g = checks.vector("gravity", gravity, 3, "m/s^2")
    rate = swing.swing_rate(shape.buffer, shape.points, held, g) + bending_rate(cable, start, end)
    return 2.0 * math.pi / math.sqrt(rate) if rate > 0.0 else math.inf


def bending_rate(cable: Cable, start: Pose | Grip, end: Pose | Grip | FreeEnd | None) -> float:
    """[1/s^2], square of the lowest angular frequency of the cable as a straight beam held like this."""
    if cable.linear_density == 0.0:
        return math.inf
    if isinstance(end, (Pose, Grip)):
        beta = _BEAM[sum(isinstance(x, Grip) and x.kind == "pinned" for x in (start, end))]
    else:
        beta = 0.0 if isinstance(start, Grip) and start.kind == "pinned" else _CANTILEVER
    return beta**2 * cable.mean_bending_stiffness / (cable.linear_density * cable.length**4)
