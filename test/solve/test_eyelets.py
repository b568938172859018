"""Clips through which the cable runs, and points of the cable whose place is an unknown of its own."""

from __future__ import annotations

import json

import numpy as np
import pytest
from references import label, references
from rods import ALONG_X, CABLE, END, GENERAL, LENGTH, START, moved, sensitivities, solved

import cable_shape as cs
from cable_shape.command.reference_case import reference_case
from cable_shape.pose import Pose
from cable_shape.scene.scene import Clip, PointMass, Scene
from cable_shape.shape import Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

FREE = cs.predict(CABLE, START, END, model="cosserat", points=241)
ACROSS = Pose((0.8, 0.0, 0.0), ALONG_X)


def eyelet(arc_length: float, position, **others) -> Scene:
    return Scene(clips=[Clip(arc_length, Pose(position), "slide")], **others)


# -- eyelets


@pytest.mark.parametrize("path", references("eyelet*"), ids=label)
def test_the_cable_runs_to_where_collocation_has_it(path):
    values = json.loads(path.read_text())
    case = reference_case(values)
    shape = solved(case.cable, case.start, case.end, scene=case.scene, tolerance=1e-8 * case.cable.length)
    for load, event in zip(shape.clips, values["solution"]["events"], strict=True):
        assert load.arc_length == pytest.approx(event["s"], abs=1e-7)
        jump = np.subtract(event["force_after"], event["force_before"])
        assert load.force == pytest.approx(jump, abs=1e-5 * np.linalg.norm(jump))
        assert load.moment == pytest.approx(np.zeros(3), abs=1e-7)


@pytest.mark.parametrize("first", [0.45, 0.5, 0.6, 0.75])
def test_a_cable_pulled_up_by_its_middle_settles_in_the_middle(first):
    shape = solved(CABLE, START, ACROSS, scene=eyelet(first, (0.4, 0.0, 0.4)))
    assert shape.status is Status.OK
    (load,) = shape.clips
    assert load.arc_length == pytest.approx(0.6, abs=2e-6)
    assert load.force[:2] == pytest.approx((0.0, 0.0), abs=1e-3 * abs(load.force[2]))
    assert load.moment == pytest.approx(np.zeros(3), abs=1e-6)


def test_the_eyelet_pulls_across_the_cable_and_the_energy_is_least():
    place = FREE.positions[90] + (0.01, 0.03, 0.05)
    shape = solved(CABLE, START, END, scene=eyelet(0.5, place), points=1201, tolerance=1e-8)
    assert shape.status is Status.OK
    (load,) = shape.clips
    i = round(load.arc_length / LENGTH * 1200)
    tangent = shape.tangents[i - 2 : i + 3].mean(axis=0)
    assert abs(load.force @ tangent) < 2e-2 * np.linalg.norm(load.force)
    energies = []
    for shift in (-2e-4, 0.0, 2e-4):
        clip = Clip(load.arc_length + shift, Pose(place))
        energies.append(solved(CABLE, START, END, scene=Scene(clips=[clip]), tolerance=1e-10).energy)
    a, b, c = energies
    assert shape.energy == pytest.approx(b, abs=1e-8)
    assert abs(c - a) < 0.02 * (a + c - 2.0 * b)  # the slope in sigma, next to its curvature
    assert a + c > 2.0 * b


def test_an_eyelet_in_which_the_cable_balances_is_left_for_one_where_it_rests():
    """Hanging over its middle with slack on both sides, the cable runs to the side that is heavier by a hair."""
    shape = solved(CABLE, START, ACROSS, scene=eyelet(0.6, (0.4, 0.0, 0.1)))
    assert shape.status is Status.OK
    assert abs(shape.clips[0].arc_length - 0.6) > 0.1
    balanced = solved(CABLE, START, ACROSS, scene=Scene(clips=[Clip(0.6, Pose((0.4, 0.0, 0.1)))]))
    assert balanced.status is Status.OK
    assert shape.energy < balanced.energy - 1e-3


def test_a_cable_through_two_eyelets_and_a_clip_is_followed_warm():
    predictor = cs.Predictor(CABLE, model="cosserat")
    clips = [Clip(0.3, Pose((0.25, 0, 0.05)), "slide"), Clip(0.6, Pose((0.45, 0.1, 0.0))),
             Clip(0.8, Pose((0.6, 0.15, 0.05)), "slide")]  # fmt: skip
    predictor.scene = Scene(clips=clips)
    assert predictor.predict(START, END).status is Status.OK
    for k in range(1, 6):
        shape = predictor.predict(START, moved(END, (-0.005 * k, 0.002 * k, 0.003 * k), (0.0, 0.02 * k, 0.0)))
        assert shape.status is Status.OK
        assert shape.iterations <= 15
    held = Scene(clips=[Clip(load.arc_length, clip.pose) for load, clip in zip(shape.clips, clips, strict=True)])
    again = solved(CABLE, START, moved(END, (-0.025, 0.01, 0.015), (0.0, 0.1, 0.0)), scene=held)
    assert again.positions == pytest.approx(shape.positions, abs=2e-5)
    assert shape.clips[1].arc_length == 0.6


def test_a_jump_through_an_eyelet_is_said():
    """Followed further, the same cable loses its stability: once, at the same place however small the steps."""
    clips = [Clip(0.3, Pose((0.25, 0, 0.05)), "slide"), Clip(0.6, Pose((0.45, 0.1, 0.0))),
             Clip(0.8, Pose((0.6, 0.15, 0.05)), "slide")]  # fmt: skip
    for steps in (8, 80):
        predictor = cs.Predictor(CABLE, model="cosserat", scene=Scene(clips=clips))
        snapped, last = [], predictor.predict(START, END).positions
        for k in np.linspace(0.0, 8.0, steps + 1)[1:]:
            end = moved(END, (-0.005 * k, 0.002 * k, 0.003 * k), (0.0, 0.02 * k, 0.0))
            shape = predictor.predict(START, end)
            assert shape.status
            if shape.status is Status.SNAPPED:
                snapped.append(k)
                assert np.abs(shape.positions - last).max() > 0.05
            last = shape.positions
        assert len(snapped) == 1
        assert 7.5 < snapped[0] <= 8.0


def test_an_eyelet_moved_by_the_scene_keeps_what_has_run_through_it():
    predictor = cs.Predictor(CABLE, model="cosserat", scene=eyelet(0.45, (0.4, 0.0, 0.35)))
    predictor.predict(START, ACROSS)
    predictor.scene = eyelet(0.45, (0.4, 0.0, 0.36))
    shape = predictor.predict(START, ACROSS)
    assert shape.status is Status.OK
    assert shape.clips[0].arc_length == pytest.approx(0.6, abs=2e-6)
    assert shape.iterations < 12


def test_a_cable_that_nothing_holds_runs_through_and_that_is_said():
    shape = solved(CABLE, START, None, scene=eyelet(1.0, (0.3, 0.0, 0.0), masses=[PointMass(0.3, 0.3)]))
    assert shape.status is Status.NOT_CONVERGED
    assert "eyelet" in shape.detail
    assert "nothing holds it" in shape.detail
    assert "'ball'" in shape.detail
    assert np.isfinite(shape.buffer).all()


def test_a_mass_does_not_pass_an_eyelet():
    """The mass pulls the cable through until it reaches the eyelet: no equilibrium without it hanging there."""
    shape = solved(CABLE, START, ACROSS, scene=eyelet(0.3, (0.4, 0.0, 0.3), masses=[PointMass(0.62, 0.02)]))
    if shape.status:
        assert shape.clips[0].arc_length < 0.62
    else:
        assert "mass" in shape.detail


def test_eyelets_too_far_apart_are_overstretched_as_a_whole():
    shape = solved(CABLE, START, ACROSS, scene=eyelet(0.3, (0.4, 0.0, 0.5)))
    assert shape.status is Status.OVERSTRETCHED
    assert "through the eyelets" in shape.detail
    near = solved(CABLE, START, ACROSS, scene=eyelet(0.3, (0.4, 0.0, 0.42)))  # 0.58 m to the grip, more than 0.3 m
    assert near.status is Status.OK


@pytest.mark.parametrize("ends", [("clamped", "clamped"), ("swivel", "pinned"), ("clamped", "free")])
def test_sensitivity_lets_the_cable_run_through_its_eyelets(ends):
    clips = [Clip(0.4, Pose(FREE.positions[80] + (0.01, 0.02, 0.02)), "slide"),
             Clip(0.8, Pose(FREE.positions[160] + (0.0, -0.03, 0.02)), "slide")]  # fmt: skip
    state = Network(Problem(GENERAL, points=22, tolerance=1e-8, scene=Scene(clips=clips)))
    found, differences = sensitivities(cosserat, state, ends)
    away = np.abs(np.linspace(0.0, LENGTH, 22)[:, None] - state.arcs[1:-1]).min(axis=1) > 1e-3  # r' jumps at an eyelet
    assert found[away] == pytest.approx(differences[away], abs=2e-4)


def test_where_the_cable_would_run_on_it_is_unstable():
    """A long end over a smooth edge: at rest where the energy, by balls at other arc lengths, is highest."""
    cable = cs.Cable(length=1.133781670847165, linear_density=0.1, bending_stiffness=0.024415584753009492)
    along_x = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))
    eye, start = Pose((0.7804, -0.0012, 0.9441), along_x), Pose((-0.0318, 0.0, 1.0), along_x)

    def held(arc_length, kind):
        scene = Scene(clips=[Clip(arc_length, eye, kind)], masses=[PointMass(0.5338, 0.01)])
        return cs.predict(cable, start, None, scene=scene, model="cosserat")

    found = held(0.8692, "slide")
    assert found.status is Status.UNSTABLE
    assert "disturbed, the cable runs on through its eyelets" in found.detail
    at = found.clips[0].arc_length
    before, here, beyond = (held(at + by, "ball").energy for by in (-0.003, 0.0, 0.003))
    assert here > max(before, beyond)
