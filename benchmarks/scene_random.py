"""Random cables moved among random bodies, in clips, over each other and themselves, each shape with a certificate.

    python benchmarks/scene_random.py [--motions N] [--kind KIND] [--only NUMBER]

Every step without a usable shape counts, but for those for which the cable is too short: whose ends are further apart,
or whose shortest way on the side of the bodies where it was last is longer than the cable (`scene_band`), or that on
which friction holds it (`scene_held`). What is wrong with a usable shape is found by `scene_certificate`, in numpy.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from figures import Figures, heading
from scene_band import Band
from scene_certificate import Array, crossed, distances, judged, passed
from scene_held import Held
from scene_slide import slid_there
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs

#: Kinds of motions, with how many steps [%] may be without a usable shape.
KINDS = {
    "contact": 1.0,
    "clips and contact": 1.0,
    "cables": 0.7,
    "itself": 0.7,
    "cables on bodies": 0.7,
    "contact with friction": 1.5,
}
STEPS, SEED, FRICTION = 30, 16, 0.4
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
TRIES = 200


class Motion(NamedTuple):
    """Cables, what they are in, and the grips of every step; clips of each cable."""

    cables: dict[str, cs.Cable]
    scene: cs.Scene
    clips: dict[str, list[cs.Clip]]
    steps: list[dict[str, tuple[cs.Pose, cs.Pose]]]


class Found(NamedTuple):
    """What came of a motion's steps."""

    statuses: Counter[str]
    wrong: Counter[str]
    first: str  # the first that is wrong, and where
    lost: tuple[int, ...] = ()  # steps without a shape, but for those for which the cable is too short


def random_cable(rng: np.random.Generator) -> cs.Cable:
    """EI from 3e-4 to 0.3 times w L^3."""
    length, density = rng.uniform(0.5, 1.2), 10.0 ** rng.uniform(-1.7, -0.5)
    bending = 10.0 ** rng.uniform(-3.5, -0.5) * 9.81 * density * length**3
    return cs.Cable(length, density, bending, bending * rng.uniform(0.5, 1.0), diameter=rng.uniform(0.004, 0.01))


def smooth(rng: np.random.Generator, size: float, columns: int) -> Array:
    """(STEPS, columns): random ways of about this size, that begin and end at rest."""
    x = np.linspace(0.0, 1.0, STEPS)[:, None]
    goal, bow = rng.normal(size=(2, columns)) * size
    return (3.0 - 2.0 * x) * x**2 * goal + np.sin(np.pi * x) ** 2 * bow


def held(rng: np.random.Generator, cable: cs.Cable, middle: Array, heading: float, chord: float, reach: float) -> list:
    """Grips on both sides of `middle`, moved by about `reach` [m] and as many radians of a length of 0.3 m."""
    turn = Rotation.from_euler("z", heading)
    half = turn.apply((0.5 * chord, 0.0, 0.0))
    out = []
    ways, turns = [smooth(rng, reach, 3) for _ in range(2)], [smooth(rng, reach / 0.6, 3) for _ in range(2)]
    tilts = [Rotation.from_rotvec(rng.normal(size=3) * 0.15) for _ in range(2)]
    for k in range(STEPS):
        poses = []
        for side, sign in ((0, -1.0), (1, 1.0)):
            own = Rotation.from_rotvec(turns[side][k]) * tilts[side] * turn * ALONG_X
            poses.append(cs.Pose(middle + sign * half + ways[side][k], own.as_quat()))
        out.append(tuple(poses))
    return out


def solid(rng: np.random.Generator, size: float) -> object:
    """One of the convex ones."""
    kind = rng.integers(4)
    radius = size * rng.uniform(0.04, 0.12)
    if kind == 0:
        return cs.Sphere(radius)
    if kind == 1:
        return cs.Cylinder(radius, size * rng.uniform(0.3, 1.0))
    if kind == 2:
        return cs.Capsule(radius, size * rng.uniform(0.3, 1.0))
    return cs.Box(size * rng.uniform(0.08, 0.4, 3))


def bodies(rng: np.random.Generator, lowest: Array, length: float) -> list[cs.Obstacle]:
    """One to three of them near the lowest place of a cable, or a table there."""
    out = []
    for k in range(rng.integers(1, 4)):
        if k == 0 and rng.random() < 0.4:
            out.append(
                cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, lowest[2] + 0.06 * length * rng.random())))
            )
            continue
        place = lowest + length * rng.normal(size=3) * (0.15, 0.15, 0.06) - (0.0, 0.0, 0.04 * length)
        out.append(cs.Obstacle(f"body{k}", solid(rng, length), cs.Pose(place, Rotation.random(rng=rng).as_quat())))
    return out


def clear(scene: cs.Scene, cable: cs.Cable, steps: list[tuple[cs.Pose, cs.Pose]], clips: list[cs.Clip]) -> bool:
    """Whether no grip comes within a twentieth of the length of a body, and no clip within a diameter."""
    grips = np.array([pose.position for pair in steps for pose in pair])
    ahead = np.array(
        [
            p.position + s * 0.05 * cable.length * np.array(Rotation.from_quat(p.quaternion).apply((0, 0, 1)))
            for pair in steps
            for p, s in zip(pair, (1.0, -1.0), strict=True)
        ]
    )
    for body in scene.obstacles:
        if min(distances(body.solid, body.pose, x).min() for x in (grips, ahead)) < 0.02 * cable.length:
            return False
        places = np.array([clip.pose.position for clip in clips]).reshape(-1, 3)
        if len(places) and distances(body.solid, body.pose, places).min() < cable.diameter:
            return False
    return True


def motion(kind: str, number: int) -> Motion:
    """The motion of a kind with this number."""
    for attempt in range(TRIES):
        rng = np.random.default_rng((SEED, list(KINDS).index(kind), number, attempt))
        found = _motion(kind, rng)
        if found is not None:
            return found
    raise AssertionError(f"no motion {number} of kind {kind} in {TRIES} tries")


def _motion(kind: str, rng: np.random.Generator) -> Motion | None:
    """One try; None if grips or clips are in the way of bodies."""
    cable = random_cable(rng)
    length = cable.length
    if kind == "itself":
        return twisted(rng, cable)
    chord = rng.uniform(0.45, 0.9) * length
    if kind == "cables":
        return let_down(rng, cable, chord)
    rubs = FRICTION if kind == "contact with friction" else 0.0
    if kind == "cables on bodies":
        return laid_down(rng, let_down(rng, cable, chord))
    steps = held(rng, cable, np.zeros(3), rng.uniform(0.0, 2.0 * math.pi), chord, 0.06 * length)
    free = cs.predict(cable, *steps[0])
    if not free.usable:
        return None
    lowest = free.positions[free.positions[:, 2].argmin()]
    clips = []
    if kind == "clips and contact":
        for part in np.sort(rng.uniform(0.25, 0.75, rng.integers(1, 3))):
            at = int(part * (free.points - 1))
            place = free.positions[at] + rng.normal(size=3) * 0.02 * length
            name = rng.choice(("ball", "slide"))
            clips.append(cs.Clip(float(free.arc_length[at]), cs.Pose(place, free.quaternions[at]), kind=str(name)))
        if len(clips) == 2 and clips[1].arc_length - clips[0].arc_length < 0.15 * length:
            return None
    obstacles = [replace(body, friction=rubs) for body in bodies(rng, lowest, length)]
    scene = cs.Scene(obstacles=obstacles, contact="solve")
    if not clear(scene, cable, steps, clips):
        return None
    return Motion({"cable": cable}, scene, {"cable": clips}, [{"cable": pair} for pair in steps])


def let_down(rng: np.random.Generator, cable: cs.Cable, chord: float) -> Motion:
    """Two or three cables, each let down across the first."""
    length, count = cable.length, int(rng.integers(2, 4))
    cables, ways = {}, {}
    for k in range(count):
        name = "abc"[k]
        cables[name] = cable if k == 0 else cable.replace(diameter=rng.uniform(0.004, 0.01))
        heading = 0.0 if k == 0 else math.radians(rng.uniform(40.0, 140.0) + (60.0 if k == 2 else 0.0))
        aside = rng.normal(size=2) * 0.04 * length + (0.2 * length if k == 2 else 0.0)
        above = 0.03 * length * k
        steps = held(rng, cable, np.array((*aside, above)), heading, chord, 0.015 * length)
        down = np.linspace(0.0, 1.0, STEPS) * (0.0 if k == 0 else 0.06 * length * rng.uniform(0.6, 1.4))
        ways[name] = [
            tuple(cs.Pose(p.position - (0.0, 0.0, drop), p.quaternion) for p in pair)
            for pair, drop in zip(steps, down, strict=True)
        ]
    scene = cs.Scene(contact="solve")
    return Motion(cables, scene, {}, [{name: way[k] for name, way in ways.items()} for k in range(STEPS)])


def laid_down(rng: np.random.Generator, cables: Motion) -> Motion | None:
    """The same with bodies below the first cable's lowest place; None if grips are in their way."""
    ways = {name: [step[name] for step in cables.steps] for name in cables.cables}
    first = next(iter(cables.cables))
    free = cs.predict(cables.cables[first], *ways[first][0])
    if not free.usable:
        return None
    scene = cs.Scene(obstacles=bodies(rng, free.positions[free.positions[:, 2].argmin()], free.length), contact="solve")
    if not all(clear(scene, cables.cables[name], way, []) for name, way in ways.items()):
        return None
    return cables._replace(scene=scene)


def twisted(rng: np.random.Generator, cable: cs.Cable) -> Motion:
    """A cable wound up by one and a half turns, its ends coming nearer."""
    length = cable.length
    steps = []
    for x in np.linspace(0.0, 1.0, STEPS):
        chord = length * (0.8 - 0.5 * x * rng.uniform(0.98, 1.0))
        turn = Rotation.from_rotvec((2.0 * math.pi * 1.5 * x, 0.0, 0.0)) * ALONG_X
        steps.append({"cable": (cs.Pose((0, 0, 0), ALONG_X.as_quat()), cs.Pose((chord, 0, 0), turn.as_quat()))})
    return Motion({"cable": cable}, cs.Scene(contact="solve"), {}, steps)


def run(kind: str, number: int) -> Found:
    """Predicts a motion's steps and judges them."""
    return run_motion(motion(kind, number), f"{kind} {number}")


def run_motion(given: Motion, title: str) -> Found:
    """The same of any motion."""
    cycle = cs.Cycle(given.cables, scene=given.scene, clips=given.clips or None, model="cosserat", points=301)
    statuses: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    first, before, lost, since = "", None, [], []
    bands, holds = (
        {name: kind(cable, given.scene, given.clips.get(name, [])) for name, cable in given.cables.items()}
        for kind in (Band, Held)
    )
    for k, grips in enumerate(given.steps):
        shapes = cycle.step(grips, stamp=10_000_000 * k).shapes
        since.append(grips)
        texts = []
        for name, shape in shapes.items():
            clips = given.clips.get(name, [])
            told = holds[name].too_short(*grips[name])
            held = told and not shape.usable
            none = not shape.usable and (
                short(clips, shape.length, *grips[name]) or bands[name].too_short(*grips[name])
            )
            statuses["too far apart" if none else "held" if held else shape.status.name] += 1
            if shape.usable:
                if told and holds[name].contradicts(shape, *grips[name]):
                    texts.append("held: friction holds the cable on a way for which it is too short")
                bands[name].lie(shape)
                holds[name].lie(shape)
                texts += judged(given.cables[name], given.scene, shape, shape.supports, given.cables)
            elif not (none or held):
                lost.append(k)
        if all(shape.usable for shape in shapes.values()):
            if before is not None:
                texts += ways(given, before, shapes, since)
            before, since = shapes, [grips]
        for text in texts:
            wrong[text.split(":")[0]] += 1
            first = first or f"{title}, step {k}: {text}"
    return Found(statuses, wrong, first, tuple(lost))


def short(clips: list[cs.Clip], length: float, start: cs.Pose, end: cs.Pose) -> bool:
    """Whether the straight way from grip to grip, by the clips, is longer than the cable on some of it."""
    stops = [(0.0, start.position, False)]
    stops += [(clip.arc_length, clip.pose.position, clip.kind == "slide") for clip in clips]
    stops.append((length, end.position, False))
    way, since = 0.0, 0.0
    for (_, here, _), (arc, there, runs) in pairwise(stops):
        way += math.dist(here, there)
        if runs:
            continue
        if way >= arc - since:
            return True
        way, since = 0.0, arc
    return False


def ways(
    given: Motion,
    before: dict[str, cs.CableShape],
    shapes: dict[str, cs.CableShape],
    since: list[dict[str, tuple[cs.Pose, cs.Pose]]],
) -> list[str]:
    """What was passed on the way from the last usable shapes, the grips of all steps since then being given.

    A cable alone that snapped may have gone another way than straight: then it is where a chain slides, too.
    """
    names = list(shapes)
    texts = []
    for name in names:
        cable, shape = given.cables[name], shapes[name]
        text = passed(given.scene, 0.5 * cable.diameter, before[name], shape)
        alone = len(names) == 1 and not given.clips.get(name)
        if text and alone and shape.status is cs.Status.SNAPPED:
            text = "" if slid_there(cable, given.scene, before[name], shape, [step[name] for step in since]) else text
        texts += [text] if text else []
    for i, one in enumerate(names):
        for other in names[i:]:
            reach = 0.5 * (given.cables[one].diameter + given.cables[other].diameter)
            if crossed((before[one], before[other]), (shapes[one], shapes[other]), reach, one == other):
                texts.append(f"through: {other}")
    return texts


def print_random(figures: Figures, motions: int, kinds: list[str] | None = None) -> None:
    """A row of each kind, and what was wrong first."""
    heading(f"Random motions of {STEPS} steps, every usable shape certified")
    print(f"{'kind':20}{'motions':>8}{'steps':>8}{'no shape':>10}{'snapped':>9}{'wrong':>7}")
    for kind in kinds or KINDS:
        found = [run(kind, number) for number in tqdm(range(motions), desc=kind, leave=False, disable=None)]
        statuses = sum((f.statuses for f in found), Counter())
        wrong = sum((f.wrong for f in found), Counter())
        steps = statuses.total() - statuses["too far apart"] - statuses["held"]
        usable = sum(statuses[name] for name in ("OK", "UNSTABLE", "SNAPPED", "BUDGET"))
        without = 100.0 * (steps - usable) / steps
        row = f"{kind:20}{motions:8d}{steps:8d}{without:8.2f} %{statuses['SNAPPED']:9d}{wrong.total():7d}"
        print(f"{row}  {dict(wrong) or ''}")
        for text in [f.first for f in found if f.first][:5]:
            print(f"    {text}")
        figures.at_most(f"random motions, {kind}: steps without a shape", without, KINDS[kind], "{:.2f}", " %")
        figures.at_most(f"random motions, {kind}: wrong", float(wrong.total()), 0.0, "{:.0f}")


def main() -> int:
    """All kinds, or one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--motions", type=int, default=100, help="of each kind (100)")
    parser.add_argument("--kind", choices=list(KINDS), help="only this one")
    parser.add_argument("--only", type=int, help="only the motion with this number")
    options = parser.parse_args()
    if options.only is not None:
        print(run(options.kind or "contact", options.only))
        return 0
    print_random(Figures(), options.motions, [options.kind] if options.kind else None)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
