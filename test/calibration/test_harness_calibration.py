"""Calibrating harnesses: known numbers found again, misses, corrected grips, bad input."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.calibration import harness_forward
from cable_shape.calibration.harness_forward import HarnessForward, missed
from cable_shape.calibration.harness_parameters import HarnessParameters
from cable_shape.solve import harness_search
from cable_shape.solve.touching import harness_solve

ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
TRUNK = cs.Cable(length=0.4, linear_density=0.05, bending_stiffness=0.002)
BRANCH = cs.Cable(length=0.25, linear_density=0.04, bending_stiffness=0.0008, rest_curvature=(1.0, 0.0, 0.0))
ENDS = {"t.start": cs.Pose((0.0, 0.0, 1.0), ALONG), "u.end": cs.Pose((0.6, 0.05, 1.0), ALONG)}


def aside(angle: float) -> cs.Pose:
    """A frame turned about d1."""
    return cs.Pose(quaternion=(math.sin(0.5 * angle), 0.0, 0.0, math.cos(0.5 * angle)))


def harness(trunk: cs.Cable = TRUNK, branch: cs.Cable = BRANCH, angle: float = 1.2) -> cs.Harness:
    """A trunk of two segments and a branch between them."""
    fork = cs.Junction("fork", ("t.end", "u.start", "b.start"), frames={"b.start": aside(angle)})
    return cs.Harness({"t": trunk, "u": trunk, "b": branch}, [fork])


def stiffer(true: cs.Harness) -> cs.Harness:
    """The same twice as stiff."""
    return true.replace(
        {
            name: cable.replace(bending_stiffness=2.0 * cable.mean_bending_stiffness, twisting_stiffness=None)
            for name, cable in true.segments.items()
        }
    )


def seen(
    true: cs.Harness, rng: np.random.Generator, count: int = 6, noise: float = 2e-4, kind: str = "clamped"
) -> list[cs.HarnessObservation]:
    """Points of a harness between ends that vary."""
    out = []
    for _ in range(count):
        far = cs.Pose((0.6, 0.05, 1.0) + 0.06 * rng.normal(size=3), ALONG)
        ends = {"t.start": cs.Grip(ENDS["t.start"], kind), "u.end": cs.Grip(far, kind)}
        shape = cs.predict(true, ends)
        assert shape.status is cs.Status.OK
        trunk = [shape.segments[name].positions[5::18] for name in ("t", "u")]
        points = {"t+u": np.concatenate(trunk), "b": shape.segments["b"].positions[5::18]}
        told = {key: x + noise * rng.normal(size=x.shape) for key, x in points.items()}
        out.append(cs.HarnessObservation(ends, told))
    return out


def test_stiffnesses_weights_and_frames_are_found_again() -> None:
    true = harness()
    begin = harness(
        TRUNK.replace(bending_stiffness=0.004, twisting_stiffness=None),
        BRANCH.replace(bending_stiffness=0.0004, linear_density=0.06, twisting_stiffness=None),
        angle=1.0,
    )
    fit = ("bending_stiffness:t+u", "bending_stiffness:b", "linear_density:b", "frames", "rest_curvature:b")
    found = cs.calibrate(
        begin, seen(true, np.random.default_rng(0), 12), fit, priors={"rest_curvature:b": 2.0, "tilt": 0.3}
    )
    assert found.converged
    assert not found.trouble
    truth = {
        "bending_stiffness:t+u": 0.002, "bending_stiffness:b": 0.0008, "linear_density:b": 0.04,
        "tilt_1:b.start": 0.2, "tilt_2:b.start": 0.0, "tilt_1:u.start": 0.0, "tilt_2:u.start": 0.0,
    }  # fmt: skip
    for name, value in truth.items():
        assert abs(found[name].value - value) <= 4.0 * found[name].standard_error, name
    assert found["bending_stiffness:t+u"].relative < 0.1
    assert 1e-4 < found.scale < 3e-4
    assert found.harness.segments["u"].mean_bending_stiffness == pytest.approx(found["bending_stiffness:t+u"].value)


def test_one_stiffness_for_all_keeps_their_ratio_and_either_order_will_do() -> None:
    true = harness()
    looks = seen(true, np.random.default_rng(1))
    begin = stiffer(true)
    found = cs.calibrate(begin, looks)
    again = cs.calibrate(looks, begin)
    assert found.values == pytest.approx(again.values)
    for name, cable in true.segments.items():
        made = found.harness.segments[name]
        assert made.mean_bending_stiffness == pytest.approx(cable.mean_bending_stiffness, rel=0.05)
        assert made.twisting_stiffness == pytest.approx(cable.twisting_stiffness, rel=0.05)


def test_tilts_and_offsets_of_grips_are_found_and_held_says_them() -> None:
    true, rng = harness(), np.random.default_rng(2)
    beside = cs.Pose((0.003, -0.002, 0.0), (math.sin(0.05), 0.0, 0.0, math.cos(0.05)))
    looks = []
    for look in seen(true, rng):
        moved = dict(look.ends)
        moved["t.start"] = cs.Grip(look.ends["t.start"].pose * beside.inverse())
        looks.append(cs.HarnessObservation(moved, look.points))
    found = cs.calibrate(true, looks, ("tilt:t.start", "offset:t.start"))
    assert found["tilt_1:t.start"].value == pytest.approx(0.1, abs=5e-3)
    assert found["offset_x:t.start"].value == pytest.approx(0.003, abs=3e-4)
    held = found.held(looks[0].ends)
    assert held["t.start"].cable_frame.distance(ENDS["t.start"])[0] < 5e-4
    assert held["u.end"] is looks[0].ends["u.end"]
    assert max(np.nanmax(x) for x in found.distances_to(looks[0]).values()) < 1.5e-3


def test_lengths_of_an_observation_are_its_own() -> None:
    true, rng = harness(), np.random.default_rng(3)
    longer = true.replace({name: cable.replace(length=cable.length + 0.01) for name, cable in true.segments.items()})
    told = {name: cable.length for name, cable in longer.segments.items()}
    looks = [cs.HarnessObservation(o.ends, o.points, lengths=told) for o in seen(longer, rng)] + seen(true, rng)
    found = cs.calibrate(true.replace(), looks, ("bending_stiffness", "length:t+u"))
    assert found["length:t+u"].value == pytest.approx(0.8, abs=1e-3)
    assert np.nanmean(found.distances) < 5e-4
    assert found.predict(looks[0]).segments["t"].length == pytest.approx(0.41, abs=1e-3)


def test_points_on_several_segments_are_on_the_nearest_or_at_their_arc_length() -> None:
    shape = cs.predict(harness(), ENDS)
    t, u = shape.segments["t"].positions, shape.segments["u"].positions
    points = {"t + u": np.array((t[30], u[0], u[100]))}
    look = cs.HarnessObservation(ENDS, points)
    assert np.abs(missed(look, shape)).max() < 1e-8
    where = 0.4 * np.array((30 / 149, 1.0, 1.0 + 100 / 149))
    known = cs.HarnessObservation(ENDS, points, {"t + u": where})
    assert np.abs(missed(known, shape)).max() < 1e-8
    assert np.abs(missed(cs.HarnessObservation(ENDS, points, {"t + u": where[::-1].copy()}), shape)).max() > 0.1


def test_rolls_of_grips_are_found_again() -> None:
    true, rolls = harness(), {"t.start": 0.4, "u.end": -0.3}
    looks = []
    for look in seen(true, np.random.default_rng(7), 4):
        ends = {}
        for end, grip in look.ends.items():
            assert isinstance(grip, cs.Grip)
            half = 0.5 * rolls[end]
            back = cs.Pose(quaternion=(0.0, 0.0, -math.sin(half), math.cos(half)))
            ends[end] = cs.Grip(grip.pose, "clamped", back)
        looks.append(cs.HarnessObservation(ends, look.points))
    found = cs.calibrate(true, looks, ("bending_stiffness", *(f"roll:{end}" for end in rolls)))
    for end, roll in rolls.items():
        assert found[f"roll:{end}"].value == pytest.approx(roll, abs=0.01)
    held = found.held(looks[0].ends)["u.end"]
    assert isinstance(held, cs.Grip)
    assert held.cable_frame.quaternion == pytest.approx(ALONG, abs=0.01)


ALL_KINDS = (
    "bending_stiffness:t", "bending_stiffness:u+b", "twisting_stiffness:t", "linear_density:each", "length:each",
    "rest_curvature:t+u", "rest_curvature:b", "tilt:b.start", "roll:b.start", "tilt:u.start", "tilt:t.start",
    "roll:t.start", "offset:u.end", "tilt:u.end",
)  # fmt: skip
SWING = {"t": (0.0, 3.0, 0.0), "b": ((0.0, 3.0, 0.0), (1.0, 0.0, 2.0))}


def alike(true: cs.Harness, kind: str) -> list[cs.HarnessObservation]:
    """Observations of every sort: held in clips here and there, with masses, arc lengths, lengths and accelerations."""
    first, second = seen(true, np.random.default_rng(4), 2, noise=2e-3, kind=kind)
    ball, other = (cs.Clip(0.2, cs.Pose((0.18, y, 0.96)), "ball", segment="t") for y in (0.0, 0.02))
    masses = [cs.PointMass(0.1, 0.01, segment="b")]
    eyelet = cs.Clip(0.22, cs.Pose((0.2, 0.01, 0.95)), "slide", segment="t")
    arcs = {"t+u": np.linspace(0.02, 0.75, len(first.points["t+u"])), "b": np.full(len(first.points["b"]), 0.2)}
    # the branch's tip touches it: of what lies along it points begin and cease to touch between two shapes
    lying = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, 0.7)))], contact="solve")
    return [
        first,
        cs.HarnessObservation(second.ends, second.points, arcs, lengths={"b": 0.26, "t": 0.41}),
        cs.HarnessObservation(first.ends, first.points, acceleration=SWING),
        cs.HarnessObservation(first.ends, first.points, arcs, scene=cs.Scene(clips=[ball], masses=masses)),
        cs.HarnessObservation(first.ends, first.points, arcs, SWING, scene=cs.Scene(clips=[other], masses=masses)),
        cs.HarnessObservation(first.ends, first.points, arcs, scene=cs.Scene(clips=[eyelet])),
        *([cs.HarnessObservation(first.ends, first.points, scene=lying)] if kind == "clamped" else []),
    ]


@pytest.mark.parametrize("kind", ["clamped", "swivel"])
def test_derivatives_are_those_of_shapes_on_both_sides(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(harness_forward, "TOLERANCE", 1e-8)
    monkeypatch.setattr(harness_forward, "POINTS", 161)
    monkeypatch.setattr(harness_forward, "NOISE", -1.0)
    parameters = HarnessParameters(harness(), ALL_KINDS)
    steps = np.array([parameter.step for parameter in parameters.each])
    values = parameters.start + 3.0 * steps * np.random.default_rng(6).normal(size=steps.size)
    for look in alike(harness(), kind):
        forward = HarnessForward(parameters, [look])
        now = forward.misses(values)
        assert np.isfinite(now).all()
        J = forward.jacobian(values, now)
        for j, parameter in enumerate(parameters.each):
            step = 0.1 * steps * (np.arange(steps.size) == j)
            moved = (forward.misses(values + step) - forward.misses(values - step)) / (0.2 * steps[j])
            off, size = (float(np.sqrt((x * x).mean())) for x in (J[:, :, j] - moved, moved))
            assert off < 5e-3 * (size + 1e-3), parameter.name


def test_looks_that_are_fitted_together_are_derived_as_each_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(harness_forward, "NOISE", -1.0)
    looks = alike(harness(), "clamped")
    parameters = HarnessParameters(harness(), ALL_KINDS)
    together = HarnessForward(parameters, looks)
    J = together.jacobian(parameters.start, together.misses(parameters.start))
    for look in looks:
        alone = HarnessForward(parameters, [look])
        own = alone.jacobian(parameters.start, alone.misses(parameters.start))
        np.testing.assert_allclose(J[: len(own)], own, rtol=0.0, atol=1e-5 * np.abs(own).max())
        J = J[len(own) :]


def test_derivatives_solve_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    true = harness()
    forward = HarnessForward(HarnessParameters(true, ALL_KINDS), alike(true, "clamped"))
    start = forward.parameters.start
    now = forward.misses(start)
    monkeypatch.setattr(harness_search, "solve", None)
    monkeypatch.setattr(harness_solve, "solve", None)
    assert np.abs(forward.jacobian(start, now)).max() > 0.0


def test_shapes_from_nothing_are_solved_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    forward = HarnessForward(HarnessParameters(harness(), "bending_stiffness"), alike(harness(), "clamped")[:4])
    start = forward.parameters.start
    first = forward.afresh(start)
    with monkeypatch.context() as patch:
        patch.setattr(harness_search, "solve", None)
        np.testing.assert_array_equal(forward.afresh(start), first)
    followed = forward.misses(start + 0.3)
    np.testing.assert_allclose(forward.afresh(start + 0.3), followed, rtol=0.0, atol=1e-4)


def test_accelerations_and_clips_of_observations_count() -> None:
    true, swing = harness(), {"t": (0.0, 3.0, 0.0), "u": (0.0, 3.0, 0.0), "b": (0.0, 3.0, 0.0)}
    clip = cs.Scene(clips=[cs.Clip(0.2, cs.Pose((0.18, 0.0, 0.96)), "ball", segment="t")])
    shape = cs.predict(true, ENDS, acceleration=swing, scene=clip)
    points = {name: one.positions[10::20] for name, one in shape.segments.items()}
    begin = stiffer(true)
    found = cs.calibrate(begin, [cs.HarnessObservation(ENDS, points, acceleration=swing, scene=clip)])
    assert found["bending_stiffness"].value == pytest.approx(0.002, rel=1e-2)
    still = cs.calibrate(begin, [cs.HarnessObservation(ENDS, points)])
    assert np.nanmean(still.distances) > 20.0 * np.nanmean(found.distances)


def test_a_calibration_is_told_in_words_in_json_and_in_a_file_that_is_read_again(tmp_path: Path) -> None:
    found = cs.calibrate(
        harness(), seen(harness(), np.random.default_rng(5), 3), ("bending_stiffness:each", "roll:t.start")
    )
    assert "EI / weight of b" in found.report()
    assert json.loads(json.dumps(found.as_dict()))["estimates"]["bending_stiffness:u"]["unit"] == "N m^2"
    read = cs.Harness.from_yaml(found.save(tmp_path / "harness.yaml"))
    assert read.segments["b"].mean_bending_stiffness == pytest.approx(found["bending_stiffness:b"].value)
    with pytest.raises(cs.UnknownKeyError, match="bending_stiffness:u"):
        found["bending_stiffness:v"]


@pytest.mark.parametrize(
    ("fit", "said"),
    [
        ("stiffness", "Did you mean"),
        ("bending_stiffness:x", "unknown key 'x'"),
        ("bending_stiffness:t+t", "names a segment twice"),
        (("bending_stiffness", "bending_stiffness:b"), "bending_stiffness of 'b' is in"),
        ("tilt:x.start", "unknown key 'x.start'"),
        ("offset:b.start", "in the rigid junction 'fork'"),
        ("frames:knot", "unknown key 'knot'"),
        ("rest_curvature", "begin with the same three numbers"),
        ((), "must name something"),
    ],
)
def test_what_cannot_be_fitted_is_refused(fit: str | tuple[str, ...], said: str) -> None:
    with pytest.raises(cs.ArgumentError, match=said):
        HarnessParameters(harness(), fit)


def test_wrong_observations_are_refused() -> None:
    points = {"b": np.zeros((2, 3))}
    for arguments, said in (
        ({"points": {"b": np.zeros(3)}}, r"must be \(m, 3\)"),
        ({"points": {"b": np.full((2, 3), np.nan)}}, "one point at least"),
        ({"points": points, "arc_length": {"b": [0.1]}}, r"must be \(2,\)"),
        ({"points": points, "arc_length": {"b": [-0.1, 0.0]}}, "at least 0 m"),
        ({"points": points, "lengths": {"b": 0.0}}, "above 0"),
        ({"points": points, "group": -1}, "at least 0"),
        ({"points": points, "scene": 1}, "must be a Scene"),
    ):
        with pytest.raises(cs.ArgumentError, match=said):
            cs.HarnessObservation(ENDS, **arguments)  # type: ignore[arg-type]
    for look, said in (
        (cs.HarnessObservation(ENDS, {"x": np.zeros((2, 3))}), r"observations\[0\]: points: unknown key 'x'"),
        (cs.HarnessObservation(ENDS, points, lengths={"x": 1.0}), "lengths: unknown key 'x'"),
        (cs.HarnessObservation({"b.start": cs.Pose()}, points), "which holds it"),
        (cs.HarnessObservation({**ENDS, "u.end": cs.Pose((5.0, 0.0, 0.0))}, points), "none has a usable shape"),
    ):
        with pytest.raises(cs.ArgumentError, match=said):
            cs.calibrate(harness(), [look])
    with pytest.raises(cs.ArgumentError, match="one at least"):
        cs.calibrate(harness(), [])
    with pytest.raises(cs.ArgumentError, match="belong to its observations"):
        cs.calibrate(harness(), [cs.HarnessObservation(ENDS, points)], scene=cs.Scene())  # type: ignore[call-overload]
    with pytest.raises(cs.ArgumentError, match="above 0"):
        cs.calibrate(harness(), [cs.HarnessObservation(ENDS, points)], priors={"bending_stiffness": 0.0})
