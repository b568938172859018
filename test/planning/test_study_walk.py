"""The shapes of one point of a study: those of a predictor, by whatever road they were found."""

import math

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.planning.study_walk import Rows
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.safety.margins import MarginWatch
from cable_shape.safety.report import WarningKind

ALONG = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(
    length=1.2, linear_density=0.1, bending_stiffness=0.02, diameter=0.01, min_bend_radius=0.05, allowable_stress=1e6
)
SCENE = cs.Scene(
    obstacles=[cs.Obstacle("ball", cs.Sphere(0.05), cs.Pose((0.4, 0.05, 0.75))), cs.Obstacle("floor", cs.HalfSpace())],
    masses=[cs.PointMass(0.4, 0.02)],
)
CLIPS = [
    cs.Clip(0.55, cs.Pose((0.4, 0.0, 0.8), ALONG), kind, name="mid") for kind in ("ball", "hinge", "fixed", "slide")
]


def path(instants=60):
    """A motion with a turn of the end."""
    t = np.linspace(0.0, 1.0, instants)
    starts = np.tile(cs.Pose((0, 0, 1), ALONG).array, (instants, 1))
    ends = np.tile(cs.Pose((0.8, 0, 1), ALONG).array, (instants, 1))
    ends[:, 0] += 0.15 * np.sin(2.0 * t)
    ends[:, 2] -= 0.2 * t
    tilt = 0.4 * t
    turn = np.stack((np.zeros_like(t), np.sin(tilt), np.zeros_like(t), np.cos(tilt)), axis=1)
    for row, (_, y, _, w) in zip(ends, turn, strict=True):
        row[3:] = (cs.Pose((0, 0, 0), (0, y, 0, w)) * cs.Pose((0, 0, 0), ALONG)).quaternion
    return cs.GripPath(starts, ends)


def study(cable=CABLE, scene=SCENE, **more):
    return cs.Study(cable, scene=scene, motion=path(), points=80, **more)


def by_hand(cable, scene, end_kind="clamped", **options):
    """Shapes, margins and distances of a predictor, a checker and a watch."""
    predictor = cs.Predictor(cable, scene=scene, points=80, **options)
    checker, watch = ClearanceChecker(scene, cable=cable), MarginWatch(cable, scene)
    moved = path()
    for a, b in zip(moved.starts, moved.ends, strict=True):
        end = cs.FreeEnd() if end_kind == "free" else cs.Grip(cs.Pose(b[:3], b[3:]), end_kind)
        shape = predictor.predict(cs.Pose(a[:3], a[3:]), end)
        clearance = checker.check(shape)
        yield shape, clearance, watch.margins(shape, clearance, 0, state=predictor.rod_state, held=end_kind != "free")


def assert_same(rows: Rows, told):
    for i, (shape, clearance, margins) in enumerate(told):
        assert rows.status[i] == shape.status.value
        apart = np.abs(rows.shape(i).positions - shape.positions).max()
        assert apart < 3e-6 * shape.length
        assert np.abs(rows.shape(i).force - shape.force).max() < 1e-4 * max(1.0, np.abs(shape.force).max())
        assert rows.energy[i] == pytest.approx(shape.energy, abs=1e-6)
        if clearance.table is not None:
            assert np.allclose(rows.tables[i, :, 0], clearance.table[:, 0], atol=1e-5)
        for margin in margins:
            if margin.kind is WarningKind.STABILITY:
                row = 5
            elif margin.kind is WarningKind.CLEARANCE:
                continue
            else:
                row = {WarningKind.OVERSTRETCHED: 0, WarningKind.BEND_RADIUS: 2, WarningKind.STRESS: 4}[margin.kind]
            assert rows.margins[i, row, 0] == pytest.approx(margin.used, rel=2e-3), margin.kind


def test_compiled_code_finds_what_a_predictor_finds():
    assert_same(study().rows(0)[""], by_hand(CABLE, SCENE))


def test_most_instants_are_solved_in_compiled_code():
    """The rows that a predictor gave have no number of iterations."""
    rows = study().rows(0)[""]
    assert np.isfinite(rows.infos[:, 0]).mean() > 0.9


@pytest.mark.parametrize("clip", CLIPS, ids=lambda clip: clip.kind)
def test_clips(clip):
    scene = SCENE.replace(clips=[clip])
    rows = study(scene=scene).rows(0)[""]
    told = list(by_hand(CABLE, scene))
    assert_same(rows, told)
    for i, (shape, _, _) in enumerate(told):
        assert np.allclose(rows.loads[i, 1, 1:4], shape.clips[0].force, atol=1e-4)


@pytest.mark.parametrize("kind", ["swivel", "pinned"])
def test_grips(kind):
    assert_same(study(end={"kind": kind}).rows(0)[""], by_hand(CABLE, SCENE, kind))


def test_a_free_end():
    moved = path()
    ends = {"start": moved.starts}
    shape = cs.Study(CABLE, scene=SCENE, motion=ends, end=cs.FreeEnd(mass=0.01), points=80).rows(0)[""].shape(5)
    alone = cs.predict(CABLE, cs.Pose(moved.starts[5, :3], ALONG), cs.FreeEnd(mass=0.01), scene=SCENE, points=80)
    assert np.abs(shape.positions - alone.positions).max() < 1e-5


@pytest.mark.parametrize(
    ("cable", "scene", "options"),
    [
        (CABLE, SCENE.replace(masses=[], contact="solve"), {}),
        (CABLE.replace(sections=[cs.Section(0.3, 0.5, bending_stiffness=0.05, diameter=0.02)]), SCENE, {}),
        (CABLE, SCENE.replace(masses=[]), {"model": "gradient4"}),
    ],
    ids=["contact", "sections", "closed form"],
)
def test_what_compiled_code_does_not_know_is_left_to_a_predictor(cable, scene, options):
    rows = study(cable, scene, **options).rows(0)[""]
    for i, (shape, clearance, _) in enumerate(by_hand(cable, scene, **options)):
        assert rows.status[i] == shape.status.value
        assert np.array_equal(rows.shape(i).positions, shape.positions)
        assert np.allclose(rows.tables[i, :, 0], clearance.table[:, 0], atol=1e-12) or cable.sections


def test_an_overstretched_instant_is_told_and_the_others_go_on():
    moved = path()
    moved.ends[20, 0] = 1.5
    rows = cs.Study(CABLE, scene=SCENE, motion=moved, points=80).rows(0)[""]
    assert rows.status[20] == cs.Status.OVERSTRETCHED.value
    assert rows.usable.sum() == 59
    assert np.isnan(rows.margins[20]).all()


def test_a_harness_is_followed_segment_by_segment():
    harness = cs.Harness({"a": CABLE, "b": CABLE}, [cs.Junction("j", ("a.end", "b.start"))])
    moved = path(12)
    ends = {"a.start": moved.starts, "b.end": moved.ends + np.array((0.9, 0, 0, 0, 0, 0, 0))}
    found = cs.Study(harness=harness, motion=cs.EndsPath(ends), points=40).rows(0)
    predictor = cs.Predictor(harness, points=40)
    for i in range(12):
        held = {end: cs.Pose(table[i, :3], table[i, 3:]) for end, table in ends.items()}
        shape = predictor.predict(held)
        for name, rows in found.items():
            assert np.array_equal(rows.shape(i).positions, shape.segments[name].positions)


def test_values_are_told_without_a_limit():
    bare = CABLE.replace(min_bend_radius=None, allowable_stress=None)
    with_limits, without = study().rows(0)[""], study(bare).rows(0)[""]
    for row in (2, 4):
        assert np.allclose(with_limits.margins[:, row, 2:4], without.margins[:, row, 2:4], rtol=1e-9)
    assert math.isfinite(without.margins[0, 1, 2])
