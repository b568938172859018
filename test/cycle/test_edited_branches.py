"""A cable keeps its branch through edits: round a post, over another cable, and wherever there is but one."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.pose import multiply
from cable_shape.solve.touching.touching import Solve

ALONG_X = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
HOOKED = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.005, diameter=0.006)
POST = cs.Obstacle("post", cs.Cylinder(0.03, 0.6), cs.Pose((0.0, 0.0, 0.9)))
FAR = cs.Obstacle("far", cs.Box((0.1, 0.1, 0.1)), cs.Pose((2.0, 0.0, 0.9)))


def ends(y: float) -> dict[str, tuple[cs.Pose, cs.Pose]]:
    return {"cable": (cs.Pose((-0.38, y, 1.0), ALONG_X), cs.Pose((0.38, y, 1.0), ALONG_X))}


def hooked(**options: object) -> cs.Cycle:
    """The cable behind a post, both its ends drawn to the front: 0.15 m before the post's axis."""
    cycle = cs.Cycle(HOOKED, scene=cs.Scene(contact="solve", obstacles=[POST]), **options)  # type: ignore[arg-type]
    for k, y in enumerate(np.linspace(0.08, -0.15, 40)):
        cycle.step(ends(float(y)), k)
    return cycle


def behind(shape: cs.CableShape, axis: float = 0.0) -> bool:
    """Whether the cable goes behind the axis of the post, which is at y = axis, where it comes past it."""
    k = int(np.abs(shape.positions[:, 0]).argmin())
    return bool(shape.positions[k, 1] > axis)


def at(shape: cs.CableShape, arc_length: float) -> np.ndarray:
    return np.array([np.interp(arc_length, shape.arc_length, x) for x in shape.positions.T])


def test_what_is_hooked_is_not_so_from_nothing() -> None:
    cycle = hooked()
    assert behind(cycle.step(ends(-0.15), 100).shapes["cable"])
    again = cs.Cycle(HOOKED, scene=cycle.scene).step(ends(-0.15), 0).shapes["cable"]
    assert again.usable
    assert not behind(again)


def test_a_cable_stays_behind_its_post_whatever_is_edited() -> None:
    cycle = hooked()
    grips, stamp = ends(-0.15), 100
    first = shape = cycle.step(grips, stamp).shapes["cable"]
    up = np.array((0.0, 0.0, 0.1))
    steps: list[tuple[cs.Add | cs.Insert | cs.Move | cs.Release | cs.Remove | cs.SetCable, float]] = [
        (cs.Add(FAR), 0.0),
        (cs.Insert(cs.Clip(0.2, cs.Pose(at(shape, 0.2)), name="a")), 0.0),
        (cs.Move("a", cs.Pose(at(shape, 0.2) + np.array((0.0, -0.01, 0.03)))), 0.0),
        (cs.Insert(cs.Clip(0.8, cs.Pose(at(shape, 0.8)), "slide", name="eye")), 0.0),
        (cs.Release("a"), 0.0),
        (cs.Move("post", cs.Pose((0.0, -0.05, 0.9))), -0.05),
        (cs.Release("eye"), -0.05),
        (
            cs.Insert(cs.Clip(0.3, cs.Pose(at(shape, 0.3) + up, ALONG_X), "fixed", name="b")),
            -0.05,
        ),
        (cs.Release("b"), -0.05),
        (cs.Move("post", cs.Pose((0.0, 0.0, 0.9))), 0.0),
        (cs.SetCable(HOOKED.replace(bending_stiffness=0.01)), 0.0),
        (cs.SetCable(HOOKED.replace(length=1.05)), 0.0),
        (cs.SetCable(HOOKED), 0.0),
        (cs.Add(cs.PointMass(0.6, 0.01)), 0.0),
        (cs.Remove("far"), 0.0),
    ]
    for edit, axis in steps:
        stamp += 1
        result = cycle.edit(edit, stamp=stamp)
        assert result, result.reason
        shape = cycle.step(grips, stamp).shapes["cable"]
        assert shape.usable, edit
        assert behind(shape, axis), edit
        assert [c.body for c in shape.contacts] == ["post"] * len(shape.contacts) != [], edit
    assert cycle.edit(cs.SetCable(HOOKED))
    assert cycle.edit(cs.Remove("post"))  # nothing is in its way any more
    shape = cycle.step(grips, stamp).shapes["cable"]
    assert not behind(shape)
    assert first.length == shape.length


def test_gripped_elsewhere_it_stays_behind_its_post() -> None:
    cycle = hooked()
    cycle.step(ends(-0.15), 100)
    for end, s, x, y in (
        ("start", 0.1, -0.3, 0.38),
        ("end", 0.9, -0.3, 0.3),
        ("start", 0.0, -0.38, 0.3),
        ("end", 1.0, -0.38, 0.38),
    ):
        assert cycle.edit(cs.Regrip(end, s)), (end, s)
        grips = {"cable": (cs.Pose((x, -0.15, 1.0), ALONG_X), cs.Pose((y, -0.15, 1.0), ALONG_X))}
        shape = cycle.step(grips, 101).shapes["cable"]
        assert shape.usable
        assert behind(shape)


def test_tubes_are_behind_the_post_as_well() -> None:
    cycle = hooked(uncertainty=cs.Uncertainty({"bending_stiffness": 0.1}))
    before = cycle.step(ends(-0.15), 100).tubes["cable"].radius.max()
    assert cycle.edit(cs.Add(FAR))
    assert cycle.step(ends(-0.15), 101).tubes["cable"].radius.max() == pytest.approx(before, rel=0.05)


@pytest.mark.parametrize("softness", [1e-2, 1e-4, 1e-6])
def test_a_limp_cable_keeps_its_bow_on_the_table(softness: float) -> None:
    """It may lie to either side, EI = softness w L^3; where it lies is asked for 5e-4 of its length."""
    cable = cs.Cable(1.2, linear_density=0.1, bending_stiffness=softness * 0.981 * 1.2**3, diameter=0.008)
    table = cs.Obstacle("table", cs.Box((4.0, 4.0, 0.1)), cs.Pose((0.4, 0.0, -0.05)))
    cycle = cs.Cycle(cable, scene=cs.Scene(contact="solve", obstacles=[table]))
    for k, z in enumerate(np.linspace(0.4, 0.1, 16)):
        grips = {"cable": (cs.Pose((0.0, 0.0, z), ALONG_X), cs.Pose((0.8, 0.0, z), ALONG_X))}
        before = cycle.step(grips, 10_000_000 * k).shapes["cable"]
    assert before.contacts
    lifted = cs.Clip(0.6, cs.Pose(at(before, 0.6) + np.array((0.0, 0.0, 1e-4))), name="a")
    for edit in (cs.Add(FAR), cs.Insert(lifted), cs.Release("a"), cs.Remove("far")):
        assert cycle.edit(edit, stamp=200_000_000), edit
        after = cycle.step(grips, 200_000_000).shapes["cable"]
        assert after.status is cs.Status.OK
        if not isinstance(edit, cs.Insert):
            assert float(np.abs(after.positions - before.positions).max()) < 2.0 * 5e-4 * 1.2, edit


def turned(pose: cs.Pose, angle: float) -> cs.Pose:
    """About its own third axis."""
    roll = np.array((0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)))
    return cs.Pose(pose.position, multiply(pose.quaternion, roll))


@pytest.mark.parametrize("contact", ["warn", "solve"])
def test_windings_are_not_lost(contact: str) -> None:
    """A cable whose end was turned once round, step by step, which from nothing it would not be."""
    cable = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.02, diameter=0.006)
    cycle = cs.Cycle(cable, scene=cs.Scene(contact=contact))
    start, end = cs.Pose((0.0, 0.0, 1.0), ALONG_X), cs.Pose((0.95, 0.0, 1.0), ALONG_X)
    for k in range(21):
        shape = cycle.step({"cable": (start, turned(end, 0.1 * math.pi * k))}, k).shapes["cable"]
    assert shape.turns == 1
    twist = shape.twist
    assert twist == pytest.approx(2.0 * math.pi, abs=0.3)  # the rest is how it winds itself
    grips = {"cable": (start, end)}
    edits = [
        cs.Add(FAR),
        cs.Insert(cs.Clip(0.5, cs.Pose(at(shape, 0.5)), name="a")),
        cs.Release("a"),
        cs.SetCable(cable.replace(bending_stiffness=0.03)),
        cs.Remove("far"),
        cs.Regrip("start", 0.25),
    ]
    for edit in edits:
        assert cycle.edit(edit)
        if isinstance(edit, cs.Regrip):
            k = int(np.abs(shape.arc_length - 0.25).argmin())
            there = cs.Pose(at(shape, 0.25), shape.quaternions[k])
            shape = cycle.step({"cable": (there, end)}, 100).shapes["cable"]
            assert shape.twist == pytest.approx(0.75 * twist, abs=0.1)
        else:
            shape = cycle.step(grips, 100).shapes["cable"]
            assert shape.turns == 1, edit
            assert shape.twist == pytest.approx(twist, abs=0.1), edit
        assert shape.usable


def test_a_cable_stays_over_another_one() -> None:
    along_y = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    cable = cs.Cable(length=0.6, linear_density=0.05, bending_stiffness=0.01, diameter=0.008)
    cycle = cs.Cycle({"under": cable, "over": cable}, scene=cs.Scene(contact="solve"), model="cosserat")

    def grips(height: float) -> dict[str, tuple[cs.Pose, cs.Pose]]:
        return {
            "under": (cs.Pose((-0.25, 0.0, 0.0), ALONG_X), cs.Pose((0.25, 0.0, 0.0), ALONG_X)),
            "over": (cs.Pose((0.02, -0.25, height), along_y), cs.Pose((0.02, 0.25, height), along_y)),
        }

    for k in range(30):
        report = cycle.step(grips(0.02 - 0.002 * k), k)
    assert [c.body for c in report.shapes["under"].contacts] == ["over"]
    place = at(report.shapes["over"], 0.15)
    edits: list[tuple[cs.Add | cs.Insert | cs.Release | cs.SetCable, str | None]] = [
        (cs.Add(FAR), None),
        (cs.Insert(cs.Clip(0.15, cs.Pose(place), name="a")), "over"),
        (cs.Release("a"), "over"),
        (cs.SetCable(cable.replace(linear_density=0.08)), "under"),
    ]
    for edit, name in edits:
        result = cycle.edit(edit, cable=name)
        assert result, result.reason
        report = cycle.step(grips(0.02 - 0.002 * 29), 100)
        (contact,) = report.shapes["under"].contacts
        assert contact.body == "over", edit
        assert contact.normal[2] < 0.0  # pressed down
        assert all(shape.status is cs.Status.OK for shape in report.shapes.values())


# -- random edits, where there is one branch

#: A cable that is nearly taut has one shape: its chord is 0.94 of its length, and clips are held near it.
TAUT = cs.Cable(
    length=1.0, linear_density=0.1, bending_stiffness=0.02, diameter=0.008, tails={"start": 0.1, "end": 0.1}
)


def _random_edit(draw: random.Random, cycle: cs.Cycle, shape: cs.CableShape, count: int) -> object:
    """An edit that may or may not be."""
    length = shape.length
    clips = [clip.name for clip in cycle.scene.clips]
    bodies = [body.name for body in cycle.scene.obstacles]
    s = draw.uniform(0.05, 0.95) * length
    near = at(shape, s) + [draw.uniform(-0.01, 0.01) for _ in range(3)]
    kind = draw.choice(("add", "remove", "move body", "insert", "release", "move clip", "regrip", "cable", "mass"))
    if kind == "add":
        below = at(shape, s) - (0.0, 0.0, draw.uniform(0.02, 0.1))
        return cs.Add(cs.Obstacle(f"body{count}", cs.Sphere(draw.uniform(0.01, 0.03)), cs.Pose(below)))
    if kind in ("remove", "move body") and bodies:
        name = draw.choice(bodies)
        if kind == "remove":
            return cs.Remove(name)
        return cs.Move(name, cs.Pose(near - (0.0, 0.0, draw.uniform(0.03, 0.1))))
    if kind == "insert":
        return cs.Insert(cs.Clip(s, cs.Pose(near), draw.choice(("ball", "slide")), name=f"clip {count}"))
    if kind in ("release", "move clip") and clips:
        name = draw.choice(clips)
        if kind == "release":
            return cs.Release(name)
        own = next(clip for clip in cycle.scene.clips if clip.name == name)
        return cs.Move(name, cs.Pose(own.pose.position + [draw.uniform(-0.01, 0.01) for _ in range(3)]))
    if kind == "regrip":
        end = draw.choice(("start", "end"))
        return cs.Regrip(end, draw.uniform(-0.05, 0.05) + (0.0 if end == "start" else 1.0))
    if kind == "mass" and not cycle.scene.masses:
        return cs.Add(cs.PointMass(0.5, 0.01))
    return cs.SetCable(TAUT.replace(bending_stiffness=draw.uniform(0.015, 0.03)))


@pytest.mark.parametrize(("contact", "seed"), [("warn", 1), ("warn", 2), ("solve", 3), ("solve", 4)])
def test_warm_and_from_nothing_are_one_where_there_is_one_branch(contact: str, seed: int) -> None:
    draw = random.Random(seed)
    cycle = cs.Cycle(TAUT, scene=cs.Scene(contact=contact))
    start = cs.Pose((0.0, 0.0, 1.0), ALONG_X)
    end = cs.Pose((0.94, 0.0, 1.0), ALONG_X)
    made = {"start": 0.0, "end": 1.0}
    done = compared = 0
    report = cycle.step({"cable": (start, end)}, 0)
    for count in range(60):
        shape = report.shapes["cable"]
        edit = _random_edit(draw, cycle, shape, count)
        result = cycle.edit(edit, stamp=count)  # type: ignore[arg-type]
        if result and isinstance(edit, cs.Regrip):  # the gripper goes along, so that the cable stays as taut
            made[edit.end] = edit.arc_length
            start, end = (cs.Pose((0.94 * made[side], 0.0, 1.0), ALONG_X) for side in ("start", "end"))
        elif not result:
            assert result.reason
        done += result.done
        report = cycle.step({"cable": (start, end)}, count)
        shape = report.shapes["cable"]
        assert not (result and shape.reused)
        again = cs.Cycle(dict(cycle.cables), scene=cycle.scene).step({"cable": (start, end)}, 0).shapes["cable"]
        if not again.usable:
            continue
        assert shape.usable, (count, edit, result)
        compared += 1
        same = 2.0 * (5e-4 if contact == "solve" else 1e-5) * shape.length
        assert float(np.abs(again.positions - shape.positions).max()) < same, (count, edit, result)
    assert done > 40
    assert compared > 50


def test_what_the_cable_cannot_follow_is_looked_for_from_nothing_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where one step of the way leads nowhere, a shorter one is made, and no other equilibrium is looked for."""
    looked: list[int] = []
    anew = Solve._anew

    def spied(self: Solve, frames: np.ndarray) -> cs.CableShape | None:
        looked.append(1)
        return anew(self, frames)

    table = cs.Obstacle("table", cs.Box((4.0, 4.0, 0.1)), cs.Pose((0.4, 0.0, -0.05)))
    cable = cs.Cable(1.2, linear_density=0.1, bending_stiffness=1e-4 * 0.981 * 1.2**3, diameter=0.008)
    cycle = cs.Cycle(cable, scene=cs.Scene(contact="solve", obstacles=[table]))
    for k, z in enumerate(np.linspace(0.4, 0.1, 16)):
        grips = {"cable": (cs.Pose((0.0, 0.0, z), ALONG_X), cs.Pose((0.8, 0.0, z), ALONG_X))}
        shape = cycle.step(grips, k).shapes["cable"]
    monkeypatch.setattr(Solve, "_anew", spied)
    result = cycle.edit(cs.Insert(cs.Clip(0.2, cs.Pose(at(shape, 0.2) + np.array((0.0, 0.0, 0.3))), name="high")))
    assert "cannot follow further" in result.reason
    assert len(looked) <= 1
    assert cycle.edit(cs.Insert(cs.Clip(0.6, cs.Pose(at(shape, 0.6) + np.array((0.0, 0.0, 0.05))), name="low")))
    assert cycle.step(grips, 100).shapes["cable"].status is cs.Status.OK
