"""Where one step does not reach: small steps, sliding to rest, and bodies that come from far or grow."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels.network.tables import NOW
from cable_shape.shape import CableShape
from cable_shape.solve.search import between
from cable_shape.solve.touching.step import DEEPEST, FAR, STEP_ITERATIONS, WARM_ITERATIONS, Steps

_FIRST_STEP, _SMALLEST_STEP = 0.25, 1.0 / 512.0
_FIRST_DRAG, _MOST_DRAG = 3e3, 1e9  #: of a sliding cable, in stiffness / length^2
_AT_REST = 0.02  #: the same, times rad in a step: a cable that is driven by less looks for its equilibrium
_SLIDES = 200  #: such steps at most


def follow(steps: Steps, frames: Array) -> bool:
    """Goes with supports and bodies from where they were to `frames` and `links`, in steps as small as it takes."""
    state = steps.state
    kept = state.copy()
    origin, links = state.grips[NOW].copy(), state.bodies.links_then
    done, step = 0.0, _FIRST_STEP
    history = 1
    while done < 1.0:
        if steps.out_of_time():
            return False
        at = min(1.0, done + step)
        state.move_bodies(between(links, steps.links, at))
        if steps.go(between(origin, frames, at), history, STEP_ITERATIONS, FAR):
            done, history = at, 2
            step *= 1.6
        else:
            step, history = 0.4 * step, 1
            if step < _SMALLEST_STEP:
                return False
    state.came_from(kept)
    return True


def relax(steps: Steps, frames: Array) -> bool:
    """Lets the cable slide, as in a thick liquid, from the last solution to where it comes to rest at `frames`."""
    state = steps.state
    origin, links = state.grips[NOW].copy(), state.bodies.links_then
    softest = state.cable.softest
    done, step, drag = 0.0, 1.0, _FIRST_DRAG * softest
    for _ in range(_SLIDES):
        if steps.out_of_time() or step < _SMALLEST_STEP or drag > _MOST_DRAG * softest:
            return False
        at = min(1.0, done + step)
        state.move_bodies(between(links, steps.links, at))
        if steps.go(between(origin, frames, at), 1, STEP_ITERATIONS, math.inf, drag=drag):
            rests = drag * state.info[12] < _AT_REST * softest
            done, drag, step = at, 0.4 * drag, 1.6 * step
            if done == 1.0 and rests and steps.go(frames, 1, WARM_ITERATIONS, FAR):
                return True
        else:
            drag *= 3.0
            step = min(0.5 * step, 1.0 - done) if done < 1.0 else step
    return False


def clear_by(steps: Steps, free: CableShape, away: Array) -> float:
    """[m], how far bodies go along the unit vector `away` until the free shape is clear of them; there they stay.

    Infinite: not within twice its length.
    """
    far = 0.25 * max(-steps.depth(free.buffer), DEEPEST)
    while far < 2.0 * steps.state.length:
        steps.state.bodies.shift(far * away)
        if steps.depth(free.buffer) > 0.0:
            return far
        far *= 1.3
    return math.inf


def approach(steps: Steps, frames: Array, free: CableShape, away: Array, iterations: int = WARM_ITERATIONS) -> bool:
    """Takes the bodies out of the cable's way along the unit vector `away` and brings them back in steps.

    iterations: of each at most.
    """
    state = steps.state
    far = clear_by(steps, free, away)
    if far == math.inf:
        return False
    state.start_from(free, frames)
    state.remember(state.seen(free))
    most = 0.6 * (state.bodies.thinnest + state.radius)
    step = min(0.25 * far, most)
    done = far
    while done > 0.0:
        if steps.out_of_time():
            return False
        to = done - step if done - step > 0.1 * step else 0.0
        state.bodies.shift(to * away)
        if steps.go(frames, 1, iterations, math.inf, jump=True):
            done = to
            step = min(1.5 * step, most)
        else:
            step *= 0.4
            if step < far * _SMALLEST_STEP:
                return False
    return True


def grow(steps: Steps, frames: Array, free: CableShape) -> bool:
    """Shrinks the bodies until the cable is outside, and lets them grow again."""
    steps.state.start_from(free, frames)
    steps.state.remember(steps.state.seen(free))
    depth = -steps.depth(free.buffer)
    sunk, step = depth, 0.25 * depth
    while sunk > 0.0:
        if steps.out_of_time():
            return False
        to = sunk - step if sunk - step > 0.1 * step else 0.0
        if steps.go(frames, 1, WARM_ITERATIONS, math.inf, to, jump=True):
            sunk = to
            step *= 1.5
        else:
            step *= 0.4
            if step < depth * _SMALLEST_STEP:
                return False
    return True
