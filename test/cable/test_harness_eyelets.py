"""Harnesses whose segments run through eyelets: against one cable, without friction, and how they answer grips."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from harness_random import balance, random_quaternion

import cable_shape as cs
from cable_shape.safety.report import WarningKind

ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
START, END = cs.Pose((0.0, 0.0, 0.0), ALONG), cs.Pose((0.9, 0.0, 0.0), ALONG)
PLACES = {0.3: cs.Pose((0.25, 0.03, -0.04), ALONG), 0.55: cs.Pose((0.48, 0.02, -0.05), ALONG)}
ASIDE = cs.Pose(quaternion=(0.479426, 0.0, 0.0, 0.877583))


def eyelets(segment: str | None = None) -> cs.Scene:
    return cs.Scene(clips=[cs.Clip(s, place, "slide", segment=segment) for s, place in PLACES.items()])


def halves() -> cs.Harness:
    parts = {"a": CABLE.replace(length=0.8), "b": CABLE.replace(length=0.4)}
    return cs.Harness(parts, [cs.Junction("j", ("a.end", "b.start"))])


def fork() -> cs.Harness:
    """A trunk with two eyelets, of which one branch is held and the other hangs."""
    parts = {"a": CABLE.replace(length=0.8), "b": CABLE.replace(length=0.4), "c": CABLE.replace(length=0.2)}
    return cs.Harness(parts, [cs.Junction("j", ("a.end", "b.start", "c.start"), frames={"c.start": ASIDE})])


def test_two_segments_run_through_eyelets_as_one_cable_does() -> None:
    single = cs.Predictor(CABLE, scene=eyelets())
    several = cs.Predictor(halves(), scene=eyelets("a"))
    for k in range(6):
        end = cs.Pose((0.9, 0.01 * k, 0.012 * k), ALONG)
        one, two = single.predict(START, end), several.predict({"a.start": START, "b.end": end})
        assert two.status is cs.Status.OK
        for mine, wanted in zip(two.clips, one.clips, strict=True):
            assert mine.arc_length == pytest.approx(wanted.arc_length, abs=2e-6)
            np.testing.assert_allclose(mine.force, wanted.force, atol=1e-4)
        np.testing.assert_allclose(two.segments["b"].positions[-1], end.position, atol=1e-9)
        assert two.energy == pytest.approx(one.energy, abs=1e-6)
    still = cs.predict(halves(), {"a.start": START, "b.end": end}, scene=eyelets("a"))
    np.testing.assert_allclose(still.segments["a"].positions, two.segments["a"].positions, atol=2e-5)


def test_retraction_draws_two_segments_through_eyelets_as_it_does_one_cable() -> None:
    single, several = cs.Predictor(CABLE, tolerance=1e-8), cs.Predictor(halves(), tolerance=1e-8)
    arcs = []
    for pulls in ((0.1, -0.05), (0.3, -0.05), (1.0, 0.2), (0.1, -0.05)):
        rings = [
            cs.Clip(s, place, "slide", segment="a", retraction=pull)
            for (s, place), pull in zip(PLACES.items(), pulls, strict=True)
        ]
        single.scene = cs.Scene(clips=[dataclasses.replace(ring, segment=None) for ring in rings])
        several.scene = cs.Scene(clips=rings)
        one, two = single.predict(START, END), several.predict({"a.start": START, "b.end": END})
        assert two.status is one.status is cs.Status.OK
        for mine, wanted in zip(two.clips, one.clips, strict=True):
            assert mine.arc_length == pytest.approx(wanted.arc_length, abs=2e-6)
            np.testing.assert_allclose(mine.force, wanted.force, atol=2e-4)
        arcs.append([load.arc_length for load in two.clips])
    assert arcs[3] == pytest.approx(arcs[0], abs=1e-6)
    assert arcs[2][0] > arcs[0][0] + 3e-4


def rough(segment: str | None = None) -> cs.Scene:
    clips = [cs.Clip(s, place, "slide", segment=segment, friction=0.05) for s, place in PLACES.items()]
    return cs.Scene(clips=clips)


def test_friction_holds_two_segments_in_eyelets_as_it_does_one_cable() -> None:
    single = cs.Predictor(CABLE, scene=rough(), tolerance=1e-8)
    several = cs.Predictor(halves(), scene=rough("a"), tolerance=1e-8)
    slips = 0
    for k, x in enumerate((0.0, 0.01, 0.02, 0.03, 0.04, 0.03, 0.02, 0.01, 0.0)):
        end = cs.Pose((0.9 + x, 0.0, 0.0), ALONG)
        one, two = single.predict(START, end), several.predict({"a.start": START, "b.end": end})
        assert two.status is cs.Status.OK
        assert two.frictionless is one.frictionless is (k == 0)
        for mine, wanted in zip(two.clips, one.clips, strict=True):
            assert mine.arc_length == pytest.approx(wanted.arc_length, abs=4e-5)  # asperities give 1e-4 of 0.8 and 1.2
            if mine.slips and wanted.slips:
                slips += 1
                assert mine.friction == pytest.approx(wanted.friction, rel=1e-3)
        assert two.segments["a"].clips[0].friction == two.clips[0].friction
    assert 2 <= slips <= 16
    batch = cs.predict_batch(halves(), {"a.start": [START.array], "b.end": [END.array]}, scene=rough("a"))
    assert abs(batch[0].clips[0].friction) < 1e-6


@pytest.mark.parametrize("mu", [0.0, 1.0])
def test_a_clip_comes_and_goes_beside_eyelets_that_hold_what_they_held(mu) -> None:
    rings = [cs.Clip(s, place, "slide", f"e{s}", "a", friction=mu) for s, place in PLACES.items()]
    cycle = cs.Cycle({"h": halves()}, scene=cs.Scene(clips=rings))
    time = iter(range(0, 10**9, 10**7))

    def step(x: float) -> cs.HarnessShape:
        shape = cycle.step({"h": {"a.start": START, "b.end": cs.Pose((0.9 + x, 0.0, 0.0), ALONG)}}, stamp=next(time))
        return shape.shapes["h"]

    for x in (0.0, 0.005, 0.01, 0.015, 0.02):
        before = step(x)
    assert (abs(before.clips[0].friction) > 0.1) == (mu > 0.0)
    branch = before.segments["b"]
    clip = cs.Clip(float(branch.arc_length[70]), cs.Pose(branch.positions[70]), name="more", segment="b")
    for edit, clips in ((cs.Insert(clip), 3), (cs.Release("more"), 2)):
        assert cycle.edit(edit)
        after = step(0.02)
        assert after.status is cs.Status.OK
        assert len(after.clips) == clips
        for mine, wanted in zip(after.clips[:2], before.clips, strict=True):
            assert mine.arc_length == pytest.approx(wanted.arc_length, abs=1e-6)
            assert mine.friction == pytest.approx(wanted.friction, abs=1e-3)


def test_a_fork_answers_grips_as_its_eyelets_stick_and_slip() -> None:
    step, ends = 1e-6, {"a.start": START, "c.end": cs.FreeEnd(mass=0.02)}

    def led(last: cs.Pose, mu: float) -> tuple[cs.Predictor, cs.HarnessShape]:
        clips = [cs.Clip(s, place, "slide", segment="a", friction=mu) for s, place in PLACES.items()]
        predictor = cs.Predictor(fork(), scene=cs.Scene(clips=clips), tolerance=1e-9)
        for x in (0.0, 0.01, 0.02):
            predictor.predict({**ends, "b.end": cs.Pose((0.9 + x, 0.0, 0.0), ALONG)})
        return predictor, predictor.predict({**ends, "b.end": last})

    told = set()
    for mu in (0.05, 2.0):
        predictor, shape = led(cs.Pose((0.93, 0.0, 0.0), ALONG), mu)
        columns, at = predictor.sensitivity(), 6 * list(predictor.grips).index("b.end")
        told |= {load.slips for load in shape.clips}
        for axis in range(3):
            way = step * np.eye(3)[axis]
            above, below = (led(cs.Pose(np.array((0.93, 0.0, 0.0)) + sign * way, ALONG), mu)[1] for sign in (1.0, -1.0))
            for name, one in columns.items():
                wanted = (above.segments[name].positions - below.segments[name].positions) / (2.0 * step)
                np.testing.assert_allclose(one[:, :, at + axis], wanted, atol=2e-4)
    assert told == {True, False}


def test_no_eyelet_of_a_fork_pulls_along_its_segment_and_shapes_answer_grips() -> None:
    predictor = cs.Predictor(fork(), scene=eyelets("a"), tolerance=1e-7)
    ends = {"a.start": START, "b.end": END, "c.end": cs.FreeEnd(mass=0.02)}
    shape = predictor.predict(ends)
    assert shape.status is cs.Status.OK
    trunk = shape.segments["a"]
    for load in shape.clips:
        tangent = np.array([np.interp(load.arc_length, trunk.arc_length, x) for x in trunk.tangents.T])
        assert np.linalg.norm(load.force) > 0.1
        assert abs(load.force @ tangent) < 2e-3 * np.linalg.norm(load.force)
    columns = predictor.sensitivity()
    step, grips = 1e-4, list(predictor.grips)
    for axis in range(3):
        moved = []
        for sign in (-1.0, 1.0):
            way = np.zeros(3)
            way[axis] = sign * step
            there = cs.Pose(END.position + way, END.quaternion)
            moved.append(predictor.predict({**ends, "b.end": there}))
        for name, one in columns.items():
            wanted = (moved[1].segments[name].positions - moved[0].segments[name].positions) / (2.0 * step)
            np.testing.assert_allclose(one[:, :, 6 * grips.index("b.end") + axis], wanted, atol=2e-3)


def test_clips_beside_an_eyelet_may_hold_other_points_from_one_shape_to_the_next() -> None:
    def scene(arc: float) -> cs.Scene:
        ball = cs.Clip(arc, cs.Pose((0.48, 0.02, -0.05), ALONG), "ball", segment="a")
        return cs.Scene(clips=[cs.Clip(0.3, PLACES[0.3], "slide", segment="a"), ball])

    ends = {"a.start": START, "b.end": END}
    predictor = cs.Predictor(halves(), scene=scene(0.55))
    predictor.predict(ends)
    predictor.scene = scene(0.556)
    warm, cold = predictor.predict(ends), cs.predict(halves(), ends, scene=scene(0.556))
    assert warm.clips[1].arc_length == 0.556
    assert warm.clips[0].arc_length == pytest.approx(cold.clips[0].arc_length, abs=1e-6)
    for name, shape in warm.segments.items():
        np.testing.assert_allclose(shape.positions, cold.segments[name].positions, atol=1e-5)


def test_a_segment_that_nothing_stops_runs_out_of_its_eyelet() -> None:
    heavy = {"a.start": START, "c.end": cs.FreeEnd(mass=0.5)}
    clip = cs.Clip(0.1, cs.Pose((0.05, 0.0, 0.3), ALONG), "slide", segment="b", name="ring")
    shape = cs.predict(fork(), heavy, scene=cs.Scene(clips=[clip]))
    assert not shape.usable
    assert shape.detail


def test_cycles_with_eyelets_have_tubes_and_stability() -> None:
    known = cs.Uncertainty({"bending_stiffness": 0.2}, (0.001, 0.01), (0.001, 0.01))
    one = cs.Cycle(CABLE, scene=eyelets(), uncertainty=known).step({"cable": (START, END)}, 0)
    two = cs.Cycle({"h": halves()}, scene=eyelets("a"), uncertainty=known).step(
        {"h": {"a.start": START, "b.end": END}}, 0
    )
    tube, whole = two.tubes["h/b"], one.tubes["cable"]
    wanted = np.interp(tube.shape.arc_length + 0.8, whole.shape.arc_length, whole.radius)
    np.testing.assert_allclose(tube.radius, wanted, rtol=0.02, atol=2e-5)
    (told,) = (m for m in one.margins["cable"] if m.kind is WarningKind.STABILITY)
    (own,) = (m for name in ("h/a", "h/b") for m in two.margins[name] if m.kind is WarningKind.STABILITY)
    assert own.value / 0.8**2 == pytest.approx(told.value / 1.2**2, rel=0.02)


# -- from nothing, where the arc length that is given at an eyelet is far from what it comes to


def drawn(seed: int) -> tuple[cs.Cable, cs.Pose, dict[str, cs.Pose], float]:
    """A segment, an eyelet, two grips beyond it, and an arc length of the eyelet on what begins at 0.6 m."""
    rng = np.random.default_rng(seed)

    def turned(place: tuple[float, float, float]) -> cs.Pose:
        return cs.Pose(place, (cs.Pose(quaternion=ALONG) * cs.Pose(quaternion=random_quaternion(rng, 0.5))).quaternion)

    cable = cs.Cable(length=0.6, linear_density=0.1, bending_stiffness=10.0 ** rng.uniform(-3.5, -1.5))
    eyelet = turned((0.62 + rng.uniform(0.05, 0.2), rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.05)))
    ends = {end: turned((1.05, y, rng.uniform(-0.1, 0.1))) for end, y in (("b.end", 0.1), ("c.end", -0.1))}
    return cable, eyelet, ends, float(rng.uniform(0.1, 0.35))


@pytest.mark.parametrize("seed", range(6))
def test_a_chain_runs_through_an_eyelet_from_nothing_as_one_cable_does(seed: int) -> None:
    """The way from the grip through the junction to the eyelet is longer than was given, most times."""
    cable, eyelet, ends, arc = drawn(seed)
    chain = cs.Harness({"t": cable, "b": cable}, [cs.Junction("j", ("t.end", "b.start"))])
    whole = cs.predict(
        cable.replace(length=1.2), cs.Pose(quaternion=ALONG), ends["b.end"],
        scene=cs.Scene(clips=[cs.Clip(0.6 + arc, eyelet, "slide")]),
    )  # fmt: skip
    held = {"t.start": cs.Pose(quaternion=ALONG), "b.end": ends["b.end"]}
    shape = cs.predict(chain, held, scene=cs.Scene(clips=[cs.Clip(arc, eyelet, "slide", segment="b")]))
    assert shape.status is whole.status is cs.Status.OK
    assert shape.clips[0].arc_length + 0.6 == pytest.approx(whole.clips[0].arc_length, abs=1e-5)
    assert shape.energy == pytest.approx(whole.energy, abs=1e-6)


@pytest.mark.parametrize("seed", [0, 1, 3, 64])
def test_both_branches_of_a_fork_run_through_one_eyelet(seed: int) -> None:
    cable, eyelet, ends, arc = drawn(seed)
    rng = np.random.default_rng(seed)
    frames = {f"{name}.start": cs.Pose(quaternion=random_quaternion(rng, 0.6)) for name in "bc"}
    harness = cs.Harness(dict.fromkeys("tbc", cable), [cs.Junction("j", ("t.end", *frames), frames=frames)])
    clips = [cs.Clip(arc, eyelet, "slide", segment=name) for name in "bc"]
    shape = cs.predict(harness, {"t.start": cs.Pose(quaternion=ALONG), **ends}, scene=cs.Scene(clips=clips))
    assert shape.status is cs.Status.OK, shape.detail
    assert max(balance(shape)[:2]) < 1e-6
    for name, load in zip("bc", shape.clips, strict=True):
        branch = shape.segments[name]
        tangent = np.array([np.interp(load.arc_length, branch.arc_length, x) for x in branch.tangents.T])
        assert abs(load.force @ tangent) < 2e-3 * np.linalg.norm(load.force)
        place = [np.interp(load.arc_length, branch.arc_length, x) for x in branch.positions.T]
        np.testing.assert_allclose(place, eyelet.position, atol=1e-3)


def test_a_way_through_an_eyelet_that_is_too_long_is_told() -> None:
    cable, eyelet, ends, arc = drawn(0)
    chain = cs.Harness({"t": cable, "b": cable}, [cs.Junction("j", ("t.end", "b.start"))])
    far = eyelet.position + np.array((0.0, 0.0, -0.4))
    clip = cs.Clip(arc, cs.Pose(far, ALONG), "slide", segment="b", name="ring")
    held = {"t.start": cs.Pose(quaternion=ALONG), "b.end": ends["b.end"]}
    shape = cs.predict(chain, held, scene=cs.Scene(clips=[clip]))
    assert shape.status is cs.Status.OVERSTRETCHED
    way = np.linalg.norm(far) + np.linalg.norm(ends["b.end"].position - far)
    assert shape.missing_length == pytest.approx(way - 1.2, rel=0.01)
    assert "through clip 'ring'" in shape.detail
