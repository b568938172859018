"""The cable as it swings: rest, order in time, energy, its matrix, masses and clips, and what is refused."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.network import momentum, moving, settle, swinging, system, tables
from cable_shape.motion.finer import FINEST

ALONG = (0.5, 0.5, 0.5, 0.5)  # d3 along x
DOWN = (1.0, 0.0, 0.0, 0.0)
CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01)
START, END = cs.Pose((0.0, 0.0, 0.0), ALONG), cs.Pose((0.7, 0.0, 0.0), ALONG)


def smooth(t: float, whole: float) -> float:
    """From 0 to 1 in the time `whole`, three times differentiable."""
    x = min(max(t / whole, 0.0), 1.0)
    return x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)


def swung(cable: cs.Cable, dt: float, seconds: float, way: float = 0.1, whole: float = 0.4) -> list[cs.CableShape]:
    """Both grips are moved sideways, one further than the other."""
    motion = cs.Motion(cable, points=41)
    shapes = [motion.begin(START, END)]
    for k in range(1, round(seconds / dt) + 1):
        y = way * smooth(k * dt, whole)
        shapes.append(motion.step(cs.Pose((0.0, y, 0.0), ALONG), cs.Pose((0.7, 0.5 * y, 0.3 * y), ALONG), dt))
    assert all(shape.status is cs.Status.OK for shape in shapes)
    return shapes


def test_it_begins_at_rest_and_stays_there():
    motion, still = cs.Motion(CABLE, points=41), cs.predict(CABLE, START, END, points=41)
    first = motion.begin(START, END)
    assert np.abs(first.positions - still.positions).max() <= first.error_estimate < 1e-4 * CABLE.length
    assert first.energy == pytest.approx(still.energy, rel=1e-3)
    np.testing.assert_allclose(first.force, still.force, rtol=0.0, atol=1e-3 * np.abs(still.force).max())
    np.testing.assert_allclose(first.moment, still.moment, rtol=0.0, atol=1e-3 * np.abs(still.moment).max())
    for _ in range(5):
        last = motion.step(START, END, 0.01)
    assert np.abs(last.positions - first.positions).max() < 1e-8
    assert last.velocity is not None
    assert np.abs(last.velocity).max() < 1e-6


@pytest.mark.parametrize("cable", [CABLE, CABLE.replace(retardation_time=0.05, drag=0.1)], ids=["free", "damped"])
def test_it_is_of_second_order_in_time(cable: cs.Cable):
    ends = [swung(cable, dt, 0.5)[-1] for dt in (4e-3, 2e-3, 1e-3)]
    first, second = (np.abs(a.positions - b.positions).max() for a, b in pairwise(ends))
    assert second < 2e-3
    assert 3.0 < first / second < 6.0


def test_energy_goes_where_it_is_said_to_go():
    """What the scheme loses falls with the square of its steps; work less that is in energies and damping."""
    for cable in (CABLE, CABLE.replace(retardation_time=0.05, drag=0.1)):
        share = []
        for dt in (2e-3, 1e-3):
            shapes = swung(cable, dt, 0.5)
            most = max(shape.kinetic_energy for shape in shapes)
            share.append(abs(sum(shape.lost for shape in shapes[1:])) / most)
            given = sum(shape.work - shape.dissipated - shape.lost for shape in shapes[1:])
            last, first = shapes[-1], shapes[0]
            assert given == pytest.approx(last.energy + last.kinetic_energy - first.energy, abs=1e-9)
            assert all(shape.dissipated >= 0.0 for shape in shapes)
        assert share[1] < 0.02
        assert share[0] / share[1] > 3.0


def test_a_distributed_load_does_work_as_weight_does():
    load = ((0.0, 0.5, 0.0), (0.0, 0.1, -0.3))
    motion = cs.Motion(CABLE, points=41, distributed_load=load)
    first = motion.begin(START, END)
    still = cs.predict(CABLE, START, END, points=41, distributed_load=load)
    assert np.abs(first.positions - still.positions).max() < 1e-4
    given = most = 0.0
    for k in range(1, 401):
        y = 0.1 * smooth(k * 1e-3, 0.4)
        shape = motion.step(cs.Pose((0.0, y, 0.0), ALONG), cs.Pose((0.7, 0.5 * y, 0.3 * y), ALONG), 1e-3)
        given += shape.work
        most = max(most, shape.kinetic_energy)
    change = shape.energy + shape.kinetic_energy - first.energy
    assert most > 1e-3
    assert abs(change - given) < 1e-3 * most


def test_damped_it_comes_to_rest_where_the_cable_is_at_rest():
    shapes = swung(CABLE.replace(retardation_time=0.2, drag=0.5), 0.02, 12.0)
    last = shapes[-1]
    still = cs.predict(CABLE, cs.Pose((0.0, 0.1, 0.0), ALONG), cs.Pose((0.7, 0.05, 0.03), ALONG), points=41)
    assert last.velocity is not None
    assert np.abs(last.velocity).max() < 1e-4
    assert np.abs(last.positions - still.positions).max() < 1e-4 * CABLE.length
    assert last.kinetic_energy < 1e-9
    lost, dissipated = (sum(getattr(shape, name) for shape in shapes) for name in ("lost", "dissipated"))
    assert abs(lost) < 0.1 * dissipated


def test_velocity_is_the_rate_of_places():
    before, now, after = swung(CABLE, 1e-3, 0.202)[-3:]
    rate = (after.positions - before.positions) / 2e-3
    assert now.velocity is not None
    assert np.abs(rate).max() > 0.1
    assert np.abs(now.velocity - rate).max() < 0.01 * np.abs(rate).max()


@pytest.mark.parametrize("end", [END, cs.Grip(END, "pinned"), cs.FreeEnd(mass=0.02)], ids=["grip", "pinned", "plug"])
def test_a_step_of_newton_is_what_differences_ask_for(end: cs.Pose | cs.Grip | cs.FreeEnd):
    """To any right-hand side the factors answer with the step along which what is to vanish changes by minus that."""
    limp = CABLE.replace(bending_stiffness=1e-3, twisting_stiffness=1e-3)
    motion, rng = cs.Motion(limp, points=12), np.random.default_rng(3)
    motion.begin(START, end)
    swing = motion._swing
    assert swing is not None
    moves, arrays = swing.motion, (swing.ints, swing.floats, swing.sols, swing.work, swing.moving)
    momentum.aim_nodes.py_func(moves, swing.memory, 0.01)
    size = swing.sols.size // 3
    swing.sols[2 * size :] = swing.sols[:size]
    trial = tables.solution_of.py_func(swing.ints, swing.sols, tables.TRIAL)
    work = tables.work_of.py_func(swing.ints, swing.work)
    settle.assemble(*arrays)
    moving.factor(swing.ints, swing.floats, swing.work, swing.moving, 0.0)
    work.G[...] = rng.standard_normal(work.G.shape)
    system.release.py_func(swing.plan, swing.model, work.G)
    moves.slack[...] = rng.standard_normal(moves.slack.shape)
    asked = np.concatenate((work.G.ravel(), moves.slack.ravel()))
    moving.solve(swing.ints, swing.floats, swing.work, swing.moving)
    turn, force = work.d.copy(), moves.step.copy()
    q, lam = Rotation.from_quat(trial.q), moves.lam.copy()

    def left(x: float) -> np.ndarray:
        trial.q[...] = (q * Rotation.from_rotvec(x * turn)).as_quat()
        moves.lam[...] = lam + x * force
        settle.assemble(*arrays)
        return np.concatenate((work.G.ravel(), moves.slack.ravel()))

    rate = (left(1e-6) - left(-1e-6)) / 2e-6
    assert np.abs(rate + asked).max() < 1e-5 * np.abs(asked).max()


@pytest.mark.parametrize("end", [END, cs.FreeEnd(mass=0.02)], ids=["grip", "plug"])
def test_factors_that_stay_and_what_comes_again_lead_to_the_same(end: cs.Pose | cs.FreeEnd):
    """Once the last way was as the one before Newton's method has its matrix once a step, and that of its start."""
    quick, plain = (cs.Motion(CABLE, points=41, elements=20) for _ in range(2))
    firsts = quick.begin(START, end), plain.begin(START, end)
    ways, tried, own = [], [], []
    for k in range(1, 61):
        start = cs.Pose((0.0, 0.05 * smooth(k, 120.0), 0.0), ALONG)
        shape = quick.step(start, end, 0.01)
        tried.append(shape.iterations)
        swing, other = quick._swing, plain._swing
        assert swing is not None
        assert other is not None
        own.append(swing._scratch[settle.I_OWN])
        other.memory.par[[momentum.LIKE, momentum.LIKE_FORCE]] = 0.0  # two steps carried on straight
        longer = plain.step(start, end, 0.01)
        ways.append(float(np.abs(shape.positions - longer.positions).max()))
    assert max(ways) < 1e-8
    assert np.abs(shape.positions - firsts[0].positions).max() > 0.01
    assert swing.memory.par[[momentum.LIKE, momentum.LIKE_FORCE]].min() > 0.8
    assert np.median(tried[20:]) > 1
    assert np.median(own[20:]) == 1


def test_a_pendulum_swings_as_a_rigid_one_does():
    """A stiff rod with a plug, let go beside the vertical."""
    mass, rod = 0.05, CABLE.replace(bending_stiffness=100.0)
    motion = cs.Motion(rod, points=12)
    pin = cs.Grip(cs.Pose(quaternion=DOWN), "pinned")
    motion.begin(pin, cs.FreeEnd(mass=mass, force=(0.02, 0.0, 0.0)))
    dt, x = 2e-3, []
    for _ in range(2000):
        shape = motion.step(pin, cs.FreeEnd(mass=mass), dt)
        x.append(shape.positions[-1, 0])
    signs = np.signbit(x)
    passes = np.flatnonzero(signs[1:] != signs[:-1])
    at = [dt * (k + x[k] / (x[k] - x[k + 1])) for k in passes]
    inertia = mass + rod.linear_density / 3.0
    torque = (mass + rod.linear_density / 2.0) * 9.81
    assert len(at) > 3
    assert np.diff(at).mean() == pytest.approx(math.pi * math.sqrt(inertia / torque), rel=2e-3)


def test_clips_hold_and_masses_are_carried():
    scene = cs.Scene(
        clips=[cs.Clip(0.4, cs.Pose((0.3, 0.0, -0.1), ALONG), kind="ball")], masses=[cs.PointMass(0.7, 0.02)]
    )
    motion = cs.Motion(CABLE, scene=scene, points=41)
    first = motion.begin(START, END)
    still = cs.predict(CABLE, START, END, points=41, scene=scene)
    assert np.abs(first.positions - still.positions).max() < 2e-4
    for k in range(1, 40):
        shape = motion.step(cs.Pose((0.0, 0.05 * smooth(0.01 * k, 0.2), 0.0), ALONG), END, 0.01)
        assert shape.status is cs.Status.OK
        assert np.abs(shape.positions[16] - (0.3, 0.0, -0.1)).max() < 1e-9
    assert shape.velocity is not None
    assert np.abs(shape.velocity).max() > 0.01


def test_out_of_reach_the_state_is_kept():
    one, other = cs.Motion(CABLE, points=21), cs.Motion(CABLE, points=21)
    for motion in (one, other):
        motion.begin(START, END)
        motion.step(START, cs.Pose((0.71, 0.0, 0.02), ALONG), 0.01)
    far = one.step(START, cs.Pose((1.2, 0.0, 0.0), ALONG), 0.01)
    assert far.status is cs.Status.OVERSTRETCHED
    assert far.missing_length == pytest.approx(0.2)
    assert "kept" in far.detail
    back = [motion.step(START, cs.Pose((0.72, 0.0, 0.04), ALONG), 0.01) for motion in (one, other)]
    assert back[0].usable
    np.testing.assert_array_equal(back[0].positions, back[1].positions)


def mass_accelerations(motion: cs.Motion) -> np.ndarray:
    """(n, 3) [m/s^2], of the masses at the nodes."""
    swing = motion._swing
    assert swing is not None
    return swing.memory.acceleration + swing.motion.lever[:, None] * swing.memory.bending


@pytest.mark.parametrize("speed", [0.02, 0.5, 2.0])
@pytest.mark.parametrize("stiffness", [1e-2, 1e-4])
def test_no_energy_comes_from_nowhere_where_grips_start_at_once(stiffness: float, speed: float):
    """At full speed from the first step on: what is lost is a sum of squares of what the scheme knows."""
    cable = CABLE.replace(bending_stiffness=stiffness, twisting_stiffness=stiffness / 1.3)
    motion, dt = cs.Motion(cable, points=12), 0.01
    first = motion.begin(START, END)
    accelerations = [mass_accelerations(motion)] * 2
    lost, squares = [], []
    given = above = most = 0.0
    for k in range(1, 41):
        way = np.array((0.0, speed * dt * min(k, 20), 0.0))
        shape = motion.step(*(cs.Pose(pose.position + way, ALONG) for pose in (START, END)), dt)
        assert shape.status is cs.Status.OK
        given += shape.work
        now = shape.energy + shape.kinetic_energy - first.energy
        above, most = max(above, now - given), max(most, abs(now))
        if speed > 0.1:  # elements turn far in a step, or too far for as many as there are
            continue
        assert motion._swing is not None
        accelerations.append(mass_accelerations(motion))
        change = np.sum((accelerations[-1] - accelerations[-3]) ** 2, axis=1)
        lost.append(shape.lost)
        squares.append(0.25 * dt**2 * float(motion._swing.memory.mass @ change))
    assert above < 1e-6 * most
    if speed < 0.1:
        np.testing.assert_allclose(lost, squares, rtol=0.0, atol=1e-3 * max(squares))


def test_what_is_limp_begins_at_rest_too():
    """Not where a mode that might grow, asked for at rest, would have led it."""
    motion = cs.Motion(CABLE.replace(bending_stiffness=1e-5), points=12)
    first = motion.begin(START, END)
    shape = motion.step(START, END, 0.01)
    assert shape.velocity is not None
    assert np.abs(shape.velocity).max() < 1e-7
    assert abs(shape.energy - first.energy) < 1e-12


@pytest.mark.parametrize("retardation", [0.0, 0.02])
@pytest.mark.parametrize("stiffness", [1e-2, 1e-3, 1e-4])
def test_whips_are_followed(stiffness: float, retardation: float):
    """Grips that are thrown about: no step is lost, and energy comes from their work alone."""
    rng = np.random.default_rng(11)
    twist = stiffness / 1.3
    cable = CABLE.replace(bending_stiffness=stiffness, twisting_stiffness=twist, retardation_time=retardation)
    for _ in range(3):
        motion = cs.Motion(cable, points=12)
        first = motion.begin(START, END)
        rates, phases = rng.uniform(4.0, 16.0, (2, 3)), rng.uniform(0.0, 6.28, (2, 3))
        energy = first.energy
        given = most = above = 0.0
        for k in range(1, 101):
            t = 0.01 * k
            way = 0.08 * smooth(t, 0.3) * np.sin(rates * t + phases)
            shape = motion.step(*(cs.Pose(p.position + w, ALONG) for p, w in zip((START, END), way, strict=True)), 0.01)
            assert shape.status is cs.Status.OK, shape.detail
            given += shape.work
            now = shape.energy + shape.kinetic_energy
            most, above = max(most, abs(now - energy)), max(above, now - energy - given)
            assert np.isfinite(shape.buffer).all()
        assert above < 1e-6 * most


@pytest.mark.parametrize(
    ("stiffness", "twist"), [((3e-4, 3e-4), 7.5e-3), ((1e-4, 1e-4), 7.7e-3), ((1.6e-3, 1e-4), 2e-4)]
)
def test_a_limp_cable_that_is_stiff_in_twist_or_flat_is_followed(stiffness: tuple[float, float], twist: float):
    """Its elements bend by less than at which they are no minimum."""
    motion = cs.Motion(CABLE.replace(bending_stiffness=stiffness, twisting_stiffness=twist), points=12)
    ratio = max(twist, *stiffness) / min(stiffness)
    assert motion.begin(START, END).usable
    swing = motion._swing
    assert swing is not None
    q = Rotation.from_quat(swing.solution.q)
    assert 0.1 < (q[:-1].inv() * q[1:]).magnitude().max() ** 2 * ratio / 6.0 < 2.0
    for k in range(1, 41):
        shape = motion.step(START, cs.Pose((0.7, 0.05 * smooth(0.01 * k, 0.3), 0.0), ALONG), 0.01)
        assert shape.status is cs.Status.OK, shape.detail


@pytest.mark.parametrize("turn", [0.0, 3.0])
def test_there_are_more_elements_where_these_are_too_long(turn: float):
    """Hands turn a limp cable back onto itself at both grips: elements that turned by almost pi held up all steps."""
    cable = cs.Cable(0.9, 0.05, 1.5e-4, twisting_stiffness=2e-5, retardation_time=0.05, drag=0.01)
    lines = []
    for elements in (None, 120):
        motion = cs.Motion(cable, points=91, elements=elements)
        motion.begin(*turning(0, turn))
        assert motion._swing is not None
        before = motion._swing.model.h.size
        shapes = [motion.step(*turning(k, turn), 0.01) for k in range(1, 100)]
        assert all(shape.status is cs.Status.OK for shape in shapes)
        lines.append([shape.positions for shape in shapes])
        many = motion._swing.model.h.size
        assert many == elements or before < many <= FINEST * before
    off = np.linalg.norm(np.array(lines[0]) - np.array(lines[1]), axis=2).max(axis=1)
    assert np.median(off) < 0.01 * cable.length


def turning(k: int, turn: float) -> tuple[cs.Pose, cs.Pose]:
    """After k steps of 10 ms."""
    t = 0.01 * k
    pitch = Rotation.from_rotvec((0.0, 2.5 * math.sin(6.0 * t), 0.0))
    end = Rotation.from_rotvec((0.0, 0.0, turn * math.sin(5.0 * t))) * pitch.inv() * Rotation.from_quat(ALONG)
    place = (0.75, 0.05 * math.sin(7.0 * t), 0.1 * math.sin(6.0 * t))
    return cs.Pose((0, 0, 0), (pitch * Rotation.from_quat(ALONG)).as_quat()), cs.Pose(place, end.as_quat())


def test_it_does_not_matter_where_and_which_way():
    turn, off = Rotation.from_rotvec((0.0, 0.0, 1.1)), np.array((3.0, -2.0, 1.0))

    def moved(pose: cs.Pose) -> cs.Pose:
        turned = turn * Rotation.from_quat(pose.quaternion.copy())
        return cs.Pose(off + turn.apply(pose.position.copy()), turned.as_quat())

    one, other = cs.Motion(CABLE, points=21), cs.Motion(CABLE, points=21)
    one.begin(START, END)
    other.begin(moved(START), moved(END))
    for k in range(1, 30):
        end = cs.Pose((0.7, 0.05 * smooth(0.01 * k, 0.2), 0.0), ALONG)
        a, b = one.step(START, end, 0.01), other.step(moved(START), moved(end), 0.01)
    np.testing.assert_allclose(turn.apply(a.positions) + off, b.positions, rtol=0.0, atol=1e-6)


def test_what_it_takes_and_what_it_refuses():
    with pytest.raises(cs.ArgumentError, match="Call begin first"):
        cs.Motion(CABLE).step(START, END, 0.01)
    motion = cs.Motion(CABLE)
    motion.begin(START, END)
    for dt in (0.0, -1.0, math.nan):
        with pytest.raises(cs.ArgumentError, match="dt"):
            motion.step(START, END, dt)
    with pytest.raises(cs.ArgumentError, match="begin again"):
        motion.step(START, cs.Grip(END, "swivel"), 0.01)
    with pytest.raises(cs.ArgumentError, match="linear_density"):
        cs.Motion(CABLE.replace(linear_density=0.0))
    with pytest.raises(cs.ArgumentError, match="bending_stiffness"):
        cs.Motion(CABLE.replace(bending_stiffness=0.0, twisting_stiffness=0.0))
    for bad in ({"retardation_time": -1.0}, {"drag": -0.1}):
        with pytest.raises(cs.ArgumentError, match=next(iter(bad))):
            CABLE.replace(**bad)
    far = cs.Motion(CABLE).begin(START, cs.Pose((1.5, 0.0, 0.0), ALONG))
    assert far.status is cs.Status.OVERSTRETCHED


def test_steps_tell_into_how_many_parts_they_went():
    motion = cs.Motion(CABLE, points=12)
    motion.begin(START, END)
    motion.step(START, END, 0.01)
    assert motion._swing is not None
    assert motion._swing.info[swinging.I_PARTS] == 1.0


def test_it_begins_as_it_is_seen():
    """In the midst of a swing, from points and velocities alone: where the cable was, and on as it went."""
    before, after = cs.Motion(CABLE, points=41), cs.Motion(CABLE, points=41)
    before.begin(START, END)

    def end(k: int) -> cs.Pose:
        return cs.Pose((0.7, 0.1 * smooth(0.01 * k, 0.4), 0.0), ALONG)

    for k in range(1, 41):
        seen = before.step(START, end(k), 0.01)
    assert seen.velocity is not None
    assert np.abs(seen.velocity).max() > 0.2
    few = slice(3, 40, 3)
    first = after.begin(START, end(40), seen.arc_length[few], seen.positions[few], seen.velocity[few])
    assert first.usable
    assert np.abs(first.positions - seen.positions).max() < 2e-3
    assert first.velocity is not None
    assert np.abs(first.velocity - seen.velocity).max() < 0.05
    for k in range(41, 61):
        one, other = before.step(START, end(k), 0.01), after.step(START, end(k), 0.01)
    assert np.abs(one.positions - seen.positions).max() > 0.05
    assert np.abs(one.positions - other.positions).max() < 0.01


def test_it_begins_as_it_is_seen_on_short_elements_too():
    """They buckle between points that are nearer to each other than the cable between them is long."""
    cable = cs.Cable(0.9, 0.05, bending_stiffness=1e-4, drag=0.02, retardation_time=0.05)
    end, at = cs.Pose((0.6, 0.0, 0.0), ALONG), np.linspace(0.1, 0.8, 8)
    rest = cs.predict(cable, START, end)
    ways = np.sin(np.outer(at, np.arange(1, 4)) * np.pi / 0.9) @ (
        0.03 * np.random.default_rng(3).normal(size=(3, 3))
    )  # fmt: skip
    seen = np.stack([np.interp(at, rest.arc_length, column) for column in rest.positions.T], axis=1) + ways
    found = [cs.Motion(cable, elements=n).begin(START, end, at, seen, np.zeros((8, 3))) for n in (40, 120, 160)]
    assert all(shape.usable for shape in found)
    for finer in found[1:]:
        assert np.abs(finer.positions - found[0].positions).max() < 5e-3


def test_what_is_seen_is_checked():
    motion, points = cs.Motion(CABLE, points=12), [(0.2, 0.0, -0.2), (0.5, 0.0, -0.2)]
    for given, match in (
        ({"arc_length": (0.2,)}, "points"),
        ({"points": points, "arc_length": (0.8, 0.2)}, "ascend"),
        ({"points": points, "velocity": [(0.0, 0.0, 0.0)]}, "as many as points"),
        ({"points": [(0.0, 0.0)]}, "shape"),
        ({"points": points, "arc_length": (0.0, 1.0)}, "between the ends"),
    ):
        with pytest.raises(cs.ArgumentError, match=match):
            motion.begin(START, END, **given)


@pytest.mark.parametrize("table", [False, True])
def test_another_motion_goes_on_from_a_shape(table):
    body = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.3)))
    scene = cs.Scene(obstacles=[body], contact="solve") if table else None
    first, twin, finer = (cs.Motion(CABLE, scene, points=81, elements=n) for n in (20, 20, 30))
    first.begin(START, END)
    moved = [cs.Pose(END.position + np.array((0.0, 0.004 * k, 0.0)), END.quaternion) for k in range(80)]
    for k in range(1, 40):
        left = first.step(START, moved[k], 0.01)
    assert first.last.velocity is not None
    twin.take_up(left, START, moved[39], left_by=first)
    taken = finer.take_up(left, START, moved[39])
    assert taken is left
    for k in range(40, 80):
        last, same, near = (one.step(START, moved[k], 0.01) for one in (first, twin, finer))
        if not table:
            np.testing.assert_array_equal(same.buffer, last.buffer)
        assert np.abs(same.positions - last.positions).max() < 1e-3
        assert np.abs(near.positions - last.positions).max() < 0.01 * CABLE.length
    assert np.abs(last.velocity).max() > 0.2


def test_a_shape_of_another_cable_is_not_taken_up():
    shape = cs.predict(CABLE.replace(length=0.9 * CABLE.length), START, END)
    with pytest.raises(cs.ArgumentError, match=r"shape = .* it must be usable"):
        cs.Motion(CABLE).take_up(shape, START, END)
    with pytest.raises(cs.ArgumentError, match="Give that of another Motion"):
        cs.Motion(CABLE).take_up("shape", START, END)  # type: ignore[arg-type]
