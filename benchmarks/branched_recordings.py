"""Whole recordings of real branched cables: their calm frames, as frames that were not chosen for their variety."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from branched_data import Branched, holding, observed, read
from scipy.signal import savgol_filter

from cable_shape.replay.observations import tracked

TOPICS = "/left_gripper/pose", "/right_gripper/pose", "/cable/markers"
#: Smoothed over so many frames of 0.01 s; calm: no vertex is faster [m/s], nor accelerates more [m/s^2].
WINDOW, PERIOD = 15, 0.01
FASTEST, MOST = 0.15, 0.5
#: Frames of one recording that are judged, at most.
FRAMES = 100
_GRIPPED = 0.03  # m, between the two vertices of a grip; only their direction counts


def recorded(name: str, folder: Path) -> tuple[Branched, np.ndarray] | None:
    """The calm frames of an object's recordings, and the trajectories of its other frames that are in them."""
    paths = sorted(folder.glob(f"{name}_recording*"))
    if not paths:
        return None
    d = read(name, folder)
    places, loads, takes, numbers, known = [], [], [], [], [np.empty(0, dtype=np.int64)]
    for number, path in enumerate(paths):
        x = vertices(path, d)
        speed, acceleration = (savgol_filter(x, WINDOW, 3, deriv=k, delta=PERIOD, axis=0) for k in (1, 2))
        fastest, most = (np.linalg.norm(v, axis=2).max(axis=1) for v in (speed, acceleration))
        calm = np.flatnonzero((fastest < FASTEST) & (most < MOST))
        calm = calm[np.unique(np.linspace(0, len(calm) - 1, FRAMES).astype(int))] if len(calm) else calm
        places.append(x[calm])
        loads.append(acceleration[calm])
        takes.append(np.full(len(calm), marked_like(x, d)))
        numbers.append(np.full(len(calm), number))
        known.append(d["traj"][(np.abs(d["frames"][:, None, 1] - x[None, :, 1]).max(axis=2) < 1e-5).any(axis=1)])
    count = sum(len(x) for x in places)
    if not count:
        return None
    those = {
        "frames": np.concatenate(places), "acc": np.concatenate(loads), "take": np.concatenate(takes),
        "traj": np.concatenate(numbers), "kind": np.full(count, "calm"), "split": np.full(count, ""),
    }  # fmt: skip
    return observed(name, d | those, 1), np.unique(np.concatenate(known))


def vertices(path: Path, d: dict[str, np.ndarray]) -> np.ndarray:
    """(n, m, 3) [m], all vertices in every frame of a recording; those outside of the grips as the grippers point."""
    left, right, markers = tracked(path, *TOPICS)
    whole = [i for i in range(len(markers)) if left[i] is not None and right[i] is not None]
    parent = np.flatnonzero(d["arm"] == 0)
    how = holding(d, parent)
    inner = [i for i in range(len(d["arm"])) if i not in (parent[0], parent[-1])]
    out = np.empty((len(whole), len(d["arm"]), 3))
    out[:, inner] = [markers[i][1] for i in whole]
    for poses, inside, outside, sign in ((left, how.begin, parent[0], -1.0), (right, how.end, parent[-1], 1.0)):
        x, y, z, w = np.array([poses[i] for i in whole])[:, 3:].T
        along = np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
        out[:, outside] = out[:, inside] + sign * _GRIPPED * along
    return out


def marked_like(x: np.ndarray, d: dict[str, np.ndarray]) -> int:
    """The take in which the vertices were as far apart along the arms as they are here."""
    parent = np.flatnonzero(d["arm"] == 0)
    own = [v for v in range(x.shape[1]) if v not in (*parent[:2], parent[-1])]
    before = d["prev"][own]
    seen = np.median(np.linalg.norm(x[:, own] - x[:, before], axis=2), axis=0)
    arc = np.where(d["arm"][own] == d["arm"][before], d["arc"][:, before], 0.0)
    return int(np.abs(d["arc"][:, own] - arc - seen).sum(axis=1).argmin())
