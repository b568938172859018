"""Random harnesses with grips that they reach, for tests and benches: :func:`random_harness`, :func:`balance`."""

from __future__ import annotations

import numpy as np

import cable_shape as cs
from cable_shape.cable.harness import split_end

GRAVITY = np.array((0.0, 0.0, -9.81))


def random_quaternion(rng: np.random.Generator, angle: float = np.pi) -> np.ndarray:
    """(4,) a turn about a random axis by at most `angle` [rad]."""
    axis = rng.normal(size=3)
    half = 0.5 * rng.uniform(0.0, angle)
    return np.append(np.sin(half) * axis / np.linalg.norm(axis), np.cos(half))


def random_harness(
    rng: np.random.Generator, most: int = 20, loops: bool = True
) -> tuple[cs.Harness, dict[str, cs.Grip | cs.FreeEnd | cs.Pose], cs.Scene | None]:
    """A tree of 2 to `most` segments, sometimes with loops, how its ends are held, and clips and masses.

    Stiffness from limp to stiff, junctions rigid and ball, some with masses. Grips stand where the harness would reach
    if it were straight but for turns at junctions and a slack of 5 to 40 %.
    """
    count = int(rng.integers(2, most + 1))
    slack = rng.uniform(0.6, 0.95)
    stiff = 10.0 ** rng.uniform(-3.0, -0.5)
    places, frames = [np.zeros(3)], [cs.Pose((0.0, 0.0, 0.0), random_quaternion(rng))]
    ends: list[list[tuple[str, cs.Pose]]] = [[]]  # of each node: ends that meet there, with their cable frames
    segments: dict[str, cs.Cable] = {}
    for i in range(count):
        close = loops and i > 1 and rng.uniform() < 0.08
        node = int(rng.integers(max(0, len(places) - 5), len(places)))
        name = f"s{i}"
        if close:
            far = int(rng.integers(len(places)))
            chord = float(np.linalg.norm(places[far] - places[node]))
            close = far != node and chord > 0.02
        length = float(rng.uniform(0.1, 0.6))
        if close:
            length = chord / slack * float(rng.uniform(1.05, 1.3))
            a, b = (_toward(rng, places[far] - places[node]) for _ in range(2))
            pair = (node, a), (far, b)
        else:
            way = cs.Pose((0, 0, 0), frames[node].quaternion) * cs.Pose((0, 0, 0), random_quaternion(rng, 1.8))
            out = way * cs.Pose((0.0, 0.0, slack * length))
            places.append(places[node] + out.position)
            frames.append(cs.Pose((0, 0, 0), way.quaternion))
            ends.append([])
            far = len(places) - 1
            pair = (node, way), (far, way * cs.Pose((0, 0, 0), random_quaternion(rng, 0.5)))
        if rng.uniform() < 0.3:  # told backwards
            turned = cs.Pose((0, 0, 0), (1.0, 0.0, 0.0, 0.0))
            pair = (pair[1][0], pair[1][1] * turned), (pair[0][0], pair[0][1] * turned)
        for (at, frame), side in zip(pair, ("start", "end"), strict=True):
            ends[at].append((f"{name}.{side}", frame))
        bend = stiff * 10.0 ** rng.uniform(-0.5, 0.5)
        weight = 10.0 ** rng.uniform(-1.5, -0.5)
        rest = rng.normal(size=3) if rng.uniform() < 0.2 else (0.0, 0.0, 0.0)
        stretch = 1e3 if rng.uniform() < 0.2 else None
        segments[name] = cs.Cable(length, weight, bend, 0.7 * bend, stretch, rest_curvature=rest)
    junctions, held = [], {}
    for node, meet in enumerate(ends):
        if len(meet) > 1:
            kind = "ball" if rng.uniform() < 0.15 else "rigid"
            own = frames[node].inverse()
            relative = {end: own * cs.Pose((0, 0, 0), frame.quaternion) for end, frame in meet}
            mass = 0.02 if rng.uniform() < 0.2 else 0.0
            names = [end for end, _ in meet]
            given = {} if kind == "ball" else {end: cs.Pose((0, 0, 0), p.quaternion) for end, p in relative.items()}
            junctions.append(cs.Junction(f"j{node}", names, kind, given, mass))
        elif meet:
            end, frame = meet[0]
            chance = rng.uniform()
            if chance < 0.5 or (node == len(ends) - 1 and not held):
                turn = frame * cs.Pose((0, 0, 0), random_quaternion(rng, 1.0))
                kind = str(rng.choice(("clamped", "clamped", "swivel", "pinned")))
                held[end] = cs.Grip(cs.Pose(places[node], turn.quaternion), kind)
            elif chance < 0.7:
                held[end] = cs.FreeEnd(mass=0.02)
    clips, masses = [], []
    for name, cable in segments.items():
        if rng.uniform() < 0.1:
            masses.append(cs.PointMass(0.4 * cable.length, 0.01, segment=name))
    if not any(isinstance(end, cs.Grip) for end in held.values()):
        name = "s0"
        clips.append(cs.Clip(0.5 * segments[name].length, cs.Pose((0.0, 0.0, 0.1)), "fixed", segment=name))
    scene = cs.Scene(clips=clips, masses=masses) if clips or masses else None
    return cs.Harness(segments, junctions), held, scene


def _toward(rng: np.random.Generator, way: np.ndarray) -> cs.Pose:
    """A frame whose d3 is about along `way`."""
    t = way / np.linalg.norm(way)
    x, y, z = t
    q = np.array((-y, x, 0.0, 1.0 + z)) if z > -0.999 else np.array((1.0, 0.0, 0.0, 0.0))
    return cs.Pose((0, 0, 0), q / np.linalg.norm(q)) * cs.Pose((0, 0, 0), random_quaternion(rng, 0.8))


def balance(shape: cs.HarnessShape, gravity: np.ndarray = GRAVITY) -> tuple[float, float, float]:
    """How far forces [N] and moments [N m] at junctions are from balance, and ends from where they meet [m]."""
    worst = [0.0, 0.0, 0.0]
    for junction in shape.harness.junctions:
        frame = shape.junctions[junction.name]
        force, moment = junction.mass * gravity, np.zeros(3)
        for end in junction.ends:
            name, side = split_end(end)
            one, i, sign = shape.segments[name], *((0, 1.0) if side == "start" else (-1, -1.0))
            arm = one.positions[i] - frame.position
            force = force + sign * one.force[i]
            own = sign * one.moment[i]
            moment = moment + own + np.cross(arm, sign * one.force[i])
            if junction.kind == "ball":
                worst[1] = max(worst[1], float(np.abs(own).max()))
                worst[2] = max(worst[2], float(np.linalg.norm(arm)))
            else:
                meets = frame * junction.frame(end)
                apart, turn = meets.distance(cs.Pose(one.positions[i], one.quaternions[i]))
                worst[2] = max(worst[2], apart, turn * one.length)
        worst[0] = max(worst[0], float(np.abs(force).max()))
        if junction.kind == "rigid":
            worst[1] = max(worst[1], float(np.abs(moment).max()))
    return worst[0], worst[1], worst[2]


def hung_tree(segments: int, seed: int = 3) -> tuple[cs.Harness, dict[str, cs.Pose], cs.Scene]:
    """A car's harness on a wall, drawn by a seed: a trunk held at its start and in a clip for every 11 segments.

    One segment in three goes on with the trunk, two leave it as branches and twigs that hang.
    """
    rng = np.random.default_rng(seed)
    down = np.array((1.0, 0.0, 0.0, 0.0))  # half a turn about x: d3 points down
    along = np.array((0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)))  # d3 along x
    cables: dict[str, cs.Cable] = {}
    meets: list[list[tuple[str, np.ndarray]]] = [[]]
    places, trunk, carries = [np.zeros(3)], [0], []
    for i in range(segments):
        name, length = f"s{i}", float(rng.uniform(0.1, 0.3))
        node, frame, step = trunk[-1], down, np.array((0.0, 0.0, -length))
        if i % 3 == 0:
            frame, step = along, np.array((0.97 * length, 0.0, 0.0))
        elif i % 3 == 2 and rng.uniform() < 0.5:
            node = len(places) - 1  # a twig
        cables[name] = cs.Cable(length, *((0.05, 0.002) if i % 3 else (0.15, 0.01)))
        meets[node].append((f"{name}.start", frame))
        meets.append([(f"{name}.end", frame)])
        places.append(places[node] + step)
        if i % 3 == 0:
            trunk.append(len(places) - 1)
            carries.append(name)
    clips = []
    for i in np.linspace(1, len(carries) - 1, round(17 * segments / 183), dtype=int):
        half = 0.5 * cables[carries[i]].length
        middle = places[trunk[i + 1]] - (0.97 * half, 0.0, 0.0)
        clips.append(cs.Clip(half, cs.Pose(middle, along), "fixed", segment=carries[i]))
    junctions = []
    for node, ends in enumerate(meets):
        if len(ends) > 1:
            own = cs.Pose(quaternion=ends[0][1]).inverse()
            frames = {end: own * cs.Pose(quaternion=frame) for end, frame in ends}
            junctions.append(cs.Junction(f"j{node}", [end for end, _ in ends], frames=frames))
    return cs.Harness(cables, junctions), {"s0.start": cs.Pose(places[0], along)}, cs.Scene(clips=clips)
