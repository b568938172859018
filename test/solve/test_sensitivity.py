"""Derivatives of shapes by what holds the cable and by its numbers: against central differences of shapes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rods import CABLE, END, GENERAL, START, moved

import cable_shape as cs

NUMBERS = ("length", "linear_density", "bending_stiffness", "twisting_stiffness")
TABLE = [(1.0, 0.0, 0.5), (-2.0, 1.0, 0.0), (0.5, 0.5, -1.0)]
WAVY = CABLE.replace(rest_curvature=TABLE)
FREE = cs.FreeEnd(mass=0.02, force=(0.1, 0.0, 0.05), moment=(0.0, 0.01, 0.0))
MASSES = (cs.PointMass(0.31, 0.03), cs.PointMass(0.71, 0.02))
SWING = ((0.0, 0.0, 0.0), (3.0, 0.0, 1.0))
SWUNG = ((0.0, 1.0, 0.0), (3.0, 0.0, 1.0), (-1.0, 2.0, 0.5), (0.0, -2.0, 2.0), (1.0, 0.0, 0.0))
POINTS = 38


def clips_at(cable: cs.Cable, end, *held: tuple[float, str], **options) -> tuple[cs.Clip, ...]:
    """Clips a little beside the shape that the cable has without them."""
    shape = cs.predict(cable, START, end, points=241, **options)
    out = []
    for k, (share, kind) in enumerate(held):
        i = round(240 * share)
        pose = cs.Pose(shape.positions[i], shape.quaternions[i])
        turn = (0.1, -0.05, 0.2) if kind in ("fixed", "hinge") else (0.0, 0.0, 0.0)
        out.append(cs.Clip(float(shape.arc_length[i]), moved(pose, (0.01, 0.02 - 0.01 * k, 0.02), turn), kind))
    return tuple(out)


@cache
def case(name: str) -> tuple[cs.Cable, object, object, cs.Scene, dict[str, object]]:
    """Cable, ends, scene and accelerations."""
    start, end, cable, held, masses, motion = START, END, CABLE, (), (), {}
    match name:
        case "elastic":
            cable = GENERAL
        case "rest table":
            cable = WAVY
        case "pinned":
            start, end = cs.Grip(START, kind="swivel"), cs.Grip(END, kind="pinned")
        case "free":
            end = FREE
        case "masses that are moved":
            cable, masses, motion = GENERAL, MASSES, {"acceleration": SWING}
        case "ball":
            held = ((0.5, "ball"),)
        case "fixed and hinge":
            cable, held = GENERAL, ((0.3, "fixed"), (0.7, "hinge"))
        case "hinge, then free":
            end, held = FREE, ((0.6, "hinge"),)
        case "table in a ball, masses":
            cable, held, masses = WAVY, ((0.4, "ball"),), MASSES
        case "eyelet":
            held = ((0.5, "slide"),)
        case "eyelets and ball":
            cable, held = GENERAL, ((0.3, "slide"), (0.5, "ball"), (0.8, "slide"))
        case "swung in clips":
            held, masses, motion = ((0.3, "fixed"), (0.7, "ball")), MASSES, {"acceleration": SWUNG}
        case "swung through eyelets":
            cable, held, motion = GENERAL, ((0.3, "slide"), (0.5, "ball"), (0.8, "slide")), {"acceleration": SWUNG}
        case "plain":
            pass
        case _:
            raise KeyError(name)
    scene = cs.Scene(masses=masses)
    return cable, start, end, scene.replace(clips=clips_at(cable, end, *held, scene=scene)), motion


NAMES = (
    "plain", "elastic", "rest table", "pinned", "free", "masses that are moved", "ball", "fixed and hinge",
    "hinge, then free", "table in a ball, masses", "eyelet", "eyelets and ball", "swung in clips",
    "swung through eyelets",
)  # fmt: skip


def all_columns(scene: cs.Scene) -> tuple[str, ...]:
    return ("end", *(f"clip:clip{k}" for k in range(len(scene.clips))), "length", "start", *NUMBERS[1:])


def turned(end, twist: np.ndarray):
    """The end, moved by a twist about the cable's end."""
    if isinstance(end, cs.FreeEnd):
        return end
    return (
        moved(end, twist[:3], twist[3:]) if isinstance(end, cs.Pose) else end.at(moved(end.pose, twist[:3], twist[3:]))
    )


def differences(name: str, by: str) -> np.ndarray:
    """(n, 3, 6) or (n, 3, 1)."""
    cable, start, end, scene, motion = case(name)
    predictor = cs.Predictor(cable, points=POINTS, tolerance=1e-9 * cable.length, scene=scene)

    def at(x: np.ndarray) -> np.ndarray:
        near, far, rod = start, end, predictor
        if by == "start":
            near = turned(start, x)
        elif by == "end":
            far = turned(end, x)
        elif by.startswith("clip:clip"):
            k = int(by.removeprefix("clip:clip"))
            clips = list(scene.clips)
            clips[k] = replace(clips[k], pose=moved(clips[k].pose, x[:3], x[3:]))
            predictor.scene = scene.replace(clips=clips)
        else:
            value = getattr(cable, by)
            changed = [v * (1.0 + x[0]) for v in value] if by == "bending_stiffness" else value * (1.0 + x[0])
            rod = cs.Predictor(
                cable.replace(**{by: changed}), points=POINTS, tolerance=1e-9 * cable.length, scene=scene
            )
        shape = rod.predict(near, far, **motion)
        assert shape.status is cs.Status.OK, shape.detail
        return shape.positions

    at(np.zeros(6))
    if by in NUMBERS:
        step = 1e-4 if by == "length" else 1e-3
        value = cable.mean_bending_stiffness if by == "bending_stiffness" else getattr(cable, by)
        return ((at(np.array((step,))) - at(np.array((-step,)))) / (2.0 * step * value))[:, :, None]
    return np.stack([(at(x) - at(-x)) / 1e-4 for x in 5e-5 * np.eye(6)], axis=2)


@pytest.mark.parametrize("name", NAMES)
def test_columns_are_central_differences(name: str) -> None:
    cable, start, end, scene, motion = case(name)
    predictor = cs.Predictor(cable, points=POINTS, tolerance=1e-9 * cable.length, scene=scene)
    assert predictor.predict(start, end, **motion).status is cs.Status.OK
    by = all_columns(scene)
    found = predictor.sensitivity(by)
    assert found.shape == (POINTS, 3, 6 * (2 + len(scene.clips)) + 4)
    first = 0
    for what in by:
        wanted = differences(name, what)
        columns = found[:, :, first : first + wanted.shape[2]]
        first += wanted.shape[2]
        size = max(1e-2, np.abs(wanted).max())
        np.testing.assert_allclose(columns, wanted, rtol=0.0, atol=3e-4 * size, err_msg=what)


places = st.tuples(st.floats(0.5, 0.8), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
turns = st.tuples(*[st.floats(-0.7, 0.7)] * 3)


@settings(max_examples=25, derandomize=True, deadline=None)
@given(places, turns, st.sampled_from([(), (0.4,), (0.3, 0.7)]), st.sampled_from(["ball", "hinge", "fixed", "slide"]))
def test_what_moves_as_one_moves_the_shape_and_what_scales_as_one_leaves_it(place, turn, shares, kind) -> None:
    end = moved(cs.Pose(place, START.quaternion), turn=turn)
    scene = cs.Scene(clips=clips_at(GENERAL, end, *((share, kind) for share in shares)))
    predictor = cs.Predictor(GENERAL, points=POINTS, tolerance=1e-8, scene=scene)
    shape = predictor.predict(START, end)
    if shape.status is not cs.Status.OK:  # nothing is asked of what has no shape
        return
    by = ("start", *(f"clip:clip{k}" for k in range(len(shares))), "end", "linear_density")
    found = predictor.sensitivity(by)
    together = found[:, :, :-1].reshape(POINTS, 3, -1, 6)
    loud = 1e-5 * max(1.0, np.abs(together).max())
    np.testing.assert_allclose(together.sum(axis=2)[:, :, :3], np.tile(np.eye(3), (POINTS, 1, 1)), atol=loud)
    # about the vertical through the world's origin: v = z x r of what is held, w = z
    at = np.array([START.position, *(clip.pose.position for clip in scene.clips), end.position])
    swung = np.concatenate((np.cross((0.0, 0.0, 1.0), at), np.tile((0.0, 0.0, 1.0), (len(at), 1))), axis=1)
    np.testing.assert_allclose(
        np.einsum("pikc,kc->pi", together, swung), np.cross((0.0, 0.0, 1.0), shape.positions), atol=loud
    )


@settings(max_examples=15, derandomize=True, deadline=None)
@given(places, turns, st.sampled_from([None, "ball", "hinge", "slide"]))
def test_stiffness_and_weight_that_grow_as_one_leave_the_shape(place, turn, kind) -> None:
    end = moved(cs.Pose(place, START.quaternion), turn=turn)
    scene = cs.Scene(clips=clips_at(WAVY, end, *(() if kind is None else ((0.4, kind),))))
    predictor = cs.Predictor(WAVY, points=POINTS, tolerance=1e-8, scene=scene)
    if predictor.predict(START, end).status is not cs.Status.OK:
        return
    numbers = ("bending_stiffness", "twisting_stiffness", "linear_density")
    found = predictor.sensitivity(numbers) * (0.01, 0.008, 0.1)
    assert np.abs(found).max() > 1e-3
    np.testing.assert_allclose(found.sum(axis=2), 0.0, atol=1e-4 * np.abs(found).max())


def test_columns_are_in_the_order_asked_for() -> None:
    name = "fixed and hinge"
    cable, start, end, scene, _ = case(name)
    named = scene.replace(clips=[replace(scene.clips[0], name="post"), scene.clips[1]])
    predictor = cs.Predictor(cable, points=POINTS, scene=named)
    predictor.predict(start, end)
    both = predictor.sensitivity()
    assert both.shape == (POINTS, 3, 12)
    np.testing.assert_array_equal(predictor.sensitivity(("start", "end")), both)
    mixed = predictor.sensitivity(["length", "clip:clip0", "end", "clip:post", "start"])
    np.testing.assert_array_equal(mixed[:, :, 7:13], both[:, :, 6:])
    np.testing.assert_array_equal(mixed[:, :, 19:], both[:, :, :6])
    np.testing.assert_array_equal(mixed[:, :, :1], predictor.sensitivity("length"))
    post = predictor.sensitivity(("clip:post",))
    np.testing.assert_array_equal(mixed[:, :, 13:19], post)
    held = np.abs(named.clips[0].arc_length - np.linspace(0.0, cable.length, POINTS)).argmin()
    assert np.abs(post[held, :, :3] - np.eye(3)).max() < 0.05  # next to it the cable goes with its clip


def test_at_the_gripper_only_ends_are_counted_about_another_origin() -> None:
    cable, start, _, scene, _ = case("fixed and hinge")
    grip = cs.Grip(END * cs.Pose((0.0, -0.05, -0.1)), offset=cs.Pose((0.0, 0.05, 0.1)))
    predictor = cs.Predictor(cable, points=POINTS, scene=scene)
    predictor.predict(start, grip)
    by = ("clip:clip1", "end", "twisting_stiffness")
    cabled, gripped = predictor.sensitivity(by), predictor.sensitivity(by, at="gripper")
    same = [*range(9), 12]
    np.testing.assert_array_equal(cabled[:, :, same], gripped[:, :, same])
    arm = grip.cable_frame.position - grip.pose.position
    for axis, spin in enumerate(np.eye(3)):
        np.testing.assert_allclose(
            gripped[:, :, 9 + axis] - cabled[:, :, 9 + axis], cabled[:, :, 6:9] @ np.cross(spin, arm), atol=1e-12
        )


def test_a_weightless_cable_may_become_heavy() -> None:
    light = CABLE.replace(linear_density=0.0)
    predictor = cs.Predictor(light, points=POINTS, tolerance=1e-9)
    predictor.predict(START, END)
    heavier = cs.Predictor(light.replace(linear_density=1e-5), points=POINTS, tolerance=1e-9).predict(START, END)
    wanted = (heavier.positions - predictor.predict(START, END).positions) / 1e-5
    np.testing.assert_allclose(
        predictor.sensitivity("linear_density")[:, :, 0], wanted, atol=1e-3 * np.abs(wanted).max()
    )


@pytest.mark.parametrize(
    ("by", "words"),
    [
        (
            ("start", "clip:post"),
            r"by = 'clip:post' .*Known: start, end, clip:guide, clip:clip0, length, .*, body:table",
        ),
        ("stiffness", r"by = 'stiffness' .*knows no derivative by it"),
        (("end", "start", "end"), r"by = 'end' .*named once"),
        ((), r"by = \(\) .*it must name something"),
        ((1,), r"by\[0\] = 1"),
        (None, r"by = None .*it must be a list"),
    ],
)
def test_names_that_mean_nothing_are_refused(by, words: str) -> None:
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -2.0)))
    clips = clips_at(CABLE, END, (0.3, "ball"), (0.6, "ball"))
    scene = cs.Scene(obstacles=[table], clips=[replace(clips[0], name="guide"), clips[1]])
    predictor = cs.Predictor(CABLE, points=POINTS, scene=scene)
    predictor.predict(START, END)
    with pytest.raises(cs.ArgumentError, match=words):
        predictor.sensitivity(by)
    assert not predictor.sensitivity(("body:table",)).any()


def test_a_body_in_contact_moves_the_cable_and_one_out_of_reach_does_not() -> None:
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.2)))
    predictor = cs.Predictor(CABLE, points=POINTS, scene=cs.Scene(obstacles=[table], contact="solve"))
    end = cs.Pose((0.7, 0.0, 0.0), START.quaternion)
    assert not predictor.predict(START, cs.Pose((1.15, 0.0, 0.0), START.quaternion)).contacts
    assert not predictor.sensitivity(("body:table",)).any()
    assert predictor.predict(START, end).contacts
    assert predictor.sensitivity(("body:table",)).any()
    both = predictor.sensitivity()
    turned_round = predictor.sensitivity(("end", "start"))
    np.testing.assert_allclose(turned_round, np.roll(both, 6, axis=2), atol=1e-12)
