"""What is seen of a cable beside what was predicted of it: :class:`Seen` gives the correction that a servo goes by."""

from __future__ import annotations

import math
from collections import deque
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.shape import CableShape

#: of the polynomials along the cable: noise from point to point falls out, what stiffness and length change stays
_DEGREE = 10


@final
class Seen:
    """The seen centreline less the predicted one, smooth along the cable and averaged over time.

    Prediction and sight are compared at the same instant: what is seen now is `delay` old, and so is the prediction
    beside it. A cable that is not as the model has it is off by much the same from pose to pose, so that the
    mean over `settling` is a correction which does not mind noise, and leaves no error once the robot stands.

    Parameters
    ----------
    points : int
        Of a predicted shape.
    delay : float
        [s], from sight to `take`.
    settling : float
        [s], of the mean.

    Attributes
    ----------
    correction : (points, 3) or None
        [m], world; None: nothing was seen yet.
    """

    def __init__(self, points: int, delay: float, settling: float) -> None:
        self.delay, self.settling = delay, settling
        along = np.linspace(-1.0, 1.0, points)
        basis = np.polynomial.legendre.legvander(along, min(_DEGREE, points - 1))
        self._smooth: Array = basis @ np.linalg.pinv(basis)
        self._along = along
        self._past: deque[tuple[float, Array]] = deque()  # [s], predicted positions
        self.reset()

    def reset(self) -> None:
        """Forgets what was seen."""
        self.correction: Array | None = None
        self._times_seen = 0
        self._past.clear()

    @property
    def lag(self) -> float:
        """[s], after which what is seen is of the cable as it stands; 0 while nothing was seen."""
        return 0.0 if self.correction is None else self.delay + 2.0 * self.settling

    def predict(self, time: float, positions: Array) -> None:
        """Remembers what was predicted at a time [s]."""
        self._past.append((time, positions.copy()))
        while len(self._past) > 2 and self._past[1][0] <= time - self.delay:
            self._past.popleft()

    def take(self, time: float, shape: CableShape, dt: float) -> None:
        """A shape that is usable, given at a time [s], `dt` after the last one."""
        share = 2.0 * shape.arc_length / shape.length - 1.0
        seen = np.stack([np.interp(self._along, share, column) for column in shape.positions.T], axis=1)
        apart = self._smooth @ (seen - self._then(time - self.delay))
        self._times_seen += 1
        part = max(1.0 / self._times_seen, -math.expm1(-dt / self.settling))
        last = 0.0 if self.correction is None else self.correction
        self.correction = last + part * (apart - last)

    def _then(self, time: float) -> Array:
        """What was predicted at that time, between the two nearest that are remembered."""
        (early, first), (late, second) = self._past[0], self._past[min(1, len(self._past) - 1)]
        part = 0.0 if late <= early else min(max((time - early) / (late - early), 0.0), 1.0)
        return np.asarray(first + part * (second - first))
