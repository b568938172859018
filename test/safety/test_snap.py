"""A snap is told before it happens, with the shape after it; the control loop's own prediction is left alone."""

import numpy as np
import pytest
from rods import arch_ends, arch_predictor

import cable_shape as cs
from cable_shape.safety.report import Severity
from cable_shape.safety.report import WarningKind as Kind
from cable_shape.safety.snap import STEPS, moved, predicted_snap

MS = 1_000_000  # ns
RATE = 0.5  # rad/s, at which both ends turn
PERIOD = 10  # ms


def ends(k: int):
    """Of cycle k; the arch snaps at a tilt of about 0.598 rad."""
    return {"cable": arch_ends(0.3 + 1e-3 * RATE * PERIOD * k)}


def arch_cycle(**keywords) -> cs.Cycle:
    return cs.Cycle(arch_predictor()[0].cable, model="cosserat", **keywords)


@pytest.fixture(scope="module")
def approach() -> list[cs.CycleReport]:
    """Reports up to and including the snap."""
    cycle = arch_cycle(snap_horizon=0.4)
    reports = []
    for k in range(100):
        reports.append(cycle.step(ends(k), k * PERIOD * MS))
        if reports[-1].shapes["cable"].status is cs.Status.SNAPPED:
            return reports
    raise AssertionError("it never snapped")


def test_it_is_told_before_it_happens_with_the_time(approach):
    at = len(approach) - 1
    told = [k for k, r in enumerate(approach) if any(w.kind is Kind.SNAP for w in r.warnings)]
    assert told, "never told"
    assert told[0] <= at - 15, "at least 0.15 s before"
    assert told == list(range(told[0], told[-1] + 1)), "without a break"
    assert told[-1] >= at - 1
    for k in told[:-1]:
        (warning,) = (w for w in approach[k].warnings if w.kind is Kind.SNAP)
        true = (at - k - 0.5) * PERIOD * 1e-3  # between the last two cycles
        step = 1.25 * 0.4 / STEPS  # of the search, once the warning stands
        assert warning.time_to_limit == pytest.approx(true, abs=step + 0.5e-3 * PERIOD), k
        assert warning.severity is Severity.WARN
        assert f"snaps to another shape in {warning.time_to_limit:.2g} s" in warning.text


def test_a_snap_carries_the_last_shape_of_the_branch_that_ended(approach):
    before, after = approach[-2].shapes["cable"], approach[-1].shapes["cable"]
    assert before.before is None
    assert after.before is not None
    assert after.before.status is cs.Status.OK
    jump = np.linalg.norm(after.positions - before.positions, axis=1).max()
    assert np.linalg.norm(after.before.positions - before.positions, axis=1).max() < 0.2 * jump


def test_it_is_told_without_a_break_until_the_cable_has_swung_round():
    """With weight this arch gives way sideways and swings round within two cycles: not a jump in every look ahead."""
    cable = arch_predictor()[0].cable.replace(linear_density=0.02)
    cycle = cs.Cycle(cable, model="cosserat", snap_horizon=0.5)
    told, heights = [], []
    for k in range(60, 110):
        report = cycle.step({"cable": arch_ends(0.005 * k)}, k * PERIOD * MS)
        told.append(any(w.kind is Kind.SNAP for w in report.warnings))
        heights.append(report.shapes["cable"].positions[75, 2])
    over = next(i for i, z in enumerate(heights) if z < 0.0)
    first = told.index(True)
    assert first < over - 20
    assert all(told[first : over - 1])
    assert not any(told[over + 2 :])


def test_it_carries_the_shape_after_it(approach):
    report = next(r for r in approach if r.after_snap)
    after, before, snapped = report.after_snap["cable"], report.shapes["cable"], approach[-1].shapes["cable"]
    assert before.positions[75, 2] > 0.1
    assert after.positions[75, 2] < -0.1
    assert np.abs(after.positions - snapped.positions).max() < 0.03, "the ends moved on a little until the snap"
    (warning,) = (w for w in report.warnings if w.kind is Kind.SNAP)
    moves = np.linalg.norm(after.positions - before.positions, axis=1)
    assert warning.arc_length == pytest.approx(before.arc_length[moves.argmax()])
    np.testing.assert_array_equal(warning.point_on_other, after.positions[moves.argmax()])


def test_it_is_looked_for_only_when_near(approach):
    assert approach[0].skipped["snap_checks"] == 1
    near = next(r for r in approach if r.after_snap)
    assert near.skipped["snap_checks"] == 0
    looked = [k for k, r in enumerate(approach) if r.skipped["snap_checks"] == 0]
    assert 3 <= len(looked) < 15
    assert min(np.diff(looked)) * PERIOD * 1e-3 >= 0.4 / 10, "ten times in a horizon"
    cycle = arch_cycle(snap_horizon=0.0)
    for k in range(len(approach) - 2):
        report = cycle.step(ends(k), k * PERIOD * MS)
        assert not report.after_snap
        assert report.skipped["snap_checks"] == 0, "there was none to skip"


def test_looking_ahead_changes_nothing_in_the_prediction(approach):
    cycle = arch_cycle(snap_horizon=0.0)
    for k, report in enumerate(approach):
        alone = cycle.step(ends(k), k * PERIOD * MS).shapes["cable"]
        np.testing.assert_array_equal(alone.buffer, report.shapes["cable"].buffer)


def test_a_copy_of_the_rod_shares_no_number():
    predictor, start, end = arch_predictor()
    predictor.predict(start, end)
    state = predictor.rod_state
    assert state is not None
    other = state.copied()
    for name, value in vars(state).items():
        if name != "ints" and isinstance(value, np.ndarray) and value.size:  # the plan is never written to
            assert not np.shares_memory(value, getattr(other, name)), name
            np.testing.assert_array_equal(value, getattr(other, name))
    assert np.shares_memory(other.target, other.sols)
    assert np.shares_memory(state.target, state.sols)
    assert other.problem is state.problem


def test_no_snap_where_there_is_none():
    predictor, start, end = arch_predictor()
    predictor.predict(start, end)
    grips = predictor.problem.start, predictor.problem.end

    def found(twists):
        return predicted_snap(predictor.ahead(), grips, twists, 1.0)

    assert found(np.zeros(12)) is None
    away = np.array((0, 0, 0, 0, -0.1, 0, 0, 0, 0, 0, 0.1, 0))
    assert found(away) is None
    pulled = np.array((0, 0, 0, 0, 0, 0, 0.3, 0, 0, 0, 0, 0))
    assert found(pulled) is None, "overstretched is no snap"


def test_extrapolated_grips():
    _, start, _ = arch_predictor()
    offset = cs.Pose((0.0, 0.1, 0.0))
    grip = cs.Grip(start, "swivel", offset, (0.0, 0.0, 1.0))
    v, w = np.array((0.1, 0.2, -0.3)), np.array((0.0, 0.0, np.pi))
    there = moved(grip, np.concatenate((v, w)), 0.5)
    frame = grip.cable_frame
    np.testing.assert_allclose(there.cable_frame.position, frame.position + 0.5 * v, atol=1e-15)
    quarter = cs.Pose(quaternion=(0, 0, np.sqrt(0.5), np.sqrt(0.5))) * cs.Pose(quaternion=frame.quaternion)
    assert there.cable_frame.distance(cs.Pose(there.cable_frame.position, quarter.quaternion))[1] < 1e-12
    assert (there.kind, there.curvature[2]) == ("swivel", 1.0)


def test_a_bad_horizon_is_refused():
    with pytest.raises(cs.ArgumentError, match=r"snap_horizon = -1.0 is not allowed: it must be at least 0 s"):
        arch_cycle(snap_horizon=-1.0)


def test_it_is_told_in_contact():
    """A bar presses the arch down at a third of it, and still does when the arch snaps past it."""
    cable = arch_predictor()[0].cable.replace(diameter=0.006)
    free = arch_predictor()[0].predict(*arch_ends(0.0)).positions
    x, _, z = free[np.abs(free[:, 0] - 0.35).argmin()]
    along_y = cs.Pose((0.0, 0.0, 0.0), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    bar = cs.Obstacle("bar", cs.Capsule(0.02, 0.4), along_y, link="bar")
    cycle = cs.Cycle(cable, scene=cs.Scene(obstacles=[bar], contact="solve"), model="cosserat", snap_horizon=0.4)
    watched, reports = cs.Cycle(cable, scene=cycle.scene, model="cosserat", snap_horizon=0.0), []
    lowered = np.append(np.linspace(0.053, 0.011, 20), np.full(140, 0.011))
    for k, above in enumerate(lowered):
        given = {"cable": arch_ends(max(0.0, 0.005 * (k - 19)))}
        links = {"bar": cs.Pose((x, 0.0, z + above))}
        reports.append(cycle.step(given, k * PERIOD * MS, links=links))
        alone = watched.step(given, k * PERIOD * MS, links=links).shapes["cable"]
        np.testing.assert_array_equal(alone.buffer, reports[-1].shapes["cable"].buffer)
        if alone.status is cs.Status.SNAPPED:
            break
    at = len(reports) - 1
    assert alone.status is cs.Status.SNAPPED
    assert [len(r.shapes["cable"].contacts) for r in reports[25:at]] == [1] * (at - 25)
    mu = [m.value for r in reports for m in r.margins["cable"] if m.kind is Kind.STABILITY]
    assert len(mu) == len(reports)
    assert all(np.diff(mu[at - 15 : at]) < 0.0)
    told = {k: w.time_to_limit for k, r in enumerate(reports[:at]) for w in r.warnings if w.kind is Kind.SNAP}
    assert min(told) <= at - 10
    for k, time in told.items():
        assert time == pytest.approx((at - k - 0.5) * PERIOD * 1e-3, abs=1.25 * 0.4 / STEPS + 0.5e-3 * PERIOD), k
