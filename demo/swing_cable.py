"""A cable that is moved fast, twice beside each other: as usual, and so that it hardly swings when the grips stop.

scripts/demo --swing [OUT.rrd]. Two pairs of grippers carry the same cable half a metre sideways in the same time, one
by a trapezoid of speed, the other in the time that `cs.shape_stop` chooses; white arrows are speeds, lines that fade
where the cables have just been. Beyond the stop is a wall: the look ahead warns before the first cable swings near to
it. Exit code 0: that one came nearer to it than the other, which hardly swung; 1: not so; 2: wrong arguments.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

import cable_shape as cs
from cable_shape.planning.shape_stop import trapezoid
from cable_shape.pose import Pose
from cable_shape.viewer.recording import RecordingWriter

ROOT = Path(__file__).resolve().parents[1]
CABLE = cs.Cable(
    length=1.0, linear_density=0.1, bending_stiffness=0.01, diameter=0.012, retardation_time=0.05, drag=0.05
)
WAY, DURATION, AFTER = 0.5, 1.2, 2.0  # m sideways, s of the motion, s of standing still in the end
DT = 0.01  # s, of a cycle
HEIGHT, SPAN, BESIDE = 1.0, 0.7, 1.0  # m, of the grips, between those of a cable, and from cable to cable
ALONG = (0.5, 0.5, 0.5, 0.5)  # the tangent along x
WALL = cs.Obstacle("wall", cs.Box((2.0, 0.02, 0.9)), cs.Pose((0.85, WAY + 0.1, 0.75)))
SCENE = cs.Scene(obstacles=[WALL], warn_distance=0.05, error_distance=0.01)
LEAST = 0.2  # part of the trapezoid's swing that the shaped way leaves at most


class Swung(NamedTuple):
    """How it went, by cable: nearest to the wall [m], and how far it still swung after the stop [m]; when it was warned
    first [s], and how."""

    nearest: dict[str, float]
    swing: dict[str, float]
    warned: tuple[float, str]


def shaped() -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and progress of the way after which the cable hangs still."""
    starts, ends = ([(x, y, HEIGHT, *ALONG) for y in (0.0, WAY)] for x in (0.0, SPAN))
    path = cs.shape_stop(CABLE, cs.GripPath(starts, ends), DURATION).path
    return np.asarray(path.times), path.starts[:, 1] / WAY


def grips(progress: float, x: float) -> tuple[Pose, Pose]:
    """Those of a cable that begins at x."""
    return tuple(Pose((at, WAY * progress, HEIGHT), ALONG) for at in (x, x + SPAN))  # type: ignore[return-value]


def run(out: Path | None) -> Swung:
    """Both cables, cycle by cycle; with a recording if a path is given."""
    times, progress = shaped()
    cables = {"trapezoid": CABLE, "shaped": CABLE}
    cycle = cs.Cycle(cables, scene=SCENE, motion="dynamic", look_ahead=0.3)
    writer = None if out is None else RecordingWriter(out, cycle.cables, SCENE)
    nearest = dict.fromkeys(cables, np.inf)
    middles: dict[str, list[np.ndarray]] = {name: [] for name in cables}
    warned = np.inf, ""
    for k in tqdm(range(round((DURATION + AFTER) / DT) + 1), desc="swing", unit=" cycles", disable=None):
        t = min(k * DT, DURATION)
        by = {"trapezoid": float(trapezoid(np.array(t / DURATION))), "shaped": float(np.interp(t, times, progress))}
        held = {name: grips(by[name], BESIDE * i) for i, name in enumerate(cables)}
        report = cycle.step(held, round(1e9 * k * DT))
        for name, shape in report.shapes.items():
            assert shape.usable, shape.detail
            walls = [body.distance for body in report.clearance[name].bodies if body.body == "wall"]
            nearest[name] = min([nearest[name], *walls])
            if k * DT >= DURATION:
                middles[name].append(shape.positions[shape.points // 2])
        if report.warnings and not warned[1]:
            warned = k * DT, report.warnings[0].text
        if writer is not None:
            writer.log(report)
    if writer is not None:
        writer.close()
    swing = {name: float(np.linalg.norm(np.array(x) - x[-1], axis=1).max()) for name, x in middles.items()}
    return Swung(nearest, swing, warned)


def main(arguments: list[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="scripts/demo --swing", description=__doc__)
    parser.add_argument("--swing", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("out", nargs="?", type=Path, default=ROOT / "out" / "swing.rrd", help="the recording")
    out = parser.parse_args(arguments).out
    out.parent.mkdir(parents=True, exist_ok=True)
    found = run(out)
    print(f"after {found.warned[0]:.2f} s, the grips stop after {DURATION:g} s: {found.warned[1]}")
    for name, swing in found.swing.items():
        print(f"{name}: swings on by {1e3 * swing:.1f} mm, {1e3 * found.nearest[name]:.0f} mm from the wall at least")
    print(f"recording: {out}")
    good = found.swing["shaped"] <= LEAST * found.swing["trapezoid"]
    return 0 if good and found.nearest["trapezoid"] < found.nearest["shaped"] else 1


if __name__ == "__main__":
    sys.exit(main())
