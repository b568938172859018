"""Random routing: cables hooked round posts, dragged over walls, laid into channels, through clips, over each other.

    python benchmarks/contact_routing.py [--motions N] [--kind KIND] [--only NUMBER]

One grip stays, the other goes where a robot would take it: round a post and to and fro, down onto walls and across
them, into a channel, along it and out again. Every second motion has friction. Each step is judged by
`scene_certificate`, and counts as lost without a usable shape unless `scene_band` proves that the cable is too short,
or `scene_held` that it is for the way on which friction holds it. One that snapped over a body has passed it unless
`scene_slide` comes to rest on the same side.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

import numpy as np
from figures import Figures, heading
from scene_certificate import Array, distances
from scene_random import ALONG_X, Found, Motion, random_cable, run_motion
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs

STEPS, SEED, FRICTION, TRIES = 200, 19, 0.4, 400
MOTIONS = 100  # of all kinds together
Route = tuple[Array, Array]  # (STEPS, 3) [m] places of a grip, (STEPS, 3) rotation vectors beside that along x


def way(rng: np.random.Generator, stops: list[tuple[float, ...]], aside: float) -> Array:
    """(STEPS, n): a smooth way through these stops, each missed by about `aside`; at rest at both ends."""
    at = np.array(stops, dtype=float)
    at[1:] += rng.normal(size=at[1:].shape) * aside
    times = np.linspace(0.0, 1.0, len(at))
    return np.asarray(CubicSpline(times, at, bc_type="clamped")(np.linspace(0.0, 1.0, STEPS)))


def posed(places: Array, turns: Array) -> list[cs.Pose]:
    """Grips at places, turned from along x by rotation vectors."""
    return [cs.Pose(p, (Rotation.from_rotvec(turn) * ALONG_X).as_quat()) for p, turn in zip(places, turns, strict=True)]


def resting(cable: cs.Cable) -> cs.Pose:
    """The start's grip."""
    return cs.Pose((0.0, 0.0, 0.0), ALONG_X.as_quat())


def hooked(rng: np.random.Generator, cable: cs.Cable, posts: int) -> tuple[list[cs.Obstacle], Route]:
    """Upright posts, and a grip that goes round the first of them and to and fro, as far as the cable lets it."""
    length, radius = cable.length, 0.5 * cable.diameter
    side = rng.choice((-1.0, 1.0))
    thick = rng.uniform(0.01, 0.06) * length
    first = np.array((rng.uniform(0.3, 0.5) * length, side * (thick + radius + rng.uniform(0.01, 0.04) * length)))
    bodies = [cs.Obstacle("post0", cs.Cylinder(thick, 4.0 * length), cs.Pose((*first, 0.0)))]
    turn, round_it = rng.uniform(0.5, 1.9), thick + radius
    for k in range(1, posts):
        angle, far = side * rng.uniform(0.2, 1.2), rng.uniform(0.15, 0.3) * length
        place = first + far * np.array((math.cos(angle), math.sin(angle)))
        bodies.append(
            cs.Obstacle(f"post{k}", cs.Cylinder(rng.uniform(0.01, 0.04) * length, 4.0 * length), cs.Pose((*place, 0.0)))
        )
    angles = way(rng, [(0.0,), (0.6 * turn,), (turn,), (0.7 * turn,), (turn,), (0.4 * turn,)], 0.1)[:, 0]
    drawn = way(rng, [(0.85,), (0.93,), (0.97,), (0.9,), (0.97,), (0.88,)], 0.01)[:, 0]
    ahead = np.stack((np.cos(angles), side * np.sin(angles)), axis=1)
    outer = np.stack((np.sin(angles), -side * np.cos(angles)), axis=1)
    arm = np.minimum(drawn, 0.995) * length - math.hypot(*first) - round_it * np.abs(angles)
    places = np.column_stack(
        (first + round_it * outer + arm[:, None] * ahead, way(rng, [(0.0,)] * 4, 0.02 * length)),
    )
    turns = np.column_stack((np.zeros((STEPS, 2)), side * angles)) + way(rng, [(0.0, 0.0, 0.0)] * 4, 0.15)
    return bodies, (places, turns)


def table_below(rng: np.random.Generator, cable: cs.Cable) -> list[cs.Obstacle]:
    """A table a little below the grips."""
    return [cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -rng.uniform(0.03, 0.12) * cable.length)))]


def posts(rng: np.random.Generator, cable: cs.Cable) -> Motion:
    """One to three posts, in half of the motions on a table."""
    bodies, route = hooked(rng, cable, int(rng.integers(1, 4)))
    if rng.random() < 0.5:
        bodies += table_below(rng, cable)
    return alone(cable, bodies, route)


def walls(rng: np.random.Generator, cable: cs.Cable) -> Motion:
    """Let down on one or two walls, or on a table with a wall beside the cable, and dragged across and along."""
    length = cable.length
    low = -rng.uniform(0.1, 0.2) * length
    bodies = []
    for k in range(rng.integers(1, 3)):
        heading = rng.uniform(-0.5, 0.5) + (0.5 * math.pi if rng.random() < 0.6 else 0.0)
        size = (rng.uniform(0.6, 1.2) * length, rng.uniform(0.01, 0.06) * length, rng.uniform(0.1, 0.3) * length)
        across = abs(math.sin(heading)) > 0.8
        place = (rng.uniform(0.3, 0.6) * length, 0.0 if across else rng.choice((-1, 1)) * 0.12 * length)
        bodies.append(
            cs.Obstacle(
                f"wall{k}",
                cs.Box(size),
                cs.Pose((*place, low - 0.5 * size[2]), Rotation.from_euler("z", heading).as_quat()),
            )
        )
    if rng.random() < 0.6:
        bodies.append(cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, low - rng.uniform(0.0, 0.15) * length))))
    chord = rng.uniform(0.7, 0.9) * length
    stops = [(0.0, 0.0, 0.0), (0.0, 0.0, -0.12), (0.0, 0.12, -0.12), (0.0, -0.12, -0.12), (-0.1, 0.0, -0.1), (0, 0, 0)]
    places = way(rng, [tuple(length * np.array(stop)) for stop in stops], 0.02 * length)
    places[:, 0] += chord
    return alone(cable, bodies, (places, way(rng, [(0.0, 0.0, 0.0)] * 4, 0.15)), follows=0.9)


def channel(rng: np.random.Generator, cable: cs.Cable) -> Motion:
    """Laid into a U of a floor and two walls, to one side and the other, along it and out again.

    The grips stay so high that the cable lies there, and is not crammed: it would sag by about sqrt(3/8 slack chord).
    """
    length = cable.length
    width, high, thick = rng.uniform(1.3, 6.0) * cable.diameter, rng.uniform(0.02, 0.06) * length, 0.02 * length
    chord = rng.uniform(0.8, 0.95) * length
    sag = math.sqrt(0.375 * (length - chord) * chord)
    low = -1.3 * sag
    span = rng.uniform(0.4, 1.3) * chord
    turn = Rotation.from_euler("z", rng.normal() * 0.05).as_quat()
    bodies = [cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, low)))]
    middle = cs.Pose((0.5 * chord, 0.0, low + 0.5 * high), turn)
    for name, sign in (("near", -1.0), ("far", 1.0)):
        place = middle * cs.Pose((0.0, sign * 0.5 * (width + thick), 0.0))
        bodies.append(cs.Obstacle(name, cs.Box((span, thick, high)), place))
    down = low + rng.uniform(0.6, 0.9) * sag
    stops = [(0, 0, 0), (0, 0, down), (0, 0.06, down), (0, -0.06, down), (-0.02, 0, down), (0, 0, down), (0, 0, 0)]
    scaled = [(x * length, y * length, z) for x, y, z in stops]
    places = way(rng, scaled, 0.005 * length)
    places[:, 0] += chord
    return alone(cable, bodies, (places, way(rng, [(0.0, 0.0, 0.0)] * 4, 0.05)), follows=1.0)


def clips(rng: np.random.Generator, cable: cs.Cable) -> Motion | None:
    """A clip on the way to one or two posts, in half of the motions on a table."""
    bodies, route = hooked(rng, cable, int(rng.integers(1, 3)))
    given = alone(cable, bodies, route)
    free = cs.predict(cable, *given.steps[0]["cable"])
    if not free.usable:
        return None
    k = int(rng.uniform(0.15, 0.25) * (free.points - 1))
    place = free.positions[k] + rng.normal(size=3) * 0.01 * cable.length
    kind = str(rng.choice(("ball", "slide", "fixed")))
    clip = cs.Clip(float(free.arc_length[k]), cs.Pose(place, free.quaternions[k]), kind=kind)
    if rng.random() < 0.5:
        low = min(place[2], 0.0) - 0.02 * cable.length - cable.diameter
        bodies.append(cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, low))))
    scene = cs.Scene(obstacles=bodies, contact="solve")
    return given._replace(scene=scene, clips={"cable": [clip]})


def two_cables(rng: np.random.Generator, cable: cs.Cable) -> Motion:
    """A second cable laid across the first and dragged over it, in half of the motions on a table, or by a post."""
    length = cable.length
    chord = rng.uniform(0.7, 0.9) * length
    other = cable.replace(diameter=rng.uniform(0.004, 0.01))
    below = -rng.uniform(0.05, 0.12) * length
    bodies = []
    if rng.random() < 0.5:
        bodies.append(cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, below))))
    elif rng.random() < 0.5:
        place = (0.5 * chord + rng.normal() * 0.05 * length, rng.choice((-1, 1)) * 0.1 * length, 0.0)
        bodies.append(cs.Obstacle("post", cs.Cylinder(0.03 * length, 4.0 * length), cs.Pose(place)))
    first = [(cs.Pose((0, 0, 0), ALONG_X.as_quat()), cs.Pose((chord, 0, 0), ALONG_X.as_quat()))] * STEPS
    heading = Rotation.from_euler("z", math.radians(rng.uniform(50.0, 130.0)))
    half = heading.apply((0.5 * chord, 0.0, 0.0))
    stops = [(0.0, 0.0, 0.1), (0.0, 0.0, 0.02), (0.08, 0.0, 0.0), (-0.08, 0.0, 0.0), (0.0, 0.08, 0.0), (0.0, 0.0, 0.1)]
    common = way(rng, [tuple(length * np.array(stop)) for stop in stops], 0.01 * length)
    common[:, 0] += 0.5 * chord
    second = []
    for at in common:
        poses = [cs.Pose(at + sign * half, (heading * ALONG_X).as_quat()) for sign in (-1.0, 1.0)]
        second.append((poses[0], poses[1]))
    scene = cs.Scene(obstacles=bodies, contact="solve")
    steps = [{"a": one, "b": two} for one, two in zip(first, second, strict=True)]
    return Motion({"a": cable, "b": other}, scene, {}, steps)


def alone(cable: cs.Cable, bodies: list[cs.Obstacle], route: Route, follows: float = 0.0) -> Motion:
    """One cable's motion; the start's grip goes `follows` times as far as the end's, and does not turn."""
    ends = posed(*route)
    places = follows * (route[0] - route[0][0])
    starts = [cs.Pose(place, ALONG_X.as_quat()) for place in places]
    steps = [{"cable": pair} for pair in zip(starts, ends, strict=True)]
    return Motion({"cable": cable}, cs.Scene(obstacles=bodies, contact="solve"), {}, steps)


#: Kinds of motions.
KINDS: dict[str, Callable[[np.random.Generator, cs.Cable], Motion | None]] = {
    "posts": posts,
    "walls": walls,
    "channel": channel,
    "clips": clips,
    "two cables": two_cables,
}


def clear(given: Motion) -> bool:
    """Whether grips, clips and the first shapes are clear of bodies and grips leave room."""
    for name, cable in given.cables.items():
        poses = [pose for step in given.steps for pose in step[name]]
        poses += [clip.pose for clip in given.clips.get(name, [])]
        ahead = [
            p.position + s * 0.03 * cable.length * Rotation.from_quat(p.quaternion).apply((0, 0, 1))
            for p, s in zip(poses, (1.0, -1.0) * len(given.steps), strict=False)
        ]
        scene = cs.Scene(clips=given.clips.get(name, []))
        free = cs.predict(cable, *given.steps[0][name], scene=scene)
        if not free.usable:
            return False
        points = np.concatenate((np.array([p.position for p in poses]), np.array(ahead)))
        for body in given.scene.obstacles:
            if distances(body.solid, body.pose, points).min() < 2.0 * cable.diameter:
                return False
            if distances(body.solid, body.pose, free.positions).min() < cable.diameter:
                return False
    return True


def motion(kind: str, number: int) -> Motion:
    """The motion of a kind with this number; odd ones have friction."""
    for attempt in range(TRIES):
        rng = np.random.default_rng((SEED, list(KINDS).index(kind), number, attempt))
        given = KINDS[kind](rng, random_cable(rng))
        if given is not None and clear(given):
            rubs = FRICTION if number % 2 else 0.0
            bodies = [replace(body, friction=rubs) for body in given.scene.obstacles]
            scene = cs.Scene(obstacles=bodies, contact="solve")
            if len(given.cables) > 1:
                cables = {name: cable.replace(friction=rubs) for name, cable in given.cables.items()}
                given = given._replace(cables=cables)
            return given._replace(scene=scene)
    raise AssertionError(f"no motion {number} of kind {kind} in {TRIES} tries")


def run(kind: str, number: int) -> Found:
    """Predicts a motion's steps and judges them."""
    return run_motion(motion(kind, number), f"{kind} {number}")


#: What is asked of the steps without a usable shape [%]: in channels with friction, and elsewhere.
LOST_IN_CHANNELS, LOST = 1.5, 0.5
SHORT = 20.0  # % of the steps, for which no shape may exist


def runs(kind: str, numbers: range, pool: Executor | None) -> list[Found]:
    """Motions of a kind, each told when it has come to its end: a log shows how far all are."""
    out = []
    found = (pool.map if pool else map)(partial(run, kind), numbers)
    for number, one in zip(numbers, tqdm(found, desc=kind, total=len(numbers), leave=False, disable=None), strict=True):
        out.append(one)
        if not sys.stderr.isatty():
            print(f"{kind} {number}: {dict(one.statuses)} {dict(one.wrong) or ''}", file=sys.stderr, flush=True)
    return out


def print_routing(figures: Figures, motions: int, kinds: list[str] | None = None, processes: int = 1) -> None:
    """A row of each kind, with and without friction, and what was wrong first; `motions` of all kinds together."""
    if processes == 1:
        _print_routing(figures, motions, kinds, None)
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        _print_routing(figures, motions, kinds, pool)


def _print_routing(figures: Figures, motions: int, kinds: list[str] | None, pool: Executor | None) -> None:
    """The same, in this process or in those of a pool."""
    heading(f"Random routing, motions of {STEPS} steps, every usable shape certified")
    print(
        f"{'kind':24}{'motions':>8}{'steps':>8}{'too short':>10}{'held':>6}"
        f"{'no shape':>14}{'snapped':>8}{'wrong':>7}{'passed':>7}"
    )
    total: Counter[str] = Counter()
    for kind in kinds or KINDS:
        count = max(2, motions // len(kinds or KINDS))
        for rubs in (0, 1):
            found = runs(kind, range(rubs, count, 2), pool)
            statuses = sum((f.statuses for f in found), Counter())
            wrong = sum((f.wrong for f in found), Counter())
            short, held = statuses["too far apart"], statuses["held"]
            steps = statuses.total() - short - held
            usable = sum(statuses[name] for name in ("OK", "UNSTABLE", "SNAPPED", "BUDGET"))
            share, passed = 100.0 * (steps - usable) / max(steps, 1), wrong["through"]
            name = f"{kind}, friction {FRICTION if rubs else 0.0}"
            row = f"{name:24}{len(found):8d}{steps:8d}{short:10d}{held:6d}{steps - usable:6d} {share:5.2f} %"
            print(
                f"{row}{statuses['SNAPPED']:9d}{wrong.total() - passed:7d}{passed:7d}  {dict(wrong) or ''}", flush=True
            )
            for text in [f.first for f in found if f.first][:5]:
                print(f"    {text}")
            worst = sorted(((len(f.lost), n) for f, n in zip(found, range(rubs, count, 2), strict=True)), reverse=True)
            print("    most lost: " + ", ".join(f"{lost} in {n}" for lost, n in worst[:6] if lost))
            bound = LOST_IN_CHANNELS if kind == "channel" and rubs else LOST
            figures.at_most(f"routing, {name}: steps without a shape", share, bound, "{:.2f}", " %")
            total += Counter(steps=steps, short=short + held, wrong=wrong.total() - passed, passed=passed)
            if bound == LOST:
                total += Counter(elsewhere=steps, lost=steps - usable)
    if total["elsewhere"]:
        share = 100.0 * total["lost"] / total["elsewhere"]
        figures.at_most("routing, all but channels with friction: steps without a shape", share, LOST, "{:.2f}", " %")
    figures.at_most("routing: violated certificates", float(total["wrong"]), 0.0, "{:.0f}")
    figures.at_most("routing: passed through a body or a cable", float(total["passed"]), 0.0, "{:.0f}")
    share = 100.0 * total["short"] / (total["steps"] + total["short"])
    figures.at_most("routing: steps for which the cable is proven to be too short", share, SHORT, "{:.1f}", " %")


def main() -> int:
    """All kinds, or one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--motions", type=int, default=MOTIONS, help=f"of all kinds together ({MOTIONS})")
    parser.add_argument("--processes", type=int, default=os.cpu_count(), help="at a time (one per core)")
    parser.add_argument("--kind", choices=list(KINDS), help="only this one")
    parser.add_argument("--only", type=int, help="only the motion with this number")
    options = parser.parse_args()
    if options.only is not None:
        print(run(options.kind or "posts", options.only))
        return 0
    print_routing(Figures(), options.motions, [options.kind] if options.kind else None, options.processes)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
