"""MuJoCo's cable beside the rod where a cable is dragged over a table, hooked round a post and laid in a channel.

Both begin hanging free, their ends go the same way, and what bodies hold by friction at last depends on all of it.
MuJoCo moves the ends slowly and lets the cable come to rest, on two meshes; how slowly is that of its fastest run whose
shape is within a part of the length of that of a run at a third of the pace. The rod is predicted step by step, as in a
cell. Distances are the largest of MuJoCo's joints from the rod, at equal arc length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from time import thread_time
from typing import Any, NamedTuple

import numpy as np
from evidence_pages import table
from evidence_rivals import ask, python
from figures import Figures, heading
from problems import ALONG_X
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import cable_shape as cs

WORKER = "rivals_mujoco_laid.py"
FRICTION, STEPS, POINTS = 0.4, 30, 601  # predictions between two stops
LINKS = (20, 40)
PACES = (0.9, 0.3, 0.1)  # m/s
SETTING = {"step": 0.002, "damping": 5.0, "armature": 1e-5, "rest": 1.0}
ALIKE = 5e-3  # of the length: runs at two paces are of one shape
FAR = 0.01  # of the length, beside what the two meshes differ by
CABLE = cs.Cable(1.0, 0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)


class Scene(NamedTuple):
    """A cable, bodies, and where its ends go."""

    cable: cs.Cable
    bodies: list[cs.Obstacle]
    starts: list[cs.Pose]
    ends: list[cs.Pose]


def posed(stops: Sequence[tuple[float, ...]], count: int = STEPS) -> list[cs.Pose]:
    """The straight way through stops of x, y, z [m] and a turn about z [rad], from along x."""
    rows = np.array(stops)
    at = np.arange((len(rows) - 1) * count + 1) / count
    ways = np.stack([np.interp(at, np.arange(len(rows)), column) for column in rows.T], axis=1)
    return [cs.Pose(w[:3], (Rotation.from_euler("z", w[3]) * Rotation.from_quat(ALONG_X)).as_quat()) for w in ways]


def still(ends: Sequence[cs.Pose], share: float = 0.0) -> list[cs.Pose]:
    """Starts that go along, a share of the way, across and down."""
    places = [(0.0, share * end.position[1], share * end.position[2]) for end in ends]
    return [cs.Pose(place, ALONG_X) for place in places]


def dragged() -> Scene:
    """On a table, to and fro."""
    table_top = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.06)), friction=FRICTION)
    ends = posed([(0.93, 0.0, 0.0, 0.0), (0.88, 0.05, 0.0, 0.0), (0.8, 0.15, 0.0, 0.2), (0.75, 0.0, 0.0, 0.0)])
    return Scene(CABLE, [table_top], still(ends), ends)


def hooked() -> Scene:
    """Round a post by 80 degrees, and tightened."""
    radius, middle = 0.05, np.array((0.4, 0.11))
    stops = []
    for angle, drawn in ((0.0, 0.9), (0.4, 0.93), (0.8, 0.955), (1.2, 0.96), (1.4, 0.96), (1.4, 0.94)):
        along, out = np.array((math.cos(angle), math.sin(angle))), np.array((math.sin(angle), -math.cos(angle)))
        arm = drawn * CABLE.length - math.hypot(*middle) - radius * angle
        stops.append((*(middle + (radius + 0.5 * CABLE.diameter) * out + arm * along), 0.0, angle))
    ends = posed(stops)
    post = cs.Obstacle("post", cs.Cylinder(radius, 4.0), cs.Pose((*middle, 0.0)), friction=FRICTION)
    return Scene(CABLE, [post], still(ends), ends)


def channelled() -> Scene:
    """Let down into a U of a floor and two walls, and drawn to both sides and along it."""
    low, width, thick, high, span = -0.24, 0.016, 0.02, 0.04, 0.5
    bodies = [cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, low)), friction=FRICTION)]
    for name, side in (("near", -1.0), ("far", 1.0)):
        place = cs.Pose((0.425, side * 0.5 * (width + thick), low + 0.5 * high))
        bodies.append(cs.Obstacle(name, cs.Box((span, thick, high)), place, friction=FRICTION))
    stops = [(0.85, 0.0, 0.0), (0.85, 0.0, -0.07), (0.85, 0.04, -0.07), (0.85, -0.04, -0.07), (0.87, -0.04, -0.07)]
    ends = posed([(*stop, 0.0) for stop in stops])
    limper = CABLE.replace(bending_stiffness=1e-3, twisting_stiffness=8e-4)
    return Scene(limper, bodies, still(ends, 0.9), ends)


SCENES = {"dragged over a table": dragged, "hooked round a post": hooked, "laid in a channel": channelled}


def rod(scene: Scene) -> tuple[cs.CableShape, cs.CableShape, float, int]:
    """The first and the last shape, time of all predictions but the first [s], and how many had no shape."""
    cell = cs.Scene(obstacles=scene.bodies, contact="solve")
    predictor = cs.Predictor(scene.cable, scene=cell, points=POINTS, model="cosserat")
    first = last = predictor.predict(scene.starts[0], scene.ends[0])
    began, lost = thread_time(), 0
    for start, end in zip(scene.starts[1:], scene.ends[1:], strict=True):
        last = predictor.predict(start, end)
        lost += not last.usable
    return first, last, thread_time() - began, lost


def told(scene: Scene, first: cs.CableShape) -> dict[str, Any]:
    """As JSON, see `rivals_common.Rod`."""
    kinds: dict[type, Any] = {
        cs.HalfSpace: lambda solid: ("plane", (5.0, 5.0, 0.1)),
        cs.Cylinder: lambda solid: ("cylinder", (solid.radius, 0.5 * solid.length)),
        cs.Box: lambda solid: ("box", tuple(0.5 * size for size in solid.size)),
    }
    bodies = []
    for body in scene.bodies:
        kind, size = kinds[type(body.solid)](body.solid)
        place = {"position": body.pose.position.tolist(), "quaternion": body.pose.quaternion.tolist()}
        bodies.append({"type": kind, "size": size, **place})
    cable, line = scene.cable, {"exact_at": first.arc_length.tolist(), "exact": first.positions.tolist()}
    return {
        "length": cable.length, "linear_density": cable.linear_density, "tension": 0.0,
        "bending_stiffness": cable.mean_bending_stiffness, "twisting_stiffness": cable.twisting_stiffness,
        "start": scene.starts[0].array.tolist(), "end": scene.ends[0].array.tolist(),
        "guess_at": first.arc_length.tolist(), "guess": first.quaternions.tolist(), **line,
        "bodies": bodies, "friction": FRICTION,
        "starts": [pose.array.tolist() for pose in scene.starts], "ends": [pose.array.tolist() for pose in scene.ends],
    }  # fmt: skip


def line_of(places: Sequence[Sequence[float]], length: float) -> CubicSpline:
    """Through joints (n, 3) [m] at their arc lengths."""
    n = len(places)
    return CubicSpline((np.arange(n) + 0.5) * length / n, np.array(places))


def apart(a: CubicSpline, b: CubicSpline) -> float:
    """[m], the largest distance of two lines at the joints of the first."""
    return float(np.linalg.norm(a(a.x) - b(a.x), axis=1).max())


def print_laid(figures: Figures, quick: bool) -> None:
    """A row of each scene and mesh."""
    heading("Contact with friction beside MuJoCo: the last shape, largest distance / L, and time of the whole way")
    if python() is None:
        return
    scenes = {name: make() for name, make in SCENES.items()}
    ours = {name: min((rod(scene) for _ in range(3)), key=lambda run: run[2]) for name, scene in scenes.items()}
    paces = PACES[:2] if quick else PACES
    keys = list(product(scenes, LINKS, paces))
    jobs = [{"problem": name, "joints": links, "setting": {**SETTING, "pace": pace}} for name, links, pace in keys]
    request = {"scenes": {name: told(scene, ours[name][0]) for name, scene in scenes.items()}, "jobs": jobs}
    answers = ask(WORKER, request)["answers"]
    answered = dict(zip(keys, answers, strict=True))
    rows = []
    for name, scene in scenes.items():
        _, last, spent, lost = ours[name]
        length, exact = scene.cable.length, CubicSpline(last.arc_length, last.positions)
        lines = {}
        for links in LINKS:
            ways = [answered[name, links, pace] for pace in paces]
            found = [(one, line_of(one["places"], length)) for one in ways if one is not None]
            if ways[-1] is None:
                continue
            alike = [one for one, line in found if apart(line, found[-1][1]) < ALIKE * length]
            lines[links], seconds = found[-1][1], min(one["seconds"] for one in alike)
            off, between = apart(lines[links], exact) / length, ""
            if len(lines) == 2:
                between = f"{apart(lines[LINKS[0]], lines[LINKS[1]]) / length:.4f}"
            rows.append((name, str(links), f"{off:.4f}", between, f"{1e3 * seconds:.0f}", f"{seconds / spent:.3g}"))
            figures.ratio(f"rod : MuJoCo cable, {links} links, {name}", seconds / spent)
        figures.at_most(f"{name}: steps without a shape", float(lost), 0.0, "{:.0f}")
        if len(lines) == len(LINKS):
            differ = apart(lines[LINKS[0]], lines[LINKS[1]]) / length
            off = apart(lines[LINKS[-1]], exact) / length
            figures.at_most(f"{name}: distance from MuJoCo's cable / L", off, FAR + differ, "{:.4f}")
        else:
            figures.check(f"{name}: MuJoCo's cable comes to rest", False)
    head = ("scene", "links", "distance / L", "between its meshes", "time [ms]", "time / rod")
    print(table(head, rows))
    print(f"The rod: {', '.join(f'{name} {1e3 * run[2]:.0f} ms' for name, run in ours.items())}; {POINTS} points.")
