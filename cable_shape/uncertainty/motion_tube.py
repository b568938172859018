"""A cable as it swings, with a tube about it: :class:`MotionTube`."""

from __future__ import annotations

import inspect
from typing import Any, final

from cable_shape.cable.harness import Harness
from cable_shape.motion.motion import Motion
from cable_shape.pose import NOT_GIVEN, FreeEnd, Grip, Pose, both_given
from cable_shape.uncertainty.motions_beside import Links, MotionsBeside
from cable_shape.uncertainty.uncertainty import Tube


@final
class MotionTube(MotionsBeside):
    """A cable, or harness, that swings, and how well that is known of it.

    Of independent errors, of numbers and grips, that last as long as the motion does. Of a cable that touches nothing
    each counts to first order, by derivatives that are carried along (:meth:`cable_shape.Motion.sensitivity`), and so
    do the grips of a harness. Where those are not to be had, in contact, in eyelets, of numbers of a harness and of
    what varies along the cable, each error has two motions of its own, a standard deviation to either side: half of the
    way between them counts, to second order.

    Parameters
    ----------
    cable : Cable or Harness
        A cable without tails.
    uncertainty : Uncertainty
        Its `inertia` does not count: a motion leaves none out.
    scene : Scene, optional
    **options
        Keywords of :class:`cable_shape.Motion`.

    Raises
    ------
    ArgumentError
        As `Motion`, for a cable with tails, and if one a standard deviation away cannot be.
    """

    def __new__(cls, cable: Any, *arguments: Any, **keywords: Any) -> Any:
        """A :class:`HarnessMotionTube` for a harness."""
        if not isinstance(cable, Harness):
            return super().__new__(cls)
        from cable_shape.uncertainty.harness_motion_tube import HarnessMotionTube

        return HarnessMotionTube(cable, *arguments, **keywords)

    def begin(
        self, start: Pose | Grip, end: Pose | Grip | FreeEnd | None = NOT_GIVEN, links: Links = None
    ) -> Tube:  # fmt: skip
        """Starts at rest between these ends, see :meth:`cable_shape.Motion.begin`; returns that shape with its tube.

        Where there is no usable shape, or none beside it, covariance and radius are NaN: look at its status, and at
        `trouble`.

        Raises
        ------
        ArgumentError
            For wrong arguments.
        """
        both_given("begin(start, end)", end)
        assert isinstance(self.motion, Motion)
        shape = self.motion.begin(start, end, links=links)
        if shape.status:
            self.follow((start, end), links)
        return self.told(shape)[""]

    def step(self, start: Pose | Grip, end: Pose | Grip | FreeEnd | None, dt: float, links: Links = None) -> Tube:
        """The cable dt [s] later with its tube, see :meth:`cable_shape.Motion.step`.

        Raises
        ------
        ArgumentError
            As there, and as `begin`.
        """
        assert isinstance(self.motion, Motion)
        shape = self.motion.step(start, end, dt, links)
        if shape.status:
            self.follow((start, end), links, dt)
        return self.told(shape)[""]


_MADE_FROM = inspect.signature(MotionsBeside.__init__)
_MADE_FROM = _MADE_FROM.replace(parameters=list(_MADE_FROM.parameters.values())[1:])
MotionTube.__signature__ = _MADE_FROM  # type: ignore[attr-defined]  # not that of __new__
