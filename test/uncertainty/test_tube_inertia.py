"""Tubes of cables that move: how many loaded cables they hold, and where the load comes from."""

from __future__ import annotations

import math

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.cable.cable import STANDARD_GRAVITY
from cable_shape.errors import ArgumentError
from cable_shape.safety.report import WarningKind
from cable_shape.uncertainty.tube_watch import LEFT, SHARE, TubeWatch
from cable_shape.uncertainty.uncertainty import Tube

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.004)
LIMP = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=1e-4)
ENDS = cs.Pose((0.0, 0.0, 1.0), ALONG_X), cs.Pose((0.75, 0.1, 1.05), ALONG_X)
EXACT = cs.Uncertainty()
MS = 1_000_000


def tube_of(ratio: float, cable: cs.Cable = CABLE, known: cs.Uncertainty = EXACT, **options) -> Tube:
    options.setdefault("points", 41)
    predictor = cs.Predictor(cable, model="cosserat", **options)
    tube = TubeWatch(cable, known, **options).tube(predictor, predictor.predict(*ENDS), ENDS, inertia=ratio)
    assert tube is not None
    return tube


def inside(tube: Tube, cable: cs.Cable, loads: np.ndarray, **options) -> np.ndarray:
    """(n,): share of cables with these accelerations (k, 3) or (k, m, 3) [m/s^2] that the tube holds at each point."""
    predictor = cs.Predictor(cable, model="cosserat", points=tube.shape.points, **options)
    lines = []
    for load in loads:
        shape = predictor.predict(*ENDS, acceleration=load)
        assert shape.status
        lines.append(shape.positions.copy())
    off = np.array(lines) - tube.shape.positions
    along = np.einsum("kni,ni->kn", off, tube.shape.tangents)
    away = np.sqrt(np.maximum((off**2).sum(axis=2) - along**2, 0.0))
    return (away <= tube.radius).mean(axis=0)[1:-1]


@pytest.mark.parametrize("ratio", [0.1, 0.3])
def test_the_tube_holds_as_many_loaded_cables_as_it_says(ratio: float) -> None:
    loads = SHARE * ratio * 9.81 * np.random.default_rng(1).normal(size=(600, 3))
    held = inside(tube_of(ratio), CABLE, loads)
    assert 0.93 < held.mean() < 0.97
    assert held.min() > 0.92
    assert held.max() < 0.98


@pytest.mark.parametrize("cable", [CABLE, LIMP], ids=["stiff", "limp"])
@pytest.mark.parametrize("ratio", [0.25, 0.7])
def test_loads_as_large_as_the_ratio_are_within_whatever_their_direction(cable: cs.Cable, ratio: float) -> None:
    """The same all along the cable, and others at its two ends."""
    ways = np.random.default_rng(2).normal(size=(200, 2, 3))
    ways *= ratio * 9.81 / np.linalg.norm(ways, axis=2)[:, :, None]
    tube = tube_of(ratio, cable)
    assert inside(tube, cable, ways[:, 0]).min() > 0.94
    assert inside(tube, cable, ways).mean() > 0.95
    assert inside(tube_of(0.25 * ratio, cable), cable, ways[:, 0]).mean() < 0.6, "a narrower one does not hold them"


def test_the_load_joins_what_else_is_not_known() -> None:
    known = cs.Uncertainty({"length": 0.003}, misses=0.004)
    still, own, both = tube_of(0.0, known=known), tube_of(0.4), tube_of(0.4, known=known)
    np.testing.assert_allclose(both.covariance, still.covariance + own.covariance, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(own.covariance, 16.0 * tube_of(0.1).covariance, rtol=1e-9, atol=1e-18)
    assert (both.inertia, still.inertia) == (0.4, 0.0)
    unknown = tube_of(math.nan, known=known)
    assert math.isnan(unknown.inertia)
    np.testing.assert_array_equal(unknown.radius, still.radius)


def test_what_is_held_along_the_cable_swings_less() -> None:
    shape = cs.predict(LIMP, *ENDS, model="cosserat", points=101)
    clip = cs.Clip(0.4, cs.Pose(shape.positions[40], shape.quaternions[40]), "ball")
    free, held = tube_of(0.4, LIMP, points=101), tube_of(0.4, LIMP, points=101, scene=cs.Scene(clips=[clip]))
    assert held.radius[40] < 1e-9 < 0.02 < free.radius[40]
    loads = SHARE * 0.4 * 9.81 * np.random.default_rng(3).normal(size=(200, 3))
    assert 0.92 < inside(held, LIMP, loads, scene=cs.Scene(clips=[clip]))[2:37].mean() < 0.98


def test_wrong_ratios_are_refused() -> None:
    with pytest.raises(ArgumentError, match=r"inertia = -0\.1"):
        tube_of(-0.1)
    with pytest.raises(ArgumentError, match=r"inertia = 0\.3 .* without gravity"):
        tube_of(0.3, gravity=(0, 0, 0))


def test_a_calibration_s_tube_counts_what_is_told_or_what_its_accelerations_leave_out() -> None:
    """Fitted to cables that swing with known accelerations of 0.2 g."""
    rng = np.random.default_rng(4)
    seen = []
    for x in (0.6, 0.7, 0.8):
        end, load = cs.Pose((x, 0.1, 1.0), ALONG_X), rng.normal(size=3)
        load *= 0.2 * STANDARD_GRAVITY / np.linalg.norm(load)
        line = cs.predict(CABLE, ENDS[0], end, model="cosserat", acceleration=load).positions[10:-10:9]
        noise = 5e-4 * rng.normal(size=line.shape)
        seen.append(cs.Observation(ENDS[0], end, line + noise, acceleration=load))
    found = cs.calibrate(seen, CABLE)
    assert found.inertia == pytest.approx(0.2)
    unknown, rest, told = (cs.predict_tube(found, *ENDS, inertia=x) for x in (None, 0.0, 0.3))
    assert (unknown.holds, rest.holds, told.holds, told.inertia) == (False, True, True, 0.3)
    np.testing.assert_array_equal(unknown.radius, rest.radius)
    assert (told.radius[5:-5] > 2.0 * rest.radius[5:-5]).all()
    calm, fast = ((0.0, x * STANDARD_GRAVITY, 0.0) for x in (0.15, 0.6))
    assert cs.predict_tube(found, *ENDS, acceleration=calm).inertia == 0.0
    given = cs.predict_tube(found, *ENDS, acceleration=fast).inertia
    assert given == pytest.approx(LEFT * math.sqrt(0.6**2 - 0.2**2), rel=1e-3)


def run(cycle: cs.Cycle, path, steps: int, period: int = 10, first: int = 0) -> list[cs.CycleReport]:
    """Both grips moved along y to path(t) [m], every so many ms."""
    out = []
    for k in range(first, first + steps):
        y = path(k * period * 1e-3)
        ends = tuple(cs.Pose(pose.position + np.array((0.0, y, 0.0)), pose.quaternion) for pose in ENDS)
        out.append(cycle.step({"cable": ends}, k * period * MS))
    return out


def ratio_in(report: cs.CycleReport) -> float:
    return next((m.value for m in report.margins["cable"] if m.kind is WarningKind.QUASISTATIC), math.nan)


def test_a_cycle_s_tubes_follow_its_own_motion_and_its_decay() -> None:
    cycle = cs.Cycle(LIMP, model="cosserat", points=41, uncertainty=cs.Uncertainty(misses=0.002))
    found = run(cycle, lambda t: 0.5 * 3.0 * min(t, 0.3) ** 2 + 0.9 * max(t - 0.3, 0.0), 200)
    told = np.array([ratio_in(report) for report in found])
    np.testing.assert_array_equal([report.tubes["cable"].inertia for report in found], told)
    assert np.isnan(told[:11]).all()
    assert not np.isnan(told[11:]).any()
    widest = np.array([report.tubes["cable"].radius.max() for report in found])
    np.testing.assert_array_equal(widest[:11], 0.002)
    fast, later = int(told[11:].argmax()) + 11, 199
    assert 0.28 < told[fast] < 0.36
    swing = np.sqrt(widest[[fast, later]] ** 2 - 0.002**2)
    assert swing[0] / swing[1] == pytest.approx(told[fast] / told[later], rel=0.05)
    assert told[later] < 0.5 * told[fast], "it has died away by a good part"


def test_a_moving_cable_with_still_grips_keeps_its_wide_tube_and_shrinks_it() -> None:
    """The shape is reused, the ratio dies away."""
    cycle = cs.Cycle(LIMP, model="cosserat", points=41, uncertainty=EXACT)
    found = run(cycle, lambda t: 0.5 * 3.0 * min(t, 0.2) ** 2, 60)
    after = [report for report in found if report.shapes["cable"].reused and report.tubes["cable"].inertia > 0.0]
    assert len(after) > 20
    radii = np.array([report.tubes["cable"].radius.max() for report in after])
    ratios = np.array([report.tubes["cable"].inertia for report in after])
    np.testing.assert_allclose(radii / radii[0], ratios / ratios[0], rtol=1e-9)
    assert radii[-1] < radii[0]


def texts(report: cs.CycleReport) -> list[str]:
    return [w.text for w in report.warnings if w.other == "tube"]


def test_where_the_motion_is_not_known_the_tube_says_that_it_holds_at_rest_only() -> None:
    known = cs.Uncertainty(misses=0.002)
    cycle = cs.Cycle(LIMP, model="cosserat", points=41, uncertainty=known)
    found = run(cycle, lambda t: 0.0, 20)
    told = [len(texts(report)) for report in found]
    assert told == [1] * 11 + [0] * 9
    assert "holds a cable at rest only" in texts(found[0])[0]
    assert [report.clearance["cable"].holds for report in found] == [False] * 11 + [True] * 9
    assert found[-1].tubes["cable"].inertia < 1e-9
    jump = run(cycle, lambda t: 1.0, 20, first=20)
    assert [len(texts(report)) for report in jump][:2] == [1, 1], "what moved that far at once says nothing"
    assert not texts(jump[-1])
    gap = cycle.step({"cable": ENDS}, 10_000 * MS)
    assert len(texts(gap)) == 1
    never = run(
        cs.Cycle(LIMP, model="cosserat", points=41, uncertainty=known, quasistatic_limit=0.0), lambda t: 0.0, 15
    )
    assert len(texts(never[-1])) == 1
    light = cs.Cycle(CABLE.replace(linear_density=0.0), model="cosserat", points=41, uncertainty=known)
    first = light.step({"cable": ENDS}, 0)
    assert (first.tubes["cable"].inertia, texts(first)) == (0.0, [])


def test_beyond_the_weight_the_tube_says_that_it_does_not_hold() -> None:
    cycle = cs.Cycle(LIMP, model="cosserat", points=41, uncertainty=EXACT)
    last = run(cycle, lambda t: 0.5 * 12.0 * t * t, 30)[-1]
    tube = last.tubes["cable"]
    assert tube.inertia == pytest.approx(12.0 / 9.81, rel=0.05), "behind by the filter"
    assert (tube.holds, last.clearance["cable"].holds) == (False, False)
    assert f"does not hold: its inertia loads the cable with {100.0 * tube.inertia:.0f} % of its" in texts(last)[0]
    assert tube.radius.max() > 0.1


def test_tails_swing_along() -> None:
    cable = LIMP.replace(tails={"end": 0.3})
    cycle = cs.Cycle(cable, model="cosserat", points=41, uncertainty=EXACT)
    last = run(cycle, lambda t: 0.5 * 3.0 * t * t, 40)[-1]
    ratio = last.tubes["cable"].inertia
    tube = last.tail_tubes["cable", "end"]
    assert tube.inertia == ratio == pytest.approx(3.0 / 9.81, rel=0.05)
    assert tube.radius[0] == 0.0
    # far from its clamp a limp tail hangs along the load: it turns by the ratio's share
    hanging = np.linalg.norm(tube.shape.positions[-1] - tube.shape.positions[0])
    widest = SHARE * ratio * hanging * math.sqrt(-2.0 * math.log(0.05))
    assert 0.5 * widest < tube.radius[-1] < 1.1 * widest
