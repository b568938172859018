"""Tubes of cables and harnesses that swing, against ensembles of motions whose errors are drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs

ALONG = (0.5, 0.5, 0.5, 0.5)  # d3 along x
CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, retardation_time=0.05, drag=0.05)
KNOWN = cs.Uncertainty(
    {"bending_stiffness": 0.1, "retardation_time": 0.2, "drag": 0.2, "length": 1e-3, "roll": 0.03},
    (1e-3, 5e-3),
    (0, 4e-3),
)
STEPS, DT = 25, 0.01


def ends(k: int, off: np.ndarray | None = None, roll: float = 0.0) -> tuple[cs.Grip, cs.Grip]:
    """Both grips move sideways and turn; `off` (12,): by so much they are elsewhere."""
    y, more = 0.1 * np.sin(0.12 * k), np.zeros(12) if off is None else off
    grips = []
    for i, (place, turn) in enumerate((((0.0, y, 0.0), (0, 0, y)), ((0.7, 0.5 * y, 0.2 * y), (0, 0, -2 * y)))):
        own = more[6 * i : 6 * i + 6]
        frame = Rotation.from_rotvec(own[3:]) * Rotation.from_rotvec(turn) * Rotation.from_quat(ALONG)
        offset = Rotation.from_rotvec((0.0, 0.0, roll if i else 0.0)).as_quat()
        grips.append(cs.Grip(cs.Pose(own[:3] + place, frame.as_quat()), offset=cs.Pose((0.0, 0.01, 0.02 * i), offset)))
    return grips[0], grips[1]


def drawn(rng: np.random.Generator, scene: cs.Scene | None) -> np.ndarray:
    """The last shape of a motion whose errors are drawn, as `KNOWN` has them."""
    cable = CABLE.replace(
        bending_stiffness=0.01 * np.exp(0.1 * rng.standard_normal()), length=1.0 + 1e-3 * rng.standard_normal(),
        retardation_time=0.05 * np.exp(0.2 * rng.standard_normal()), drag=0.05 * np.exp(0.2 * rng.standard_normal()),
    )  # fmt: skip
    spread = np.array((*[1e-3] * 3, *[5e-3] * 3, *[0.0] * 3, *[4e-3] * 3))
    off, roll = spread * rng.standard_normal(12), 0.03 * rng.standard_normal()
    motion = cs.Motion(cable, scene, points=21)
    shape = motion.begin(*ends(0, off, roll))
    for k in range(1, STEPS + 1):
        shape = motion.step(*ends(k, off, roll), DT)
        assert shape.status, shape.detail
    return shape.positions


@pytest.mark.parametrize("contact", [False, True], ids=["free", "against a wall"])
def test_a_tube_is_as_wide_as_an_ensemble(contact: bool):
    """Standard deviations of 40 motions; those have an error of 11 %."""
    wall = cs.Obstacle("wall", cs.Box((0.3, 0.02, 2.0)), cs.Pose((0.4, 0.09, -1.1)))
    scene = cs.Scene(obstacles=[wall], contact="solve") if contact else None
    tubes = cs.MotionTube(CABLE, KNOWN, scene, points=21)
    tube = tubes.begin(*ends(0))
    for k in range(1, STEPS + 1):
        tube = tubes.step(*ends(k), DT)
        assert tube.shape.status, tube.shape.detail
        assert not tubes.trouble
    assert tube.holds
    assert (len(tube.shape.touches) > 0) == contact
    rng = np.random.default_rng(22)
    lines = np.array([drawn(rng, scene) for _ in range(40)])
    apart = lines - lines.mean(axis=0)
    found = np.sqrt(np.einsum("knc,knc->n", apart, apart) / 39.0)
    told = np.sqrt(np.trace(tube.covariance, axis1=1, axis2=2))
    assert np.abs(told - found).max() < 0.25 * found.max()
    assert found.max() > 2e-3
    # 95 % of the points that are drawn are in the tube
    way = lines - tube.shape.positions
    way -= np.einsum("knc,nc->kn", way, tube.shape.tangents)[:, :, None] * tube.shape.tangents
    inside = np.linalg.norm(way, axis=2) <= tube.radius + 1e-12
    assert 0.9 < inside.mean() < 0.995


def test_derivatives_and_motions_beside_agree(monkeypatch: pytest.MonkeyPatch):
    def told() -> np.ndarray:
        tubes = cs.MotionTube(CABLE, KNOWN, points=21)
        tubes.begin(*ends(0))
        for k in range(1, 21):
            tube = tubes.step(*ends(k), DT)
        return tube.covariance

    first = told()
    monkeypatch.setattr(cs.Motion, "traceable", False)
    second = told()
    assert np.abs(first - second).max() < 0.02 * np.abs(second).max()


def step(cycle: cs.Cycle, k: int) -> cs.CycleReport:
    return cycle.step({"cable": ends(k)}, stamp=10_000_000 * k)


def test_a_cycle_has_the_tube_of_what_swings_and_clearance_is_its():
    wall = cs.Obstacle("wall", cs.Box((2.0, 0.02, 2.0)), cs.Pose((0.35, 0.17, 0.0)))
    scene = cs.Scene(obstacles=[wall])
    cycle = cs.Cycle(CABLE, scene=scene, motion="dynamic", uncertainty=KNOWN, points=21)
    plain = cs.Cycle(CABLE, scene=scene, motion="dynamic", points=21)
    own = cs.MotionTube(CABLE, KNOWN, scene, points=21)
    own.begin(*ends(0))
    for k in range(11):
        report, other = step(cycle, k), step(plain, k)
        tube = report.tubes["cable"]
        np.testing.assert_array_equal(report.shapes["cable"].positions, other.shapes["cable"].positions)
        if k:
            np.testing.assert_allclose(tube.covariance, own.step(*ends(k), DT).covariance, rtol=1e-9, atol=1e-15)
    assert report.clearance["cable"].closest is not None
    assert other.clearance["cable"].closest is not None
    assert report.clearance["cable"].closest.distance < other.clearance["cable"].closest.distance - 1e-3
    again = step(cycle, 10)
    assert again.shapes["cable"].reused
    np.testing.assert_array_equal(again.tubes["cable"].covariance, tube.covariance)


@pytest.mark.parametrize("contact", [False, True], ids=["free", "against a wall"])
def test_a_harness_has_a_tube_of_each_segment(contact: bool):
    wall = cs.Obstacle("wall", cs.Box((0.3, 0.02, 2.0)), cs.Pose((0.4, 0.017, -1.1)))
    scene = cs.Scene(obstacles=[wall], contact="solve") if contact else None
    arm = CABLE.replace(length=0.5)
    harness = cs.Harness({"a": arm, "b": arm, "c": arm}, [cs.Junction("j", ("a.end", "b.start", "c.start"))])
    known = cs.Uncertainty({"bending_stiffness:each": 0.1}, (1e-3, 5e-3), (2e-3, 0.0))
    cycle = cs.Cycle({"h": harness}, scene=scene, motion="dynamic", uncertainty={"h": known}, points=11)

    def go(k: int, off: np.ndarray | None = None) -> dict[str, Any]:
        y, more = 0.05 * np.sin(0.12 * k), np.zeros((2, 3)) if off is None else off
        return {"a.start": cs.Pose((0, y, 0) + more[0], ALONG), "b.end": cs.Pose((0.8, y, 0.1) + more[1], ALONG)}

    tubes = cs.MotionTube(harness, known, scene, points=11)
    for k in range(16):
        report = cycle.step({"h": go(k)}, stamp=10_000_000 * k)
        own = tubes.begin(go(k)) if k == 0 else tubes.step(go(k), DT)
    assert set(own) == set("abc")
    for name, tube in own.items():
        np.testing.assert_allclose(tube.radius, report.tubes[f"h/{name}"].radius, rtol=1e-6)
        assert tube.holds
    assert set(report.tubes) == {"h/a", "h/b", "h/c"}
    touched = {name for name, one in report.shapes["h"].segments.items() if one.contacts}
    assert bool(touched) == contact
    rng = np.random.default_rng(3)
    lines = []
    for _ in range(40):
        sides = rng.standard_normal((2, 3)) * ((1e-3,), (2e-3,))
        turn = Rotation.from_rotvec(5e-3 * rng.standard_normal(3)) * Rotation.from_quat(ALONG)
        arms = {
            name: arm.replace(bending_stiffness=0.01 * np.exp(0.1 * rng.standard_normal())) for name in ("a", "b", "c")
        }
        motion = cs.Motion(cs.Harness(arms, harness.junctions), scene, points=11)

        def turned(k: int, sides: np.ndarray = sides, turn: Rotation = turn) -> dict[str, Any]:
            both = go(k, sides)
            return both | {"a.start": cs.Pose(both["a.start"].position, turn.as_quat())}

        shape = motion.begin(turned(0))
        for k in range(1, 16):
            shape = motion.step(turned(k), DT)
            assert shape.status
        lines.append([shape.segments[name].positions for name in "abc"])
    found = np.array(lines).std(axis=0, ddof=1)
    found = np.linalg.norm(found, axis=2)
    told = np.array([np.sqrt(np.trace(report.tubes[f"h/{name}"].covariance, axis1=1, axis2=2)) for name in "abc"])
    assert np.abs(told - found).max() < 0.25 * found.max()


def test_contacts_of_segments_are_called_by_the_harness_beside_a_tube():
    """As without one: h/under, not under."""
    cable = cs.Cable(0.55, linear_density=0.05, bending_stiffness=0.01, diameter=0.008, drag=0.05)
    harness = cs.Harness({"under": cable, "over": cable}, [])
    across = (-0.7071, 0.0, 0.0, 0.7071)
    held = {
        "under.start": cs.Pose((-0.25, 0.0, 0.0), ALONG), "under.end": cs.Pose((0.25, 0.0, 0.0), ALONG),
        "over.start": cs.Pose((0.02, -0.25, -0.004), across), "over.end": cs.Pose((0.02, 0.25, -0.004), across),
    }  # fmt: skip
    for known in (None, {"h": cs.Uncertainty({"bending_stiffness:each": 0.1})}):
        cycle = cs.Cycle(
            {"h": harness}, scene=cs.Scene(contact="solve"), motion="dynamic", uncertainty=known, points=101
        )  # fmt: skip
        report = cycle.step({"h": held}, stamp=0)
        segments = report.shapes["h"].segments
        assert {contact.body for contact in segments["over"].contacts} == {"h/under"}
        assert {contact.body for contact in segments["under"].contacts} == {"h/over"}


def test_where_none_is_known_it_says_why_and_what_is_refused():
    tubes = cs.MotionTube(CABLE, cs.Uncertainty({"length": 1e-3}), points=21)
    tube = tubes.begin(ends(0)[0], cs.Pose((1.2, 0, 0), ALONG))
    assert not tube.shape.status
    assert np.isnan(tube.radius).all()
    assert tubes.trouble == "there is no usable shape"
    with pytest.raises(cs.ArgumentError, match="one standard deviation away"):
        cs.MotionTube(CABLE, cs.Uncertainty({"length": 1.5}))
    with pytest.raises(cs.ArgumentError, match="tails of a cable that swings have no tube"):
        cs.MotionTube(CABLE.replace(tails={"end": 0.1}), KNOWN)
    harness = cs.Harness({"a": CABLE, "b": CABLE}, [cs.Junction("j", ("a.end", "b.start"))])
    branched = cs.MotionTube(harness, cs.Uncertainty(start=(1e-3, 0.0)), points=21)
    with pytest.raises(cs.ArgumentError, match="mapping"):
        branched.begin(*ends(0))
    far = branched.begin({"a.start": ends(0)[0], "b.end": cs.Pose((2.2, 0, 0), ALONG)})
    assert set(far) == {"a", "b"}
    assert np.isnan(far["a"].radius).all()
    assert branched.trouble == "there is no usable shape"
