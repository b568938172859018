"""What goes together with harnesses: the same answers, asked of a fork with a branch that hangs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from harness_random import balance

import cable_shape as cs
from cable_shape.cable.harness import split_end
from cable_shape.planning.harness_batch import HarnessBatch

ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
CABLE = cs.Cable(0.6, 0.1, 0.01, 0.008, diameter=0.008)
ASIDE = cs.Pose(quaternion=(math.sin(0.5), 0.0, 0.0, math.cos(0.5)))
HARNESS = cs.Harness(
    {"a": CABLE, "b": CABLE, "c": CABLE.replace(length=0.3)},
    [cs.Junction("fork", ("a.end", "b.start", "c.start"), frames={"c.start": ASIDE}, mass=0.01)],
)
G = np.array((0.0, 0.0, -9.81))
SECOND, SIZE = 1_000_000_000, 2e-4  # ns; m, of differences
PLACES = (0.0, 0.6)  # of rows; from nothing a cable that is held much lower comes to hang below the harness

Ends = dict[str, cs.Pose]


def clip(arc: float, place: tuple[float, float, float], kind: str) -> cs.Clip:
    """On the second half of the trunk."""
    return cs.Clip(arc, cs.Pose(place, ALONG), kind, segment="b")


TABLE = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.25)))
RING = (clip(0.2, (0.6, 0.05, -0.12), "fixed"), clip(0.4, (0.75, 0.08, -0.05), "slide"))
ACROSS = cs.Cable(1.0, 0.05, 0.01, 0.008, diameter=0.008)


class Around(NamedTuple):
    """What the harness is in, and the cables that are let down across it, in `steps`."""

    scene: cs.Scene
    cables: Mapping[str, cs.Cable] = {}
    steps: int = 2


HARNESSES: Mapping[str, Around] = {
    "harness": Around(cs.Scene()),
    "harness in a clip and an eyelet": Around(cs.Scene(clips=RING)),
    "harness on bodies": Around(cs.Scene(obstacles=[TABLE], contact="solve")),
    "cable on a harness": Around(cs.Scene(contact="solve"), {"over": ACROSS}, 26),
}


def ends_at(x: float, raised: float = 0.0) -> Ends:
    """Where it is held as x goes from 0 to 1; the second grip `raised` [m]."""
    return {"a.start": cs.Pose((0.0, 0.0, 0.0), ALONG), "b.end": cs.Pose((0.9 + 0.02 * x, 0.1, 0.05 + raised), ALONG)}


def over_at(x: float) -> tuple[cs.Pose, cs.Pose]:
    """Where a cable is held that is let down onto the first half of the trunk."""
    along_y, height = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)), 0.15 - 0.08 * x
    return cs.Pose((0.2, -0.42, height), along_y), cs.Pose((0.2, 0.42, height), along_y)


def grips_at(around: Around, x: float, raised: float = 0.0) -> dict[str, Any]:
    """Of all that there is."""
    return {"h": ends_at(x, raised), **{name: over_at(x) for name in around.cables}}


def longer(by: float) -> cs.Harness:
    """The harness with its segment b longer by so much [m]."""
    return HARNESS.replace(segments={**HARNESS.segments, "b": CABLE.replace(length=CABLE.length + by)})


def run(around: Around, harness: cs.Harness = HARNESS, **more: Any) -> tuple[cs.Cycle, cs.CycleReport]:
    """A cycle at the end of its way, and its last report; more: of the step, or of the cycle."""
    moves = {"acceleration": {"h": more.pop("acceleration")}} if "acceleration" in more else {}
    raised = more.pop("raised", 0.0)
    cycle = cs.Cycle({"h": harness, **around.cables}, scene=around.scene, **{"tolerance": 1e-6, **more})
    for k, x in enumerate(np.linspace(0.0, 1.0, around.steps)):
        report = cycle.step(grips_at(around, float(x), raised * x), k * SECOND, **moves)
    assert report.shapes["h"].status is cs.Status.OK, report.shapes["h"].detail
    for name in around.cables:
        assert report.shapes[name].contacts, "nothing touches"
    return cycle, report


def led(around: Around, harness: cs.Harness = HARNESS, **more: Any) -> cs.CycleReport:
    """What that cycle says."""
    return run(around, harness, **more)[1]


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


def sensitivity(around: Around) -> None:
    """By the height of a grip and by the length of a segment, beside differences."""
    predictor = run(around, tolerance=1e-7)[0]._harnesses["h"].predictor
    columns = np.concatenate(list(predictor.sensitivity(("b.end", "length:b")).values()))
    above, below = (lines(led(around, raised=x)) for x in (SIZE, -SIZE))
    near(columns[:, :, 2], (above - below) / (2.0 * SIZE), 0.02)
    above, below = (lines(led(around, longer(x))) for x in (SIZE, -SIZE))
    near(columns[:, :, 6], (above - below) / (2.0 * SIZE), 0.05)


def stability(around: Around) -> None:
    """Told, and a look ahead is where the harness is later."""
    cycle, report = run(around, tolerance=1e-7)
    margins = {name: of for name, of in report.margins.items() if name.startswith("h/")}
    told = [m.value for name in margins for m in margins[name] if m.kind is cs.WarningKind.STABILITY]
    assert [x > 0.0 for x in told] == [True], f"told {told}"
    later = grips_at(around, 1.0, 1e-3)
    ahead = cycle._harnesses["h"].predictor.ahead()(later["h"])
    found = cycle.step(later, 1000 * SECOND).shapes["h"]
    for name, one in ahead.segments.items():
        assert np.abs(one.positions - found.segments[name].positions).max() < 1e-5


def tube(around: Around) -> None:
    """By the length of a segment, beside differences."""
    report = led(around, uncertainty={"h": cs.Uncertainty({"length:b": SIZE})}, quasistatic_limit=0.0)
    way = 0.5 * (lines(led(around, longer(SIZE))) - lines(led(around, longer(-SIZE))))
    told = np.concatenate([report.tubes[f"h/{name}"].covariance for name in HARNESS.segments])
    near(told, way[:, :, None] * way[:, None, :], 0.05)


def acceleration(around: Around) -> None:
    """Forces balance under it, at the junction, too: its mass is that of a point there."""
    moving = np.array((0.3, 0.0, 1.0))
    shape = led(around, acceleration=dict.fromkeys(HARNESS.segments, moving)).shapes["h"]
    balanced(shape, G - moving)


def distributed_load(around: Around) -> None:
    """Forces balance under it."""
    load = np.array(((0.0, 0.05, -0.1), (0.0, 0.05, -0.1)))
    shape = led(around, distributed_load={"h": {"a": load}}).shapes["h"]
    balanced(shape, more=CABLE.length * load[0])


def tables(places: tuple[float, ...]) -> dict[str, np.ndarray]:
    """Of each held end (k, 7)."""
    return {end: np.array([ends_at(x)[end].array for x in places]) for end in ends_at(0.0)}


def paths(around: Around, places: tuple[float, ...]) -> dict[str, Any]:
    """Of the harness and the cables across it (k, 7)."""
    across = tuple(np.array([over_at(x)[side].array for x in places]) for side in (0, 1))
    return {"h": tables(places), **dict.fromkeys(around.cables, across)}


def rows(around: Around, harness: cs.Harness = HARNESS, **more: Any) -> HarnessBatch:
    """A batch of `PLACES`; where there are cables they lie on it in the last row, and in that alone."""
    options = {"scene": around.scene, "tolerance": 1e-6, **more}
    if not around.cables:
        return cs.predict_batch(harness, tables(PLACES), **options)
    found = cs.predict_batch({"h": harness, **around.cables}, paths(around, PLACES), **options)
    for name in around.cables:
        assert [bool(row[name].contacts) for row in found] == [False, True], "not touching in the last row alone"
    return found.harnesses["h"]


def from_nothing(around: Around, x: float, harness: cs.Harness = HARNESS) -> cs.HarnessShape:
    """The shape of the harness, predicted by itself, or in the first step of a cycle."""
    if not around.cables:
        return cs.predict(harness, ends_at(x), scene=around.scene, tolerance=1e-6)
    cycle = cs.Cycle({"h": harness, **around.cables}, scene=around.scene, tolerance=1e-6)
    found: cs.HarnessShape = cycle.step(grips_at(around, x), 0).shapes["h"]
    return found


def batch(around: Around) -> None:
    """Rows are what is found from nothing, and forces balance in them."""
    found = rows(around)
    assert found.usable.all(), found.details
    for row, x in enumerate(PLACES):
        shape = from_nothing(around, x)
        for name, one in shape.segments.items():
            assert np.abs(found.positions[name][row] - one.positions).max() < 1e-5
        balanced(found[row])


def batch_tube(around: Around) -> None:
    """Rows have the tube of differences."""
    known = cs.Uncertainty({"length:b": SIZE})
    found = rows(around, uncertainty={"h": known} if around.cables else known)
    shapes = [from_nothing(around, PLACES[-1], longer(x)) for x in (SIZE, -SIZE)]
    for name in HARNESS.segments:
        above, below = (shape.segments[name] for shape in shapes)
        way = 0.5 * (above.positions - below.positions)
        expected = known.radius(way[:, :, None] * way[:, None, :], above.tangents)
        assert np.abs(found.radius[name][-1] - expected).max() <= 0.05 * expected.max() + 1e-6


def calibrate(around: Around) -> None:
    """The stiffness of the trunk comes back from a shape."""
    if around.cables:
        cs.calibrate([{}], {"h": HARNESS, **around.cables}, "bending_stiffness", scene=around.scene, progress=False)
    shape = led(around).shapes["h"]
    points = {name: one.positions[5:-5:5] for name, one in shape.segments.items()}
    arcs = {name: one.arc_length[5:-5:5] for name, one in shape.segments.items()}
    seen = cs.HarnessObservation(ends_at(1.0), points, arcs, scene=around.scene)
    softer = {
        name: one.replace(bending_stiffness=0.009, twisting_stiffness=0.0072) for name, one in HARNESS.segments.items()
    }
    found = cs.calibrate([seen], HARNESS.replace(segments=softer), "bending_stiffness", progress=False)
    told = found.harness.segments["b"].mean_bending_stiffness
    assert abs(told / CABLE.mean_bending_stiffness - 1.0) < 0.02, f"{told:g} N m^2 found, 0.01 is true"


def trajectory(around: Around) -> None:
    """The whole way is followed, and nothing is wrong with it but that bodies are near."""
    if around.cables:
        places = tuple(np.linspace(0.0, 1.0, around.steps).tolist())
        found = cs.check_trajectory({"h": HARNESS, **around.cables}, around.scene, None, paths(around, places))
    else:
        found = cs.check_trajectory(HARNESS, around.scene, None, cs.EndsPath(tables((0.0, 1.0))))
    assert found.done.all(), found.first
    assert found.first is None or found.first.reason is cs.Reason.CLEARANCE, found.first


ASKED_OF_HARNESSES: Mapping[str, Callable[[Around], None]] = {
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
