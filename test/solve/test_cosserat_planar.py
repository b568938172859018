"""Cables that ends, loads and rest curvature leave in a plane: they stay in it until they buckle out of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rods import ALONG_X, CABLE, moved
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.network import respond
from cable_shape.safety.margins import MarginWatch
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

START, ACROSS = cs.Pose((0, 0, 0), ALONG_X), cs.Pose((0.8, 0, 0), ALONG_X)


def motion(steps: int = 40) -> list[cs.Pose]:
    """End poses in the plane y = 0, the end lifted and pitched."""
    x = np.arange(1, steps + 1) / steps
    return [moved(ACROSS, (-0.2 * a, 0, 0.1 * math.sin(math.pi * a) + 0.1 * a), (0, -0.7 * a, 0)) for a in x]


class RandomCase:
    """A cable, loads and ends in a random plane of the world; ends(k) makes the ends of a motion in it."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.world = Rotation.random(rng=rng)
        length, ei = rng.uniform(0.5, 2.0), 10 ** rng.uniform(-3.0, -0.5)
        ribbon = rng.random() < 0.5
        self.roll = Rotation.from_euler("z", math.pi / 2 * rng.integers(4) if ribbon else rng.uniform(0, 2 * math.pi))
        normal = (Rotation.from_quat(ALONG_X) * self.roll).inv().apply((0.0, 1.0, 0.0))
        self.normal = normal  # of the plane, in the cable frame
        rest = ((0, 0, 0), 1.5 / length * rng.normal() * normal, np.outer(1.5 / length * rng.normal(size=5), normal))
        self.cable = cs.Cable(
            length=length,
            linear_density=10 ** rng.uniform(-2.0, 0.0),
            bending_stiffness=(ei, ei * rng.uniform(0.4, 3.0) if ribbon else ei),
            twisting_stiffness=ei * rng.uniform(0.4, 1.5),
            rest_curvature=rest[rng.choice(3, p=(0.6, 0.2, 0.2))],
            axial_stiffness=10 ** rng.uniform(1.5, 4.0) if rng.random() < 0.4 else None,
            shear_stiffness=10 ** rng.uniform(1.5, 4.0) if rng.random() < 0.2 else None,
        )
        masses = [cs.PointMass(length * rng.uniform(0.1, 0.9), 0.1 * rng.random()) for _ in range(rng.integers(3))]
        self.options = {
            "gravity": 9.81 * self.direction(rng.uniform(0, 2 * math.pi)),
            "scene": cs.Scene(masses=masses) if masses else None,
            "distributed_load": rng.normal(size=(2, 1)) * self.direction(rng.uniform(0, 7)) if seed % 3 == 0 else None,
        }
        self.free = cs.FreeEnd(0.05 * rng.random(), 0.2 * self.direction(rng.uniform(0, 7))) if seed % 5 == 0 else None
        chord, self.along = rng.uniform(0.5, 0.95) * length, rng.uniform(0, 2 * math.pi)
        self.tangents = self.along + 0.5 * rng.normal(size=2)
        self.end = chord * self.direction(self.along)
        self.speed = rng.normal(size=4) * (0.02, 0.02, 0.05, 0.05)

    def direction(self, angle: float) -> np.ndarray:
        """In the plane, world axes."""
        return np.asarray(self.world.apply((math.cos(angle), 0.0, math.sin(angle))))

    def ends(self, k: int) -> tuple:
        """Of the motion's step k."""
        a, b = (
            (self.world * Rotation.from_euler("y", -angle) * Rotation.from_quat(ALONG_X) * self.roll).as_quat()
            for angle in self.tangents + k * self.speed[2:]
        )
        shift = self.cable.length * k * self.speed[:2]
        place = self.end + shift[0] * self.direction(self.along) + shift[1] * self.direction(self.along + math.pi / 2)
        return cs.Pose((0, 0, 0), a), cs.Pose(place, b) if self.free is None else self.free


def test_random_planar_problems_are_stable_in_their_plane_or_clearly_out_of_it():
    """Nothing drifts out of it: what leaves it is far below the tolerance, or a shape that has buckled."""
    flat = buckled = 0
    for seed in range(150):
        case = RandomCase(seed)
        state = Network(Problem(case.cable, **case.options))
        outside = False
        for k in range(4):
            shape = cosserat.solve(state.problem.move(*case.ends(k)), state)
            if shape.status is not cs.Status.OK:
                continue
            to_plane = case.world.inv()
            across = np.abs(to_plane.apply(shape.positions)[:, 1]).max() / case.cable.length
            if across > 1e-4:
                buckled += 1
                outside = True
                continue
            flat += 1
            assert across < 1e-6, (seed, k)
            if outside:  # solved for from shapes out of the plane, to the tolerance
                continue
            normals = to_plane.apply(Rotation.from_quat(shape.quaternions).apply(case.normal))
            assert np.abs(normals - (0.0, 1.0, 0.0)).max() < 1e-5, (seed, k)
            force, moment = to_plane.apply(shape.force), to_plane.apply(shape.moment)
            assert np.abs(force[:, 1]).max() < 1e-5 * np.abs(force).max(), (seed, k)
            assert np.abs(moment[:, (0, 2)]).max() < 1e-5 * np.abs(moment).max(), (seed, k)
            assert cosserat.smallest_eigenvalue(state) > -state.neutral, (seed, k)
    assert flat > 400
    assert buckled > 100


@pytest.mark.parametrize("load", [0.99, 1.01])
def test_a_ribbon_leaves_its_plane_where_it_buckles_sideways(load):
    """Michell and Prandtl: a cantilever with a dead load P at its tip does at P L^2 = 4.0126 sqrt(EI GJ)."""
    ribbon = cs.Cable(1.0, 0.0, (1.0, 1e4), 0.8)  # under the load it bends about d2, hardly
    root = cs.Pose((0, 0, 0), (0, math.sqrt(0.5), 0, math.sqrt(0.5)))  # d1 = -z, d3 = x
    tip = cs.FreeEnd(force=(0, 0, -load * 4.012599 * math.sqrt(0.8)))
    shape = cosserat.solve(Problem(ribbon, gravity=(0, 0, 0)).move(root, tip))
    assert shape.status is cs.Status.OK
    across = np.abs(shape.positions[:, 1]).max()
    assert across > 1e-3 if load > 1.0 else across < 1e-9


def test_a_motion_leaves_its_plane_and_comes_back_without_a_jump():
    """Tilts of a millionth: the cable moves across by as little, and not a bit longer than they last."""
    state, last = Network(Problem(CABLE)), None
    for k, end in enumerate(motion(20)):
        tilt = {8: 1e-6, 9: 2e-6, 10: 1e-6}.get(k, 0.0)
        shape = cosserat.solve(state.problem.move(START, moved(end, turn=(0.0, 0.0, tilt))), state)
        across = float(np.abs(shape.positions[:, 1]).max()) / CABLE.length
        assert shape.status is cs.Status.OK
        assert 0.05 * tilt < across < tilt if tilt else across < 1e-10
        if last is not None:
            assert np.abs(shape.positions - last.positions).max() < 0.05 * CABLE.length
        last = shape


@pytest.mark.parametrize("stiffness", [0.01, (0.01, 0.02), (0.012, 0.01)])
def test_the_softest_mode_of_a_planar_cable_is_found_out_of_its_plane_too(stiffness):
    """By inverse iteration beside bisection over inertias, from which no symmetry hides a mode."""
    cable = CABLE.replace(bending_stiffness=stiffness)
    state = Network(Problem(cable))
    for end in motion(12):
        cosserat.solve(state.problem.move(START, end), state)
        mode, told = np.zeros((state.elements + 1, 3)), np.empty(2)
        mode[:, 1] = np.sin(np.linspace(0.0, math.pi, state.elements + 1))  # in the plane, nothing out of it
        network = state.ints, state.floats, state.sols, state.work
        respond.softest_mode(*network, np.empty(0), mode, 200, True, told)
        assert told[0] == pytest.approx(cosserat.smallest_eigenvalue(state), rel=3e-3)


def test_what_else_uses_the_rods_memory_does_not_change_its_stability():
    """A sensitivity or an eigenvalue between a solve and its margins writes where the solve has left its factors."""
    state = Network(Problem(CABLE))
    watches = [MarginWatch(CABLE, cs.Scene()) for _ in range(2)]
    ask = (lambda state: None, cosserat.sensitivity, cosserat.smallest_eigenvalue)
    for k, end in enumerate(motion(12)):
        shape = cosserat.solve(state.problem.move(START, end), state)
        watches[0].margins(shape, cs.Clearance(), 10_000_000 * k, state=state)
        ask[k % 3](state)
        watches[1].margins(shape, cs.Clearance(), 10_000_000 * k, state=state)
        assert watches[1].stability.value == pytest.approx(watches[0].stability.value, rel=1e-3), k
