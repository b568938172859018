"""Several cables predicted together: the same as a cycle, begun from shapes as they were seen, and gone on from."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.errors import ArgumentError
from cable_shape.prediction.cables_predictor import CablesPredictor

CABLE = cs.Cable(1.0, 0.05, 0.01, 0.008, diameter=0.008)
CABLES = {"under": CABLE, "over": CABLE.replace(linear_density=0.08), "far": CABLE}
SOLVED = cs.Scene(contact="solve")
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
Ends = dict[str, tuple[cs.Pose, cs.Pose]]


def pair(heading: float, place: tuple[float, float, float]) -> tuple[cs.Pose, cs.Pose]:
    turn = Rotation.from_euler("z", heading, degrees=True)
    half = turn.apply((0.35, 0.0, 0.0))
    q = (turn * ALONG_X).as_quat()
    return cs.Pose(np.array(place) - half, q), cs.Pose(np.array(place) + half, q)


def ends(height: float, heading: float = 70.0) -> Ends:
    return {
        "under": pair(0.0, (0.0, 0.0, 0.0)),
        "over": pair(heading, (0.02, 0.01, height)),
        "far": pair(0.0, (0.0, 2.0, 0.0)),
    }


def predictor(**options: object) -> CablesPredictor:
    return CablesPredictor(CABLES, scene=SOLVED, model="cosserat", tolerance=1e-6, **options)


def led(low: float = -0.05) -> tuple[CablesPredictor, dict[str, cs.CableShape]]:
    """One let down onto another."""
    made = predictor()
    for height in np.linspace(0.02, low, 21):
        shapes = made.predict(ends(float(height)))
    assert [contact.body for contact in shapes["under"].contacts] == ["over"]
    return made, shapes


def test_it_predicts_what_a_cycle_does() -> None:
    made, cycle = predictor(), cs.Cycle(CABLES, scene=SOLVED, model="cosserat", tolerance=1e-6)
    for k, height in enumerate(np.linspace(0.02, -0.05, 21)):
        shapes, report = made.predict(ends(float(height))), cycle.step(ends(float(height)), k * 10**9)
        for name, shape in shapes.items():
            assert shape.status is report.shapes[name].status
            np.testing.assert_allclose(shape.positions, report.shapes[name].positions, atol=1e-9)
    assert made.touching == {"under", "over"}
    made.reset()
    cycle.reset()
    for name, shape in made.predict(ends(0.0)).items():
        np.testing.assert_array_equal(shape.buffer, cycle.step(ends(0.0), 0).shapes[name].buffer)


def test_begun_from_shapes_that_are_no_equilibrium_they_come_to_rest_as_they_lay() -> None:
    _, shapes = led()
    seen = {}
    for name, shape in shapes.items():
        wave = 1.5e-3 * np.sin(7.0 * np.pi * shape.arc_length / shape.length)
        seen[name] = shape.again()
        seen[name].buffer = shape.buffer.copy()
        seen[name].buffer[shape.points : 4 * shape.points] += (wave[:, None] * (1.0, 1.0, 1.0)).ravel()
        seen[name].touches = seen[name].touches[:0]
    fresh = predictor()
    assert fresh.wound(seen) == {"under", "over"}
    found = fresh.begin(ends(-0.05), seen)
    for name, shape in shapes.items():
        assert found[name].status is cs.Status.OK
        np.testing.assert_allclose(found[name].positions, shape.positions, atol=2e-5)
    assert found["under"].contacts[0].force == pytest.approx(shapes["under"].contacts[0].force, rel=1e-3)
    apart = predictor().predict(ends(-0.05))  # from nothing the one hangs below
    assert np.abs(apart["over"].positions - shapes["over"].positions).max() > 0.01
    later = fresh.predict(ends(-0.055))  # and it goes on from there
    expected = led(-0.055)[1]
    for name, shape in expected.items():
        np.testing.assert_allclose(later[name].positions, shape.positions, atol=2e-5)


def test_shapes_that_touch_nowhere_begin_from_nothing() -> None:
    made = predictor()
    shapes = made.predict(ends(0.1))
    fresh = predictor()
    assert fresh.wound(shapes) == set()
    for name, shape in fresh.begin(ends(0.1), shapes).items():
        np.testing.assert_array_equal(shape.buffer, shapes[name].buffer)


def test_cables_that_were_seen_along_each_other_have_no_shape_and_say_so() -> None:
    made = predictor()
    along = {height: {**ends(height), "over": pair(0.0, (0.02, 0.0, height))} for height in (0.02, 0.006)}
    shapes = made.predict(along[0.02])
    low = {name: shape.again() for name, shape in shapes.items()}
    low["over"].buffer = shapes["over"].buffer.copy()
    low["over"].buffer[150 : 4 * 150].reshape(150, 3)[:, 2] -= 0.014
    found = predictor().begin(along[0.006], low)
    assert found["over"].status is cs.Status.NOT_CONVERGED
    assert "no equilibrium of cables that touch" in found["over"].detail


def test_it_goes_on_with_cables_almost_alike_and_stays_as_it_is() -> None:
    made, shapes = led()
    stiffer = {**CABLES, "under": CABLE.replace(bending_stiffness=0.012, twisting_stiffness=0.0096)}
    beside = made.onto(stiffer)
    found = beside.predict(ends(-0.05))
    again = predictor_of(stiffer)
    for height in np.linspace(0.02, -0.05, 21):
        expected = again.predict(ends(float(height)))
    for name, shape in expected.items():
        np.testing.assert_allclose(found[name].positions, shape.positions, atol=2e-5)
    for name, shape in made.predict(ends(-0.05)).items():
        np.testing.assert_array_equal(shape.buffer, shapes[name].buffer)


def predictor_of(cables: dict[str, cs.Cable]) -> CablesPredictor:
    return CablesPredictor(cables, scene=SOLVED, model="cosserat", tolerance=1e-6)


def test_sensitivities_are_differences_by_the_ends_of_all() -> None:
    """Where cables touch, the grips of the one move the other."""
    made, _ = led()
    told, size = made.sensitivity(), 1e-4
    assert told["under"].shape == (150, 3, 36)
    for column, (name, side) in enumerate((n, s) for n in CABLES for s in (0, 1)):
        moved = []
        for sign in (1.0, -1.0):
            held = ends(-0.05)
            both = list(held[name])
            both[side] = cs.Pose(both[side].position + np.array((0.0, 0.0, sign * size)), both[side].quaternion)
            held[name] = (both[0], both[1])
            moved.append(led()[0].predict(held))
        for cable in CABLES:
            wanted = (moved[0][cable].positions - moved[1][cable].positions) / (2.0 * size)
            np.testing.assert_allclose(told[cable][:, :, 6 * column + 2], wanted, atol=5e-3)
    assert np.abs(told["under"][:, :, 6:18]).max() > 0.1
    assert not told["far"][:, :, :24].any()


def test_without_contact_solved_for_each_is_by_itself() -> None:
    made = CablesPredictor(CABLES, model="cosserat")
    assert not made.solves_crossing
    for name, shape in made.predict(ends(-0.02)).items():
        alone = cs.predict(CABLES[name], *ends(-0.02)[name], model="cosserat")
        np.testing.assert_array_equal(shape.buffer, alone.buffer)
    assert made.touching == set()
    assert made.wound(made.predict(ends(0.0))) == set()


def test_what_is_wrong_is_named() -> None:
    with pytest.raises(ArgumentError, match=r"grips = .*'far' is missing"):
        predictor().predict({name: both for name, both in ends(0.0).items() if name != "far"})
    with pytest.raises(ArgumentError, match=r"grips\['far'\]"):
        predictor().predict({**ends(0.0), "far": pair(0.0, (0.0, 0.0, 0.0))[0]})  # type: ignore[dict-item]
    with pytest.raises(ArgumentError, match=r"acceleration\['far'\]"):
        predictor().predict(ends(0.0), acceleration={"far": (1.0, 2.0)})
    cut = CABLE.replace(sections=[cs.Section(0.2, 0.4, linear_density=0.1)])
    assert CablesPredictor({**CABLES, "far": cut}, scene=SOLVED).predict(ends(0.0))["far"].usable  # once refused
