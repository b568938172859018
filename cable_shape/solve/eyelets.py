"""Clips through which the cable runs: which arc lengths of the cable are in its eyelets.

At rest the force F of an eyelet has no part along the cable but its friction f, see `kernels.network.gripping`, less
the force r by which it draws the cable towards its start: F . d3 = f - r; without both the energy is stationary in the
arc length sigma there, dE/dsigma = -F . d3. Near the solution sigma is one more unknown of the compiled Newton
iteration (`kernels.network.sliding`); from afar it has a Newton iteration of its own, the rod being solved for every
sigma.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.network.drive import I_TURNED
from cable_shape.kernels.network.sliding import LEAST, REACH
from cable_shape.solve.network import Network
from cable_shape.solve.starts import COLD_ITERATIONS

Inner = Callable[[int, int, bool, bool, float, bool, bool], bool]

_MOST = 40  #: steps in sigma
_NEAR = 0.03  #: of the length: after a smaller step in sigma all unknowns are solved for at once
_AT_REST = 1e-6  #: of the length: a smaller step on a saddle leads nowhere
_SOFT = 0.8  #: of the slack: as much may go to spans that seem to need it, but do not have to have it
_KICK = 0.02  #: of the length: step off a saddle


@final
class Eyelets:
    """How one solve finds what is in the eyelets; `why`: what failed."""

    __slots__ = ("_inner", "_out_of_time", "_softest", "_stable", "_state", "why")

    def __init__(self, state: Network, inner: Inner, out_of_time: Callable[[], bool]) -> None:
        self._state = state
        self._inner = inner
        self._out_of_time = out_of_time
        self._softest: Array = np.zeros(0)
        self._stable = True
        self.why = ""

    def call(self, history: int, most: int, guard: bool, output: bool, far: float, near: bool) -> bool:
        """Solves for the supports in the trial, and for what is in the eyelets; near: the trial is next to it."""
        if near and self._inner(history, most, guard, output, far, False, True):
            return True
        if near and most < COLD_ITERATIONS and self._state.rough.any():
            return False  # what sticks and slips is found sooner in smaller steps
        return not self._out_of_time() and self._outer(history, most, guard, output, far)

    def _outer(self, history: int, most: int, guard: bool, output: bool, far: float) -> bool:
        """The rod is solved for given arc lengths, which step towards rest, until both can be solved for at once."""
        state = self._state
        before = state.bounds()
        arcs = state.predicted_arcs() if history else before
        self._slide(arcs if self._room(arcs, state.target).min() > 0.0 else self._feasible(state.target))
        if not self._inner(history, most, guard, False, far, False, False):
            if history:  # the last solution stays, on its own mesh
                self._slide(before)
            return False
        near = _NEAR * state.length
        shrink, most_of, turned = 1.0, 1.0, state.info[I_TURNED]
        good = state.bounds()
        last = np.zeros(len(state.rings))
        for _ in range(_MOST):
            step = self._step()
            most_of = 0.5 * most_of if float(step @ last) < 0.0 else min(1.0, 2.0 * most_of)  # else it swings for ever
            last = step
            if self._out_of_time():
                return False
            if np.abs(step).max() <= near:
                if self._stable or not guard:
                    if self._inner(1, most, guard, output, far - turned, True, True):
                        return True
                    near *= 0.1
                elif np.abs(step).max() <= _AT_REST * state.length:
                    step = _KICK * state.length * self._softest
            shrink = min(most_of, 4.0 * shrink)
            while True:
                bounded = self._bounded(good, step, shrink)
                if bounded is None:
                    return False
                self._slide(bounded)
                if self._inner(1, most, guard, False, far - turned, True, False):
                    break
                shrink *= 0.25
                if shrink < 1e-3:
                    self._slide(good)
                    self.why = "no equilibrium was found for the cable running through its eyelets. "
                    return False
            good = bounded
            turned += state.info[I_TURNED]
        held = "which do not hold it" if self._state.rough.any() else "which have no friction"
        self.why = f"the cable did not come to rest in its eyelets, {held}: make one a 'ball' clip. "
        return False

    def spread(self, frames: Array) -> None:
        """Arc lengths at the eyelets that leave every span slack enough, for a cold start between `frames`."""
        if self._room(self._state.bounds(), frames).min() <= 0.0:
            self._state.begin_at(self._feasible(frames))

    def _slide(self, arcs: Array) -> None:
        if not np.array_equal(arcs, self._state.bounds()):
            self._state.slide_to(arcs)

    def _step(self) -> Array:
        """Newton's step downhill in the energy, for the eyelets (k,)."""
        state = self._state
        state.refresh()
        f, J, _ = state.pulls()
        values, vectors = np.linalg.eigh(-0.5 * (J + J.T))
        self._stable = bool(values[0] > 0.0)
        self._softest = vectors[:, 0]
        if self._stable:
            return np.asarray(np.linalg.solve(J, -f))
        # uphill in some direction: its slope with the curvature's sign turned round
        floor = 1e-3 * np.abs(values).max()
        return np.asarray(vectors @ ((vectors.T @ f) / np.maximum(np.abs(values), floor)))

    def _room(self, arcs: Array, frames: Array) -> Array:
        """(m,) [m]: slack of each span; of an extensible cable, or before a free end, its length."""
        return self._state.slack(arcs, frames)

    def _bounded(self, arcs: Array, step: Array, shrink: float) -> Array | None:
        """The arc lengths after as much of a step as spans and stops allow; None where the cable has run through."""
        state = self._state
        length = state.length
        full = np.zeros(arcs.size)
        full[state.rings] = shrink * step
        fraction = 1.0
        room = self._room(arcs, state.target)
        for j, used in enumerate(-np.diff(full)):
            if used > REACH * room[j]:
                fraction = min(fraction, REACH * max(room[j], 0.0) / used)
        for ring in state.rings:
            if full[ring] == 0.0:
                continue
            stops = np.concatenate((state.points, arcs[:ring] if full[ring] < 0.0 else arcs[ring + 1 :]))
            ahead = (stops - arcs[ring]) * np.sign(full[ring])
            way = ahead[ahead > 0.0].min()
            if way < LEAST * length:
                self.why = (
                    f"{state.ring_name(ring)} is an eyelet {self._hold_of(ring)}, and the cable runs through it until "
                    f"the next clip, mass or end is reached, at {arcs[ring]:.3g} m: nothing holds it. "
                    f"{'Lower its retraction, or make' if self._drawn(ring) else 'Make'} it a 'ball' clip. "
                )
                return None
            if abs(full[ring]) > REACH * way:
                fraction = min(fraction, REACH * way / abs(full[ring]))
        return np.asarray(arcs + fraction * full)

    def _drawn(self, ring: int) -> float:
        """[N], by which an eyelet draws the cable in."""
        return float(self._state.drawn[self._state.rings.index(ring)])

    def _hold_of(self, ring: int) -> str:
        """What an eyelet does along the cable, in words."""
        mu, pull = self._state.rough[self._state.rings.index(ring)], self._drawn(ring)
        rubs = "without friction" if mu == 0.0 else f"whose friction, {mu:g}, does not hold it"
        return rubs if pull == 0.0 else f"{rubs} that draws the cable in by {pull:g} N"

    def _feasible(self, frames: Array) -> Array:
        """Arc lengths for which each stretch of cable shares its slack out among its spans as before, or by length.

        Spans to what may move need nothing; they get as much as they seem to need, if there is so much.
        """
        state = self._state
        arcs = state.bounds().copy()
        room = self._room(arcs, frames)
        needed, wish = np.diff(arcs) - room, state.apart(arcs, frames)
        before = self._room(arcs, state.poses) if state.history else wish
        holding = [j for j in range(arcs.size) if j not in state.rings]
        for a, b in pairwise(holding):
            if b - a > 1 and room[a:b].min() <= 0.0:
                more = wish[a:b] - needed[a:b]
                least = needed[a:b] + more * min(1.0, _SOFT * room[a:b].sum() / max(more.sum(), 1e-300))
                share = np.maximum(before[a:b], 1e-3 * (arcs[b] - arcs[a]))
                spans = least + share * ((arcs[b] - arcs[a] - least.sum()) / share.sum())
                arcs[a + 1 : b] = arcs[a] + np.cumsum(spans)[:-1]
        return arcs
