"""Several cables calibrated at once, from looks in which they lie on each other."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.calibration.cables_forward import CablesForward
from cable_shape.calibration.cables_parameters import CablesParameters
from cable_shape.calibration.parameters import Parameters
from cable_shape.errors import ArgumentError, UnknownKeyError

TRUE = {
    "under": cs.Cable(1.0, 0.05, 0.02, 0.016, diameter=0.008),
    "over": cs.Cable(0.9, 0.08, 0.01, 0.008, diameter=0.01),
}
SOLVED = cs.Scene(contact="solve")
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
Ends = dict[str, tuple[cs.Pose, cs.Pose]]


def pair(heading: float, height: float, chord: float, aside: float = 0.0) -> tuple[cs.Pose, cs.Pose]:
    turn = Rotation.from_euler("z", heading, degrees=True)
    half = turn.apply((0.5 * chord, 0.0, 0.0))
    q, middle = (turn * ALONG_X).as_quat(), np.array((0.02 + aside, 0.01, height))
    return cs.Pose(middle - half, q), cs.Pose(middle + half, q)


@cache
def reports() -> tuple[tuple[Ends, dict[str, cs.CableShape]], ...]:
    """The one let down across the other, in three places: where they are held, and their shapes."""
    out = []
    for k, aside in enumerate((-0.05, 0.0, 0.08)):
        cycle = cs.Cycle(TRUE, scene=SOLVED, model="cosserat", tolerance=1e-6)
        for i, height in enumerate(np.linspace(0.12, -0.08, 41)):
            grips = {"under": pair(0.0, 0.0, 0.7), "over": pair(70.0 + 5.0 * k, float(height), 0.6, aside)}
            report = cycle.step(grips, i * 10**9)
        assert [c.body for c in report.shapes["under"].contacts] == ["over"]
        assert all(shape.status is cs.Status.OK for shape in report.shapes.values())
        out.append((grips, report.shapes))
    return tuple(out)


def looks(noise: float = 1e-4, arcs: bool = True, every: int = 6) -> list[dict[str, cs.Observation]]:
    """Points on both, which scatter."""
    rng, out = np.random.default_rng(7), []
    for grips, shapes in reports():
        look = {}
        for name, shape in shapes.items():
            points = shape.positions[every:-every:every]
            arc = shape.arc_length[every:-every:every] if arcs else None
            look[name] = cs.Observation(*grips[name], points + noise * rng.normal(size=points.shape), arc)
        out.append(look)
    return out


def begin(under: float = 1.3, over: float = 0.7) -> dict[str, cs.Cable]:
    """Cables of other stiffnesses, in the same ratio of bending to twisting."""
    return {
        name: cable.replace(
            bending_stiffness=factor * cable.mean_bending_stiffness,
            twisting_stiffness=factor * cable.twisting_stiffness,
        )
        for (name, cable), factor in zip(TRUE.items(), (under, over), strict=True)
    }


def test_the_stiffness_of_each_is_found() -> None:
    found = cs.calibrate(looks(), begin(), "bending_stiffness:each", scene=SOLVED, progress=False)
    assert isinstance(found, cs.CablesCalibration)
    assert found.converged
    assert not found.trouble
    for name, cable in TRUE.items():
        told = found[f"bending_stiffness:{name}"]
        assert told.value == pytest.approx(cable.mean_bending_stiffness, rel=0.02)
        assert found.cables[name].mean_bending_stiffness == told.value
    assert found.scale == pytest.approx(1e-4, rel=0.2)
    assert found.files["over"].cable is found.cables["over"]
    assert "EI / weight of over" in found.report()
    assert set(found.as_dict()["cables"]) == set(TRUE)


def test_as_if_they_did_not_touch_it_would_be_another_one() -> None:
    """What one does to the other is in the answer: without it the stiffnesses are off by far more."""
    apart = cs.calibrate(looks(), begin(), "bending_stiffness:each", progress=False)
    off = [
        abs(math.log(apart.cables[name].mean_bending_stiffness / cable.mean_bending_stiffness))
        for name, cable in TRUE.items()
    ]
    assert max(off) > 0.2


def test_both_may_share_a_number() -> None:
    """The same factor of stiffness on both, and lengths in their ratio."""
    same = begin(1.3, 1.3)
    found = cs.calibrate(looks(), same, "bending_stiffness", scene=SOLVED, progress=False)
    assert [e.name for e in found.estimates] == ["bending_stiffness"]
    for name, cable in TRUE.items():
        assert found.cables[name].mean_bending_stiffness == pytest.approx(cable.mean_bending_stiffness, rel=0.02)
    longer = {name: cable.replace(length=1.01 * cable.length) for name, cable in TRUE.items()}
    for fit in ("length", "length:under+over"):
        found = cs.calibrate(looks(), longer, fit, scene=SOLVED, progress=False)
        for name, cable in TRUE.items():
            assert found.cables[name].length == pytest.approx(cable.length, abs=5e-4)


def test_derivatives_are_differences_of_one_by_the_other_too() -> None:
    fit = ("bending_stiffness:each", "length:under", "end_offset:over", "roll:under")
    parameters = CablesParameters(TRUE, fit)
    seen = looks(0.0)[:1]
    forward = CablesForward(parameters, seen, scene=SOLVED)
    at = parameters.start
    derivatives = forward.jacobian(at, forward.misses(at))
    assert forward.shapes(at)[0]["under"].contacts
    split = len(seen[0]["under"].points)
    for j, parameter in enumerate(parameters.each):
        step = np.zeros_like(at)
        step[j] = 0.1 * parameter.step
        wanted = (forward.misses(at + step) - forward.misses(at - step)) / (2.0 * step[j])
        for part in (slice(None, split), slice(split, None)):
            size = float(np.abs(wanted[part]).max())
            assert size > 0.0
            np.testing.assert_allclose(derivatives[part, :, j], wanted[part], rtol=0.0, atol=0.04 * size + 1e-6)


def test_one_that_is_alone_is_what_it_is_of_one_cable() -> None:
    """Its misses and derivatives, whichever way they are asked for."""
    seen, cable = [look["under"] for look in looks()], TRUE["under"]
    fit = ("bending_stiffness", "length")
    alone = CablesForward(CablesParameters.alone("cable", Parameters(cable, fit)), [{"cable": o} for o in seen])
    named = CablesForward(CablesParameters({"a": cable}, fit), [{"a": o} for o in seen])
    at = alone.parameters.start
    np.testing.assert_array_equal(at, named.parameters.start)
    np.testing.assert_array_equal(alone.misses(at), named.misses(at))
    np.testing.assert_array_equal(alone.jacobian(at, alone.misses(at)), named.jacobian(at, named.misses(at)))


def test_cables_that_do_not_touch_are_found_as_each_by_itself() -> None:
    rng, seen = np.random.default_rng(3), []
    for chord in (0.5, 0.6, 0.7):
        look = {}
        for name, ends in (("under", pair(0.0, 0.0, chord)), ("over", pair(70.0, 0.6, 0.9 * chord))):
            shape = cs.predict(TRUE[name], *ends, model="cosserat")
            points = shape.positions[6:-6:6] + 1e-4 * rng.normal(size=shape.positions[6:-6:6].shape)
            look[name] = cs.Observation(*ends, points, shape.arc_length[6:-6:6])
        seen.append(look)
    together = cs.calibrate(seen, begin(), "bending_stiffness:each", scene=SOLVED, progress=False)
    for name, cable in begin().items():
        alone = cs.calibrate([look[name] for look in seen], cable, progress=False)
        own = together[f"bending_stiffness:{name}"]
        assert own.value == pytest.approx(alone.cable.mean_bending_stiffness, rel=1e-3)
        assert own.relative == pytest.approx(alone["bending_stiffness"].relative, rel=0.5)


def test_how_they_lie_over_each_other_is_what_the_points_say() -> None:
    """From nothing the one would hang below: the points have it on top."""
    grips, _ = reports()[1]
    deep = {**grips, "over": pair(75.0, -0.2, 0.6)}
    cycle = cs.Cycle(TRUE, scene=SOLVED, model="cosserat", tolerance=1e-6)
    for i, height in enumerate(np.linspace(0.12, -0.2, 65)):
        report = cycle.step({**grips, "over": pair(75.0, float(height), 0.6)}, i * 10**9)
    seen = {
        name: cs.Observation(*deep[name], shape.positions[6:-6:6], shape.arc_length[6:-6:6])
        for name, shape in report.shapes.items()
    }
    assert report.shapes["under"].contacts
    fresh = cs.Cycle(TRUE, scene=SOLVED, model="cosserat").step(deep, 0)
    assert not fresh.shapes["under"].contacts
    assert np.abs(fresh.shapes["over"].positions - report.shapes["over"].positions).max() > 0.02
    found = cs.calibrate([seen], begin(), "bending_stiffness:each", scene=SOLVED, progress=False)
    for name, cable in TRUE.items():
        assert found.cables[name].mean_bending_stiffness == pytest.approx(cable.mean_bending_stiffness, rel=0.02)


def test_cables_that_cross_on_a_table_are_found() -> None:
    """On it one of them bows to a side, and lies on the other."""
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.2)))
    scene = cs.Scene(obstacles=[table], contact="solve")
    cycle = cs.Cycle(TRUE, scene=scene, model="cosserat", tolerance=1e-6)
    for i, height in enumerate(np.linspace(0.12, -0.1, 45)):
        grips = {"under": pair(0.0, 0.0, 0.7), "over": pair(75.0, float(height), 0.6, 0.03)}
        shapes = cycle.step(grips, i * 10**9).shapes
    rng = np.random.default_rng(4)
    look = {}
    for name, shape in shapes.items():
        assert "table" in {contact.body for contact in shape.contacts}
        points = shape.positions[6:-6:6] + 1e-4 * rng.normal(size=shape.positions[6:-6:6].shape)
        look[name] = cs.Observation(*grips[name], points, shape.arc_length[6:-6:6])
    found = cs.calibrate([look], begin(), "bending_stiffness:each", scene=scene, progress=False)
    assert found.converged
    assert found.scale == pytest.approx(1e-4, rel=0.3)
    for name, cable in TRUE.items():
        assert found.cables[name].mean_bending_stiffness == pytest.approx(cable.mean_bending_stiffness, rel=0.03)


def test_what_does_not_tell_how_they_lie_is_refused() -> None:
    look = looks()[0]
    untold = {**look, "over": looks(arcs=False)[0]["over"]}
    with pytest.raises(
        ArgumentError, match=r"observations\[1\]\['over'\]\.arc_length.*8 points at least.*Give the arc"
    ):
        cs.calibrate([look, untold], begin(), scene=SOLVED, progress=False)


def test_names_say_what_is_fitted_of_which() -> None:
    one = CablesParameters(TRUE, ("length", "bending_stiffness:under", "roll:each"), {"length": 0.01, "roll:over": 0.1})
    assert one.names == ("length", "bending_stiffness:under", "roll:under", "roll:over")
    assert [p.name for p in one.each] == list(one.names)
    assert np.diag(one.precision).tolist() == pytest.approx([1e4, 0.0, 0.0, 100.0])
    step = np.array((0.01, math.log(2.0), 0.0, 0.2))
    made = one.make(one.start + step)
    assert made["under"].length == pytest.approx(1.01)
    assert made["over"].length == pytest.approx(0.909)
    assert made["under"].mean_bending_stiffness == pytest.approx(0.04)
    assert made["over"].mean_bending_stiffness == pytest.approx(0.01)
    assert one.offset("under", one.start + step, "end") is None
    assert one.offset("over", one.start + step, "end") is not None
    alone = CablesParameters(TRUE, "bending_stiffness:over")
    assert alone.make(alone.start)["under"] is TRUE["under"]
    assert alone.offset("under", alone.start, "start") is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"observations": [{"under": None}]}, r"observations\[0\].*'over' is missing.*Write"),
        ({"observations": [{"under": 1, "over": 2}]}, r"observations\[0\]\['under'\].*Observation"),
        ({"observations": []}, "0 items.*one at least"),
        ({"cable": {**TRUE, "h": cs.Harness(TRUE)}}, r"cables\['h'\] = Harness.*must be a Cable.*calibrated by itself"),
        ({"observations": {}}, "list of mappings"),
        ({"fit": "stiffness"}, "stiffness.*bending_stiffness"),
        ({"fit": "length:top"}, "top"),
        ({"fit": "length:under+under"}, "twice"),
        ({"fit": ("length", "length:under")}, "length of 'under' is fitted twice"),
        ({"fit": ()}, "name something"),
        ({"priors": {"width": 0.1}}, "width"),
        ({"supports": "auto"}, "whole number"),
        ({"optional": "length"}, "optional.*several"),
        ({"clips": {"top": []}}, "top"),
        ({"proceed": 1}, "function"),
        ({"cable": {"under": 1, "over": 2}}, r"cables\['under'\]"),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"observations": looks(), "cable": begin(), "progress": False, **changes}
    with pytest.raises((ArgumentError, UnknownKeyError), match=words):
        cs.calibrate(given.pop("observations"), given.pop("cable"), **given)


def test_a_look_is_of_one_group_and_one_plane() -> None:
    look = looks()[0]
    under, over = look["under"], look["over"]
    other = cs.Observation(over.start, over.end, over.points, over.arc_length, group=3)
    with pytest.raises(ArgumentError, match=r"observations\[0\]: group.*the same"):
        cs.calibrate([{"under": under, "over": other}], begin(), progress=False)
    with pytest.raises(ArgumentError, match=r"clips.*several"):
        cs.calibrate([under], TRUE["under"], clips={"under": []}, progress=False)
