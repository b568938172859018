"""Clearance of cables to each other and to themselves: closed forms, culling to the bit, names, warnings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cable_shape as cs
from cable_shape.kernels.distance import cable_near
from cable_shape.kernels.distance.apart import apart_from_itself, leans
from cable_shape.kernels.distance.cable_near import counts_as_near
from cable_shape.safety.near import CableNear

ALONG_X = (0.5, 0.5, 0.5, 0.5)
ALONG_Y = (math.sqrt(0.5), 0.0, 0.0, -math.sqrt(0.5))  # d3 = y
CABLE = cs.Cable(length=0.8, linear_density=0.05, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
CLEAR = cs.Clearance()


def shape_of(points):
    """A shape with those positions (n, 3), its arc length that of the polygon."""
    points = np.asarray(points, dtype=float)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    n = len(points)
    buffer = np.zeros(17 * n)
    buffer[:n] = np.concatenate(([0.0], np.cumsum(steps)))
    buffer[n : 4 * n] = points.ravel()
    return cs.CableShape(buffer, n, length=float(steps.sum()), model="catenary", status=cs.Status.OK)


def straight(a, b, n=40):
    return shape_of(np.linspace(a, b, n))


def circle(radius, turns, rise=0.0, n=200):
    angle = np.linspace(0.0, 2.0 * math.pi * turns, n)
    height = rise * angle / (2.0 * math.pi)
    return shape_of(np.stack((radius * np.cos(angle), radius * np.sin(angle), height), axis=1))


def near(shapes, cull=True):
    checker = CableNear(dict.fromkeys(shapes, CABLE), cs.Scene(), cull=cull)
    return checker.added(shapes, dict.fromkeys(shapes, CLEAR))


def wiggle(rng, n=120):
    s = np.linspace(0.0, 1.0, n)
    waves = rng.normal(size=(4, 3)) * 0.12
    return shape_of(sum(np.cos(math.pi * (k + 1) * s + rng.uniform(0, 6))[:, None] * waves[k] for k in range(4)))


def test_two_pieces_against_a_dense_search():
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(np.linspace(0, 1, 301), np.linspace(0, 1, 301))
    for kind in range(60):
        a, b = rng.normal(size=(2, 3)), rng.normal(size=(2, 3))
        if kind % 3 == 0:
            b[1] = b[0] + rng.uniform(-2, 2) * (a[1] - a[0])  # parallel
        square, u, v = cable_near.between_pieces(a, 0, b, 0)
        apart = a[0] + x[..., None] * (a[1] - a[0]) - b[0] - y[..., None] * (b[1] - b[0])
        least = float((apart**2).sum(axis=-1).min())
        assert 0.0 <= u <= 1.0
        assert 0.0 <= v <= 1.0
        there = a[0] + u * (a[1] - a[0]) - b[0] - v * (b[1] - b[0])
        assert float(there @ there) == pytest.approx(square, abs=1e-12)
        assert least - 2e-3 < square < least + 1e-12


def test_crossed_straight_cables():
    shapes = {"a": straight((-0.4, 0, 0), (0.4, 0, 0)), "b": straight((0.1, -0.3, 0.05), (0.1, 0.5, 0.05))}
    found = near(shapes)
    (on_a,), (on_b,) = found["a"].bodies, found["b"].bodies
    assert (on_a.body, on_b.body) == ("b", "a")
    assert on_a.distance == on_b.distance == pytest.approx(0.05 - 0.008)
    assert on_a.arc_length == pytest.approx(0.5)
    assert on_b.arc_length == pytest.approx(0.3)
    assert on_a.point_on_cable == pytest.approx((0.1, 0.0, 0.004))
    assert on_a.point_on_body == pytest.approx((0.1, 0.0, 0.046))
    assert on_b.point_on_cable == pytest.approx(on_a.point_on_body)


def test_a_straight_or_bent_cable_is_not_near_itself_and_a_coil_is():
    assert near({"a": straight((0, 0, 0), (0.8, 0, 0))})["a"].bodies == ()
    assert near({"a": circle(0.02, 0.45)})["a"].bodies == ()
    (found,) = near({"a": circle(0.02, 2.0, rise=0.03)})["a"].bodies
    assert found.body == "itself"
    pitch = math.hypot(2.0 * math.pi * 0.02, 0.03)
    across = 0.03 * 2.0 * math.pi * 0.02 / pitch  # of neighbouring turns, measured at right angles to them
    assert found.distance == pytest.approx(across - 0.008, abs=1e-3)


def test_a_hairpin_is_as_near_itself_as_its_legs():
    angle = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 60)
    bend = np.stack((0.3 + 0.015 * np.cos(angle), 0.015 * np.sin(angle), 0.0 * angle), axis=1)
    legs = np.linspace((0.0, -0.015, 0.0), (0.3, -0.015, 0.0), 60)[:-1]
    (found,) = near({"a": shape_of(np.vstack((legs, bend, legs[::-1] * (1, -1, 1))))})["a"].bodies
    assert found.distance == pytest.approx(0.03 - 0.008, abs=2e-4)  # to the length of a piece


def test_culling_does_not_change_the_answer_by_a_bit_and_is_counted():
    rng = np.random.default_rng(7)
    culled = listed = 0
    for _ in range(40):
        shapes = {name: wiggle(rng) for name in "abc"}
        quick, slow = near(shapes), near(shapes, cull=False)
        for name in shapes:
            one, other = quick[name], slow[name]
            assert [b.body for b in one.bodies] == [b.body for b in other.bodies]
            assert np.array_equal(one.table, other.table)
            assert one.pairs_culled + one.pairs_exact == other.pairs_culled + other.pairs_exact
            assert one.pairs_exact <= other.pairs_exact
            culled += one.pairs_culled
            listed += len(one.bodies)
    assert culled > 100_000
    assert listed > 40


def test_places_are_the_separate_nearest_points():
    wave = np.linspace(0.0, 0.4, 81)
    a = shape_of(np.stack((wave, 0.02 * np.cos(4 * math.pi * wave / 0.4), 0.0 * wave), axis=1))
    b = straight((0.0, 0.0, 0.006), (0.4, 0.0, 0.006), 81)
    out = np.empty((cable_near.MOST_SPOTS, cable_near.SPOT))
    count = cable_near.spots(
        a.positions, a.arc_length, b.positions, b.arc_length, False, 0.0, np.zeros((2, 2)), 0.008, 0.02, out
    )
    assert count == 4  # where the wave crosses the line
    assert np.sort(out[:count, 2]) == pytest.approx(np.array((0.05, 0.15, 0.25, 0.35)), abs=2e-3)
    assert out[:count, 0] == pytest.approx(0.006, abs=1e-9)


def taut(height, name):
    if name == "low":
        return cs.Pose((-0.395, 0, 0), ALONG_X), cs.Pose((0.395, 0, 0), ALONG_X)
    return cs.Pose((0, -0.395, height), ALONG_Y), cs.Pose((0, 0.395, height), ALONG_Y)


def test_a_cycle_warns_of_another_cable_with_the_time_left():
    cycle = cs.Cycle({"low": CABLE, "high": CABLE}, model="cosserat")
    for k in range(3):  # 0.1 m/s downwards
        grips = {name: taut(0.05 - 0.001 * k, name) for name in ("low", "high")}
        report = cycle.step(grips, stamp=10_000_000 * k)
    gap = 0.05 - 0.002 - 0.008
    (margin,) = [m for m in report.margins["low"] if m.other == "high"]
    assert margin.kind is cs.WarningKind.CLEARANCE
    assert margin.value == pytest.approx(gap, abs=2e-4)
    assert margin.time_to_limit == pytest.approx((gap - 0.03) / 0.1, rel=2e-2)
    assert not report.warnings
    assert report.skipped["pairs_culled"] > 1000
    report = cycle.step({name: taut(0.025, name) for name in ("low", "high")}, stamp=10**9)
    assert {(w.cable_id, w.other, w.severity) for w in report.warnings} == {
        ("low", "high", cs.Severity.WARN),
        ("high", "low", cs.Severity.WARN),
    }
    assert "from 'high' at 0.4" in next(w.text for w in report.warnings if w.cable_id == "low")
    report = cycle.step({name: taut(0.004, name) for name in ("low", "high")}, stamp=2 * 10**9)
    assert all(w.severity is cs.Severity.ERROR and "overlaps" in w.text for w in report.warnings)
    assert len(report.warnings) == 2


def test_a_cable_that_did_not_converge_is_near_nothing():
    cycle = cs.Cycle({"low": CABLE, "high": CABLE}, scene=cs.Scene(contact="off"))
    assert cycle.step({n: taut(0.01, n) for n in ("low", "high")}, stamp=0).clearance["low"].bodies == ()
    lost = straight((-0.4, 0, 0), (0.4, 0, 0))
    lost.status = cs.Status.NOT_CONVERGED
    found = near({"a": lost, "b": straight((0, -0.4, 0.01), (0, 0.4, 0.01))})
    assert found["a"].bodies == found["b"].bodies == ()
    assert found["b"].beyond == 0.0


@pytest.mark.parametrize("name", ["low", "itself"])
def test_an_obstacle_with_the_name_of_a_cable_is_refused(name):
    scene = cs.Scene(obstacles=[cs.Obstacle(name, cs.Sphere(0.1))])
    with pytest.raises(cs.ArgumentError, match="Rename the obstacle"):
        cs.Cycle({"low": CABLE, "high": CABLE}, scene=scene)


def test_a_cable_called_itself_is_refused():
    with pytest.raises(cs.ArgumentError, match="Rename the cable"):
        cs.Cycle({"itself": CABLE})


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.floats(0.0, 0.8))
def test_what_leans_is_not_near_itself_nor_is_any_shape_on_the_way(seed, tilt):
    """The bound that rules out most cables at once, on random walks whose pieces lean along x by up to `tilt` rad."""
    rng = np.random.default_rng(seed)
    walks = []
    for _ in range(2):
        lean, round_ = rng.uniform(0.0, tilt, 60), rng.uniform(0.0, 2.0 * math.pi, 60)
        pieces = np.stack((np.cos(lean), np.sin(lean) * np.cos(round_), np.sin(lean) * np.sin(round_)), axis=1)
        walks.append(np.concatenate((np.zeros((1, 3)), np.cumsum(0.01 * pieces, axis=0))))
    p, then = walks
    arcs = np.linspace(0.0, 0.6, 61)
    if tilt < 0.4:  # the direction is that of the chord, which is a little off x itself
        assert apart_from_itself(p, arcs, then, 0.02, 0.008, 1e-9)
    if leans(p, 1.0, 0.0, 0.0) and leans(then, 1.0, 0.0, 0.0):
        for x in (0.0, 0.3, 0.5, 0.8, 1.0):
            way = np.ascontiguousarray(p + x * (then - p))
            assert not any(counts_as_near(way, arcs, i, j, 0.02) for i in range(60) for j in range(i + 1, 60))


def test_what_has_moved_far_is_not_near_itself_on_the_way_either():
    ruled_out: list[bool] = []
    moved_far(ruled_out)
    assert 10 < sum(ruled_out) < len(ruled_out) - 10


def moved_far(ruled_out):
    """The bound of what may have come nearer, on smooth curves that move by up to `far` m and turn meanwhile."""

    @settings(derandomize=True, deadline=None, max_examples=150)
    @given(st.integers(0, 10**6), st.floats(0.0, 12.0), st.floats(0.0, 0.06))
    def one(seed, bent, far):
        ruled_out.append(is_ruled_out(seed, bent, far))

    one()


def is_ruled_out(seed, bent, far):
    """Whether a random pair of shapes is; fails if it is near itself on the way for all that."""
    rng = np.random.default_rng(seed)
    arcs, reach = np.linspace(0.0, 0.6, 61), 0.02
    curves = []
    waves = rng.normal(size=(3, 3))
    for k in range(2):
        waves = waves + (0.1 * rng.normal(size=(3, 3)) if k else 0.0)
        angles = np.array([sum(w * np.sin((i + 1) * 3.0 * arcs) for i, w in enumerate(row)) for row in waves])
        x = bent * arcs + angles[0]
        t = np.stack((np.cos(x), np.sin(x), 0.5 * np.sin(angles[1])), axis=1)
        t /= np.linalg.norm(t, axis=1, keepdims=True)
        curve = np.concatenate((np.zeros((1, 3)), np.cumsum(0.01 * t[1:], axis=0)))
        curves.append(curve + k * far * rng.uniform(-1.0, 1.0, 3) / math.sqrt(3.0))
    p, then = curves
    out = apart_from_itself(p, arcs, then, 0.05, reach, 1e-9)
    for x in np.linspace(0.0, 1.0, 9) if out else ():
        way = np.ascontiguousarray(p + x * (then - p))
        i, j = np.triu_indices(60, 1)
        apart = np.linalg.norm(0.5 * (way[1:] + way[:-1])[i] - 0.5 * (way[1:] + way[:-1])[j], axis=1)
        for a, b in zip(i[apart < reach - 0.01].tolist(), j[apart < reach - 0.01].tolist(), strict=True):
            assert not counts_as_near(way, arcs, a, b, 0.05)
    return bool(out)
