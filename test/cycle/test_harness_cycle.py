"""Tubes, stability and snaps of harnesses in cycles, against those of one cable."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rods import arch_ends, arch_predictor

import cable_shape as cs
from cable_shape.safety.report import WarningKind
from cable_shape.uncertainty.harness_tube_watch import HarnessTubeWatch

ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.02, twisting_stiffness=0.015)
START, END = cs.Pose((0.0, 0.0, 0.0), ALONG), cs.Pose((0.8, 0.1, 0.05), ALONG)
FLOOR = cs.Scene(obstacles=[cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.5)))], warn_distance=0.5)
POINTS = 101


def halves(cable: cs.Cable = CABLE, share: float = 0.4) -> cs.Harness:
    """The same cable in two segments."""
    a, b = cable.replace(length=share * cable.length), cable.replace(length=(1.0 - share) * cable.length)
    return cs.Harness({"a": a, "b": b}, [cs.Junction("j", ("a.end", "b.start"))])


def both(cable: cs.Cable, harness: cs.Harness, **options: object) -> tuple[cs.Cycle, cs.Cycle]:
    return cs.Cycle(cable, points=POINTS, **options), cs.Cycle({"h": harness}, points=POINTS, **options)  # type: ignore[arg-type]


def at_cable(tube: cs.Tube, arc: np.ndarray) -> np.ndarray:
    """(n, 3, 3) of the cable's tube, between its points."""
    flat = tube.covariance.reshape(len(tube.covariance), 9)
    return np.stack([np.interp(arc, tube.shape.arc_length, x) for x in flat.T], axis=1).reshape(-1, 3, 3)


@pytest.mark.parametrize(
    "known",
    [
        cs.Uncertainty({"bending_stiffness": 0.2}),
        cs.Uncertainty({}, (0.002, 0.01), (0.001, 0.02)),
        cs.Uncertainty({"bending_stiffness": 0.1}, (0.001, 0.0), misses=0.003, confidence=0.8),
    ],
)
def test_the_tube_of_two_segments_is_that_of_one_cable(known: cs.Uncertainty) -> None:
    single, several = both(CABLE, halves(), uncertainty=known, scene=FLOOR)
    one = single.step({"cable": (START, END)}, 0)
    two = several.step({"h": {"a.start": START, "b.end": END}}, 0)
    assert set(two.tubes) == {"h/a", "h/b"}
    size = np.abs(one.tubes["cable"].covariance).max()
    for name, first in (("h/a", 0.0), ("h/b", 0.4)):
        tube = two.tubes[name]
        expected = at_cable(one.tubes["cable"], tube.shape.arc_length + first)
        np.testing.assert_allclose(tube.covariance, expected, atol=2e-3 * size)
        assert tube.confidence == known.confidence
    nearest = min(two.clearance[name].closest.distance for name in ("h/a", "h/b"))
    assert nearest == pytest.approx(one.clearance["cable"].closest.distance, abs=1e-4)
    assert two.clearance["h/a"].confidence == known.confidence


def test_what_is_known_of_each_segment_adds_up() -> None:
    ends = {"a.start": START, "b.end": END}
    told = cs.Uncertainty({"bending_stiffness:each": 0.2})
    alone = [cs.Uncertainty({f"bending_stiffness:{name}": 0.2}) for name in "ab"]
    found = [cs.Cycle({"h": halves()}, uncertainty=one).step({"h": ends}, 0).tubes for one in (told, *alone)]
    for name in ("h/a", "h/b"):
        together = found[1][name].covariance + found[2][name].covariance
        np.testing.assert_allclose(found[0][name].covariance, together, atol=1e-12)
        assert found[1][name].radius.max() > 1e-4
    with pytest.raises(cs.ArgumentError, match=r"names of a harness"):
        cs.Cycle(CABLE, uncertainty=told)
    with pytest.raises(cs.ArgumentError, match="Known keys"):
        cs.Uncertainty({"stiffness:each": 0.2})
    again = cs.Uncertainty.from_mapping(told.as_dict())
    assert again.spread == told.spread


def test_bundles_say_themselves_how_stiff_they_may_be() -> None:
    bundle = CABLE.replace(stiffness_interval=(0.02, 0.06))
    told = cs.Uncertainty({"bending_stiffness": bundle.stiffness_spread})
    ends = {"cable": (START, END)}
    itself = cs.Cycle(bundle, uncertainty=cs.Uncertainty()).step(ends, 0).tubes["cable"]
    by_name = cs.Cycle(CABLE, uncertainty=told).step(ends, 0).tubes["cable"]
    np.testing.assert_allclose(itself.covariance, by_name.covariance, atol=1e-15)
    assert itself.radius.max() > 1e-3
    over = cs.Cycle(bundle, uncertainty=cs.Uncertainty({"bending_stiffness": 1e-6})).step(ends, 0).tubes["cable"]
    assert over.radius.max() < 1e-5
    held = {"h": {"a.start": START, "b.end": END}}
    each = cs.Cycle({"h": halves(bundle)}, uncertainty=cs.Uncertainty()).step(held, 0).tubes
    named = cs.Uncertainty({"bending_stiffness:each": bundle.stiffness_spread})
    same = cs.Cycle({"h": halves()}, uncertainty=named).step(held, 0).tubes
    np.testing.assert_allclose(each["h/b"].covariance, same["h/b"].covariance, atol=1e-15)
    table = predict_radius(bundle)
    np.testing.assert_allclose(table, itself.radius, rtol=0.15, atol=1e-5)


def predict_radius(cable: cs.Cable) -> np.ndarray:
    """(n,) [m], of a batch's tube: to first order in EI."""
    batch = cs.predict_batch(
        cable, START.array[None], END.array[None], uncertainty=cs.Uncertainty({"bending_stiffness": 1e-3})
    )
    small = batch.radius
    assert small is not None
    return small[0] * cable.stiffness_spread / 1e-3


def test_a_tube_of_sections_is_that_of_segments() -> None:
    stiff = {"bending_stiffness": 0.06, "twisting_stiffness": 0.05}
    cable = CABLE.replace(sections=[cs.Section(0.4, 1.0, **stiff)])
    harness = cs.Harness(
        {"a": CABLE.replace(length=0.4), "b": CABLE.replace(length=0.6, **stiff)},
        [cs.Junction("j", ("a.end", "b.start"))],
    )
    single, several = both(cable, harness, uncertainty=cs.Uncertainty({"bending_stiffness": 0.2}, (0.001, 0.01)))
    one = single.step({"cable": (START, END)}, 0).tubes["cable"]
    two = several.step({"h": {"a.start": START, "b.end": END}}, 0).tubes
    size = np.abs(one.covariance).max()
    for name, first in (("h/a", 0.0), ("h/b", 0.4)):
        expected = at_cable(one, two[name].shape.arc_length + first)
        np.testing.assert_allclose(two[name].covariance, expected, atol=2e-3 * size)
    longer = cs.Cycle(cable, uncertainty=cs.Uncertainty({"length": 0.01})).step({"cable": (START, END)}, 0)
    assert longer.tubes["cable"].radius.max() > 1e-3


def test_a_harness_with_no_shape_beside_it_has_no_tube_and_says_so() -> None:
    far = cs.Pose((0.9999, 0.0, 0.0), ALONG)
    known = cs.Uncertainty({"length:a": 0.2})
    report = cs.Cycle({"h": halves()}, uncertainty=known).step({"h": {"a.start": START, "b.end": far}}, 0)
    assert report.shapes["h"].usable
    tight = cs.Cycle({"h": halves()}, uncertainty=known).step(
        {"h": {"a.start": START, "b.end": cs.Pose((2.0, 0.0, 0.0), ALONG)}}, 0
    )
    assert not tight.tubes


def test_a_calibration_leaves_its_uncertainty() -> None:
    looks = []
    for y in (-0.1, 0.0, 0.1):
        ends = {"a.start": START, "b.end": cs.Pose((0.8, y, 0.05), ALONG)}
        shape = cs.predict(halves(), ends)
        points = {name: one.positions[10::20] for name, one in shape.segments.items()}
        noise = np.random.default_rng(3)
        seen = {name: x + 2e-3 * noise.normal(size=x.shape) for name, x in points.items()}
        looks.append(cs.HarnessObservation(ends, seen))
    found = cs.calibrate(looks, halves(), ("bending_stiffness", "tilt:a.start"))
    known = cs.Uncertainty.of(found)
    assert known.misses == found.miss_quantile(0.95)
    again = cs.Uncertainty.from_mapping(known.as_dict())
    held = {"h": found.held(ends)}
    tubes = [cs.Cycle({"h": found.harness}, uncertainty=one).step(held, 0).tubes["h/b"] for one in (known, again)]
    np.testing.assert_allclose(tubes[0].radius, tubes[1].radius, rtol=1e-9)
    assert tubes[0].radius.max() > known.misses
    known.covariance = known.covariance[:2, :2]
    with pytest.raises(cs.ArgumentError, match="numbers of these names"):
        cs.Cycle({"h": found.harness}, uncertainty=known)


def test_predict_tube_of_a_harness_is_that_of_its_uncertainty() -> None:
    """The ends are those of the grips, beside which the calibration holds the segments."""
    looks = []
    for y in (-0.1, 0.0, 0.1):
        ends = {"a.start": START, "b.end": cs.Pose((0.8, y, 0.05), ALONG)}
        shape = cs.predict(halves(), ends)
        noise = np.random.default_rng(3)
        seen = {name: one.positions[10::20] for name, one in shape.segments.items()}
        looks.append(cs.HarnessObservation(ends, {n: x + 2e-3 * noise.normal(size=x.shape) for n, x in seen.items()}))
    found = cs.calibrate(looks, halves(), ("bending_stiffness", "tilt:a.start"), progress=False)
    moving = {"a": (0.0, 0.5, 0.0)}
    tubes = cs.predict_tube(found, ends, start_error=(0.001, 0.01), acceleration=moving, inertia=0.02, points=150)
    known = cs.Uncertainty.of(found, (0.001, 0.01))
    cycle = HarnessTubeWatch(found.harness, known)
    predictor, there = cs.Predictor(found.harness), found.held(ends)
    wanted = cycle.tubes(predictor, predictor.predict(there, acceleration=moving), there, moving, 0.02)
    for name, tube in tubes.items():
        np.testing.assert_allclose(tube.radius, wanted[name].radius, rtol=1e-9)
        assert tube.holds
    assert not any(tube.holds for tube in cs.predict_tube(found, ends).values())
    left = cs.predict_tube(found, ends, acceleration=moving)
    assert left["a"].inertia == left["b"].inertia == pytest.approx(0.6 * 0.5 / 9.81)
    far = cs.predict_tube(found, {**ends, "b.end": cs.Pose((2.0, 0.0, 0.0), ALONG)})
    assert np.isnan(far["b"].radius).all()
    assert far["b"].shape.status is cs.Status.OVERSTRETCHED
    with pytest.raises(cs.ArgumentError, match="the ends of a harness are one mapping"):
        cs.predict_tube(found, START, END)
    with pytest.raises(cs.ArgumentError, match=r"'c\.end' is not allowed: there is no such end"):
        cs.predict_tube(found, {"c.end": START})


def with_tails() -> tuple[cs.Cable, cs.Harness]:
    """A cable with a tail at both ends, and two segments that are the same."""
    cable, parts = CABLE.replace(tails={"start": 0.2, "end": 0.7}), halves()
    sides = zip(parts.segments.items(), ("start", "end"), strict=True)
    return cable, parts.replace({name: one.replace(tails={side: cable.tails[side]}) for (name, one), side in sides})


@pytest.mark.parametrize("kind", ["clamped", "swivel"])
def test_tails_have_the_tubes_of_the_same_cable(kind: str) -> None:
    """By grips, stiffness, length and inertia; where a grip lets it turn a tail goes with its segment's tangent."""
    cable, harness = with_tails()
    known = cs.Uncertainty({"bending_stiffness": 0.1, "length": 0.01}, (0.001, 0.02), (0.002, 0.01))
    start, moved = (cs.Grip(cs.Pose((0.0, y, 0.0), ALONG), kind) for y in (0.0, 0.03))
    single, several = both(cable, harness, uncertainty=known, scene=FLOOR)
    fresh = both(cable, harness, uncertainty=known)

    def step(cycles: tuple[cs.Cycle, cs.Cycle], grip: cs.Grip, stamp: int) -> tuple[cs.CycleReport, cs.CycleReport]:
        one, two = cycles
        return one.step({"cable": (grip, END)}, stamp), two.step({"h": {"a.start": grip, "b.end": END}}, stamp)

    one, two = step((single, several), start, 0)
    assert set(two.tail_tubes) == {("h/a", "start"), ("h/b", "end")}
    for (name, side), tube in two.tail_tubes.items():
        assert tube.shape is two.tails[name, side]
        told, places = one.tail_tubes["cable", side], np.linspace(0.0, 1.0, tube.shape.points)
        wanted = np.interp(places, np.linspace(0.0, 1.0, told.shape.points), told.radius)
        np.testing.assert_allclose(tube.radius, wanted, rtol=0.01, atol=1e-5)
    lowest = two.tails["h/b", "end"].positions[:, 2] - two.tail_tubes["h/b", "end"].radius
    assert two.clearance["h/b"].closest.distance == pytest.approx(0.5 + lowest.min() - 0.5 * CABLE.diameter, abs=2e-3)
    sway = [], []
    swaying, still = step((single, several), moved, 200_000_000), step(fresh, moved, 0)
    for told, now, rest in zip(sway, swaying, still, strict=True):
        for key, tube in now.tail_tubes.items():
            assert tube.inertia > 0.0
            told.append((tube.covariance[-1] - rest.tail_tubes[key].covariance[-1]) / tube.inertia**2)
    np.testing.assert_allclose(sway[0], sway[1], atol=0.02 * np.abs(sway).max())  # judged by the whole, and by halves


def test_tails_hang_beyond_grips_and_count_for_clearance() -> None:
    ends = {"a.start": START, "b.end": END}
    cable, harness = with_tails()
    single, several = both(cable, harness, scene=FLOOR)
    one, two = single.step({"cable": (START, END)}, 0), several.step({"h": ends}, 0)
    assert set(two.tails) == {("h/a", "start"), ("h/b", "end")}
    for (name, side), tail in two.tails.items():
        same = one.tails["cable", side]
        tip = np.interp(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, same.points), same.positions[:, 2])
        own = np.interp(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, tail.points), tail.positions[:, 2])
        np.testing.assert_allclose(own, tip, atol=2e-3)
        span = two.shapes["h"].segments[name[2:]]  # type: ignore[attr-defined]
        lowest = min(tail.positions[:, 2].min(), span.positions[:, 2].min())
        assert two.clearance[name].closest.distance == pytest.approx(0.5 + lowest - 0.5 * CABLE.diameter, abs=1e-3)
    free = cs.Cycle({"h": harness}).step({"h": {"a.start": START}}, 0)
    assert set(free.tails) == {("h/a", "start")}


def test_inertia_of_a_moving_harness_widens_its_tubes_and_is_warned_of() -> None:
    cycle = cs.Cycle({"h": halves()}, uncertainty=cs.Uncertainty({"bending_stiffness": 0.01}), quasistatic_limit=0.1)
    for k in range(200):
        t = 0.01 * k
        sway = cs.Pose((0.0, 0.06 * math.cos(6.0 * t), 0.0), ALONG)
        report = cycle.step({"h": {"a.start": sway, "b.end": END}}, int(1e9 * t))
        if k == 100:
            assert report.tubes["h/a"].holds
    moved = report.tubes["h/b"]
    assert moved.inertia > 0.05
    assert any(margin.kind is WarningKind.QUASISTATIC for margin in report.margins["h/a"])
    cycle.reset()
    still = cycle.step({"h": {"a.start": START, "b.end": END}}, 0, acceleration={"h": {"a": (0.0, 0.0, 0.1)}})
    assert still.tubes["h/b"].inertia == 0.0
    assert still.tubes["h/b"].radius.max() < moved.radius.max()
    assert not any(m.kind is WarningKind.QUASISTATIC for one in still.margins.values() for m in one)


def test_stability_and_snaps_are_those_of_the_same_cable() -> None:
    """An arch whose ends are turned until it snaps: eigenvalue, warning, time and the shape after it."""
    arch = arch_predictor()[0].cable
    single, several = both(arch, halves(arch), snap_horizon=0.4)
    units = 0.6**-2  # of the eigenvalues: the longest segment against the whole
    warned = [0, 0]
    for k in range(100):
        start, end = arch_ends(0.3 + 5e-3 * k)
        one = single.step({"cable": (start, end)}, 10_000_000 * k)
        two = several.step({"h": {"a.start": start, "b.end": end}}, 10_000_000 * k)
        assert one.shapes["cable"].status is two.shapes["h"].status
        if one.shapes["cable"].status is cs.Status.SNAPPED:
            break
        (told,) = (m for m in one.margins["cable"] if m.kind is WarningKind.STABILITY)
        (own,) = (m for name in ("h/a", "h/b") for m in two.margins[name] if m.kind is WarningKind.STABILITY)
        if k > 5:
            assert own.value * units == pytest.approx(told.value, rel=0.05, abs=0.05)
        snaps = [[w for w in report.warnings if w.kind is WarningKind.SNAP] for report in (one, two)]
        warned = [n + len(w) for n, w in zip(warned, snaps, strict=True)]
        if all(snaps):
            assert snaps[1][0].time_to_limit == pytest.approx(snaps[0][0].time_to_limit, abs=0.08)
            assert snaps[1][0].cable_id in ("h/a", "h/b")
            assert set(two.after_snap) == {"h/a", "h/b"}
    else:
        raise AssertionError("it never snapped")
    assert warned[0] >= 15
    assert abs(warned[1] - warned[0]) <= 8
    assert several.step({"h": {"a.start": start, "b.end": end}}, 10_000_000 * k).skipped["snap_checks"] >= 0
