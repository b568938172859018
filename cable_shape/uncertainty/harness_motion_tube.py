"""A harness as it swings, with a tube about each segment: :class:`HarnessMotionTube`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

from cable_shape.motion.harness_motion import HarnessMotion
from cable_shape.pose import one_mapping
from cable_shape.solve.harness_problem import End
from cable_shape.uncertainty.motions_beside import Links, MotionsBeside
from cable_shape.uncertainty.uncertainty import Tube


@final
class HarnessMotionTube(MotionsBeside):
    """A harness that swings, and how well that is known of each segment; what ``MotionTube(harness)`` makes.

    Parameters are those of :class:`MotionTube` with a harness.
    """

    def begin(self, ends: Mapping[str, End], *more: object, links: Links = None) -> dict[str, Tube]:
        """Starts at rest between these ends, see :meth:`HarnessMotion.begin`; returns the tube of each segment.

        Where there is no usable shape, or none beside it, covariance and radius are NaN: look at the status of the
        tubes' shapes, and at `trouble`.

        Raises
        ------
        ArgumentError
            For wrong arguments.
        """
        one_mapping(ends, more)
        assert isinstance(self.motion, HarnessMotion)
        shape = self.motion.begin(ends, links=links)
        if shape.status:
            self.follow(ends, links)
        return self.told(shape)

    def step(self, ends: Mapping[str, End], dt: float, links: Links = None) -> dict[str, Tube]:
        """The tubes dt [s] later, see :meth:`HarnessMotion.step`.

        Raises
        ------
        ArgumentError
            As there.
        """
        assert isinstance(self.motion, HarnessMotion)
        shape = self.motion.step(ends, dt, links)
        if shape.status:
            self.follow(ends, links, dt)
        return self.told(shape)
