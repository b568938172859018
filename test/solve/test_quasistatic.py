"""Whether a moving cable may be taken for one at rest: ratio of the loads, period, and the warning."""

import math

import numpy as np
import pytest
from scipy.linalg import eigh

import cable_shape as cs
from cable_shape.errors import ArgumentError
from cable_shape.kernels import swing
from cable_shape.safety.report import WarningKind
from cable_shape.solve.quasistatic import bending_rate

ALONG_X = (0.5, 0.5, 0.5, 0.5)
LIMP = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=1e-5)
MS = 1_000_000


def grips(x: float = 0.0, z: float = 1.0, chord: float = 0.8) -> tuple[cs.Pose, cs.Pose]:
    return cs.Pose((x, 0.0, z), ALONG_X), cs.Pose((x + chord, 0.0, z), ALONG_X)


def swing_period(
    cable: cs.Cable, shape: cs.CableShape, start: cs.Pose | cs.Grip, end: cs.Pose | cs.Grip | None
) -> float:
    """[s], with which a cable of this shape swings about the line through its ends."""
    slack = swing.swing_rate(shape.buffer, shape.points, end is not None, np.array((0.0, 0.0, -9.81)))
    return 2.0 * math.pi / math.sqrt(slack + bending_rate(cable, start, end))


def ratios(path, seconds: float, period: float = 0.01, noise: float = 0.0, cable: cs.Cable = LIMP) -> list[float]:
    """The ratio in each cycle while both grips are at (0, 0, path(t))."""
    cycle = cs.Cycle(cable)
    rng = np.random.default_rng(0)
    out = []
    for k in range(round(seconds / period)):
        ends = grips(z=1.0 + path(k * period))
        if noise:
            ends = tuple(cs.Pose(p.position + noise * rng.normal(size=3), p.quaternion) for p in ends)
        report = cycle.step({"cable": ends}, round(k * period * 1e9))
        found = [m for m in report.margins["cable"] if m.kind is WarningKind.QUASISTATIC]
        out.append(found[0].value if found else math.nan)
    return out


def test_a_steady_acceleration_is_its_part_of_gravity() -> None:
    found = ratios(lambda t: 0.5 * 2.0 * t * t, 0.5)
    assert np.isnan(found[:11]).all()  # 0.1 s is needed for a speed and how it changes
    assert found[-1] == pytest.approx(2.0 / 9.81, rel=5e-3)


def test_a_steady_speed_is_no_load_and_neither_is_noise_of_tracked_poses() -> None:
    assert np.nanmax(ratios(lambda t: 0.7 * t, 0.3)) < 1e-6
    assert np.nanmax(ratios(lambda t: 0.7 * t, 1.0, noise=2e-4)) < 0.06
    assert np.nanmax(ratios(lambda t: 0.7 * t, 0.5, period=0.001, noise=1e-4)) < 0.06


def test_a_cable_that_was_accelerated_swings_on_for_its_period() -> None:
    found = ratios(lambda t: 0.5 * 3.0 * min(t, 0.3) ** 2 + 0.9 * max(t - 0.3, 0.0), 2.0)
    shape = cs.predict(LIMP, *grips())
    period = swing_period(LIMP, shape, *grips())
    assert found[120] / found[80] == pytest.approx(math.exp(-0.4 / period), rel=1e-3)


def test_a_gripper_that_turns_swings_the_stiff_end_along() -> None:
    stiff = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.06 * 9.81 * 0.2**3)  # 0.2 m of its weight
    cycle, end = cs.Cycle(stiff, model="cosserat"), grips()[1]
    found = None
    for k in range(50):
        angle = 0.5 * 4.0 * (0.01 * k) ** 2  # 4 rad/s^2 about y
        half = cs.Pose((0, 0, 1), (0.0, math.sin(0.5 * angle), 0.0, math.cos(0.5 * angle)))
        report = cycle.step({"cable": (half * cs.Pose((0, 0, 0), ALONG_X), end)}, 10 * MS * k)
        found = next((m for m in report.margins["cable"] if m.kind is WarningKind.QUASISTATIC), None)
    omega = 4.0 * (0.49 - 0.005 - 0.05)  # mean of the last cycle, behind by the filter
    assert found is not None
    assert found.value == pytest.approx(0.2 * (4.0 + omega**2) / 9.81, rel=0.02)
    assert found.arc_length == 0.0


def test_period_of_a_shallow_chain_is_that_of_the_parabola() -> None:
    # out of its plane a parabola of sag f swings as a rigid body: 2 pi sqrt(4 f / 5 g), exactly for small f
    ends = tuple(cs.Grip(p, kind="pinned") for p in grips(chord=0.985))
    shape = cs.predict(LIMP, *ends, model="catenary")
    sag = 1.0 - float(shape.positions[:, 2].min())
    assert swing_period(LIMP, shape, *ends) == pytest.approx(2.0 * math.pi * math.sqrt(0.8 * sag / 9.81), rel=0.01)


def test_period_of_a_stiff_beam_and_of_a_hanging_chain() -> None:
    stiff = cs.Cable(length=0.5, linear_density=0.1, bending_stiffness=2.0)
    ends = grips(chord=0.5)
    beam = 2.0 * math.pi / (22.3733 / 0.25 * math.sqrt(2.0 / 0.1))
    assert swing_period(stiff, cs.predict(stiff, *ends, model="cosserat"), *ends) == pytest.approx(beam, rel=1e-3)
    start = cs.Grip(cs.Pose((0, 0, 1), (1.0, 0.0, 0.0, 0.0)), kind="pinned")
    chain = cs.predict(LIMP, start, None, model="catenary")
    bessel = 2.0 * math.pi / (0.5 * 2.404826 * math.sqrt(9.81))  # J0(2 w sqrt(L / g)) = 0
    assert swing_period(LIMP, chain, start, None) == pytest.approx(bessel, rel=0.025)  # a rigid rod is a little quicker


def test_period_against_the_lowest_mode_across_of_a_discrete_chain() -> None:
    """Small motion across the plane of a hanging chain: stiffness of the tension, masses at the points."""
    ends = tuple(cs.Grip(p, kind="pinned") for p in grips(chord=0.6))
    shape = cs.predict(LIMP, *ends, model="catenary", points=201)
    n, h = shape.points - 2, shape.length / (shape.points - 1)
    tension = 0.5 * (shape.tension[:-1] + shape.tension[1:])
    K = (np.diag(tension[:-1] + tension[1:]) - np.diag(tension[1:-1], 1) - np.diag(tension[1:-1], -1)) / h
    lowest = eigh(K, LIMP.linear_density * h * np.eye(n), eigvals_only=True, subset_by_index=(0, 0))[0]
    exact = 2.0 * math.pi / math.sqrt(lowest)
    assert 0.98 * exact < swing_period(LIMP, shape, *ends) < exact, "Rayleigh's quotient is a little too quick"


def test_the_warning_comes_stays_while_the_cable_swings_and_ends() -> None:
    cycle = cs.Cycle(LIMP)
    said = []
    place = speed = 0.0
    for k in range(400):
        acceleration = 4.0 * (20 <= k < 40) - 4.0 * (40 <= k < 60)
        place, speed = place + 0.01 * speed, speed + 0.01 * acceleration
        report = cycle.step({"cable": grips(place)}, 10 * MS * k)
        said.append([w for w in report.warnings if w.kind is WarningKind.QUASISTATIC])
    counts = [len(w) for w in said]
    first, last = counts.index(1), len(counts) - 1 - counts[::-1].index(1)
    assert 20 < first < 35
    assert counts[first : last + 1] == [1] * (last + 1 - first), "it does not chatter"
    assert 70 < last < 250
    warning = said[45][0]
    assert warning.severity is cs.Severity.WARN
    assert (warning.limit, warning.arc_length) == (0.25, 0.0)
    assert "swings with a period of about" in warning.text
    assert warning.value > 0.25


def test_what_is_not_known_has_no_margin() -> None:
    def kinds(cycle: cs.Cycle, steps) -> list[bool]:
        return [
            any(m.kind is WarningKind.QUASISTATIC for m in cycle.step({"cable": ends}, stamp).margins["cable"])
            for ends, stamp in steps
        ]

    steady = [(grips(0.001 * k), 60 * MS * k) for k in range(4)]
    assert kinds(cs.Cycle(LIMP), steady) == [False, False, True, True]
    assert kinds(cs.Cycle(LIMP, quasistatic_limit=0.0), steady) == [False] * 4
    assert kinds(cs.Cycle(LIMP, gravity=(0, 0, 0)), steady) == [False] * 4
    after_gap = [*steady, (grips(0.1), 5000 * MS), (grips(0.1), 5120 * MS)]
    assert kinds(cs.Cycle(LIMP), after_gap) == [False, False, True, True, False, True]
    jump = [*steady, (grips(3.0), 200 * MS), (grips(3.0), 210 * MS)]
    assert kinds(cs.Cycle(LIMP), jump)[4:] == [False, False]
    with pytest.raises(ArgumentError, match="quasistatic_limit"):
        cs.Cycle(LIMP, quasistatic_limit=-0.1)


def test_a_repeated_stamp_repeats_the_ratio() -> None:
    cycle = cs.Cycle(LIMP)
    values = []
    for k in (0, 1, 2, 3, 3, 4):
        report = cycle.step({"cable": grips(0.005 * k * k)}, 100 * MS * k)
        values += [m.value for m in report.margins["cable"] if m.kind is WarningKind.QUASISTATIC]
    assert values[1] == values[2]
    assert values[3] != values[2]


def test_a_cable_whose_acceleration_is_given_is_not_warned_of_it() -> None:
    told = {}
    for given in (None, {"cable": (0.0, 0.0, 5.0)}):
        cycle = cs.Cycle(LIMP)
        for k in range(40):
            ends = grips(z=1.0 + 2.5 * (0.01 * k) ** 2)
            report = cycle.step({"cable": ends}, 10 * MS * k, acceleration=given)
        told[given is None] = [
            any(one.kind is WarningKind.QUASISTATIC for one in every)
            for every in (report.margins["cable"], report.warnings)
        ]
    assert told == {True: [True, True], False: [False, False]}
