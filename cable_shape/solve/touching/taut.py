"""How much a cable that does not stretch is let stretch: little, less where it is taut, more while it is too short.

So long as it is too short for its way past the bodies, it gives as much as it takes to pull a little only: then it is
followed wherever its ends go, and lies on the same side of everything once it is long enough again.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.contact import afterwards
from cable_shape.kernels.network.tables import NOW
from cable_shape.solve.touching.road import TAUT
from cable_shape.solve.touching.step import FAR, WARM_ITERATIONS, Steps

#: A cable that lacks something is let stretch so many times less, or nearly, at least this part of what it may; if what
#: it lacks then is more than that to this power, it is too short. Once it is stretched by no more than this part of its
#: length it is let again.
_TIGHTER, _HARDLY, _TIGHTEST, _LESS, EASED = 0.1, 0.9, 1e-5, 0.4, 1e-6
#: One that is too short is let stretch up to so many times more at once, and in all.
LOOSER, LOOSEST = 10.0, 1e6
#: Pulls, in `TouchState.usual_pull`, from which on a cable may be too short; with which one that is is drawn, and with
#: which it goes on, at least and at most; how much further than to these bounds is aimed at, and how often.
TIGHT, HARD, EASY = 2.0, (1e3, math.inf), (10.0, 30.0)
_FURTHER, _PULLS = 1.2, 8


def stretch_of(steps: Steps) -> tuple[float, float]:
    """[m] by how much the cable is longer or shorter in all, and what it lacks."""
    state = steps.state
    bounds = state.arcs[: int(state.forces) + 1]
    if state.rings.size:
        bounds = np.delete(bounds, state.rings)  # an eyelet lets it run
    found: tuple[float, float] = afterwards.stretched(steps.buffer, steps.problem.points, state.stretch, bounds)
    return found


def tightened(steps: Steps, missing: float) -> bool:
    """Whether the last solution is now that of a cable that gives less than the one that lacked so much [m].

    Where there is one that lacks next to nothing it is taut, no more; else it gives as little as Newton's method
    bears, at least as little as usual if it is not too short.
    """
    state, changed, part = steps.state, False, _TIGHTER
    while part < _HARDLY and (missing > TAUT * state.length or state.tight > 1.0):
        left = _give_less(steps, part, missing)
        if left < math.inf:
            missing, changed, part = left, True, max(part**2, _TIGHTER)
        else:
            part = math.sqrt(part)
    return (missing > TAUT * state.length and state.tight > 1.0 and led_to_its_length(steps)) or changed


def led_to_its_length(steps: Steps) -> bool:
    """Whether the last solution is now that of a cable that gives no more than usual, to which the road has led.

    Newton's method may find none where a cable that gets tighter lets go of much that it lies on.
    """
    state, kept, frames = steps.state, steps.kept(), steps.state.grips[NOW].copy()
    state.tighten(1.0)
    road = steps.by_road(frames)
    if road is not None and not road.taut:
        found = steps.go(frames, 1, WARM_ITERATIONS, FAR) or (steps.stand(frames) and steps.settle(frames))
        steps.still = False
        if found and stretch_of(steps)[1] <= TAUT * state.length:
            return True
    steps.take_back(kept)
    return False


def _give_less(steps: Steps, part: float, missing: float) -> float:
    """[m] what the cable lacks if it gives so much less; infinite, and the last solution is as it was, where it has
    no equilibrium then or lacks `missing` [m] all the same."""
    state = steps.state
    kept = steps.kept()
    tight, enough = part * state.tight, max(part**_LESS * missing, TAUT * state.length)
    for pulls_more in (False, True):
        state.tighten(tight)
        if pulls_more:
            state.pull_less(part)
        if tight > _TIGHTEST and steps.go(state.grips[NOW].copy(), 1, WARM_ITERATIONS, FAR):
            left = stretch_of(steps)[1]
            if left <= enough:
                return left
            break
        steps.take_back(kept)
    steps.take_back(kept)
    return math.inf


def loosened(steps: Steps, frames: Array) -> bool:
    """Whether the last solution, between supports `frames`, is now that of a cable that gives more.

    It pulls as before, or where it is too short by as much less as it gives more.
    """
    state, kept, looser = steps.state, steps.kept(), LOOSER * steps.state.tight
    for pulls_less in (False, True):
        state.tighten(looser)
        state.move_bodies(state.bodies.links_then)
        if pulls_less:
            state.pull_less(LOOSER)
        if steps.go(frames, 1, WARM_ITERATIONS, FAR):
            return True
        steps.take_back(kept)
    return False


def pull(steps: Steps, least: float, most: float) -> None:
    """Makes a cable that is too short give as much as it takes to pull as hard as this, or nearly."""
    state = steps.state
    frames = state.grips[NOW].copy()
    most_at_once = LOOSER
    for _ in range(_PULLS):
        if least <= state.pull <= most:
            break
        wanted = state.pull / most * _FURTHER if state.pull > most else state.pull / least / _FURTHER
        looser = min(max(wanted, 1.0 / most_at_once), most_at_once)
        kept = steps.kept()
        state.tighten(looser * state.tight)
        state.pull_less(looser)
        if not steps.go(frames, 1, WARM_ITERATIONS, FAR):
            steps.take_back(kept)
            most_at_once = math.sqrt(most_at_once)
