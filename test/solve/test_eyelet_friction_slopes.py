"""Derivatives of cables that stick and slip in eyelets, against differences of shapes that were solved for."""

from __future__ import annotations

import numpy as np
import pytest
from eyelets import ALONG_X, CABLE, FROM, PLACE, at, eyelet, led

import cable_shape as cs
from cable_shape.solve import answers, cosserat
from cable_shape.solve.nearby import nearby
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem


@pytest.mark.parametrize(
    ("mu", "drawn", "ways", "slips"),
    [
        (0.2, 0.0, np.arange(0.0, 0.05, 0.005), True),
        (3.0, 0.0, np.arange(0.0, 0.05, 0.005), False),
        (0.2, 0.0, (*np.arange(0.0, 0.05, 0.005), 0.0448), False),
        (0.0, 0.3, np.arange(0.0, 0.02, 0.002), False),  # on the side that it is drawn from the cable is nearly taut
        (0.2, 0.3, np.arange(0.0, 0.02, 0.002), True),
        (3.0, 0.3, np.arange(0.0, 0.02, 0.002), False),
    ],
    ids=["slips", "sticks", "turns back", "drawn in", "drawn in, slips", "drawn in, sticks"],
)
def test_sensitivity_is_that_of_finite_differences(mu, drawn, ways, slips):
    predictor, shapes = led(eyelet(mu, PLACE, drawn), ways, tolerance=1e-10)
    assert shapes[-1].clips[0].slips is slips
    columns = predictor.sensitivity(("start", "end", "clip:e"))
    h = 1e-6

    def after(start=FROM, end=None, place=PLACE):
        """The shape where only the last step was another one."""
        other, _ = led(eyelet(mu, PLACE, drawn), ways[:-1], tolerance=1e-10)
        other.scene = eyelet(mu, place, drawn)
        return other.predict(start, at(ways[-1]) if end is None else end).positions

    for axis in range(3):
        d = h * np.eye(3)[axis]
        pairs = {
            axis: [after(start=cs.Pose(FROM.position + sign * d, ALONG_X)) for sign in (1, -1)],
            6 + axis: [after(end=at(ways[-1] + sign * d[0], sign * d[1], sign * d[2])) for sign in (1, -1)],
            12 + axis: [after(place=np.array(PLACE) + sign * d) for sign in (1, -1)],
        }
        for column, (above, below) in pairs.items():
            assert columns[:, :, column] == pytest.approx((above - below) / (2.0 * h), abs=1e-5)


@pytest.mark.parametrize(("mu", "slips"), [(0.2, True), (3.0, False)], ids=["slips", "sticks"])
def test_numbers_of_the_cable_and_shapes_beside_it_are_answered_as_differences_are(mu, slips):
    ways = np.arange(0.0, 0.05, 0.005)

    def problem(x, cable=CABLE):
        return Problem(cable, scene=eyelet(mu), points=121, tolerance=1e-10).move(FROM, at(x))

    def led_to(count):
        state = Network(problem(0.0))
        for x in ways[:count]:
            shape = cosserat.solve(problem(x), state)
        return state, shape

    state, shape = led_to(len(ways))
    assert shape.clips[0].slips is slips
    columns = answers.sensitivity(state, ("bending_stiffness", "linear_density"))
    for i, (name, value) in enumerate({"bending_stiffness": 0.01, "linear_density": 0.05}.items()):
        h, solved, beside = 1e-4 * value, [], []
        for sign in (1.0, -1.0):
            other = problem(ways[-1], CABLE.replace(**{name: value + sign * h}))
            solved.append(cosserat.solve(other, led_to(len(ways) - 1)[0]).positions)
            state.refresh()
            beside.append(nearby(state, other)[0].positions)
        for above, below in (solved, beside):
            assert columns[:, :, i] == pytest.approx((above - below) / (2.0 * h), abs=1e-5)


@pytest.mark.parametrize("mu", [0.05, 0.6])
def test_sensitivity_on_a_body_is_that_of_finite_differences(mu):
    start, place, ways = cs.Pose((0.0, 0.0, 0.1), ALONG_X), np.array((0.4, 0.02, 0.15)), np.arange(0.0, 0.05, 0.005)

    def scene(eye=place, height=-0.02):
        floor = cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, height)))
        return eyelet(mu, eye, obstacles=[floor], contact="solve")

    def led_to(last):
        """The predictor after all steps, or where the last one was another one."""
        predictor = cs.Predictor(CABLE, scene=scene(), model="cosserat", points=121, tolerance=1e-8)
        for x in ways if last is None else ways[:-1]:
            shape = predictor.predict(start, at(x, 0.0, 0.1))
        if last is not None:
            predictor.scene = last[0]
            shape = predictor.predict(start, last[1])
        return predictor, shape

    predictor, shape = led_to(None)
    assert shape.contacts
    columns = predictor.sensitivity(("end", "clip:e", "body:floor"))
    h, end = 1e-5, np.array((ways[-1], 0.0, 0.1))
    for axis in range(3):
        d = h * np.eye(3)[axis]
        asked = {
            axis: [(scene(), at(*(end + sign * d))) for sign in (1.0, -1.0)],
            6 + axis: [(scene(place + sign * d), at(*end)) for sign in (1.0, -1.0)],
            12 + axis: [(scene(height=-0.02 + sign * d[2]), at(*end)) for sign in (1.0, -1.0)],
        }
        for column, lasts in asked.items():
            above, below = (led_to(last)[1].positions for last in lasts)
            assert columns[:, :, column] == pytest.approx((above - below) / (2.0 * h), abs=5e-4)
