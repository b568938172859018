"""How far trouble is: margins, each normalised to its limit, and the time until it is reached.

======================  ======================================================================================
kind                    `used`, 1 at the limit
======================  ======================================================================================
OVERSTRETCHED           distance of the ends / length; of an elastic cable with a `max_tension` / the length that
                        it has under that tension
TENSION                 greatest tension / `max_tension`
BEND_RADIUS             `min_bend_radius` / smallest radius of curvature
TWIST_RATE              greatest \\|twist rate\\| / `max_twist_rate`
CLEARANCE, each body    2 - distance / warning distance: 1 at the warning distance, 2 at contact
STRESS                  greatest von Mises stress / `allowable_stress`: 1 / safety factor
STABILITY               1 / (1 + mu) while stable, 1 - mu beyond; mu: smallest eigenvalue of the second variation
                        in units of the smallest stiffness / length^2, 0 where the cable snaps
======================  ======================================================================================

A limit that the cable does not have, a body beyond the horizon of the clearance check, the stretch of a cable with a
free end and the stability of a model that knows none have no margin.

Times are extrapolated in a straight line at the present speed: of the clearance to what stands still from how the rod
answers the motion of its grips; of the clearance to robot links and of tails, of other models, and of all else from the
last two cycles. Towards a snap mu^2, not mu, falls in a straight line.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from cable_shape.cable import Cable
from cable_shape.checks import Array
from cable_shape.clearance import NOT_JUDGED
from cable_shape.kernels import margins as kernels
from cable_shape.models.rod_state import RodState
from cable_shape.report import Clearance, Margin, WarningKind
from cable_shape.scene import Scene
from cable_shape.shape import CableShape, Status
from cable_shape.speed import LONGEST_GAP
from cable_shape.stress import section_of

#: Inverse iterations from nothing, from the last mode when a snap is near, and else.
_COLD_STEPS, _NEAR_STEPS, _WARM_STEPS = 60, 4, 1
#: Below this mu a snap is near, and the factors are made anew each cycle.
_NEAR = 1.0
#: Of the rows of the kernel before those of the bodies.
_KINDS = (
    WarningKind.OVERSTRETCHED,
    WarningKind.TENSION,
    WarningKind.BEND_RADIUS,
    WarningKind.TWIST_RATE,
    WarningKind.STRESS,
    WarningKind.STABILITY,
)
_CLEARANCE = WarningKind.CLEARANCE
_STABILITY, _BODIES = int(kernels.STABILITY), int(kernels.BODIES)
#: A Margin from a tuple of its fields, in half the time.
_margin: Callable[[tuple[Any, ...]], Margin] = functools.partial(tuple.__new__, Margin)
_NONE, _NO_BODIES, _NO_MODE = np.empty(0), np.empty((0, 8)), np.empty((0, 3))


def margins_of(
    cable: Cable, scene: Scene, shape: CableShape, clearance: Clearance, *, held: bool = False
) -> tuple[Margin, ...]:
    """The margins of one shape by itself: without stability, times not known.

    held: grips hold both ends, so that their distance stretches the cable; the shape alone does not tell.
    """
    return MarginWatch(cable, scene).margins(shape, clearance, 0, held=held)


@final
class MarginWatch:
    """The margins of one cable cycle by cycle; it remembers the last cycle for the times and for the softest mode.

    moving: (m,), of the rows of a clearance's table: whether that body may move by itself. Default: none does.
    """

    def __init__(self, cable: Cable, scene: Scene, moving: NDArray[np.bool_] | None = None) -> None:
        longest = cable.length
        if cable.axial_stiffness is not None and cable.max_tension is not None:
            longest *= 1.0 + cable.max_tension / cable.axial_stiffness
        limits = (longest, cable.max_tension, cable.min_bend_radius, cable.max_twist_rate, cable.allowable_stress)
        warn = max(scene.warn_distance, scene.error_distance)
        self.limits = np.array([math.nan if limit is None else limit for limit in (*limits, warn)])
        self.section = np.zeros(5) if cable.allowable_stress is None else section_of(cable)
        self.soft = min(*cable.bending_stiffness, cable.twisting_stiffness) / cable.length**2
        self._moving = moving
        self._still: NDArray[np.bool_] = np.zeros(0, np.bool_)  # of the last table's rows: none moves, which ones do
        self._on_links = self._still
        self.reset()

    def reset(self) -> None:
        """Forgets the last cycle."""
        self._mode: Array = _NO_MODE
        self._memory: Array = np.array((math.nan, 0.0, 0.0))
        self._stamp = self._older_stamp = -math.inf
        self.stability: Margin | None = None  # of the last shape
        self._newest: Array = _NONE
        self._older: Array = _NONE

    def margins(
        self,
        shape: CableShape,
        clearance: Clearance,
        stamp: int,
        *,
        state: RodState | None = None,
        twists: Array | None = None,
        held: bool = False,
    ) -> tuple[Margin, ...]:
        """The margins of a shape at `stamp` [ns].

        Parameters
        ----------
        state : RodState, optional
            Of the rod that has just made the shape; None: stability is not told.
        twists : (12,), optional
            Velocity [m/s] and angular velocity [rad/s] of the start, then of the end, world axes, about that cable end.
            None: not known.
        held : bool
            Grips hold both ends.
        """
        if stamp != self._stamp:  # a repeated stamp is compared with the same cycle again
            self._older, self._older_stamp, self._stamp = self._newest, self._stamp, stamp
        status = shape.status
        if status in NOT_JUDGED:
            self._newest, self.stability = _NONE, None
            return ()
        table = _table(clearance)
        now = np.empty(_BODIES + len(table))
        seconds = (stamp - self._older_stamp) * 1e-9
        listed = clearance.table is not None or not clearance.bodies  # rows are the same bodies in every cycle
        known = 0.0 < seconds <= LONGEST_GAP and len(self._older) == len(now) and listed
        if len(self._still) != len(table):
            self._still = np.zeros(len(table), np.bool_)
            self._on_links = self._still.copy()
            if self._moving is not None:
                both = min(len(table), len(self._moving))
                self._on_links[:both] = self._moving[:both]
        rows = kernels.measure(
            shape.buffer,
            shape.points,
            self.section,
            self.limits,
            held,
            status is not Status.OVERSTRETCHED,
            table,
            self._on_links if listed else self._still,
            *self._rod(shape, state),
            self.soft,
            shape.reused and not math.isnan(self._memory[0]),
            status is Status.UNSTABLE,
            self._memory,
            _NONE if twists is None else twists,
            self._older if known else now,
            seconds if known else math.nan,
            now,
        ).tolist()
        self._newest, self.stability = now, None
        found = [
            _margin((kind, used, limit, value, at, "", time))
            for kind, (used, limit, value, at, time) in zip(_KINDS, rows, strict=False)
            if used == used  # not NaN
        ]
        if rows[_STABILITY][0] == rows[_STABILITY][0]:
            self.stability = found[-1]
        if clearance.bodies:
            bodies = iter(clearance.bodies)
            found += [
                _margin((_CLEARANCE, used, limit, value, at, next(bodies).body, time))
                for used, limit, value, at, time in rows[_BODIES:]
                if used == used
            ]
        return tuple(found)

    def _rod(
        self, shape: CableShape, state: RodState | None
    ) -> tuple[Array, Array, Array, Array, int, int, Array, int, bool]:
        """What the kernel needs of the rod behind the shape: its memory, the last mode, steps, fresh factors or not."""
        if state is None or shape.model != "cosserat" or not shape.status or state.history == 0:
            return _NONE, _NONE, _NONE, _NONE, 0, 0, _NO_MODE, 0, False
        cold = len(self._mode) != state.elements + 1
        if cold:
            self._mode = np.random.default_rng(0).normal(size=(state.elements + 1, 3))
        fresh = cold or not self._memory[0] > _NEAR or shape.status is not Status.OK
        if not fresh or shape.reused:
            state.factor()
        steps = _COLD_STEPS if cold else _NEAR_STEPS if fresh else _WARM_STEPS
        return state.par, state.mesh, state.sol, state.work, state.elements, state.width, self._mode, steps, fresh


def _table(clearance: Clearance) -> Array:
    """(m, 8), see `Clearance.table`."""
    if clearance.table is not None:
        return clearance.table
    if not clearance.bodies:
        return _NO_BODIES
    return np.array([(b.distance, b.arc_length, *b.point_on_cable, *b.point_on_body) for b in clearance.bodies])
