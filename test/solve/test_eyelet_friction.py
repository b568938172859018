"""Friction in eyelets: the capstan's ratio, sticking and slipping with memory, and that what is told keeps the law."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from eyelets import ALONG_X, CABLE, FROM, at, at_eyelet, eyelet, led, limit, motions

import cable_shape as cs
from cable_shape.kernels.network import gripping
from cable_shape.prediction.turned import turned_shape

GIVES = 2.6e-4  # of the length: from its limit one way to that the other way, asperities give so much


def to_and_fro(step: float, far: float = 0.06, times: int = 3) -> np.ndarray:
    there = np.arange(0.0, far - 0.5 * step, step)
    loop = [np.arange(far, -far + 0.5 * step, -step), np.arange(-far, far - 0.5 * step, step)]
    return np.concatenate([there, *loop * times, [far]])


# -- the law


@pytest.mark.parametrize("degrees", [45, 90, 135, 180])
@pytest.mark.parametrize("mu", [0.1, 0.2, 0.4])
def test_a_limp_cable_that_is_pulled_through_has_the_capstans_tensions(degrees, mu):
    cable = cs.Cable(length=1.0, linear_density=0.0, bending_stiffness=1e-5, diameter=0.004)
    turn = np.radians(degrees)
    end = cs.FreeEnd(force=(np.cos(turn), np.sin(turn), 0.0))
    clip = cs.Clip(0.5, cs.Pose((0.0, 0.0, 0.0)), "slide", friction=mu)
    predictor = cs.Predictor(cable, scene=cs.Scene(clips=[clip]), model="cosserat")
    ratios = []
    for x in (*np.arange(-0.49, -0.53, -0.004), *np.arange(-0.53, -0.49, 0.004)):
        shape = predictor.predict(cs.Grip(cs.Pose((x, 0.0, 0.0), ALONG_X), "pinned"), end)
        assert shape.status is cs.Status.OK
        ratios.append(np.linalg.norm(shape.force[2]) / np.linalg.norm(shape.force[-3]))
    assert ratios[0] == pytest.approx(1.0, rel=1e-3)  # nothing is known yet
    assert ratios[9] == pytest.approx(np.exp(mu * turn), rel=0.01)
    assert ratios[-1] == pytest.approx(np.exp(-mu * turn), rel=0.01)


def test_the_limit_changes_as_its_differences_do():
    rng = np.random.default_rng(5)
    for mu in (0.05, 0.3, 1.5):
        for near in (1.0, 1e-2, 1e-5):
            a, t = rng.normal(size=3), rng.normal(size=3)
            b, t = a + near * rng.normal(size=3), t / np.linalg.norm(t)
            da, db, spin = rng.normal(size=(3, 3))
            dt = np.cross(spin, t)

            def told(h, a=a, b=b, t=t, da=da, db=db, spin=spin, mu=mu):
                turned = t + np.sin(h) * np.cross(spin, t) + h * h / 2.0 * np.cross(spin, np.cross(spin, t))
                zero = (0.0, 0.0, 0.0)
                return gripping.limit_of.py_func(
                    mu, tuple(a + h * da), tuple(b + h * db), tuple(turned), zero, zero, zero
                )[0]

            h = 1e-5 * near
            value, slope = gripping.limit_of.py_func(mu, *map(tuple, (a, b, t, da, db, dt)))
            assert value == pytest.approx(limit(mu, a, a - b, t), rel=1e-6)
            assert slope == pytest.approx((told(h) - told(-h)) / (2.0 * h), rel=2e-4, abs=1e-6)


def test_no_force_across_holds_nothing_along():
    """A cable that hangs straight through an eyelet is not held by it, however rough it is."""
    a, t, zero = (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    for b in ((0.0, 0.0, 0.5), (0.0, 0.0, -0.5), (0.0, 0.0, 0.0)):
        assert gripping.limit_of.py_func(0.5, a, b, t, zero, zero, zero)[0] == 0.0


# -- memory


@pytest.mark.parametrize("mu", [0.2, 0.6])
def test_to_and_fro_is_the_same_loop_every_time_and_takes_the_work_of_the_ends(mu):
    off = []
    for step in (0.01, 0.005):
        ways = to_and_fro(step)
        _, shapes = led(eyelet(mu), ways)
        size = round(0.24 / step)
        arcs = np.array([shape.clips[0].arc_length for shape in shapes])
        pulls = np.array([shape.clips[0].friction for shape in shapes])
        for told in (arcs, pulls):
            second, third = told[-2 * size - 1 : -size], told[-size - 1 :]
            assert np.abs(second - third).max() < 1e-4 * np.ptp(third)
        assert 0.4 < np.mean([shape.clips[0].slips for shape in shapes]) < 0.97
        ends = np.array([shape.force[-1, 0] for shape in shapes[-size - 1 :]])
        work = np.trapezoid(ends, ways[-size - 1 :])
        assert work > 0.0
        rubbed = -np.trapezoid(pulls[-size - 1 :], arcs[-size - 1 :])
        off.append(abs(work - abs(rubbed)) / work)
    assert off[0] < 0.06  # trapezia of the steps
    assert off[1] < 0.4 * off[0]


def test_what_sticks_keeps_the_point_of_the_cable():
    _, free = led(eyelet(0.0), to_and_fro(0.01, times=1))
    _, held = led(eyelet(3.0), to_and_fro(0.01, times=1))
    arcs = [np.ptp([shape.clips[0].arc_length for shape in shapes[1:]]) for shapes in (free, held)]
    assert arcs[0] > 5e-3
    assert arcs[1] < GIVES * CABLE.length
    assert not any(shape.clips[0].slips for shape in held)


def test_the_larger_friction_of_cable_and_eyelet_counts():
    ways = to_and_fro(0.02, times=1)
    _, clip = led(eyelet(0.05), ways)
    _, cable = led(eyelet(0.02), ways, CABLE.replace(friction=0.05))
    assert all(np.array_equal(a.buffer, b.buffer) for a, b in zip(clip, cable, strict=True))


def test_without_a_past_it_is_without_friction_and_says_so():
    plain = cs.predict(CABLE, FROM, at(0.0), scene=eyelet(0.0), model="cosserat")
    rough = cs.predict(CABLE, FROM, at(0.0), scene=eyelet(0.4), model="cosserat")
    assert np.array_equal(plain.buffer, rough.buffer)
    assert (plain.frictionless, rough.frictionless) == (False, True)
    assert (rough.clips[0].friction, rough.clips[0].slips) == (pytest.approx(0.0, abs=1e-6), False)
    _, shapes = led(eyelet(0.4), (0.0, 0.01, 0.02))
    assert [shape.frictionless for shape in shapes] == [True, False, False]
    _, smooth = led(eyelet(0.4), (0.0, 0.01, 0.02), friction=False)
    _, none = led(eyelet(0.0), (0.0, 0.01, 0.02))
    assert all(shape.frictionless for shape in smooth)
    assert all(np.array_equal(a.buffer, b.buffer) for a, b in zip(smooth, none, strict=True))
    rows = [[pose.array for pose in poses] for poses in ((FROM, FROM), (at(0.0), at(0.01)))]
    batch = cs.predict_batch(CABLE, *rows, scene=eyelet(0.4))
    assert all(shape.frictionless for shape in batch)


def test_a_clip_that_moves_and_one_that_comes_keep_what_is_known():
    predictor, shapes = led(eyelet(3.0), np.arange(0.0, 0.05, 0.01))
    before = shapes[-1].clips[0]
    assert abs(before.friction) > 0.01
    predictor.scene = eyelet(3.0, (0.4, 0.02, 0.381))
    shape = predictor.predict(FROM, at(0.04))
    assert shape.clips[0].arc_length == pytest.approx(before.arc_length, abs=GIVES * CABLE.length)
    again = predictor.predict(FROM, at(0.04))
    assert again.clips[0].friction == pytest.approx(shape.clips[0].friction, rel=1e-6)


def test_what_would_run_to_a_side_balances_where_it_sticks():
    """Let down with slack on both sides, a cable runs to the side that is heavier by a hair; held, it stays."""
    arcs = {}
    for mu in (0.0, 0.3):
        predictor = cs.Predictor(CABLE, scene=eyelet(mu, (0.4, 0.0, 0.38)), model="cosserat")
        for z in np.linspace(0.38, 0.1, 40):
            predictor.scene = eyelet(mu, (0.4, 0.0, z))
            shape = predictor.predict(FROM, at(0.0))
            assert shape.status is cs.Status.OK
        arcs[mu] = shape.clips[0].arc_length
    assert abs(arcs[0.0] - 0.6) > 0.1
    assert arcs[0.3] == pytest.approx(0.6, abs=1e-4)


def test_smaller_steps_find_what_sticks_and_slips_sooner():
    """Ways through one to three eyelets at which cables stick, slip and snap: 9,000 iterations where the point in each
    eyelet was looked for first."""
    cable = cs.Cable(length=1.3, linear_density=0.06, bending_stiffness=0.003, diameter=0.008)
    t, iterations = np.linspace(0.0, 1.0, 40)[:, None], 0
    for seed in (1, 4, 5, 7):
        rng, count = np.random.default_rng(seed), 1 + seed % 3

        def way(size, rng=rng):
            waves = [rng.normal(size=3) * np.sin(np.pi * (k + 1) * t * rng.uniform(0.5, 2.0)) for k in range(4)]
            return 0.5 * size * sum(waves)

        middle = [np.array((0.9 * (i + 1) / (count + 1), 0.0, 0.0)) + rng.uniform(-0.12, 0.12, 3) for i in range(count)]
        places, end = [place + way(0.05) for place in middle], np.array((0.9, 0.0, 0.0)) + way(0.06)
        predictor = None
        for k in range(len(t)):
            rings = [
                cs.Clip(1.3 * (i + 1) / (count + 1), cs.Pose(place[k]), "slide", friction=1.0)
                for i, place in enumerate(places)
            ]
            if predictor is None:
                predictor = cs.Predictor(cable, scene=cs.Scene(clips=rings), model="cosserat", tolerance=1e-5)
            predictor.scene = cs.Scene(clips=rings)
            shape = predictor.predict(FROM, cs.Pose(end[k], ALONG_X))
            assert shape.usable or shape.status is cs.Status.OVERSTRETCHED
            iterations += shape.iterations
    assert iterations < 4000


# -- motions of all kinds, judged from the shapes alone


@pytest.mark.parametrize("contact", ["off", "solve"])
@pytest.mark.parametrize("mu", [0.1, 0.6])
def test_in_seeded_motions_every_shape_keeps_the_law(mu, contact):
    cable = cs.Cable(length=1.3, linear_density=0.06, bending_stiffness=0.01, diameter=0.008)
    weight = 0.06 * 9.81
    known = stuck = slipped = 0
    for steps in motions(20, 4).values():
        predictor, last = None, None
        for scene, start, end in steps:
            clips = [dataclasses.replace(c, friction=mu) if c.kind == "slide" else c for c in scene.clips]
            rough = scene.replace(clips=clips, contact=contact)
            if predictor is None:
                predictor = cs.Predictor(cable, scene=rough, model="cosserat", points=401, tolerance=1e-5)
            else:
                predictor.scene = rough
            shape = predictor.predict(start, end)
            assert shape.usable
            loads = shape.clips
            for i, (clip, load) in enumerate(zip(clips, loads, strict=True)):
                if clip.kind != "slide":
                    assert (load.friction, load.slips) == (0.0, False)
                    continue
                before, tangent = at_eyelet(shape, load, weight)
                force = -load.force
                most = limit(mu, before, force, tangent)
                assert force @ tangent == pytest.approx(load.friction, abs=2e-3 * np.linalg.norm(force))
                if shape.frictionless:
                    assert abs(load.friction) < 1e-3 * np.linalg.norm(force)
                    continue
                known += 1
                assert abs(load.friction) < 1.002 * most
                if load.slips:
                    slipped += 1
                    assert abs(load.friction) == pytest.approx(most, rel=3e-3)
                if last is not None and shape.status is cs.Status.OK:
                    way = load.arc_length - last[i].arc_length
                    if load.slips:  # against the way, but for what asperities give
                        assert way * np.sign(load.friction) > -GIVES * cable.length
                    elif abs(load.friction) < 0.9 * most and abs(last[i].friction) < 0.9 * most and contact == "off":
                        stuck += 1
                        assert abs(way) < GIVES * cable.length
            last = loads
    assert known > 100
    assert slipped > 10
    if mu > 0.5 and contact == "off":
        assert stuck > 5


# -- with bodies, and where it is refused


def test_beside_a_body_that_is_not_touched_it_is_as_without_and_on_one_the_loops_close():
    ways = [(cs.Pose((0.0, 0.0, 0.1), ALONG_X), at(x, 0.0, 0.1)) for x in to_and_fro(0.01, times=2)]

    def shapes(**others):
        scene = eyelet(0.05, (0.4, 0.02, 0.15), **others)
        predictor = cs.Predictor(CABLE, scene=scene, model="cosserat", points=121, tolerance=1e-6)
        return [predictor.predict(start, end) for start, end in ways]

    far = cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.5)))
    near = dataclasses.replace(far, pose=cs.Pose((0.0, 0.0, -0.02)))
    free, beside = shapes(), shapes(obstacles=[far], contact="solve")
    assert all(np.array_equal(a.buffer, b.buffer) for a, b in zip(free, beside, strict=True))
    on = shapes(obstacles=[near], contact="solve")
    assert [shape.frictionless for shape in on] == [True, *[False] * (len(on) - 1)]
    assert all(shape.status is cs.Status.OK and shape.contacts for shape in on)
    told = np.array([(shape.clips[0].arc_length, shape.clips[0].friction) for shape in on])
    assert (np.abs(told[-49:-24] - told[-25:]).max(axis=0) < 1e-3 * np.ptp(told[-25:], axis=0)).all()
    assert 0.1 < np.mean([shape.clips[0].slips for shape in on]) < 0.9


def test_told_from_the_other_end_it_is_the_same_with_the_other_sign():
    _, shapes = led(eyelet(0.6), np.arange(0.0, 0.05, 0.01))
    (one,), (other,) = shapes[-1].clips, turned_shape(shapes[-1]).clips
    assert (other.friction, other.slips) == (-one.friction, one.slips)
    assert turned_shape(shapes[0]).frictionless


def test_a_cycle_remembers_and_tells_it():
    cycle = cs.Cycle(CABLE, scene=eyelet(0.6), model="cosserat")
    predictor = cs.Predictor(CABLE, scene=eyelet(0.6), model="cosserat")
    for k in range(6):
        report = cycle.step({"cable": (FROM, at(0.01 * k))}, stamp=10_000_000 * k)
        (mine,), (wanted,) = report.shapes["cable"].clips, predictor.predict(FROM, at(0.01 * k)).clips
        assert (mine.friction, mine.slips) == (wanted.friction, wanted.slips)
    assert abs(mine.friction) > 0.1


def test_what_friction_held_before_there_was_none_is_forgotten():
    predictor, shapes = led(eyelet(3.0), np.arange(0.0, 0.05, 0.01))
    held = shapes[-1].clips[0].arc_length
    predictor.scene = eyelet(0.0)
    smooth = predictor.predict(FROM, at(0.04)).clips[0].arc_length
    assert abs(smooth - held) > 1e-3
    predictor.scene = eyelet(3.0)
    first, second = predictor.predict(FROM, at(0.04)), predictor.predict(FROM, at(0.05))
    assert (first.frictionless, second.frictionless) == (True, False)
    assert first.clips[0].arc_length == pytest.approx(smooth, abs=1e-6)
    assert second.clips[0].arc_length == pytest.approx(smooth, abs=GIVES * CABLE.length)


def test_a_clip_comes_and_goes_beside_an_eyelet_that_holds_what_it_held():
    cycle = cs.Cycle(CABLE, scene=eyelet(3.0), model="cosserat")
    for k in range(5):
        shape = cycle.step({"cable": (FROM, at(0.01 * k))}, stamp=10_000_000 * k).shapes["cable"]
    before = shape.clips[0]
    assert abs(before.friction) > 0.5
    clip = cs.Clip(float(shape.arc_length[30]), cs.Pose(shape.positions[30]), name="more")
    for k, edit in enumerate((cs.Insert(clip), cs.Release("more")), 5):
        assert cycle.edit(edit)
        after = cycle.step({"cable": (FROM, at(0.04))}, stamp=10_000_000 * k).shapes["cable"].clips[-1]
        assert after.arc_length == pytest.approx(before.arc_length, abs=1e-7)
        assert after.friction == pytest.approx(before.friction, abs=1e-3)


def test_what_swings_is_refused():
    with pytest.raises(cs.ArgumentError, match="at rest only, not as it swings"):
        cs.Motion(CABLE, eyelet(0.2))


@pytest.mark.parametrize("kind", ["ball", "fixed", "hinge"])
def test_only_eyelets_have_friction(kind):
    with pytest.raises(cs.ArgumentError, match=f"runs through eyelets alone, and this is a '{kind}' clip"):
        cs.Clip(0.5, cs.Pose((0, 0, 0)), kind, friction=0.2)


@pytest.mark.parametrize("friction", [-0.1, 10.5, np.nan])
def test_its_bounds_are_those_of_bodies(friction):
    with pytest.raises(cs.ArgumentError, match=r"Clip\.friction"):
        cs.Clip(0.5, cs.Pose((0, 0, 0)), "slide", friction=friction)
