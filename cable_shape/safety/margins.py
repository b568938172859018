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
QUASISTATIC             load of the cable's inertia / its weight / limit, see :mod:`cable_shape.solve.quasistatic`
======================  ======================================================================================

A limit that the cable does not have, a body beyond the horizon of the clearance check, the stretch of a cable with a
free end and the stability of a model that knows none have no margin.

Times are extrapolated in a straight line at the present speed: of the clearance to what stands still from how the rod
answers the motion of its grips; of the clearance to robot links, of tails, in contact, of other models, and of all else
from the last two cycles. Towards a snap mu^2, not mu, falls in a straight line.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable
from functools import lru_cache
from itertools import chain, repeat
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import pieces_of, slowest
from cable_shape.checks import Array
from cable_shape.kernels import swing
from cable_shape.kernels.safety import margin_watch as kernels
from cable_shape.kernels.safety.loads_used import BODIES, COLUMNS, STABILITY
from cable_shape.pose import Ends, Grip, Pose
from cable_shape.safety.clearance import NOT_JUDGED
from cable_shape.safety.report import LOAD_MARGINS, Clearance, Margin, WarningKind
from cable_shape.safety.stress import section_of
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape, Status
from cable_shape.solve.answers import Solved
from cable_shape.solve.network import Network
from cable_shape.solve.outcome import MODEL
from cable_shape.solve.problem import GRAVITY
from cable_shape.solve.quasistatic import bending_rate, swing_state
from cable_shape.solve.touching.pile import Member

#: [s], cycles further apart say nothing about the speed now.
LONGEST_GAP = 0.5
#: Inverse iterations from nothing, from the last mode when a snap is near, and else.
_COLD_STEPS, _NEAR_STEPS, _WARM_STEPS = 60, 4, 1
_TOUCHED_STEPS = 10  #: the same, where contacts have come or gone
#: Below this mu a snap is near, and the factors are made anew each cycle.
_NEAR = 1.0
#: Those that are told, by what the kernel returns.
_TOLD = [
    tuple(kind for row, kind in enumerate(LOAD_MARGINS) if which >> row & 1) for which in range(1 << len(LOAD_MARGINS))
]
_NAMELESS = [("",) * len(kinds) for kinds in _TOLD]
_CLEARANCE, _STABLE, _LOADS = WarningKind.CLEARANCE, 1 << STABILITY, (1 << BODIES) - 1
_INERTIA, _NO_NAME = (WarningKind.QUASISTATIC,), ("",)
_HELD, _LOADED, _FRESH, _AGAIN = kernels.HELD, kernels.LOADED, kernels.FRESH, kernels.AGAIN
_UNSTABLE, _NEW, _LISTED, _TOUCHED = kernels.UNSTABLE, kernels.NEW, kernels.LISTED, kernels.TOUCHED
#: Looked up once: an enumeration's members take longer than their name says.
_OK, _SADDLE, _OVERSTRETCHED = Status.OK, Status.UNSTABLE, Status.OVERSTRETCHED
#: A Margin from its type and a tuple of its fields, in half the time.
_margin: Callable[[type[Margin], tuple[Any, ...]], Margin] = tuple.__new__
_name = operator.attrgetter("body")
_NONE, _NO_BODIES, _NO_MODE = np.empty(0), np.empty((0, 8)), np.empty((0, 3))
#: ints, floats, sols, work, mode, steps, flags
_Rod = tuple[Any, Array, Array, Array, Array, int, int]
_NO_ROD: _Rod = (np.empty(0, dtype=np.int64), _NONE, _NONE, _NONE, _NO_MODE, 0, 0)


def margins_of(
    cable: Cable, scene: Scene, shape: CableShape, clearance: Clearance, *, held: bool = False
) -> tuple[Margin, ...]:
    """The margins of one shape by itself: without stability, times not known.

    held: grips hold both ends, so that their distance stretches the cable; the shape alone does not tell.
    """
    return MarginWatch(cable, scene).margins(shape, clearance, 0, held=held)


@lru_cache(maxsize=64)
def _pieces(cable: Cable) -> Array:
    """(p, PIECE), not to be changed: what a cable is made of and its limits, as `loads_used.measure_loads` takes it."""
    rows = []
    pieces = pieces_of(cable)
    pulls = [one.max_tension for _, _, one in pieces if one.max_tension is not None]
    longest = cable.length
    for start, end, one in pieces:
        if one.axial_stiffness is not None and pulls:
            longest += (end - start) * min(pulls) / one.axial_stiffness
    for start, end, one in pieces:
        limits = (longest, one.max_tension, one.min_bend_radius, one.max_twist_rate, one.allowable_stress)
        section = np.zeros(5) if one.allowable_stress is None else section_of(one)
        rows.append((start, end, *section, *(math.nan if limit is None else limit for limit in limits)))
    return np.array(rows)


@lru_cache(maxsize=64)
def _any_mode(nodes: int) -> Array:
    """(nodes, 3), what the softest mode is looked for from."""
    return np.random.default_rng(0).normal(size=(nodes, 3))


@final
class MarginWatch:
    """The margins of one cable cycle by cycle; it remembers the last cycle for the times and for the softest mode.

    moving: (m,), of the rows of a clearance's table: whether that body may move by itself. Default: none does.
    quasistatic_limit: of the load of inertia as a fraction of the weight under `gravity`; None: it is not told.
    """

    def __init__(
        self,
        cable: Cable,
        scene: Scene,
        moving: NDArray[np.bool_] | None = None,
        *,
        gravity: ArrayLike = GRAVITY,
        quasistatic_limit: float | None = None,
    ) -> None:
        self._slowest = slowest(cable)
        made = [one for _, _, one in pieces_of(cable)]
        self._weightless = not any(one.linear_density for one in made) and not scene.masses
        self._swing = swing_state(self._slowest, gravity, quasistatic_limit)
        self.warn = max(scene.warn_distance, scene.error_distance)
        self.pieces = _pieces(cable)
        self.soft = min(min(*one.bending_stiffness, one.twisting_stiffness) for one in made) / cable.length**2
        self._moving = np.empty(0, np.bool_) if moving is None else moving
        self.reset()

    def reset(self) -> None:
        """Forgets the last cycle."""
        self._history: Array = np.full((2, BODIES), math.nan)  # of loads, and of bodies, see `kernels.margin_watch`
        self._mode: Array = _NO_MODE
        self._stamp = self._older_stamp = -math.inf
        self.stability: Margin | None = None  # of the last shape
        self._mu = math.nan
        unknown = np.full(kernels.SWING - kernels.EIGEN, math.nan)
        self._near, self._far, self._held = "", "", False  # kinds of the ends, and whether the second is held
        self._lay_out(np.concatenate(((self.warn, self.soft), unknown, self._swing, (0.0,))), 0)

    def go_on_from(self, other: MarginWatch, *, still: bool) -> None:
        """Remembers how the ends moved as another one does, and the last loads if the same cable is where it was.

        still: whether it is; where it has jumped, the loads before tell no speed of them.
        """
        self._stamp, self._older_stamp = other._stamp, other._older_stamp
        first, last = kernels.SWING, kernels.SWING + swing.MEMORY
        found = first + np.array((swing.RATIO, swing.WHERE, swing.PERIOD))
        for rows in (slice(kernels.TWISTS, last), found, slice(kernels.TURN, kernels.HEAD)):
            self._memory[rows] = other._memory[rows]
        if still and np.array_equal(self.pieces, other.pieces, equal_nan=True):
            self._history[:, :BODIES] = other._history[:, :BODIES]

    def _lay_out(self, head: Array, bodies: int) -> None:
        """Makes the kernel's memory one for so many bodies; times to these are not known then."""
        loads = self._history[:, :BODIES]
        k, head_size = BODIES + bodies + 1, int(kernels.HEAD)
        until = head_size + 2 * (COLUMNS + 1) * k + bodies
        memory = np.concatenate((np.full(until, math.nan), self.pieces.ravel()))
        memory[:head_size] = head[:head_size]
        moving = memory[until - bodies : until]
        known = min(bodies, len(self._moving))
        moving[:known], moving[known:] = self._moving[:known], False
        self._memory = memory
        self._bodies = bodies
        self._start: Array = memory[kernels.NOW : kernels.NOW + 7]
        self._end: Array = memory[kernels.NOW + 7 : kernels.SWING]
        self._twists: Array = memory[kernels.TWISTS : kernels.BEFORE]
        self._history = memory[until - bodies - 2 * k : until - bodies].reshape(2, k)
        self._history[:, :BODIES] = loads
        self._told: Array = memory[head_size + COLUMNS * k : head_size + 2 * COLUMNS * k].reshape(COLUMNS, k)

    @property
    def twists(self) -> Array | None:
        """(12,): velocity [m/s] and angular velocity [rad/s] of the start's cable frame, then of the end's; world axes.

        None while not known: at first, and after a gap in the stamps. Zero for a free end.
        """
        twists: Array = self._twists.copy()
        return None if math.isnan(twists[0]) else twists

    @property
    def mode(self) -> Array:
        """(nodes, 3), the softest mode of the last shape whose stability was told."""
        return self._mode

    @property
    def period(self) -> float:
        """[s], with which the cable swings, where its motion was judged last; NaN: not known."""
        return float(self._memory[kernels.SWING + swing.PERIOD])

    def inertia(self, shape: CableShape, ends: Ends, stamp: int) -> float:
        """Load of the cable's inertia as a fraction of its weight at this stamp, that of QUASISTATIC; NaN: not known.

        Of a usable shape, before the `margins` of the same cycle, which go on from there.
        """
        if self._weightless:
            return 0.0
        flags, seconds = self._step(stamp)
        if self._hold(ends):
            flags |= _HELD
        state = self._memory[kernels.SWING : kernels.TURN]
        kernels.begin(self._memory, self._bodies, flags, seconds)
        kernels.tell_inertia(state, self._twists, flags, seconds, shape.buffer, shape.points, np.empty(COLUMNS))
        return float(state[swing.RATIO])

    def _step(self, stamp: int) -> tuple[int, float]:
        """Whether this is a new cycle, as the kernel's flag, and the time since the last one [s]; NaN: not known."""
        flags = 0
        if stamp != self._stamp:
            self._older_stamp, self._stamp = self._stamp, stamp
            flags = _NEW
        seconds = (stamp - self._older_stamp) * 1e-9
        return flags, seconds if 0.0 < seconds <= LONGEST_GAP else math.nan

    def _hold(self, ends: Ends) -> bool:
        """Tells the kernel what the ends are and where; whether grips hold both."""
        start, end = ends
        near = far = "clamped"
        if type(start) is Grip:
            near, start = start.kind, start.cable_frame
        self._start[...] = start.array
        if type(end) is Grip:
            far, end = end.kind, end.cable_frame
        held = type(end) is Pose
        if held:
            self._end[...] = end.array  # type: ignore[union-attr]
        if near != self._near or far != self._far or held != self._held:
            self._near, self._far, self._held = near, far, held
            self._memory[kernels.SWING + swing.RATE] = bending_rate(self._slowest, *ends)
        return held

    def margins(
        self,
        shape: CableShape,
        clearance: Clearance,
        stamp: int,
        *,
        state: Solved | Network | None = None,
        ends: Ends | None = None,
        held: bool = False,
    ) -> tuple[Margin, ...]:
        """The margins of a shape at `stamp` [ns]; a repeated stamp is compared with the same cycle again.

        Parameters
        ----------
        state : Solved or Network, optional
            Of the rod that has just made the shape, in contact or not; None: stability is not told.
        ends : (Pose or Grip, Pose, Grip, FreeEnd or None), optional
            What the ends of the cable were last at this stamp; None: their speed is not known.
        held : bool
            Grips hold both ends, where `ends` does not tell.
        """
        status, table, flags = shape.status, clearance.table, _LOADED | _LISTED
        if table is None:
            table = _table(clearance)
            if clearance.bodies:
                flags -= _LISTED
        if len(table) != self._bodies:
            self._lay_out(self._memory, len(table))
        new, seconds = self._step(stamp)
        flags |= new
        if ends is not None:
            held = self._hold(ends)
        if held:
            flags |= _HELD
        if status is not _OK:
            if status in NOT_JUDGED:
                self.stability = None
                kernels.begin(self._memory, len(table), flags, seconds)
                return ()
            if status is _OVERSTRETCHED:
                flags -= _LOADED
        ints, floats, sols, work, mode, steps, more = self._rod(shape, state)
        which = kernels.measure(
            self._memory, shape.buffer, shape.points, table, ints, floats, sols, work, mode, steps, flags | more,
            seconds,
        )  # fmt: skip
        which, inertia = which & _LOADS, which >> BODIES
        kinds, names, bodies = _TOLD[which], _NAMELESS[which], clearance.bodies
        if which & _STABLE and isinstance(state, Member):  # the mode may turn another cable more
            self._told[3, len(kinds) - 1] = state.turns_most(self._mode)
        used, limits, values, places, times = self._told[:, : len(kinds) + len(bodies) + inertia].tolist()
        of: Iterable[WarningKind] = kinds
        others: Iterable[str] = names
        if bodies:
            of, others = chain(kinds, repeat(_CLEARANCE, len(bodies))), chain(names, map(_name, bodies))
        if inertia:
            of, others = chain(of, _INERTIA), chain(others, _NO_NAME)
        fields = zip(of, used, limits, values, places, others, times)  # noqa: B905, a keyword doubles its time
        found = tuple(map(_margin, repeat(Margin), fields))
        if which & _STABLE:
            self.stability, self._mu = found[len(kinds) - 1], values[len(kinds) - 1]
        else:
            self.stability = None
            if len(ints):
                self._mu = math.nan
        return found

    def _rod(self, shape: CableShape, state: Solved | Network | None) -> _Rod:
        """What the kernel needs of the rod behind the shape: its memory, the softest mode, steps, and what to add."""
        status = shape.status
        if state is None or state.history == 0 or shape.model != MODEL or not (status is _OK or status):
            return _NO_ROD
        more = _UNSTABLE if status is _SADDLE else 0
        touched = not isinstance(state, Network)
        if touched and not shape.reused:
            state.refresh()  # its contacts with it
        steps = _WARM_STEPS
        if len(self._mode) != state.network_nodes:
            self._mode = _any_mode(state.network_nodes).copy()
            self._mu, steps = math.nan, _TOUCHED_STEPS if touched else _COLD_STEPS
        if shape.reused and not math.isnan(self._mu):
            more |= _AGAIN
        elif touched or status is not _OK or not self._mu > _NEAR:
            steps = max(steps, _NEAR_STEPS)
            more |= 0 if touched else _FRESH
        elif not state.factored:  # type: ignore[union-attr]
            more |= _FRESH
        if touched:
            more |= _TOUCHED
        return state.ints, state.floats, state.sols, state.work, self._mode, steps, more


def _table(clearance: Clearance) -> Array:
    """(m, 8), see `Clearance.table`."""
    if not clearance.bodies:
        return _NO_BODIES
    return np.array([(b.distance, b.arc_length, *b.point_on_cable, *b.point_on_body) for b in clearance.bodies])
