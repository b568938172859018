#!/usr/bin/env python
"""What goes together with what: all answers of the package, asked of cables and harnesses in all kinds of surroundings.

    scripts/bench combinations [--save FILE] [--write]

Each cell of the table is tried: an answer is held to a difference of predictions, or to the balance of forces. What no
call asks for, or none should, is no cell to be tried, and says why. --write puts the table into docs/limits.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from combinations_harness import ASKED_OF_HARNESSES, HARNESSES
from figures import Figures, bench_options, bench_parser, finish
from scipy.spatial.transform import Rotation

import cable_shape as cs

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = "<!-- written by scripts/bench combinations -->\n", "<!-- to here -->\n"
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
CABLE = cs.Cable(1.0, 0.05, 0.01, 0.008, diameter=0.008)
G = np.array((0.0, 0.0, -9.81))
SECOND = 1_000_000_000  # ns: slow enough for no inertia

Ends = tuple[cs.Pose, cs.Pose]


class Around(NamedTuple):
    """What a cable is in: other cables, a scene, and where all are held as x goes from 0 to 1 in `steps`."""

    cables: dict[str, cs.Cable]
    scene: cs.Scene
    way: Callable[[float], dict[str, Ends]]
    steps: int = 2


def held(heading: float, chord: float, place: tuple[float, float, float] = (0.0, 0.0, 0.0), twist: float = 0.0) -> Ends:
    """Grips `chord` apart about a place, the end turned about the chord by `twist` [rad]."""
    turn = Rotation.from_euler("z", heading, degrees=True)
    half = turn.apply((0.5 * chord, 0.0, 0.0))
    end = turn * Rotation.from_rotvec((twist, 0.0, 0.0)) * ALONG_X
    return cs.Pose(np.array(place) - half, (turn * ALONG_X).as_quat()), cs.Pose(np.array(place) + half, end.as_quat())


def moved(x: float) -> dict[str, Ends]:
    """One cable whose ends go apart a little."""
    return {"cable": held(0.0, 0.7 + 0.02 * x)}


def clipped(kind: str) -> cs.Scene:
    """A scene with one clip where the hanging cable nearly is."""
    return cs.Scene(clips=[cs.Clip(0.5, cs.Pose((0.01, 0.02, -0.3), ALONG_X.as_quat()), kind=kind)])


SOLVED = cs.Scene(contact="solve")
ON_A_TABLE = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0, 0, -0.25)))], contact="solve")
WOUND = CABLE.replace(linear_density=0.005, bending_stiffness=0.004, twisting_stiffness=0.003)
AROUND = {
    "plain": Around({"cable": CABLE}, cs.Scene(), moved),
    "clips": Around({"cable": CABLE}, clipped("fixed"), moved),
    "eyelets": Around({"cable": CABLE}, clipped("slide"), moved),
    "bodies": Around({"cable": CABLE}, ON_A_TABLE, moved),
    "another cable": Around(
        {"cable": CABLE, "under": CABLE}, SOLVED,
        lambda x: {"cable": held(70.0, 0.7, (0.02, 0.01, 0.02 - 0.05 * x)), "under": held(0.0, 0.7)}, 26,
    ),
    "itself": Around(
        {"cable": WOUND}, SOLVED, lambda x: {"cable": held(0.0, 0.3, twist=2.0 * math.pi * (0.3 + 0.8 * x))}, 81
    ),
    "tails": Around({"cable": CABLE.replace(tails={"end": 0.2})}, cs.Scene(), moved),
    "several cables": Around(
        {"cable": CABLE, "far": CABLE}, cs.Scene(), lambda x: {**moved(x), "far": held(0.0, 0.7, (0.0, 1.0, 0.0))}
    ),
}  # fmt: skip


def led(around: Around, *, acceleration: object = None, **changes: object) -> tuple[cs.Cycle, cs.CycleReport]:
    """A cycle at the end of its way, and its last report; changes: of the cable, by its numbers, or of the cycle."""
    numbers = {name: changes.pop(name) for name in ("length", "bending_stiffness") if name in changes}
    cables = {**around.cables, "cable": around.cables["cable"].replace(**numbers)}
    cycle = cs.Cycle(cables, scene=around.scene, model="cosserat", tolerance=1e-6, **changes)
    moves = {} if acceleration is None else {"acceleration": {"cable": acceleration}}
    for k, x in enumerate(np.linspace(0.0, 1.0, around.steps)):
        report = cycle.step(around.way(float(x)), k * SECOND, **moves)
    assert report.shapes["cable"].status is cs.Status.OK, report.shapes["cable"].detail
    return cycle, report


def line(around: Around, **changes: object) -> np.ndarray:
    """The centreline at the end of the way."""
    return np.asarray(led(around, **changes)[1].shapes["cable"].positions)


def raised(around: Around, shift: float) -> Ends:
    """The cable's ends at the end of its way, the second one raised by `shift` [m]."""
    start, end = around.way(1.0)["cable"]
    return start, cs.Pose(end.position + np.array((0.0, 0.0, shift)), end.quaternion)


def near(told: np.ndarray, expected: np.ndarray, part: float) -> None:
    """Fails where two arrays differ by more than a part of the largest."""
    off = float(np.abs(told - expected).max() / np.abs(expected).max())
    assert off <= part, f"off by {off:.3g} of the largest, {part:g} allowed"


def balanced(shape: cs.CableShape, cable: cs.Cable, more: np.ndarray) -> None:
    """Fails where forces of grips, clips and contacts do not carry the weight and `more` [N]."""
    carried = shape.force[-1] - shape.force[0]
    carried = carried + sum((c.force * c.normal + c.tangential_force for c in shape.contacts), np.zeros(3))
    carried = carried - sum((load.force for load in shape.clips), np.zeros(3))
    load = cable.linear_density * cable.length * G + more
    assert np.abs(carried + load).max() <= 1e-4 * np.linalg.norm(load), f"out of balance by {carried + load} N"


# -- what is asked: each fails where it does not hold, or is refused


def sensitivity(around: Around) -> None:
    """By the height of the end and by the length, beside differences."""
    length, size = around.cables["cable"].length, 2e-4
    told = led(around)[0]._cables["cable"].predictor.sensitivity(("end", "length"))
    seen = []
    for shift in (size, -size):
        cycle, _ = led(around)
        grips = {**around.way(1.0), "cable": raised(around, shift)}
        seen.append(cycle.step(grips, 1000 * SECOND).shapes["cable"].positions)
    near(told[:, :, 2], (seen[0] - seen[1]) / (2.0 * size), 0.02)
    longer, shorter = (line(around, length=length + sign * size) for sign in (1.0, -1.0))
    near(told[:, :, 6], (longer - shorter) / (2.0 * size), 0.05)


def stability(around: Around) -> None:
    """Told, and a look ahead is where the cable is later."""
    cycle, report = led(around)
    assert any(m.kind is cs.WarningKind.STABILITY and m.value > 0.0 for m in report.margins["cable"]), "not told"
    ends = raised(around, 1e-3)
    told = cycle._cables["cable"].predictor.ahead()(*(cs.Grip(end) for end in ends))
    later = cycle.step({**around.way(1.0), "cable": ends}, 1000 * SECOND).shapes["cable"]
    assert np.abs(told.positions - later.positions).max() < 1e-5


def tube(around: Around) -> None:
    """By the length, beside differences."""
    length, off = around.cables["cable"].length, 2e-4
    report = led(around, uncertainty=cs.Uncertainty({"length": off}), quasistatic_limit=0.0)[1]
    way = 0.5 * (line(around, length=length + off) - line(around, length=length - off))
    near(report.tubes["cable"].covariance, way[:, :, None] * way[:, None, :], 0.05)


def acceleration(around: Around) -> None:
    """Forces balance under it."""
    moving = np.array((0.3, 0.0, 1.0))
    shape, cable = led(around, acceleration=moving)[1].shapes["cable"], around.cables["cable"]
    balanced(shape, cable, -cable.linear_density * cable.length * moving)


def distributed_load(around: Around) -> None:
    """Forces balance under it."""
    load = np.array(((0.0, 0.05, -0.1), (0.0, 0.05, -0.1)))
    shape, cable = led(around, distributed_load={"cable": load})[1].shapes["cable"], around.cables["cable"]
    balanced(shape, cable, cable.length * load[0])


def tables(around: Around, places: Sequence[float]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Of each cable (k, 7) of both ends at places of the way, 0 to 1."""
    ways = [around.way(x) for x in places]
    return {name: tuple(np.array([way[name][i].array for way in ways]) for i in (0, 1)) for name in around.cables}


def asked(around: Around, places: Sequence[float], **more: object) -> tuple[object, dict[str, cs.ShapeBatch]]:
    """What predict_batch gives at places of the way, and of each cable."""
    given = {"scene": around.scene, "model": "cosserat", "tolerance": 1e-6, **more}
    rows = tables(around, places)
    if len(around.cables) > 1:
        found = cs.predict_batch(around.cables, rows, **given)
        return found, found.cables
    found = cs.predict_batch(around.cables["cable"], *rows["cable"], **given)
    return found, {"cable": found}


def batch(around: Around) -> None:
    """Rows are what a cycle finds from nothing, and forces balance in them."""
    places = (0.0, 0.4)
    found, cables = asked(around, places)
    assert found.usable.all(), found.details
    assert cables["cable"][1].contacts or around not in (AROUND["bodies"], AROUND["another cable"]), "nothing touches"
    for row, x in enumerate(places):
        cycle = cs.Cycle(around.cables, scene=around.scene, model="cosserat", tolerance=1e-6)
        for name, one in cycle.step(around.way(x), 0).shapes.items():
            assert np.abs(cables[name].positions[row] - one.positions).max() < 1e-5
            balanced(cables[name][row], around.cables[name], np.zeros(3))


def batch_tube(around: Around) -> None:
    """Rows have the tube of a prediction from nothing."""
    off, x = 2e-4, 0.4
    known = cs.Uncertainty({"length": off})
    _, cables = asked(around, (x,), uncertainty=known)
    cycle = cs.Cycle(around.cables, scene=around.scene, model="cosserat", tolerance=1e-6)
    shapes = cycle.step(around.way(x), 0).shapes
    for name, shape in shapes.items():
        way = off * cycle._cables[name].predictor.sensitivity(("length",))
        near(cables[name].radius[0], known.radius(way @ way.transpose(0, 2, 1), shape.tangents), 0.02)


def calibrate(around: Around) -> None:
    """The stiffness comes back from a shape; of several cables each its own."""
    shapes, ways = led(around)[1].shapes, around.way(1.0)
    seen = {
        name: cs.Observation(*ways[name], shape.positions[5:-5:5], shape.arc_length[5:-5:5])
        for name, shape in shapes.items()
    }
    begin = {
        name: one.replace(bending_stiffness=1.1 * one.mean_bending_stiffness) for name, one in around.cables.items()
    }
    if len(begin) > 1:
        found = cs.calibrate([seen], begin, "bending_stiffness:each", scene=around.scene, progress=False).cables
    else:
        found = {"cable": cs.calibrate(seen.values(), begin["cable"], scene=around.scene, progress=False).cable}
    for name, one in around.cables.items():
        told, true = found[name].mean_bending_stiffness, one.mean_bending_stiffness
        assert abs(told / true - 1.0) < 0.02, f"{told:g} N m^2 found, {true:g} is true"


def trajectory(around: Around) -> None:
    """The whole way is followed, and nothing is wrong with it but that bodies, and itself, are near."""
    rows = tables(around, np.linspace(0.0, 1.0, around.steps))
    if len(around.cables) > 1:
        found = cs.check_trajectory(around.cables, around.scene, None, rows)
    else:
        found = cs.check_trajectory(around.cables["cable"], around.scene, None, cs.GripPath(*rows["cable"]))
    assert found.done.all(), found.first
    assert found.first is None or found.first.reason is cs.Reason.CLEARANCE, found.first


ASKED: Mapping[str, Callable[[Around], None]] = {
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


WHERE = (*AROUND, *HARNESSES)


def cell(what: str, where: str) -> str:
    """ "yes", or why not."""
    try:
        if where in HARNESSES:
            ASKED_OF_HARNESSES[what](HARNESSES[where])
        else:
            ASKED[what](AROUND[where])
    except cs.ArgumentError as error:
        return str(error)
    except AssertionError as error:
        return f"NO: {error}"
    return "yes"


def table(cells: Mapping[tuple[str, str], str]) -> str:
    """In Markdown; reasons beneath."""
    reasons = list(dict.fromkeys(text for text in cells.values() if text != "yes"))
    rows = [["", *WHERE], ["---"] * (1 + len(WHERE))]
    for what in ASKED:
        told = [cells[what, where] for where in WHERE]
        rows.append([what, *["yes" if text == "yes" else f"no ({1 + reasons.index(text)})" for text in told]])
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([*lines, "", *[f"{i}. {text}" for i, text in enumerate(reasons, 1)]]) + "\n"


def main() -> int:
    """Tries every cell, and prints the table."""
    parser = bench_parser(__doc__, "nothing")
    parser.add_argument("--write", action="store_true", help="put the table into docs/limits.md")
    options = bench_options(parser)
    figures = Figures()
    cells = {(what, where): cell(what, where) for what in ASKED for where in WHERE}
    made = table(cells)
    print(made)
    figures.check("every answer holds or is refused", not any(text.startswith("NO") for text in cells.values()))
    if options.write:
        page = ROOT / "docs" / "limits.md"
        text = page.read_text(encoding="utf-8")
        before, _, rest = text.partition(BEGIN)
        page.write_text(before + BEGIN + made + END + rest.partition(END)[2], encoding="utf-8")
    return finish(figures, options)


if __name__ == "__main__":
    raise SystemExit(main())
