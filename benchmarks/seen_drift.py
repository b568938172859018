"""Coherent point drift on a chain of nodes, as a peer, with terms of TrackDLO that its public text gives, and no more.

Nonrigid drift of Myronenko and Song (2010) from look to look, written out here: pycpd has neither of what makes it one
of cables. Motion is coherent along the chain (a kernel of the distance along it), and memberships are weighted by how
near a node is to what is seen, exp(-K_VIS d), d in mm. Numbers are those of launch/trackdlo.launch in
github.com/RMDLO/trackdlo; the kernel is Gaussian, whatever its is. Its guess of the tips from the image is left out:
the chain is held at both grips, which are told, and it begins at the tracker's first shape.
"""

from __future__ import annotations

import numpy as np

import cable_shape as cs

NODES = 40
BETA, LAMBDA, MU, K_VIS = 0.5, 5e4, 0.05, 0.2
ITERATIONS, TOLERANCE = 50, 1e-5


class Drift:
    """The chain from look to look."""

    def __init__(self) -> None:
        self._chain = np.empty((0, 3))

    def update(
        self, points: np.ndarray, begin: np.ndarray | None, start: cs.Pose | cs.Grip, end: cs.Pose | cs.Grip
    ) -> np.ndarray:
        """(NODES, 3) [m]; begin (n, 3): the chain at first."""
        if begin is not None:
            at = np.linspace(0.0, 1.0, NODES)
            self._chain = np.stack([np.interp(at, np.linspace(0.0, 1.0, len(begin)), x) for x in begin.T], axis=1)
        ends = [(end.cable_frame if isinstance(end, cs.Grip) else end).position for end in (start, end)]
        cloud = np.concatenate((points, np.repeat(ends, 3, axis=0)))
        first = self._chain
        steps = np.linalg.norm(np.diff(first, axis=0), axis=1)
        s = np.concatenate(([0.0], np.cumsum(steps)))
        kernel = np.exp(-0.5 * ((s[:, None] - s) / BETA) ** 2)
        apart = np.linalg.norm(first[:, None] - cloud, axis=2)
        seen = np.exp(-1e3 * K_VIS * apart.min(axis=1))
        seen /= max(float(seen.sum()), 1e-300)
        chain, variance = first, float((apart**2).min(axis=0).mean()) + 1e-6
        for _ in range(ITERATIONS):
            squares = ((chain[:, None] - cloud) ** 2).sum(axis=2)
            near = seen[:, None] * np.exp(-0.5 * squares / variance)
            noise = (2.0 * np.pi * variance) ** 1.5 * MU / (1.0 - MU)
            member = near / (near.sum(axis=0) + noise + 1e-300)
            weight = member.sum(axis=1)
            left = weight[:, None] * kernel + LAMBDA * variance * np.eye(NODES)
            moved = kernel @ np.linalg.solve(left, member @ cloud - weight[:, None] * first)
            before, chain = chain, first + moved
            squares = ((chain[:, None] - cloud) ** 2).sum(axis=2)
            variance = max(float((member * squares).sum()) / (3.0 * max(float(member.sum()), 1e-9)), 1e-7)
            if np.abs(chain - before).max() < TOLERANCE:
                break
        self._chain = chain
        return chain
