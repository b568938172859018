"""Eyelets that draw the cable through themselves: what the tension jumps by, and where that comes to rest."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
import yaml
from eyelets import ALONG_X, CABLE, FROM, PLACE, at, at_eyelet, eyelet, led, limit, motions

import cable_shape as cs
from cable_shape.scene.scene_files import clip_entry
from cable_shape.solve import answers, cosserat
from cable_shape.solve.nearby import nearby
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

STRING = cs.Cable(length=1.0, linear_density=0.0, bending_stiffness=1e-5, diameter=0.004)
HELD = cs.Grip(cs.Pose((-0.49, 0.0, 0.0), ALONG_X), "pinned")


def pulled(degrees: float, retraction: float, newtons: float = 1.0) -> cs.CableShape:
    """A string without weight through an eyelet at the origin, its end pulled at under an angle."""
    turn = np.radians(degrees)
    end = cs.FreeEnd(force=(newtons * np.cos(turn), newtons * np.sin(turn), 0.0))
    clip = cs.Clip(0.5, cs.Pose((0.0, 0.0, 0.0)), "slide", retraction=retraction)
    return cs.predict(STRING, HELD, end, scene=cs.Scene(clips=[clip]), model="cosserat", tolerance=1e-7)


# -- what it does


@pytest.mark.parametrize("degrees", [45, 90, 180])
@pytest.mark.parametrize("retraction", [0.3, 0.9, -0.5, -30.0])
def test_the_tensions_of_a_limp_cable_differ_by_it(degrees, retraction):
    shape = pulled(degrees, retraction)
    assert shape.status is cs.Status.OK
    before, behind = (float(np.linalg.norm(shape.force[k])) for k in (2, -3))
    assert behind == pytest.approx(1.0, abs=1e-9)
    assert before == pytest.approx(1.0 - retraction, abs=2e-4)
    assert shape.clips[0].friction == 0.0


def test_more_than_what_pulls_at_the_end_draws_the_cable_out_and_that_is_said():
    shape = pulled(90.0, 1.2)
    assert shape.status is cs.Status.NOT_CONVERGED
    assert "draws the cable in by 1.2 N, and the cable runs through it until the next clip, mass or end" in shape.detail
    assert "Lower its retraction, or make it a 'ball' clip." in shape.detail


@pytest.mark.parametrize("mu", [0.0, 0.2])
@pytest.mark.parametrize("retraction", [0.4, -0.3])
def test_without_load_n_t_and_the_square_of_the_moment_are_constant_but_for_the_jump(mu, retraction):
    """Euler's elastica between grip and eyelet, and between eyelet and grip."""
    cable = CABLE.replace(linear_density=0.0)
    _, shapes = led(eyelet(mu, (0.4, 0.05, 0.3), retraction), (0.0, 0.01, 0.02), cable, tolerance=1e-9)
    for shape in shapes:
        assert shape.status is cs.Status.OK
        sums = (shape.force * shape.tangents).sum(axis=1) + 0.5 / 0.01 * (shape.moment**2).sum(axis=1)
        load = shape.clips[0]
        before, behind = (sums[k] for k in (shape.arc_length < load.arc_length, shape.arc_length > load.arc_length))
        size = np.abs(sums).max()
        assert np.ptp(before) < 1e-5 * size
        assert np.ptp(behind) < 1e-5 * size
        assert before.mean() - behind.mean() == pytest.approx(load.friction - retraction, abs=1e-5 * size)
    assert (load.friction != 0.0) is (mu > 0.0)


def test_none_changes_no_bit():
    for mu in (0.0, 0.2):
        _, plain = led(eyelet(mu), (0.0, 0.01, 0.02))
        _, none = led(eyelet(mu, retraction=0.0), (0.0, 0.01, 0.02))
        assert all(np.array_equal(a.buffer, b.buffer) for a, b in zip(plain, none, strict=True))


def test_from_nothing_and_in_steps_it_comes_to_the_same_shape():
    """Up, down, and in one step to the other sign."""
    wanted = {
        r: cs.predict(CABLE, FROM, at(0.0), scene=eyelet(0.0, PLACE, r), tolerance=1e-8) for r in (-0.6, 0.5, 2.0)
    }
    assert wanted[2.0].clips[0].arc_length > wanted[0.5].clips[0].arc_length > wanted[-0.6].clips[0].arc_length + 0.03
    predictor = cs.Predictor(CABLE, scene=eyelet(0.0, PLACE, 0.0), tolerance=1e-8)
    predictor.predict(FROM, at(0.0))
    for r in (0.2, 0.5, 1.0, 2.0, 1.0, 0.5):
        predictor.scene = eyelet(0.0, PLACE, r)
        shape = predictor.predict(FROM, at(0.0))
        assert shape.status is cs.Status.OK
        assert shape.iterations < 30
        if r in wanted:
            assert np.abs(shape.positions - wanted[r].positions).max() < 1e-6
    predictor.scene = eyelet(0.0, PLACE, -0.6)
    assert np.abs(predictor.predict(FROM, at(0.0)).positions - wanted[-0.6].positions).max() < 1e-6


# -- with friction, and among bodies


@pytest.mark.parametrize("contact", ["off", "solve"])
@pytest.mark.parametrize(("mu", "retraction"), [(0.0, 0.3), (0.3, 0.2), (0.3, -0.2)])
def test_in_seeded_motions_the_force_along_the_cable_is_friction_less_it(mu, retraction, contact):
    cable = cs.Cable(length=1.3, linear_density=0.06, bending_stiffness=0.01, diameter=0.008)
    told = slipped = touched = 0
    for steps in motions(12, 4).values():
        predictor = None
        for scene, start, end in steps:
            clips = [
                dataclasses.replace(c, friction=mu, retraction=retraction) if c.kind == "slide" else c
                for c in scene.clips
            ]
            drawn = scene.replace(clips=clips, contact=contact)
            if predictor is None:
                predictor = cs.Predictor(cable, scene=drawn, model="cosserat", points=401, tolerance=1e-5)
            else:
                predictor.scene = drawn
            shape = predictor.predict(start, end)
            assert shape.usable
            touched += len(shape.contacts) > 0
            for clip, load in zip(clips, shape.clips, strict=True):
                if clip.kind != "slide":
                    continue
                before, tangent = at_eyelet(shape, load, 0.06 * 9.81)
                force = -load.force
                assert force @ tangent == pytest.approx(load.friction - retraction, abs=2e-3 * np.linalg.norm(force))
                told += 1
                if shape.frictionless or mu == 0.0:
                    assert abs(load.friction) < 1e-3 * np.linalg.norm(force)
                    continue
                most = limit(mu, before, force, tangent)
                assert abs(load.friction) < 1.002 * most
                if load.slips:
                    slipped += 1
                    assert abs(load.friction) == pytest.approx(most, rel=3e-3)
    assert told > 80
    assert slipped > (5 if mu else -1)
    assert touched > (20 if contact == "solve" else -1)


def test_of_a_cable_whose_start_has_opened_it_draws_the_same_way():
    """Which is solved as told from its end."""
    turn, right = cs.Pose(quaternion=(1.0, 0.0, 0.0, 0.0)), at(0.0)
    eye = cs.Pose((0.62, 0.0, -0.15), ALONG_X)
    described = (
        (cs.Clip(0.9, eye, "slide", "e", retraction=-0.3), {"cable": (FROM, right)}, "start"),
        (cs.Clip(0.3, eye * turn, "slide", "e", retraction=0.3), {"cable": (right * turn, FROM * turn)}, "end"),
    )
    shapes = []
    for clip, ends, side in described:
        cycle = cs.Cycle(CABLE, scene=cs.Scene(clips=[clip]), model="cosserat")
        assert cycle.step(ends, stamp=0).shapes["cable"].usable
        assert cycle.edit(cs.Open(side))
        shapes.append(cycle.step(ends, stamp=1).shapes["cable"])
    one, two = shapes
    assert one.status is two.status is cs.Status.OK
    assert one.positions == pytest.approx(two.positions[::-1], abs=1e-5)
    force, (_, tangent) = -one.clips[0].force, at_eyelet(one, one.clips[0], 0.05 * 9.81)
    assert force @ tangent == pytest.approx(0.3, abs=5e-3)


# -- derivatives


def test_numbers_of_the_cable_and_shapes_beside_it_are_answered_as_differences_are():
    def problem(cable=CABLE, place=PLACE):
        return Problem(cable, scene=eyelet(0.0, place, 0.3), points=121, tolerance=1e-10).move(FROM, at(0.02))

    state = Network(problem())
    cosserat.solve(problem(), state)
    columns = answers.sensitivity(state, ("bending_stiffness", "linear_density"))
    for i, (name, value) in enumerate({"bending_stiffness": 0.01, "linear_density": 0.05}.items()):
        h, solved, beside = 1e-4 * value, [], []
        for sign in (1.0, -1.0):
            other = problem(CABLE.replace(**{name: value + sign * h}))
            solved.append(cosserat.solve(other, state.copied()).positions)
            state.refresh()
            beside.append(nearby(state, other)[0].positions)
        for above, below in (solved, beside):
            assert columns[:, :, i] == pytest.approx((above - below) / (2.0 * h), abs=1e-5)


def test_sensitivity_on_a_body_is_that_of_finite_differences():
    start, place = cs.Pose((0.0, 0.0, 0.1), ALONG_X), np.array((0.4, 0.02, 0.15))

    def led_to(end=(0.81, 0.0, 0.1), eye=place, height=-0.02):
        floor = cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, height)))
        predictor = cs.Predictor(CABLE, model="cosserat", points=121, tolerance=1e-8)
        predictor.scene = eyelet(0.0, place, 0.1, obstacles=[dataclasses.replace(floor, pose=cs.Pose((0, 0, -0.02)))],
                                 contact="solve")  # fmt: skip
        predictor.predict(start, at(0.0, 0.0, 0.1))
        predictor.scene = eyelet(0.0, eye, 0.1, obstacles=[floor], contact="solve")
        return predictor, predictor.predict(start, cs.Pose(end, ALONG_X))

    predictor, shape = led_to()
    assert shape.contacts
    assert shape.status is cs.Status.OK
    columns = predictor.sensitivity(("end", "clip:e", "body:floor"))
    h, end = 1e-5, np.array((0.81, 0.0, 0.1))
    for axis in range(3):
        d = h * np.eye(3)[axis]
        asked = {
            axis: [{"end": end + sign * d} for sign in (1.0, -1.0)],
            6 + axis: [{"eye": place + sign * d} for sign in (1.0, -1.0)],
            12 + axis: [{"height": -0.02 + sign * d[2]} for sign in (1.0, -1.0)],
        }
        for column, lasts in asked.items():
            above, below = (led_to(**last)[1].positions for last in lasts)
            assert columns[:, :, column] == pytest.approx((above - below) / (2.0 * h), abs=5e-4)


# -- wherever clips are taken


def test_on_a_link_that_moves_it_is_as_in_the_world_where_that_puts_it():
    clip = cs.Clip(0.6, cs.Pose((0.0, 0.02, 0.1)), "slide", "e", link="arm", retraction=0.4)
    cycle = cs.Cycle(CABLE, scene=cs.Scene(clips=[clip]), model="cosserat")
    predictor = cs.Predictor(CABLE, model="cosserat")
    for k in range(6):
        link = cs.Pose((0.4 + 0.01 * k, 0.0, 0.28 + 0.004 * k))
        report = cycle.step({"cable": (FROM, at(0.005 * k))}, stamp=10_000_000 * k, links={"arm": link})
        predictor.scene = cs.Scene(clips=[dataclasses.replace(clip, pose=link * clip.pose, link=None)])
        shape, wanted = report.shapes["cable"], predictor.predict(FROM, at(0.005 * k))
        assert shape.status is wanted.status is cs.Status.OK
        assert shape.positions == pytest.approx(wanted.positions, abs=1e-7)
        assert shape.clips[0].arc_length == pytest.approx(wanted.clips[0].arc_length, abs=1e-7)


def test_on_a_table_two_segments_are_as_one_cable():
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.02)))
    halves = {"a": CABLE.replace(length=0.9), "b": CABLE.replace(length=0.3)}
    start, end = cs.Pose((0.0, 0.0, 0.1), ALONG_X), at(0.0, 0.0, 0.1)
    clip = cs.Clip(0.6, cs.Pose((0.4, 0.02, 0.15)), "slide", "e", retraction=0.1)
    one = cs.predict(CABLE, start, end, scene=cs.Scene(clips=[clip], obstacles=[table], contact="solve"))
    two = cs.predict(
        cs.Harness(halves, [cs.Junction("j", ("a.end", "b.start"))]),
        {"a.start": start, "b.end": end},
        scene=cs.Scene(clips=[dataclasses.replace(clip, segment="a")], obstacles=[table], contact="solve"),
    )
    assert one.contacts
    assert two.status is one.status is cs.Status.OK
    assert two.clips[0].arc_length == pytest.approx(one.clips[0].arc_length, abs=1e-3)
    assert two.clips[0].force == pytest.approx(one.clips[0].force, abs=5e-3)


def test_edits_of_a_cycle_keep_it():
    cycle = cs.Cycle(CABLE, scene=cs.Scene(), model="cosserat")
    shape = cycle.step({"cable": (FROM, at(0.0))}, stamp=0).shapes["cable"]
    clip = cs.Clip(float(shape.arc_length[75]), cs.Pose(shape.positions[75]), "slide", "e", retraction=0.2)
    assert cycle.edit(cs.Insert(clip))
    arcs = []
    for k in range(1, 12):
        shape = cycle.step({"cable": (FROM, at(0.0))}, stamp=10_000_000 * k).shapes["cable"]
        assert shape.usable
        arcs.append(shape.clips[0].arc_length)
        if k == 5:
            assert cycle.edit(cs.Move("e", cs.Pose(clip.pose.position + np.array((0.0, 0.0, 0.05)))))
    force, tangent = -shape.clips[0].force, at_eyelet(shape, shape.clips[0], 0.05 * 9.81)[1]
    assert force @ tangent == pytest.approx(-0.2, abs=5e-3 * np.linalg.norm(force))
    assert all(abs(b - a) < 0.2 for a, b in pairwise(arcs))


def test_batches_and_paths_of_poses_take_it():
    rows = [[pose.array for pose in poses] for poses in ((FROM, FROM), (at(0.0), at(0.02)))]
    batch = cs.predict_batch(CABLE, *rows, scene=eyelet(0.0, PLACE, 0.4))
    for row, end in zip(batch, (at(0.0), at(0.02)), strict=True):
        alone = cs.predict(CABLE, FROM, end, scene=eyelet(0.0, PLACE, 0.4))
        assert row.positions == pytest.approx(alone.positions, abs=2e-5)


def test_a_scene_keeps_it_in_a_file(tmp_path):
    (clip,) = eyelet(0.1, PLACE, 12.5).clips
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump({"clips": [clip_entry(clip)]}))
    assert "retraction: 12.5" in path.read_text()
    (again,) = cs.Scene.from_yaml(path).clips
    assert (again.retraction, again.friction) == (12.5, 0.1)
    assert "retraction" not in clip_entry(eyelet(0.1).clips[0])


# -- where it is refused


@pytest.mark.parametrize("kind", ["ball", "fixed", "hinge"])
def test_only_eyelets_draw(kind):
    with pytest.raises(cs.ArgumentError, match=rf"retraction = 2.*and this is a '{kind}' clip.*leave retraction out"):
        cs.Clip(0.5, cs.Pose((0, 0, 0)), kind, retraction=2.0)


@pytest.mark.parametrize("retraction", [np.nan, np.inf, 1e21, "5", None])
def test_it_is_one_finite_number(retraction):
    with pytest.raises(cs.ArgumentError, match=r"Clip\.retraction"):
        cs.Clip(0.5, cs.Pose((0, 0, 0)), "slide", retraction=retraction)


def test_what_swings_is_refused():
    with pytest.raises(cs.ArgumentError, match=r"Clip\.retraction = 0\.2.*draw a cable along it at rest only"):
        cs.Motion(CABLE, eyelet(0.0, PLACE, 0.2))
