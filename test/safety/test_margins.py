"""Margins: how far trouble is, and the time until it is there."""

import math

import numpy as np
import pytest
from rods import ALONG_X, CABLE, END, START, arch_ends, arch_predictor, moved
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.network import respond
from cable_shape.safety.margins import MarginWatch, margins_of
from cable_shape.safety.report import WarningKind as Kind
from cable_shape.solve import cosserat

MS = 1_000_000  # ns
LIMITED = CABLE.replace(min_bend_radius=0.05, max_tension=20.0, max_twist_rate=6.0, allowable_stress=5e6)
BALL = cs.Obstacle("ball", cs.Sphere(0.03), cs.Pose((0.45, 0.1, -0.28)))
SCENE = cs.Scene(obstacles=[BALL])


def by_kind(margins) -> dict:
    """kind, or the name of a body, -> margin."""
    return {m.other or m.kind: m for m in margins}


def step_after(cycle, ends, stamp=0, **keywords):
    return cycle.step({"cable": ends}, stamp, **keywords)


def test_every_kind_is_there_and_normalised_to_its_limit():
    report = step_after(cs.Cycle(LIMITED, scene=SCENE, model="cosserat"), (START, END))
    shape, found = report.shapes["cable"], by_kind(report.margins["cable"])
    assert set(found) == {
        Kind.OVERSTRETCHED, Kind.TENSION, Kind.BEND_RADIUS, Kind.TWIST_RATE, Kind.STRESS, Kind.STABILITY, "ball",
    }  # fmt: skip
    bodies = report.clearance["cable"].bodies
    stress = cs.stress_of(LIMITED, shape)
    twist = np.abs(shape.curvature[:, 2])
    expected = {
        Kind.OVERSTRETCHED: (math.dist(START.position, END.position), 1.2, 1.2),
        Kind.TENSION: (shape.tension.max(), 20.0, shape.arc_length[shape.tension.argmax()]),
        Kind.BEND_RADIUS: (shape.bend_radius.min(), 0.05, shape.arc_length[shape.bend_radius.argmin()]),
        Kind.TWIST_RATE: (twist.max(), 6.0, shape.arc_length[twist.argmax()]),
        Kind.STRESS: (stress.von_mises.max(), 5e6, shape.arc_length[stress.worst]),
        "ball": (bodies[0].distance, 0.03, bodies[0].arc_length),
    }
    for key, (value, limit, at) in expected.items():
        margin = found[key]
        assert margin.value == pytest.approx(value), key
        assert margin.limit == limit, key
        assert margin.arc_length == pytest.approx(at), key
        assert math.isnan(margin.time_to_limit), "one cycle holds no speed"
    for key in (Kind.OVERSTRETCHED, Kind.TENSION, Kind.TWIST_RATE, Kind.STRESS):
        assert found[key].used == pytest.approx(found[key].value / found[key].limit), key
    assert found[Kind.BEND_RADIUS].used == pytest.approx(0.05 / found[Kind.BEND_RADIUS].value)
    assert found[Kind.STRESS].used == pytest.approx(1.0 / stress.safety_factor)
    assert found["ball"].used == pytest.approx(2.0 - bodies[0].distance / 0.03)


def test_limits_that_the_cable_does_not_have_have_no_margin():
    report = step_after(cs.Cycle(CABLE, model="gradient4"), (START, END))
    assert set(by_kind(report.margins["cable"])) == {Kind.OVERSTRETCHED}, "a closed form knows no stability"
    hanging = step_after(cs.Cycle(CABLE, model="cosserat"), (START, None))
    assert set(by_kind(hanging.margins["cable"])) == {Kind.STABILITY}, "a free end is not stretched"


def test_stretch_of_an_elastic_cable_counts_to_its_length_under_the_allowed_tension():
    elastic = CABLE.replace(axial_stiffness=100.0, max_tension=5.0, linear_density=0.0)
    report = step_after(cs.Cycle(elastic, model="cosserat"), (START, cs.Pose((1.212, 0, 0), ALONG_X)))
    stretch = by_kind(report.margins["cable"])[Kind.OVERSTRETCHED]
    assert stretch.limit == pytest.approx(1.2 * 1.05)
    assert stretch.used == pytest.approx(1.212 / 1.26)
    tension = by_kind(report.margins["cable"])[Kind.TENSION]
    assert tension.used == pytest.approx(0.01 / 0.05), "strain / allowed strain"


def test_of_a_shape_that_is_none_nothing_is_told_and_of_a_straight_line_no_loads():
    shape = cs.predict(LIMITED, START, cs.Pose((1.3, 0, 0), ALONG_X))
    found = by_kind(margins_of(LIMITED, SCENE, shape, cs.Clearance(), held=True))
    assert set(found) == {Kind.OVERSTRETCHED}
    assert found[Kind.OVERSTRETCHED].used == pytest.approx(1.3 / 1.2)
    shape.status = cs.Status.NOT_CONVERGED
    assert margins_of(LIMITED, SCENE, shape, cs.Clearance(), held=True) == ()


# Stability


def test_stability_is_the_smallest_eigenvalue_of_the_second_variation():
    for cable, start, end in (
        (CABLE, START, END),
        (CABLE, START, None),
        (CABLE.replace(bending_stiffness=(0.02, 0.004)), START, cs.Grip(END, kind="swivel")),
        (CABLE, START, cs.Pose((1.19, 0, 0), ALONG_X)),
    ):
        predictor = cs.Predictor(cable, model="cosserat")
        shape = predictor.predict(start, end)
        watch = MarginWatch(cable, cs.Scene())
        for stamp in range(4):
            margins = watch.margins(shape, cs.Clearance(), stamp * MS, state=predictor.rod_state)
        (stability,) = (m for m in margins if m.kind is Kind.STABILITY)
        soft = min(*cable.bending_stiffness, cable.twisting_stiffness) / cable.length**2
        assert predictor.rod_state is not None
        exact = cosserat.smallest_eigenvalue(predictor.rod_state) / soft
        assert stability.value == pytest.approx(exact, rel=3e-3)  # the bisection stops at 1e-3
        assert stability.used == pytest.approx(1.0 / (1.0 + stability.value))
        assert 0.0 <= stability.arc_length <= cable.length


def test_factors_left_by_a_warm_solve_tell_stability_nearly_as_well_as_fresh_ones():
    predictor = cs.Predictor(CABLE, model="cosserat")
    predictor.predict(START, END)
    for k in range(1, 40):
        predictor.predict(START, moved(END, shift=(-0.004 * k, 0.002 * k, 0.0), turn=(0.0, 0.01 * k, 0.0)))
        state = predictor.rod_state
        assert state is not None
        network = state.ints, state.floats, state.sols, state.work
        mode = np.random.default_rng(1).normal(size=(state.elements + 1, 3))
        told = np.empty((2, 2))
        for fresh in (0, 1):
            respond.softest_mode(*network, np.empty(0), mode, 12, bool(fresh), told[fresh])
        left, fresh = told[:, 0]
        assert left == pytest.approx(fresh, rel=1e-2), k


def test_stability_is_used_up_where_the_cable_snaps():
    predictor, *_ = arch_predictor()
    watch = MarginWatch(predictor.cable, cs.Scene())
    used = []
    for k in range(400):
        shape = predictor.predict(*arch_ends(0.004 * k))
        (m,) = (
            m
            for m in watch.margins(shape, cs.Clearance(), k * MS, state=predictor.rod_state)
            if m.kind is Kind.STABILITY
        )
        if shape.status is cs.Status.SNAPPED:
            break
        used.append(m.used)
    assert shape.status is cs.Status.SNAPPED
    assert used[0] < 0.3
    assert 0.8 < used[-1] < 1.0
    assert all(np.diff(used[-10:]) > 0.0)


def test_an_unstable_shape_has_used_its_stability_up():
    cable = cs.Cable(length=1.0, linear_density=0.0, bending_stiffness=0.02, twisting_stiffness=0.015)
    watch = MarginWatch(cable, cs.Scene())
    predictor = cs.Predictor(cable, model="cosserat")
    shape = predictor.predict(*arch_ends(0.0))
    shape.status = cs.Status.UNSTABLE
    (m,) = (m for m in watch.margins(shape, cs.Clearance(), 0, state=predictor.rod_state) if m.kind is Kind.STABILITY)
    assert m.value < 0.0
    assert m.used == 1.0 - m.value
    assert m.time_to_limit == 0.0


# Speeds and times


def test_speed_of_the_grips():
    watch, shape = MarginWatch(CABLE, cs.Scene()), cs.predict(CABLE, START, END, model="gradient4")

    def twists_after(start, end, stamp) -> np.ndarray | None:
        watch.margins(shape, cs.Clearance(), stamp, ends=(start, end))
        return watch.twists

    offset = cs.Pose((0.0, 0.05, 0.1), ALONG_X)
    v, w = np.array((0.1, -0.2, 0.05)), np.array((0.4, 0.1, -0.3))
    tool = cs.Pose((0.3, 0.0, 0.2), Rotation.from_rotvec((0.1, 0.2, 0.3)).as_quat())
    assert twists_after(START, cs.Grip(tool, offset=offset), 0) is None
    dt = 1e-4
    later = cs.Grip(moved(tool, shift=v * dt, turn=w * dt), offset=offset)
    flipped = cs.Pose(START.position, -START.quaternion)  # the same rotation
    twists = twists_after(flipped, later, 100_000)
    arm = later.cable_frame.position - later.pose.position
    np.testing.assert_allclose(twists[:6], 0.0, atol=1e-12)
    np.testing.assert_allclose(twists[6:9], v + np.cross(w, arm), atol=1e-5)
    np.testing.assert_allclose(twists[9:], w, atol=1e-9)
    again = twists_after(START, cs.Grip(tool), 100_000)
    np.testing.assert_array_equal(again, twists, "a repeated stamp holds no speed")
    assert twists_after(START, later, 100_000 + 2_000 * MS) is None, "nor does a gap"
    np.testing.assert_allclose(twists_after(START, None, 2_001 * MS)[6:], 0.0)
    assert twists_after(START, later, 2_002 * MS) is None, "nothing held the end before"
    assert twists_after(START, later, 2_003 * MS) is not None
    shape.status = cs.Status.NOT_CONVERGED
    further = moved(START, shift=1e-3 * v)
    np.testing.assert_allclose(twists_after(further, later, 2_004 * MS)[:3], v, atol=1e-12)
    watch.reset()
    assert twists_after(START, later, 2_005 * MS) is None


def motion(k: int, rate: float = 1.0):
    """Ends of a smooth motion, one step a millisecond at rate 1."""
    t = 1e-3 * rate * k
    return START, moved(END, shift=(-0.2 * t, 0.1 * t, -0.3 * t), turn=(0.2 * t, -0.1 * t, 0.3 * t))


def test_velocities_are_the_sensitivity_times_the_twists_and_the_finite_difference():
    for end in (END, cs.Grip(END, kind="swivel"), cs.Grip(END, kind="pinned"), None):
        predictor = cs.Predictor(CABLE, model="cosserat", tolerance=1e-8)
        shape = predictor.predict(START, end)
        twists = np.random.default_rng(2).normal(size=12)
        state = predictor.rod_state
        assert state is not None
        jacobian = predictor.sensitivity()
        network = state.ints, state.floats, state.sols, state.work
        moves, v = twists.reshape(2, 6), np.empty((shape.points, 3))
        respond.still(state.ints, state.work)
        respond.move_knots(*network, moves)
        respond.answer(*network, moves)
        respond.velocities(*network, shape.arc_length, v)
        np.testing.assert_allclose(v, jacobian @ twists, atol=1e-12)
        dt, pair = 2e-4, []
        for sign in (1.0, -1.0):
            ends = [moved(START, sign * dt * twists[:3], sign * dt * twists[3:6])]
            if end is None:
                ends.append(None)
            else:
                at = moved(END, sign * dt * twists[6:9], sign * dt * twists[9:])
                ends.append(end.at(at) if isinstance(end, cs.Grip) else at)
            pair.append(predictor.predict(*ends).positions.copy())
        np.testing.assert_allclose(v, (pair[0] - pair[1]) / (2.0 * dt), atol=2e-5)


@pytest.mark.parametrize("model", ["cosserat", "gradient4"])
def test_time_to_a_body_is_when_it_is_there(model):
    """Extrapolated near the limit, the time is that at which the same motion, continued, uses the margin up."""
    cycle = cs.Cycle(CABLE, scene=SCENE.replace(obstacles=[floor_below(model)]), model=model, tolerance=1e-7)
    times, k = {}, 0
    while True:
        margin = by_kind(step_after(cycle, motion(k), k * MS).margins["cable"])["floor"]
        if margin.used >= 1.0:
            break
        times[k] = margin.time_to_limit
        k += 1
    assert margin.time_to_limit == 0.0
    assert k > 20
    assert math.isnan(times[0])
    for before in (20, 10, 5):  # the limit lies between k - 1 and k
        assert times[k - before] == pytest.approx((before - 0.5) * 1e-3, rel=0.1, abs=0.6e-3)


def test_a_body_that_moves_with_the_grip_is_not_approached():
    """A link that goes along with both grips keeps its distance; a fixed body there would be approached."""
    link = cs.Obstacle("hand", cs.Sphere(0.02), link="tool")
    low = cs.predict(CABLE, START, END, model="cosserat").positions[75]
    fixed = cs.Obstacle("fixed", cs.Sphere(0.02), cs.Pose(low - (0.0, 0.0, 0.1)))
    cycle = cs.Cycle(CABLE, scene=cs.Scene(obstacles=[fixed]), robot_links=[link], model="cosserat")
    for k in range(3):
        down = np.array((0.0, 0.0, -0.001 * k))
        grips = tuple(cs.Pose(p.position + down, p.quaternion) for p in (START, END))
        report = step_after(cycle, grips, k * 10 * MS, links={"tool": cs.Pose(low + down - (0.0, 0.0, 0.08))})
    found = by_kind(report.margins["cable"])
    assert found["hand"].value == pytest.approx(0.08 - 0.02 - 0.004, abs=5e-4)
    assert found["hand"].time_to_limit > 60.0
    distance = found["fixed"].value
    assert found["fixed"].time_to_limit == pytest.approx((distance - 0.03) / 0.1, rel=1e-2)


def floor_below(model: str) -> cs.Obstacle:
    """A floor whose warning distance the cable reaches after about 30 ms of `motion`."""
    low = cs.predict(CABLE, *motion(30), model=model).positions[:, 2].min()
    return cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, low - 0.03 - 0.5 * CABLE.diameter)))


@pytest.mark.parametrize("kind", [Kind.OVERSTRETCHED, Kind.TENSION, Kind.BEND_RADIUS, Kind.TWIST_RATE, Kind.STRESS])
def test_time_to_a_load_is_when_it_is_reached(kind):
    def ends(k: int):
        t = 1e-3 * k
        if kind is Kind.OVERSTRETCHED or kind is Kind.TENSION:
            return START, cs.Pose((1.0 + t, 0.0, 0.0), ALONG_X)
        if kind is Kind.TWIST_RATE:
            roll = Rotation.from_rotvec((1.0 + t, 0.0, 0.0))
            return START, cs.Pose((0.9, 0.0, 0.0), (roll * Rotation.from_quat(ALONG_X)).as_quat())
        return START, cs.Pose((0.9 - t, 0.0, 0.0), ALONG_X)

    probe = step_after(cs.Cycle(LIMITED, model="cosserat"), ends(30))
    value = by_kind(probe.margins["cable"])[kind].value
    limits = {
        Kind.OVERSTRETCHED: {"length": 1.03},
        Kind.TENSION: {"max_tension": value},
        Kind.BEND_RADIUS: {"min_bend_radius": value},
        Kind.TWIST_RATE: {"max_twist_rate": value},
        Kind.STRESS: {"allowable_stress": value},
    }
    cycle = cs.Cycle(LIMITED.replace(**limits[kind]), model="cosserat")
    times = [by_kind(step_after(cycle, ends(k), k * MS).margins["cable"])[kind].time_to_limit for k in range(28)]
    assert math.isnan(times[0])
    for k in (20, 24, 27):
        assert times[k] == pytest.approx((30 - k) * 1e-3, rel=0.1), k


def test_moving_away_is_infinite_and_standing_still_is_too():
    cycle = cs.Cycle(LIMITED, scene=SCENE, model="cosserat", quasistatic_limit=0.0)
    for k in range(3):
        report = step_after(cycle, (START, cs.Pose((0.9 + 0.001 * k, 0.0, 0.0), ALONG_X)), k * MS)
    assert by_kind(report.margins["cable"])[Kind.BEND_RADIUS].time_to_limit == math.inf
    assert 0.0 < by_kind(report.margins["cable"])[Kind.OVERSTRETCHED].time_to_limit < math.inf
    still = step_after(cycle, (START, cs.Pose((0.902, 0.0, 0.0), ALONG_X)), 4 * MS)
    assert {m.time_to_limit for m in still.margins["cable"]} == {math.inf}


def test_a_repeated_stamp_and_a_gap_do_not_upset_the_times():
    cycle = cs.Cycle(LIMITED, model="cosserat")
    for k in range(3):
        report = step_after(cycle, motion(k), k * MS)
    again = step_after(cycle, motion(2), 2 * MS)
    assert again.margins == report.margins
    late = step_after(cycle, motion(3), 2_000 * MS)
    assert all(math.isnan(m.time_to_limit) for m in late.margins["cable"])
    cycle.reset()
    assert all(math.isnan(m.time_to_limit) for m in step_after(cycle, motion(4), 0).margins["cable"])
