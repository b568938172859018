"""Real branched cables between two grips, by motion capture: frames as observations of a harness, in parts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from truth_data import BEGIN, DATA, DENSITY, carried, shares

import cable_shape as cs

BRANCHED = DATA / "branched"
#: Rows of the tables of accelerations, of each segment.
ROWS = 2
#: Arms by number: the parent, then its children.
LETTERS = "pabcdefgh"


@dataclass(frozen=True)
class Branched:
    """Frames of one object, as observations `static` and `moving` (with inertial load), and what is known of each.

    straight (n, 2): mean distances [m] of parent's and children's vertices to straight lines; runs: keys of the
    observations' points, the parent's first; branches: ends with which children begin; angles (n, children) [rad]:
    between a child and the arm it hangs on, below 0 on the other side than the first; other_day (n,): whether it is a
    frame of other days than most.
    """

    name: str
    harness: cs.Harness
    static: list[cs.HarnessObservation]
    moving: list[cs.HarnessObservation]
    straight: np.ndarray
    runs: tuple[str, ...]
    angles: np.ndarray
    branches: tuple[str, ...]
    length: float
    kind: np.ndarray
    traj: np.ndarray
    other_day: np.ndarray
    part: np.ndarray

    def where(self, kinds: tuple[str, ...], part: int, inside: bool) -> np.ndarray:
        """Indices of frames of these kinds, inside or outside of one part of the trajectories, without other days."""
        return np.flatnonzero(np.isin(self.kind, kinds) & ((self.part == part) == inside) & ~self.other_day)

    def elsewhere(self, kinds: tuple[str, ...]) -> np.ndarray:
        """Indices of frames of these kinds of other days."""
        return np.flatnonzero(np.isin(self.kind, kinds) & self.other_day)

    @property
    def trunk(self) -> str:
        """The parent's segments."""
        return self.runs[0]

    def measured(self, learn: np.ndarray) -> cs.Harness:
        """The harness whose children leave their junctions as these frames show, all in one plane about the arms."""
        turns = {
            end: cs.Pose(quaternion=(np.sin(0.5 * a), 0.0, 0.0, np.cos(0.5 * a)))
            for end, a in zip(self.branches, self.angles[learn].mean(axis=0), strict=True)
        }
        junctions = [
            cs.Junction(one.name, one.ends, frames={end: turns[end] for end in one.ends if end in turns})
            for one in self.harness.junctions
        ]
        return self.harness.replace(junctions=junctions)


@dataclass(frozen=True)
class Piece:
    """A segment: of which arm, and the vertices at its ends; the first may be another arm's."""

    name: str
    arm: int
    vertices: tuple[int, ...]


def objects(folder: Path) -> list[str]:
    """Names of the objects in a folder of this layout."""
    return sorted(path.name.removesuffix("_frames.npz") for path in folder.glob("*_frames.npz"))


def load(name: str, parts: int, folder: Path = BRANCHED) -> Branched:
    """Frames of one object; whole trajectories go into one of so many parts of about the same number of frames."""
    return observed(name, read(name, folder), parts)


def read(name: str, folder: Path = BRANCHED) -> dict[str, np.ndarray]:
    """What is in the file of one object."""
    with np.load(folder / f"{name}_frames.npz", allow_pickle=False) as file:
        return {key: file[key] for key in file.files}


def observed(name: str, d: dict[str, np.ndarray], parts: int) -> Branched:
    """The frames of such a file."""
    x, arc = d["frames"].astype(np.float64), d["arc"].astype(np.float64)[d["take"]]
    arms = [np.flatnonzero(d["arm"] == k) for k in range(int(d["arm"].max()) + 1)]
    how = holding(d, arms[0])
    pieces = pieces_of(arms, [int(v) for v in d["arm_start"]], how)
    free = [[v for v in arm.tolist() if v not in d["grips"]] for arm in arms]
    runs = tuple("+".join(piece.name for piece in pieces if piece.arm == k) for k in range(len(arms)))
    ends = held(x, arms[0], how, [piece.name for piece in pieces if piece.arm == 0])
    static, moving = [], []
    for i, own in enumerate(arc):
        points = {run: x[i, vertices] for run, vertices in zip(runs, free, strict=True)}
        told = {
            "lengths": {piece.name: float(np.ptp(along(piece, own))) for piece in pieces},
            "scene": cs.Scene(clips=[clip(v, pieces, own, x[i]) for v in how.clips]) if how.clips else None,
            "group": int(d["traj"][i]),
        }
        static.append(cs.HarnessObservation(ends[i], points, **told))
        loads = accelerations(d["acc"][i].astype(np.float64), d, arms, pieces, own)
        moving.append(cs.HarnessObservation(ends[i], points, acceleration=loads, **told))
    start = how.clips[0] if how.clips and not how.near else how.begin
    return Branched(
        name, joined(pieces, np.median(arc, axis=0)), static, moving,
        straight_lines(x, arc, d, free, start, how.end), runs, sides(d, arms) * directions(x, d, arms),
        tuple(f"{run.partition('+')[0]}.start" for run in runs[1:]), float(d["parent_length"]), d["kind"], d["traj"],
        d["split"] == "test", shares(d["traj"], parts),
    )  # fmt: skip


class Holding(NamedTuple):
    """How the parent is held: its first and last vertex that count, whether a grip with a known tangent is there, and
    the vertices held as points."""

    begin: int
    end: int
    near: bool
    far: bool
    clips: list[int]


def holding(d: dict[str, np.ndarray], parent: np.ndarray) -> Holding:
    """Two held vertices at an end are a grip at the second of them; the others are held as points."""
    given = {int(v) for v in d["grips"]}
    first, last = int(parent[0]), int(parent[-1])
    near, far = {first, first + 1} <= given, {last, last - 1} <= given
    gripped = ({first, first + 1} if near else set()) | ({last, last - 1} if far else set())
    return Holding(first + near, last - far, near, far, sorted(given - gripped))


def held(x: np.ndarray, parent: np.ndarray, how: Holding, trunk: list[str]) -> list[dict[str, cs.Grip]]:
    """The grips of each frame: their roll was not measured."""
    first, last = int(parent[0]), int(parent[-1])
    near, far = carried(x[:, first + 1] - x[:, first]), carried(x[:, last] - x[:, last - 1])
    out: list[dict[str, cs.Grip]] = []
    for places, q, p in zip(x, near, far, strict=True):
        ends = {}
        if how.near:
            ends[f"{trunk[0]}.start"] = cs.Grip(cs.Pose(places[how.begin], q), "swivel")
        if how.far:
            ends[f"{trunk[-1]}.end"] = cs.Grip(cs.Pose(places[how.end], p), "swivel")
        out.append(ends)
    return out


def accelerations(
    acc: np.ndarray, d: dict[str, np.ndarray], arms: list[np.ndarray], pieces: list[Piece], arc: np.ndarray
) -> dict[str, np.ndarray]:
    """Of each segment (ROWS, 3) [m/s^2], by splines along the arms through those of the vertices (m, 3)."""
    out = {}
    for k, arm in enumerate(arms):
        at, s = arm, arc[arm]
        if k:
            at, s = np.concatenate(([int(d["arm_start"][k])], arm)), np.concatenate(([0.0], s))
        spline = CubicSpline(s, acc[at])
        for piece in (piece for piece in pieces if piece.arm == k):
            own = along(piece, arc)
            out[piece.name] = spline(np.linspace(own[0], own[-1], ROWS))
    return out


def pieces_of(arms: list[np.ndarray], starts: list[int], how: Holding) -> list[Piece]:
    """Segments of every arm, cut where another one hangs on it; those of the parent where it is held."""
    out = []
    for k, arm in enumerate(arms):
        vertices = [v for v in arm.tolist() if how.begin <= v <= how.end] if k == 0 else [starts[k], *arm.tolist()]
        cuts = [0, *(i for i, v in enumerate(vertices) if i and v in starts[1:]), len(vertices) - 1]
        for number, (low, high) in enumerate(pairwise(cuts)):
            out.append(Piece(f"{LETTERS[k]}{number}", k, tuple(vertices[low : high + 1])))
    return out


def joined(pieces: list[Piece], arc: np.ndarray) -> cs.Harness:
    """The harness of these segments, straight, all of one stiffness; children go straight on."""
    segments = {}
    for piece in pieces:
        s = along(piece, arc)
        segments[piece.name] = cs.Cable(
            length=s[-1] - s[0], linear_density=DENSITY, bending_stiffness=BEGIN * DENSITY * 9.81
        )
    junctions = []
    for piece in pieces:
        after = [p for p in pieces if p.vertices[0] == piece.vertices[-1]]
        if after:
            after.sort(key=lambda p: p.arm != piece.arm)
            ends = (f"{piece.name}.end", *(f"{p.name}.start" for p in after))
            junctions.append(cs.Junction(f"at_{piece.name}", ends))
    return cs.Harness(segments, junctions)


def along(piece: Piece, arc: np.ndarray) -> np.ndarray:
    """Arc lengths [m] of a segment's vertices along its arm; where it hangs on another, 0."""
    s = arc[list(piece.vertices)]
    if piece.arm and piece.name.endswith("0"):
        s = np.concatenate(([0.0], s[1:]))
    return s


def clip(vertex: int, pieces: list[Piece], arc: np.ndarray, x: np.ndarray) -> cs.Clip:
    """What holds a vertex of the parent, as a point."""
    piece = next(p for p in pieces if p.arm == 0 and vertex in p.vertices[1:])
    return cs.Clip(float(arc[vertex] - along(piece, arc)[0]), cs.Pose(x[vertex]), "ball", segment=piece.name)


def hosts(d: dict[str, np.ndarray], arms: list[np.ndarray]) -> list[tuple[int, int, int]]:
    """Of each child the vertices of its junction, and before and after that on the arm it hangs on."""
    out = []
    for k in range(1, len(arms)):
        v = int(d["arm_start"][k])
        own = arms[int(d["arm"][v])].tolist()
        out.append((v, int(d["prev"][v]), own[own.index(v) + 1]))
    return out


def directions(x: np.ndarray, d: dict[str, np.ndarray], arms: list[np.ndarray]) -> np.ndarray:
    """(n, children) [rad]: angle of each child's first edge to the tangent of the arm it hangs on."""
    angles = np.empty((len(x), len(arms) - 1))
    for k, (v, before, after) in enumerate(hosts(d, arms)):
        t = _unit(_unit(x[:, v] - x[:, before]) + _unit(x[:, after] - x[:, v]))
        angles[:, k] = np.arccos((t * _unit(x[:, arms[k + 1][0]] - x[:, v])).sum(axis=1))
    return angles


def sides(d: dict[str, np.ndarray], arms: list[np.ndarray]) -> np.ndarray:
    """(children,) on which side of its arm each leaves, as the object lies on a table: 1 that of the first, or -1."""
    x = d["rest_markers"][:, :2].astype(np.float64)
    turns = [
        _turn(x[[after]] - x[[before]], x[[arms[k + 1][0]]] - x[[v]])
        for k, (v, before, after) in enumerate(hosts(d, arms))
    ]
    out = np.sign(np.concatenate(turns))
    return np.asarray(out[0] * out)


def _turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n,) [rad], from vectors (n, 2) to others, about the vertical."""
    return np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1))


def straight_lines(
    x: np.ndarray, arc: np.ndarray, d: dict[str, np.ndarray], free: list[list[int]], start: int, end: int
) -> np.ndarray:
    """(n, 2) [m]: mean distance of parent's and children's vertices if the parent is its chord, arms hang down."""
    chord = x[:, end] - x[:, start]
    place = {}
    sums = np.zeros((len(x), 2))
    for arm, vertices in enumerate(free):
        for v in np.flatnonzero(d["arm"] == arm):
            if arm == 0:
                share = np.clip((arc[:, v] - arc[:, start]) / (arc[:, end] - arc[:, start]), 0.0, 1.0)
                place[v] = x[:, start] + share[:, None] * chord
                place[v] -= np.outer(np.maximum(arc[:, start] - arc[:, v], 0.0), (0.0, 0.0, 1.0))
            else:
                place[v] = place[int(d["arm_start"][arm])] - np.outer(arc[:, v], (0.0, 0.0, 1.0))
        for v in vertices:
            if arm == 0 and v >= start:
                a, way = x[:, start], chord
            elif arm == 0:
                a, way = x[:, start], place[0] - x[:, start]
            else:
                a = place[int(d["arm_start"][arm])]
                way = np.outer(arc[:, np.flatnonzero(d["arm"] == arm)[-1]], (0.0, 0.0, -1.0))
            t = np.clip(((x[:, v] - a) * way).sum(axis=1) / (way * way).sum(axis=1), 0.0, 1.0)
            sums[:, int(arm > 0)] += np.linalg.norm(x[:, v] - a - t[:, None] * way, axis=1)
    return sums / (len(free[0]), sum(len(one) for one in free[1:]))


def _unit(v: np.ndarray) -> np.ndarray:
    return np.asarray(v / np.linalg.norm(v, axis=1)[:, None])
