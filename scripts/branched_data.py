"""Real branched cables between two grips, by motion capture: frames as observations of a harness, in parts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from truth_data import BEGIN, DATA, DENSITY, carried, shares

import cable_shape as cs

BRANCHED = DATA / "branched"
#: Rows of the tables of accelerations, of each segment.
ROWS = 3
#: Arms by number: the parent, then its children.
LETTERS = "pabcdefgh"


@dataclass(frozen=True)
class Branched:
    """Frames of one object, as observations `static` and `moving` (with inertial load), and what is known of each.

    straight (n,): mean distances [m] of parent's and children's vertices to straight lines, (n, 2); counts: of these
    vertices; runs: keys of the observations' points, the parent's first; branches: ends with which children begin;
    angles (n, children) [rad]: between a child and the arm it hangs on, below 0 on the other side than the first.
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
    take: np.ndarray
    other_day: np.ndarray
    part: np.ndarray

    def where(self, kinds: tuple[str, ...], part: int, inside: bool) -> np.ndarray:
        """Indices of frames of these kinds, inside or outside of one part of the trajectories, all of the main days."""
        return np.flatnonzero(np.isin(self.kind, kinds) & ((self.part == part) == inside) & ~self.other_day)


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
    with np.load(folder / f"{name}_frames.npz", allow_pickle=False) as file:
        d = {key: file[key] for key in file.files}
    x, a = (d[key].astype(np.float64) for key in ("frames", "acc"))
    arc, take = d["arc"].astype(np.float64), d["take"]
    arms = [np.flatnonzero(d["arm"] == k) for k in range(int(d["arm"].max()) + 1)]
    held = {int(v) for v in d["grips"]}
    first, last = int(arms[0][0]), int(arms[0][-1])
    near, far = {first, first + 1} <= held, {last, last - 1} <= held
    begin, end = first + near, last - far
    clips = sorted(held - {first, first + 1, last, last - 1} | (held & {first + 1} if not near else set()))
    pieces = pieces_of(arms, [int(v) for v in d["arm_start"]], begin, end)
    trunk = [piece for piece in pieces if piece.arm == 0]
    harness = joined(pieces, np.median(arc, axis=0))
    tangents = carried(x[:, first + 1] - x[:, first]), carried(x[:, last] - x[:, last - 1])
    runs = tuple("+".join(piece.name for piece in pieces if piece.arm == k) for k in range(len(arms)))
    free = [[v for v in arm if v not in held] for arm in arms]
    static, moving = [], []
    for i in range(len(x)):
        own = arc[take[i]]
        ends, where = {}, {piece.name: along(piece, own) for piece in pieces}
        if near:
            ends[f"{trunk[0].name}.start"] = cs.Grip(cs.Pose(x[i, begin], tangents[0][i]), "swivel")
        if far:
            ends[f"{[p for p in pieces if p.arm == 0][-1].name}.end"] = cs.Grip(
                cs.Pose(x[i, end], tangents[1][i]), "swivel"
            )
        scene = cs.Scene(clips=[clip(v, pieces, own, x[i]) for v in clips]) if clips else None
        points = {run: x[i, vertices] for run, vertices in zip(runs, free, strict=True)}
        lengths = {name: float(s[-1] - s[0]) for name, s in where.items()}
        loads = {}
        for arm, vertices in enumerate(arms):
            begins = int(d["arm_start"][arm])
            at = vertices if begins < 0 else np.concatenate(([begins], vertices))
            spline = CubicSpline(np.where(at == begins, 0.0, own[at]), a[i, at])
            for piece in (p for p in pieces if p.arm == arm):
                loads[piece.name] = spline(np.linspace(where[piece.name][0], where[piece.name][-1], ROWS))
        told = {"lengths": lengths, "scene": scene, "group": int(d["traj"][i])}
        static.append(cs.HarnessObservation(ends, points, **told))
        moving.append(cs.HarnessObservation(ends, points, acceleration=loads, **told))
    other = d["split"] == "test"
    start = clips[0] if clips and not near else begin
    return Branched(
        name, harness, static, moving, straight_lines(x, arc[take], d, free, start, end), runs,
        sides(d, arms) * directions(x, d, arms),
        tuple(f"{run.partition('+')[0]}.start" for run in runs[1:]), float(d["parent_length"]), d["kind"], d["traj"],
        take, other, shares(d["traj"], parts),
    )  # fmt: skip


def pieces_of(arms: list[np.ndarray], starts: list[int], begin: int, end: int) -> list[Piece]:
    """Segments of every arm, cut where another one hangs on it; those of the parent from vertex `begin` to `end`."""
    out = []
    for k, arm in enumerate(arms):
        vertices = [v for v in arm.tolist() if begin <= v <= end] if k == 0 else [starts[k], *arm.tolist()]
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
