"""Cables that touch are looked ahead of together: one look for all, with all their grips going on as they do."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.cycle.looking_ahead import Together
from cable_shape.prediction.together import joined
from cable_shape.safety.report import WarningKind
from cable_shape.safety.snap import STEPS
from cable_shape.solve.touching.crossing import Crossing

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
PERIOD = 10_000_000  # ns
LONG = cs.Cable(length=0.62, linear_density=0.02, bending_stiffness=0.02, diameter=0.008)
SHORT = cs.Cable(length=0.40, linear_density=0.03, bending_stiffness=0.01, diameter=0.008)
SCENE = cs.Scene(contact="solve")
HORIZON = 0.5  # s


def held(middle, yaw: float, span: float) -> tuple[cs.Pose, cs.Pose]:
    turn = Rotation.from_rotvec((0.0, 0.0, yaw))
    side, q = turn.apply((0.5 * span, 0.0, 0.0)), (turn * ALONG_X).as_quat()
    return cs.Pose(middle - side, q), cs.Pose(middle + side, q)


def ends(shift=(0.0, 0.0, 0.0), drop: float = 0.03) -> dict[str, tuple[cs.Pose, cs.Pose]]:
    """The short one lies across the long one, which sags, from a `drop` of 0.02 m or so on."""
    shift = np.asarray(shift, dtype=float)
    return {
        "long": held(shift, 0.0, 0.58),
        "short": held(shift + np.array((0.0, 0.0, 0.01 - drop)), np.pi / 2.0, 0.36),
    }


def tilted(given: dict[str, tuple[cs.Pose, cs.Pose]], angle: float) -> dict[str, tuple[cs.Pose, cs.Pose]]:
    """The same with the long one pitched at both its grips, bowing up."""
    out = []
    for pose, pitch in zip(given["long"], (-angle, 0.98 * angle), strict=True):
        q = Rotation.from_rotvec((0.0, pitch, 0.0)) * Rotation.from_quat(pose.quaternion)
        out.append(cs.Pose(pose.position, q.as_quat()))
    return {**given, "long": (out[0], out[1])}


def cycle(horizon: float = HORIZON) -> cs.Cycle:
    made = cs.Cycle({"long": LONG, "short": SHORT}, scene=SCENE, model="cosserat", snap_horizon=horizon)
    for k in range(-30, 0):  # lowered onto it
        report = made.step(ends(drop=0.03 + 0.001 * k), k * PERIOD)
    assert all(shape.usable and shape.contacts for shape in report.shapes.values())
    return made


def test_all_grips_go_on_in_a_look():
    """Pushed along as a whole they keep their shapes, whatever time is looked at."""
    predictors = {"long": cs.Predictor(LONG, scene=SCENE), "short": cs.Predictor(SHORT, scene=SCENE)}
    crossing = joined(predictors)
    speed = np.array((0.3, -0.2, 0.1))
    ahead = Together(crossing, predictors, HORIZON)
    for k in range(3):
        for name, (start, end) in ends(0.01 * k * speed).items():
            predictors[name].move(start, end, None)
        shapes = crossing.solve()
        find = ahead.find(k * PERIOD)
    assert crossing.touching == {0, 1}
    assert set(find) == {"long", "short"}
    look = ahead._from_here()
    for time in (0.1, 0.35):
        for i, name in enumerate(predictors):
            shape = look(time)[name]
            assert shape.status is cs.Status.OK
            np.testing.assert_allclose(shape.positions, shapes[i].positions + time * speed, atol=2e-6)
    assert all(one(HORIZON) is None for one in find.values())
    again = crossing.solve()
    for shape, before in zip(again, shapes, strict=True):
        np.testing.assert_array_equal(shape.buffer, before.buffer)


def test_nothing_is_looked_for_where_it_is_not_known_how_they_move():
    predictors = {"long": cs.Predictor(LONG, scene=SCENE), "short": cs.Predictor(SHORT, scene=SCENE)}
    crossing = joined(predictors)
    ahead = Together(crossing, predictors, HORIZON)
    for name, (start, end) in ends().items():
        predictors[name].move(start, end, None)
    crossing.solve()
    assert ahead.find(0) == {}
    assert set(ahead.find(PERIOD)) == {"long", "short"}
    assert ahead.find(10 * 1_000_000_000) == {}, "a gap"


@pytest.fixture
def solved(monkeypatch) -> list[int]:
    """How often crossings were solved for so far, in one number."""
    count, solve = [0], Crossing.solve

    def counted(self):
        count[0] += 1
        return solve(self)

    monkeypatch.setattr(Crossing, "solve", counted)
    return count


def test_one_look_serves_all(solved):
    """As the long one is turned at its grips both look for a snap: in a cycle once, not each by itself."""
    made = cycle(horizon=1.0)
    most = looks = told = 0
    for k in range(22):
        before = solved[0]
        report = made.step(tilted(ends(), 0.005 * k), k * PERIOD)
        assert all(shape.usable for shape in report.shapes.values())
        most, looks = max(most, solved[0] - before), looks + (2 - report.skipped["snap_checks"])
        told += set(report.after_snap) == {"long", "short"}
    assert looks >= 4
    assert told >= 4
    assert 1 < most <= 1 + STEPS


def test_stability_is_told_where_a_cable_turns_most_itself():
    """Of a stiff one pressed onto an arch the softest mode of both turns the arch most: that place was told of both."""
    cables = {"arch": LONG.replace(linear_density=0.002), "bar": SHORT.replace(bending_stiffness=0.5)}
    made = cs.Cycle(cables, scene=SCENE, model="cosserat")
    arch = tilted({"long": held((0.0, 0.0, 0.0), 0.0, 0.6)}, 0.35)["long"]
    for k in range(60):
        bar = held((0.0, 0.0, 0.14 - 0.002 * k), np.pi / 2.0, 0.398)
        report = made.step({"arch": arch, "bar": bar}, k * PERIOD)
        if k < 48:  # it comes to be known from cycle to cycle
            continue
        assert report.shapes["bar"].contacts
        for name, cable in cables.items():
            (margin,) = (m for m in report.margins[name] if m.kind is WarningKind.STABILITY)
            assert margin.arc_length == pytest.approx(0.5 * cable.length, abs=0.02), "both are alike on both sides"
