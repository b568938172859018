"""What goes together with harnesses: the same answers, asked of a fork with a branch that hangs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from harness_random import balance

import cable_shape as cs
from cable_shape.cable.harness import split_end

ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
CABLE = cs.Cable(0.6, 0.1, 0.01, 0.008, diameter=0.008)
ASIDE = cs.Pose(quaternion=(math.sin(0.5), 0.0, 0.0, math.cos(0.5)))
HARNESS = cs.Harness(
    {"a": CABLE, "b": CABLE, "c": CABLE.replace(length=0.3)},
    [cs.Junction("fork", ("a.end", "b.start", "c.start"), frames={"c.start": ASIDE}, mass=0.01)],
)
G = np.array((0.0, 0.0, -9.81))
SECOND, SIZE = 1_000_000_000, 2e-4  # ns; m, of differences

Ends = dict[str, cs.Pose]


def clip(arc: float, place: tuple[float, float, float], kind: str) -> cs.Clip:
    """On the second half of the trunk."""
    return cs.Clip(arc, cs.Pose(place, ALONG), kind, segment="b")


TABLE = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.25)))
HARNESSES: Mapping[str, cs.Scene] = {
    "harness": cs.Scene(),
    "harness in a clip and an eyelet": cs.Scene(
        clips=[clip(0.2, (0.6, 0.05, -0.12), "fixed"), clip(0.4, (0.75, 0.08, -0.05), "slide")]
    ),
    "harness on bodies": cs.Scene(obstacles=[TABLE], contact="solve"),
}


def ends_at(x: float, raised: float = 0.0) -> Ends:
    """Where it is held as x goes from 0 to 1; the second grip `raised` [m]."""
    return {"a.start": cs.Pose((0.0, 0.0, 0.0), ALONG), "b.end": cs.Pose((0.9 + 0.02 * x, 0.1, 0.05 + raised), ALONG)}


def longer(by: float) -> cs.Harness:
    """The harness with its segment b longer by so much [m]."""
    return HARNESS.replace(segments={**HARNESS.segments, "b": CABLE.replace(length=CABLE.length + by)})


def led(scene: cs.Scene, harness: cs.Harness = HARNESS, raised: float = 0.0, **more: Any) -> cs.CycleReport:
    """What a cycle says at the end of its way; more: of the step, or of the cycle."""
    moves = {"acceleration": {"h": more.pop("acceleration")}} if "acceleration" in more else {}
    cycle = cs.Cycle({"h": harness}, scene=scene, tolerance=1e-6, **more)
    cycle.step({"h": ends_at(0.0)}, 0, **moves)
    report = cycle.step({"h": ends_at(1.0, raised)}, SECOND, **moves)
    assert report.shapes["h"].status is cs.Status.OK, report.shapes["h"].detail
    return report


def followed(scene: cs.Scene) -> cs.Predictor:
    """A predictor at the end of the way."""
    predictor = cs.Predictor(HARNESS, scene=scene, tolerance=1e-7)
    for x in (0.0, 1.0):
        assert predictor.predict(ends_at(x)).status is cs.Status.OK
    return predictor


def lines(report: cs.CycleReport) -> np.ndarray:
    """(s n, 3) [m], of all segments in turn."""
    return np.concatenate([one.positions for one in report.shapes["h"].segments.values()])


def near(told: np.ndarray, expected: np.ndarray, part: float) -> None:
    """Fails where two arrays differ by more than a part of the largest."""
    off = float(np.abs(told - expected).max() / np.abs(expected).max())
    assert off <= part, f"off by {off:.3g} of the largest, {part:g} allowed"


def balanced(shape: cs.HarnessShape, gravity: np.ndarray = G, more: np.ndarray | float = 0.0) -> None:
    """Fails where forces at junctions, or of all that holds the harness, do not carry its weight and `more` [N]."""
    force, moment, gap = balance(shape, gravity)
    assert max(force, moment, 100.0 * gap) <= 1e-6, f"at junctions: {force:g} N, {moment:g} N m, {gap:g} m"
    carried = np.zeros(3)
    for end in ends_at(0.0):
        name, side = split_end(end)
        carried += shape.segments[name].force[-1] if side == "end" else -shape.segments[name].force[0]
    for one in shape.segments.values():
        carried += sum((c.force * c.normal for c in one.contacts), np.zeros(3))
        carried -= sum((load.force for load in one.clips), np.zeros(3))
    mass = sum(one.linear_density * one.length for one in HARNESS.segments.values()) + 0.01
    load = mass * gravity + more
    assert np.abs(carried + load).max() <= 1e-4 * np.linalg.norm(load), f"out of balance by {carried + load} N"


def sensitivity(scene: cs.Scene) -> None:
    """By the height of a grip and by the length of a segment, beside differences."""
    columns = np.concatenate(list(followed(scene).sensitivity(("b.end", "length:b")).values()))
    above, below = (lines(led(scene, raised=x)) for x in (SIZE, -SIZE))
    near(columns[:, :, 2], (above - below) / (2.0 * SIZE), 0.02)
    above, below = (lines(led(scene, longer(x))) for x in (SIZE, -SIZE))
    near(columns[:, :, 6], (above - below) / (2.0 * SIZE), 0.05)


def stability(scene: cs.Scene) -> None:
    """Told, and a look ahead is where the harness is later."""
    margins = led(scene).margins
    told = [m.value for name in margins for m in margins[name] if m.kind is cs.WarningKind.STABILITY]
    assert [x > 0.0 for x in told] == [True], f"told {told}"
    predictor = followed(scene)
    later = ends_at(1.0, 1e-3)
    ahead, found = predictor.ahead()(later), predictor.predict(later)
    for name, one in ahead.segments.items():
        assert np.abs(one.positions - found.segments[name].positions).max() < 1e-5


def tube(scene: cs.Scene) -> None:
    """By the length of a segment, beside differences."""
    report = led(scene, uncertainty=cs.Uncertainty({"length:b": SIZE}), quasistatic_limit=0.0)
    way = 0.5 * (lines(led(scene, longer(SIZE))) - lines(led(scene, longer(-SIZE))))
    told = np.concatenate([report.tubes[f"h/{name}"].covariance for name in HARNESS.segments])
    near(told, way[:, :, None] * way[:, None, :], 0.05)


def acceleration(scene: cs.Scene) -> None:
    """Forces balance under it, at the junction, too: its mass is that of a point there."""
    moving = np.array((0.3, 0.0, 1.0))
    shape = led(scene, acceleration=dict.fromkeys(HARNESS.segments, moving)).shapes["h"]
    balanced(shape, G - moving)


def distributed_load(scene: cs.Scene) -> None:
    """Forces balance under it."""
    load = np.array(((0.0, 0.05, -0.1), (0.0, 0.05, -0.1)))
    shape = led(scene, distributed_load={"h": {"a": load}}).shapes["h"]
    balanced(shape, more=CABLE.length * load[0])


def tables(places: tuple[float, ...]) -> dict[str, np.ndarray]:
    """Of each held end (k, 7)."""
    return {end: np.array([ends_at(x)[end].array for x in places]) for end in ends_at(0.0)}


def batch(scene: cs.Scene) -> None:
    """Rows are what is found from nothing, and forces balance in them."""
    found = cs.predict_batch(HARNESS, tables((0.0, 1.0)), scene=scene, tolerance=1e-6)
    assert found.usable.all(), found.details
    for row in (0, 1):
        shape = cs.predict(HARNESS, ends_at(float(row)), scene=scene, tolerance=1e-6)
        for name, one in shape.segments.items():
            assert np.abs(found.positions[name][row] - one.positions).max() < 1e-5
        balanced(found[row])


def batch_tube(scene: cs.Scene) -> None:
    """Rows have the tube of differences."""
    known = cs.Uncertainty({"length:b": SIZE})
    found = cs.predict_batch(HARNESS, tables((1.0,)), scene=scene, tolerance=1e-6, uncertainty=known)
    shapes = [cs.predict(longer(x), ends_at(1.0), scene=scene, tolerance=1e-6) for x in (SIZE, -SIZE)]
    for name in HARNESS.segments:
        above, below = (shape.segments[name] for shape in shapes)
        way = 0.5 * (above.positions - below.positions)
        expected = known.radius(way[:, :, None] * way[:, None, :], above.tangents)
        assert np.abs(found.radius[name][0] - expected).max() <= 0.05 * expected.max() + 1e-6


def calibrate(scene: cs.Scene) -> None:
    """The stiffness of the trunk comes back from a shape."""
    shape = led(scene).shapes["h"]
    points = {name: one.positions[5:-5:5] for name, one in shape.segments.items()}
    arcs = {name: one.arc_length[5:-5:5] for name, one in shape.segments.items()}
    seen = cs.HarnessObservation(ends_at(1.0), points, arcs, scene=scene)
    softer = {
        name: one.replace(bending_stiffness=0.009, twisting_stiffness=0.0072) for name, one in HARNESS.segments.items()
    }
    found = cs.calibrate([seen], HARNESS.replace(segments=softer), "bending_stiffness", progress=False)
    told = found.harness.segments["b"].mean_bending_stiffness
    assert abs(told / CABLE.mean_bending_stiffness - 1.0) < 0.02, f"{told:g} N m^2 found, 0.01 is true"


def trajectory(scene: cs.Scene) -> None:
    """The whole way is followed, and nothing is wrong with it but that bodies are near."""
    found = cs.check_trajectory(HARNESS, scene, None, cs.EndsPath(tables((0.0, 1.0))))
    assert found.done.all(), found.first
    assert found.first is None or found.first.reason is cs.Reason.CLEARANCE, found.first


ASKED_OF_HARNESSES: Mapping[str, Callable[[cs.Scene], None]] = {
    "sensitivity, mink tasks": sensitivity,
    "stability, snap ahead": stability,
    "tube": tube,
    "given acceleration": acceleration,
    "distributed load": distributed_load,
    "predict_batch": batch,
    "batch tube": batch_tube,
    "calibrate": calibrate,
    "check_trajectory": trajectory,
}
