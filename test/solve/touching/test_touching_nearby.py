"""Shapes of cables almost alike on bodies, from factors alone, against differences of cables that were solved for."""

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.pose import FreeEnd
from cable_shape.solve.answers import sensitivity
from cable_shape.solve.touching.nearby import nearby
from cable_shape.solve.touching.state import TouchState

ALONG = (0.5, 0.5, 0.5, 0.5)
START, END = cs.Pose((0, 0, 1), ALONG), cs.Pose((0.8, 0.05, 0.95), ALONG)
SPHERE = {"name": "ball", "sphere": 0.1, "position": [0.42, 0.01, 0.68]}
TABLE = {"name": "table", "box": [2, 2, 0.1], "position": [0.4, 0, 0.7]}
BAR = {"name": "bar", "capsule": {"radius": 0.05, "length": 0.6}, "position": [0.35, 0, 0.7],
       "quaternion": [0.7071067811865476, 0, 0, 0.7071067811865476]}  # fmt: skip
CLIP = {"name": "mid", "arc_length": 0.3, "position": [0.15, 0.05, 0.83], "kind": "ball"}
#: Steps of differences of solved shapes, of shapes nearby, and of shapes that are each solved for from nothing.
STEP, NEAR, FAR = 1e-4, 1e-6, 1e-3
#: Contacts run along the cable, which the mesh follows and the factors have to first order in its elements: that is how
#: far derivatives may be off differences on the same mesh, of the largest.
RUN = 0.02


def scene_of(body, **more):
    return cs.Scene.from_mapping({"contact": "solve", "obstacles": [body], **more})


def predictor_of(body, cable=None, **scene):
    made = {"length": 1.2, "linear_density": 0.1, "bending_stiffness": (0.02, 0.03), "diameter": 0.01,
            "axial_stiffness": 500.0, **(cable or {})}  # fmt: skip
    return cs.Predictor(cs.Cable(**made), scene=scene_of(body, **scene), points=120, tolerance=1e-6)


def lifted(body, cable=None, end=END, **scene):
    """A predictor whose last shape lies on a body, which came from below."""
    x, y, z = body["position"]
    predictor = predictor_of({**body, "position": [x, y, z - 0.2]}, cable, **scene)
    for height in np.linspace(z - 0.2, z, 21).tolist():
        predictor.scene = scene_of({**body, "position": [x, y, height]}, **scene)
        shape = predictor.predict(START, end)
    assert shape.status is cs.Status.OK
    assert shape.contacts
    return predictor


def parts_of(shape):
    parts = shape.positions, shape.quaternions, shape.curvature, shape.force, shape.moment, shape.supports[:, 1:]
    return [part.copy() for part in parts] + [np.array([shape.energy])]


def beside(predictor, other, start=START, end=END):
    """Derivatives by what `other` makes of x, by shapes nearby; the predictor's last shape is that at x = 0."""
    state = predictor.rod_state
    assert isinstance(state, TouchState)
    state.refresh()
    told = []
    for x in (NEAR, -NEAR):
        a, b = (one(x) if callable(one) else one for one in (start, end))
        told.append(parts_of(nearby(state, other(x).problem.move(a, b))))
    return [(high - low) / (2.0 * NEAR) for high, low in zip(*told, strict=True)]


def differences(shapes, step):
    """The same of solved shapes, extrapolated from two steps."""
    one, two = ([(h - low) / (2.0 * n * step) for h, low in zip(*shapes(n * step), strict=True)] for n in (1.0, 2.0))
    return [(4.0 * a - b) / 3.0 for a, b in zip(one, two, strict=True)]


def near(found, expected, share):
    for i, (a, b) in enumerate(zip(found, expected, strict=True)):
        assert np.abs(a - b).max(initial=0.0) < share * np.abs(b).max(initial=0.0) + 1e-6, i


RING = {"clips": [{**CLIP, "kind": "slide"}]}
MASS = {"masses": [{"arc_length": 0.9, "mass": 0.02}]}
HELD = [(SPHERE, {}), (TABLE, {}), (BAR, {}), (SPHERE, {"clips": [CLIP]}), (TABLE, {"clips": [CLIP]}), (BAR, MASS),
        (TABLE, MASS), (TABLE, RING), (BAR, RING)]  # fmt: skip


@pytest.mark.parametrize(("body", "more"), HELD)
def test_as_an_end_moves(body, more):
    def end(x):
        return cs.Pose((0.8 + x, 0.05 + 0.5 * x, 0.95), ALONG)

    predictor = lifted(body, **more)
    for x in (2.0 * STEP, -2.0 * STEP):  # contacts that come and go on the way have done so
        predictor.predict(START, end(x))
    base = parts_of(predictor.predict(START, END))
    state = predictor.rod_state
    state.refresh()
    again = nearby(state, predictor_of(body, **more).problem.move(START, END))
    for a, b in zip(parts_of(again), base, strict=True):
        assert np.allclose(a, b, atol=1e-9)
    found = beside(predictor, lambda _: predictor_of(body, **more), end=end)
    near(found, differences(lambda x: [parts_of(predictor.predict(START, end(s * x))) for s in (1, -1)], STEP), RUN)


@pytest.mark.parametrize("body", [SPHERE, TABLE, BAR], ids=lambda body: body["name"])
@pytest.mark.parametrize("axis", ["along", "z", "turn"])
def test_as_a_body_moves(body, axis):
    def moved(x):
        place, turn = np.array(body["position"]), cs.Pose((0, 0, 0), body.get("quaternion", (0, 0, 0, 1)))
        if axis == "turn":
            way = np.array((0.6, 0.5, 0.2))
            way *= np.sin(0.5 * x) / np.linalg.norm(way)
            turn = cs.Pose((0, 0, 0), (*way, np.cos(0.5 * x))) * turn
            place[2] += 0.1 * x  # a sphere is none the wiser
        else:
            place += x * np.array((0.0, 0.0, 1.0) if axis == "z" else (0.8, 0.1, 0.3))
        return {**body, "position": place.tolist(), "quaternion": turn.quaternion.tolist()}

    def shape(x):
        predictor.scene = scene_of(moved(x))
        return parts_of(predictor.predict(START, END))

    predictor = lifted(body)
    found = beside(predictor, lambda x: predictor_of(moved(x)))
    near(found, differences(lambda x: [shape(s * x) for s in (1, -1)], STEP), RUN)


SOFT = {"twisting_stiffness": 0.02}
NUMBERS = {
    "length": (lambda x: {"length": 1.2 + x}, 1.0),
    "linear_density": (lambda x: {"linear_density": 0.1 + 0.1 * x}, 0.1),
    "bending_stiffness": (lambda x: {**SOFT, "bending_stiffness": (0.02 + 0.02 * x, 0.03 + 0.03 * x)}, 0.025),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_as_a_number_of_the_cable_changes(name):
    made, rate = NUMBERS[name]
    predictor = predictor_of(SPHERE, made(0.0))
    assert predictor.predict(START, END).contacts
    found = beside(predictor, lambda x: predictor_of(SPHERE, made(x)))
    exact = sensitivity(predictor.rod_state, [name])[:, :, 0] * rate
    assert np.allclose(found[0], exact, atol=1e-4 * np.abs(exact).max())

    def shapes(x):
        return [parts_of(predictor_of(SPHERE, made(s * x)).predict(START, END)) for s in (1, -1)]

    near(found, differences(shapes, FAR), 2e-2)  # each on a mesh of its own


def test_in_a_row_of_contacts_with_a_free_end():
    """Differences are noise there, where contacts come and go; places move as sensitivities have it."""
    end = FreeEnd(force=(0.4, 0.05, 0.1))
    table = {**TABLE, "position": [0.4, 0, 0.9]}
    predictor = predictor_of(table)
    assert len(predictor.predict(START, end).contacts) > 10
    columns = predictor.sensitivity(["start", "length"])
    found = beside(predictor, lambda _: predictor_of(table), lambda x: cs.Pose((0, x, 1 + x), ALONG), end)
    assert np.allclose(found[0], columns[:, :, 1] + columns[:, :, 2], atol=1e-3)
    found = beside(predictor, lambda x: predictor_of(table, {"length": 1.2 + x}), end=end)
    assert np.allclose(found[0], columns[:, :, 6], atol=1e-3)


def test_what_is_another_problem_has_none():
    predictor = predictor_of(SPHERE)
    predictor.predict(START, END)
    state = predictor.rod_state
    state.refresh()
    for other in (
        predictor_of({**SPHERE, "sphere": 0.11}),
        predictor_of({**SPHERE, "name": "other"}),
        predictor_of(SPHERE, {"diameter": 0.011}),
        predictor_of(SPHERE, clips=[CLIP]),
    ):
        assert nearby(state, other.problem.move(START, END)) is None
