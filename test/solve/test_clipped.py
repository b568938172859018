"""The rod held in clips: references, limits that are known otherwise, infeasible and bad scenes, sensitivity."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from clips import FREE, WEIGHT, arrays, on_the_free_shape
from references import label, references
from rods import ALONG_X, CABLE, END, GENERAL, LENGTH, START, integrated_residual, moved, sensitivities, solved
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.command.reference_case import reference_case
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.scene.scene import Clip, PointMass, Scene
from cable_shape.shape import CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

HELD = references("*clip*")


# -- references


def along_approach(values: dict, steps: int = 20) -> CableShape:
    """The shape reached from a straight cable, ends and clips moving as the case says."""
    case, path = reference_case(values), values["approach"]
    along_x = Rotation.from_quat((0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)))  # d3 = x, d2 = y
    origin = np.array(values["start"]["position"])
    state = None
    for t in np.linspace(0.0, 1.0, steps + 1):

        def at(s, goal, t=t) -> np.ndarray:
            return (1 - t) * (origin + np.array((0.97 * s, 0.0, 0.0))) + t * np.asarray(goal)

        clips = []
        for clip in case.scene.clips:
            turn = (Rotation.from_quat(clip.pose.quaternion) * along_x.inv()).as_rotvec()
            frame = Rotation.from_rotvec(t * turn) * along_x
            clips.append(
                Clip(clip.arc_length, Pose(at(clip.arc_length, clip.pose.position), frame.as_quat()), clip.kind)
            )
        scene = case.scene.replace(clips=clips)
        start = Pose(origin, (Rotation.from_rotvec(t * np.array(path["start_rotvec"])) * along_x).as_quat())
        end = case.end
        if isinstance(end, Grip):
            twist = Rotation.from_rotvec((0.0, 0.0, t * path["end_twist"]))
            frame = Rotation.from_rotvec(t * np.array(path["end_rotvec"])) * along_x * twist
            end = Pose(at(case.cable.length, values["end"]["position"]), frame.as_quat())
        problem = Problem(case.cable, points=len(values["solution"]["s"]), scene=scene, gravity=values["gravity"]).move(
            start, end
        )
        state = state or Network(problem)
        shape = cosserat.solve(problem, state)
        assert shape.status, (t, shape)
    return shape


@pytest.mark.parametrize("path", HELD, ids=label)
def test_reference_shape_along_its_approach(path):
    values = json.loads(path.read_text())
    shape, answer = along_approach(values), values["solution"]
    assert shape.status is Status.OK
    assert np.linalg.norm(shape.positions - answer["r"], axis=1).mean() < 1e-5 * shape.length
    scale = np.abs(answer["n"]).max()
    for load, event in zip(shape.clips, answer["events"], strict=True):
        jump = np.subtract(event["force_after"], event["force_before"])
        assert load.arc_length == pytest.approx(event["s"])
        assert load.force == pytest.approx(jump, abs=2e-4 * scale)
        jump = np.subtract(event["moment_after"], event["moment_before"])
        assert load.moment == pytest.approx(jump, abs=1e-3 * np.abs(answer["m"]).max())


@pytest.mark.parametrize("path", HELD, ids=label)
def test_smallest_eigenvalue_of_the_second_variation(path):
    values = json.loads(path.read_text())
    case = reference_case(values)
    problem = Problem(case.cable, gravity=values["gravity"], scene=case.scene, tolerance=1e-7 * case.cable.length)
    state = Network(problem.move(case.start, case.end))
    assert cosserat.solve(problem, state).status is Status.OK
    unit = max(*case.cable.bending_stiffness, case.cable.twisting_stiffness) / case.cable.length**2
    assert cosserat.smallest_eigenvalue(state) / unit == pytest.approx(values["solution"]["min_eig"], rel=3e-3)


# -- known otherwise


@pytest.mark.parametrize("kinds", [("ball",), ("ball", "ball"), ("fixed",), ("hinge", "ball"), ("slide",)])
def test_clips_on_the_free_shape_carry_nothing_and_change_nothing(kinds):
    places = zip((60, 160), kinds, strict=False)
    shape = solved(CABLE, START, END, scene=on_the_free_shape(*places), points=241, tolerance=1e-8 * LENGTH)
    assert shape.status is Status.OK
    assert shape.positions == pytest.approx(FREE.positions, abs=3e-8)
    assert shape.energy == pytest.approx(FREE.energy, abs=1e-8)
    assert shape.twist == pytest.approx(FREE.twist, abs=1e-6)
    scale = np.abs(FREE.force).max()
    for load in shape.clips:
        assert np.abs(load.force).max() < 1e-5 * scale
        assert np.abs(load.moment).max() < 1e-5 * np.abs(FREE.moment).max()


def test_a_fixed_clip_leaves_two_cables_that_know_nothing_of_each_other():
    cable = CABLE.replace(bending_stiffness=(0.01, 0.02), rest_curvature=(0.5, 0.0, 0.3), axial_stiffness=100.0)
    frame = moved(Pose((0.43, 0.12, -0.1), ALONG_X), turn=(0.2, 0.3, 0.4))
    end = moved(Pose((0.8, 0.2, 0.0), ALONG_X), turn=(0.3, -0.2, 0.3))
    scene = Scene(clips=[Clip(0.6, frame, "fixed")], masses=[PointMass(0.9, 0.02)])
    whole = solved(cable, START, end, scene=scene, points=81, tolerance=1e-7)
    half = cable.replace(length=0.6)
    left = solved(half, START, frame, points=41, tolerance=1e-7)
    right = solved(half, frame, end, points=41, tolerance=1e-7, scene=Scene(masses=[PointMass(0.3, 0.02)]))
    assert whole.positions[:41] == pytest.approx(left.positions, abs=2e-7)
    assert whole.positions[40:] == pytest.approx(right.positions, abs=2e-7)
    assert whole.force[0] == pytest.approx(left.force[0], rel=1e-4)
    assert whole.moment[-1] == pytest.approx(right.moment[-1], abs=1e-4 * np.abs(right.moment).max())
    assert whole.energy == pytest.approx(left.energy + right.energy, abs=3e-7)
    (load,) = whole.clips
    assert load.force == pytest.approx(right.force[0] - left.force[-1], abs=1e-4 * np.abs(whole.force).max())
    assert load.moment == pytest.approx(right.moment[0] - left.moment[-1], abs=1e-4 * np.abs(whole.moment).max())


def test_between_clips_the_points_satisfy_the_rod_equations_integrated_independently():
    cable = CABLE.replace(bending_stiffness=(0.01, 0.02), axial_stiffness=30.0, shear_stiffness=20.0)
    scene = on_the_free_shape((60, "ball"), (160, "hinge"), shift=(0.0, 0.01, 0.02))
    shape = solved(cable, START, END, scene=scene, points=241, tolerance=1e-8 * LENGTH)
    for a, b in ((0, 60), (60, 160), (160, 241)):
        part = CableShape(np.concatenate([array[a:b].ravel() for array in arrays(shape)]), b - a, length=LENGTH,
                          model="part", status=Status.OK)  # fmt: skip
        assert integrated_residual(cable, part, np.array((0.0, 0.0, -WEIGHT))) < 1e-5


def test_forces_on_grips_and_clips_carry_the_weight():
    scene = Scene(clips=on_the_free_shape((60, "ball"), (160, "fixed"), shift=(0, 0, 0.03)).clips,
                  masses=[PointMass(0.5, 0.1), PointMass(FREE.arc_length[160], 0.05)])  # fmt: skip
    shape = solved(CABLE, START, END, scene=scene, points=241)
    assert shape.status is Status.OK
    on_all = shape.force[0] - shape.force[-1] + sum(load.force for load in shape.clips)
    assert on_all == pytest.approx((0, 0, -9.81 * (0.1 * LENGTH + 0.15)), abs=1e-8)
    for load, i in zip(shape.clips, (60, 160), strict=True):
        assert load.arc_length == pytest.approx(shape.arc_length[i])
        mass = 0.05 if i == 160 else 0.0
        step = WEIGHT * LENGTH / 240  # the point before the clip is one spacing away
        jump = shape.force[i] - shape.force[i - 1]
        assert jump == pytest.approx(load.force + np.array((0, 0, step + 9.81 * mass)), abs=1e-8)


def test_a_hinge_holds_the_tangent_and_lets_the_cable_roll():
    turn = Rotation.from_quat(FREE.quaternions[120]) * Rotation.from_rotvec((0.3, 0.0, 1.0))
    clip = Clip(0.6, Pose(FREE.positions[120], turn.as_quat()), "hinge")
    shape = solved(CABLE, START, END, scene=Scene(clips=[clip]), points=241)
    assert shape.status is Status.OK
    tangent = turn.apply((0.0, 0.0, 1.0))
    assert shape.tangents[120] == pytest.approx(tangent, abs=1e-6)
    (load,) = shape.clips
    assert abs(load.moment @ tangent) < 1e-6 * np.abs(load.moment).max()
    assert np.linalg.norm(load.moment) > 1e-3
    rolled = Clip(0.6, Pose(clip.pose.position, (turn * Rotation.from_rotvec((0, 0, 0.7))).as_quat()), "hinge")
    again = solved(CABLE, START, END, scene=Scene(clips=[rolled]), points=241)
    assert again.positions == pytest.approx(shape.positions, abs=1e-6)


def test_a_free_end_beyond_the_last_clip_hangs_as_a_cable_of_its_own():
    """Clamped in a fixed clip, what hangs beyond is a cantilever with a plug."""
    frame = Pose((0.5, 0.0, 0.1), ALONG_X)
    plug = FreeEnd(mass=0.05)
    shape = solved(CABLE, START, plug, scene=Scene(clips=[Clip(0.6, frame, "fixed")]), points=81)
    alone = solved(CABLE.replace(length=0.6), frame, plug, points=41)
    assert shape.positions[40:] == pytest.approx(alone.positions, abs=1.5e-5)
    assert shape.force[-1] == pytest.approx((0, 0, -9.81 * 0.05))


@pytest.mark.parametrize("kind", ["swivel", "pinned"])
def test_ends_may_turn(kind):
    scene = on_the_free_shape((80, "ball"), shift=(0.0, 0.02, 0.0))
    shape = solved(CABLE, Grip(START, kind=kind), Grip(END, kind=kind), scene=scene)
    assert shape.status is Status.OK
    scale = np.abs(shape.moment).max()
    for i in (0, -1):
        local = Rotation.from_quat(shape.quaternions[i]).inv().apply(shape.moment[i])
        assert abs(local[2]) < 1e-5 * scale
        assert kind == "swivel" or np.abs(local).max() < 1e-5 * scale


def test_ten_clips():
    """Held at the points of a catenary-like curve: every span is short and hangs by itself."""
    arcs = LENGTH * np.arange(1, 11) / 11
    places = np.stack((0.8 * arcs / LENGTH, 0.02 * np.sin(9 * arcs), -0.1 * np.sin(np.pi * arcs / LENGTH)), axis=1)
    scene = Scene(clips=[Clip(s, Pose(r)) for s, r in zip(arcs, places, strict=True)])
    end = Pose((0.8, 0, 0), ALONG_X)
    shape = solved(CABLE, START, end, scene=scene, points=111)
    assert shape.status is Status.OK
    assert shape.positions[10:101:10] == pytest.approx(places, abs=1e-8)
    assert shape.error_estimate <= 1e-5 * LENGTH
    fine = solved(CABLE, START, end, scene=scene, points=111, tolerance=1e-8 * LENGTH)
    assert np.linalg.norm(shape.positions - fine.positions, axis=1).max() <= shape.error_estimate
    total = shape.force[0] - shape.force[-1] + sum(load.force for load in shape.clips)
    assert total == pytest.approx((0, 0, -WEIGHT * LENGTH), abs=1e-8)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_the_true_error_is_below_the_estimate_and_not_far_below(tolerance):
    scene = on_the_free_shape((60, "ball"), (160, "hinge"), shift=(0.01, 0.01, 0.03))
    exact = solved(CABLE, START, END, scene=scene, tolerance=1e-10 * LENGTH)
    shape = solved(CABLE, START, END, scene=scene, tolerance=tolerance * LENGTH)
    error = np.linalg.norm(shape.positions - exact.positions, axis=1).max()
    assert error <= shape.error_estimate <= min(6.0 * error, tolerance * LENGTH)


# -- infeasible


def test_a_span_that_is_too_short_is_named_before_anything_is_solved():
    scene = Scene(clips=[Clip(0.3, Pose((0.2, 0, 0))), Clip(0.5, Pose((0.45, 0, 0)))])
    shape = solved(CABLE, START, Pose((0.8, 0, 0), ALONG_X), scene=scene, points=25)
    assert shape.status is Status.OVERSTRETCHED
    assert "clips[0] and clips[1] are 0.25 m apart" in shape.detail
    assert "0.05 m more" in shape.detail
    assert shape.iterations == 0
    assert shape.positions[[0, 6, 10, 24]] == pytest.approx(
        np.array(((0, 0, 0), (0.2, 0, 0), (0.45, 0, 0), (0.8, 0, 0)))
    )
    assert np.isfinite(shape.buffer).all()


def test_overstretch_and_back():
    predictor = cs.Predictor(CABLE, model="cosserat", scene=Scene(clips=[Clip(0.6, Pose((0.5, 0, 0)))]))
    seen = {}
    for chord in (1.0, 1.08, 1.0999, 1.1, 1.2, 1.0999, 1.08, 1.0):
        shape = predictor.predict(START, Pose((chord, 0, 0), ALONG_X))
        assert np.isfinite(shape.buffer).all()
        if chord >= 1.1:
            assert shape.status is Status.OVERSTRETCHED
            assert "clips[0] and the end grip" in shape.detail
        else:
            assert shape.status is Status.OK, (chord, shape)
            mirrored = shape.positions * (1.0, -1.0, 1.0)  # from straight on it bows to either side
            apart = min(abs(p - seen.setdefault(chord, p)).max() for p in (shape.positions, mirrored))
            assert apart < 5e-5


def test_an_elastic_cable_stretches_between_its_clips():
    """Straight between two clips, without weight: tension EA (chord / length - 1)."""
    cable = CABLE.replace(axial_stiffness=200.0, linear_density=0.0)
    scene = Scene(clips=[Clip(0.4, Pose((0.42, 0, 0))), Clip(0.8, Pose((0.86, 0, 0)))])
    shape = solved(cable, START, Pose((1.28, 0, 0), ALONG_X), scene=scene, points=13)
    assert shape.status is Status.OK
    assert shape.tension[[1, 6, 10]] == pytest.approx(np.array((10.0, 20.0, 10.0)), abs=1e-8)
    assert [load.force[0] for load in shape.clips] == pytest.approx([10.0, -10.0], abs=1e-8)


# -- refused


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Scene(clips=[Clip(0.5, END), Clip(0.4, END)]), r"clips\[1\]\.arc_length = 0\.4 .*above .*order"),
        (lambda: Scene(clips=[Clip(0.5, END), Clip(0.5, END)]), r"clips\[1\].* = 0\.5 .*above that of clips\[0\]"),
        (lambda: Clip(0.5, Pose(turns=1)), r"Clip\.pose\.turns = 1 "),
        (lambda: Problem(CABLE, scene=Scene(clips=[Clip(1.3, END)])), r"clips\[0\].* = 1\.3 .*at most 1\.1988 m"),
        (lambda: Problem(CABLE, scene=Scene(clips=[Clip(1.2, END)])), r"clips\[0\].* held by a grip"),
        (lambda: Problem(CABLE, scene=Scene(clips=[Clip(0.0, END)])), r"clips\[0\].* = 0\.0 .*the start grip"),
        (
            lambda: Problem(CABLE, scene=Scene(clips=[Clip(0.5, END), Clip(0.5001, END)])),
            r"clips\[1\]\.arc_length = 0\.5001 .*beyond clips\[0\]",
        ),
        (
            lambda: Problem(CABLE, scene=Scene(clips=[Clip(0.5, END, "slide")], masses=[PointMass(0.5, 0.1)])),
            r"clips\[0\]\.arc_length = 0\.5 .*run through an eyelet",
        ),
        (
            lambda: cs.Predictor(CABLE.replace(bending_stiffness=0.0), scene=Scene(clips=[Clip(0.5, END)])),
            "bending stiffness above 0",
        ),
        (lambda: Network(Problem(CABLE.replace(bending_stiffness=0.0, twisting_stiffness=0.0),
                                   scene=Scene(clips=[Clip(0.5, END)]))), "catenary"),
        (lambda: cosserat.sensitivity(Network(Problem(CABLE, scene=Scene(clips=[Clip(0.5, END)])))), "predict first"),
    ],
)  # fmt: skip
def test_bad_clips_are_refused_by_name(make, words):
    with pytest.raises(cs.ArgumentError, match=words):
        make()


# -- sensitivity


@pytest.mark.parametrize("ends", [("clamped", "clamped"), ("swivel", "pinned"), ("pinned", "free")])
@pytest.mark.parametrize("clips", [("ball", "ball"), ("fixed", "hinge")])
def test_sensitivity_against_finite_differences(ends, clips):
    scene = on_the_free_shape((80, clips[0]), (160, clips[1]), shift=(0.01, 0.0, 0.03))
    state = Network(Problem(GENERAL, points=21, tolerance=1e-7, scene=scene))
    found, differences = sensitivities(cosserat, state, ends)
    assert found == pytest.approx(differences, abs=4e-4)


def test_sensitivity_at_the_gripper_includes_its_offset():
    offset = Pose((0.0, 0.05, 0.1), (0.0, 0.6, 0.0, 0.8))
    grip = Grip(Pose((0.6, 0.2, -0.1), (0.1, 0.7, 0.1, 0.7)), offset=offset)
    predictor = cs.Predictor(CABLE, model="cosserat", points=11, tolerance=1e-8, scene=on_the_free_shape((60, "ball")))
    predictor.predict(START, grip)
    J = predictor.sensitivity(at="gripper")
    for axis, turn in enumerate(2e-5 * np.eye(3)):
        ahead = predictor.predict(START, grip.at(moved(grip.pose, turn=turn))).positions
        behind = predictor.predict(START, grip.at(moved(grip.pose, turn=-turn))).positions
        assert J[:, :, 9 + axis] == pytest.approx((ahead - behind) / 4e-5, abs=2e-4)


@pytest.mark.parametrize(
    ("length", "bend", "twist", "mass", "at", "places"),
    [
        (1.0294, 0.026, 0.02, 0.51, (0.6014, 0.859), ((0.5792, -0.0149, 0.86), (0.8092, -0.0258, 0.9329))),
        (
            1.0293500373805693, 0.026134820587709842, 0.020103708144392187, 0.5102696798653522,
            (0.6014033408206416, 0.8592498629310812),
            ((0.5792189475368971, -0.014940394754887188, 0.8599686080028885),
             (0.8091572016180508, -0.025760097664344533, 0.9329129560285156)),
        ),
    ],
    ids=["nothing", "itself"],
)  # fmt: skip
def test_what_bends_too_sharply_for_a_coarse_mesh_is_found_on_a_finer_one(length, bend, twist, mass, at, places):
    """From nothing in the one, from the shape in the other: between hinge and eyelet the cable is all but straight."""
    along_x = Pose(quaternion=(0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)))
    cable = cs.Cable(length=length, linear_density=0.1, bending_stiffness=bend, twisting_stiffness=twist)
    kinds = zip(at, places, ("hinge", "slide"), strict=True)
    clips = [Clip(arc, Pose(place) * along_x, kind) for arc, place, kind in kinds]
    scene = Scene(clips=clips, masses=[PointMass(mass, 0.01)])
    ends = Pose((-0.0050413001540199716, 0.0, 1.0)) * along_x, Pose((0.9625477349837152, 0.0, 1.0)) * along_x
    shape = cs.Predictor(cable, scene=scene).predict(*ends)
    assert shape.status is Status.OK
    again = cs.Predictor(cable, scene=scene)
    again.begin(shape, ends, None)
    again.look_again()
    found = again.solve()
    assert found.status is Status.OK
    assert np.abs(found.positions - shape.positions).max() < 1e-5 * cable.length
