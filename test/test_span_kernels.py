"""Kernels of the rod in spans against dense linear algebra and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cable_shape.kernels.span_factor import FORCE, PLACE, SHIFTED, backward, factor, forward
from cable_shape.kernels.span_newton import balance, shaky
from cable_shape.kernels.span_system import assemble, gradient
from cable_shape.kernels.span_work import JOINT

FREE, ROLL, HELD = (1.0, 1.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)

#: elements of each span, rotations free at each support, free directions of its place, whether the last end is held
LAYOUTS = {
    "one span": ((6,), (HELD, ROLL), (0, 0), True),
    "ball clip": ((4, 5), (FREE, FREE, HELD), (0, 0, 0), True),
    "hinge and fixed clips": ((4, 5, 3), (FREE, ROLL, HELD, FREE), (0, 0, 0, 0), True),
    "a free place and one on a line": ((4, 5, 3), (HELD, FREE, FREE, HELD), (0, 3, 1, 0), True),
    "places in a plane and free, then a free end": (
        (4, 5, 3, 4),
        (HELD, ROLL, FREE, FREE, FREE),
        (0, 2, 3, 0, 0),
        False,
    ),
    "a free place before a free end": ((4, 5), (HELD, FREE, FREE), (0, 3, 0), False),
}


class System:
    """A random system in spans, and the same as one dense matrix in (rotations, forces, places)."""

    def __init__(self, layout: str, seed: int, definite: float) -> None:
        counts, masks, free, held = LAYOUTS[layout]
        rng = np.random.default_rng(seed)
        self.spans, self.elements = len(counts), sum(counts)
        self.where = np.concatenate(([0], np.cumsum(counts)))
        self.mask = np.array(masks)
        self.forces = self.spans if held else self.spans - 1
        symmetric = rng.normal(size=(self.elements + 1, 3, 3))
        self.D = symmetric + symmetric.transpose(0, 2, 1) + definite * np.eye(3)
        self.U = rng.normal(size=(self.elements, 9))
        self.parts = rng.normal(size=(self.elements, 36))
        self.sums = rng.normal(size=(self.spans, 12))
        for row in self.sums:
            A = rng.normal(size=(3, 3))
            row[3:] = -0.1 * (A @ A.T).ravel()
        self.place = np.zeros((self.spans + 1, PLACE))
        self.G = rng.normal(size=(self.elements + 1, 3))
        self.pull, self.given = rng.normal(size=(self.spans + 1, 3)), np.zeros((self.spans + 1, 3))
        for j in range(self.spans + 1):
            A, Z = rng.normal(size=(3, 3)), np.linalg.qr(rng.normal(size=(3, 3)))[0]
            self.place[j, 0], self.place[j, 1:10], self.place[j, 13:22] = free[j], (A + A.T).ravel(), Z.ravel()
            if free[j]:
                self.given[j] = Z[free[j] :].T @ rng.normal(size=3 - free[j])
            node = self.where[j]
            off = self.mask[j] == 0.0
            self.D[node][off] = 0.0
            self.D[node][:, off] = 0.0
            self.D[node][off, off] = 1.0
            self.G[node][off] = 0.0
        self.h, self.shift = np.full(self.elements, 0.1), 0.3

    def solved(self) -> tuple[int, np.ndarray]:
        """Negative eigenvalues counted by the factors, and the solution as one vector."""
        n = self.elements
        P, Y, W = np.zeros((n + 1, 9)), np.zeros((n, 9)), np.zeros((n + 1, 12))
        joints, d = np.zeros((self.spans, JOINT)), np.zeros((n + 1, 3))
        D = self.D.reshape(-1, 9)
        negative = factor(
            D, self.U, self.parts, self.sums, self.where, self.mask, self.place, self.forces, self.shift, self.h, P, Y,
            W, joints,
        )  # fmt: skip
        forward(self.G, self.sums, self.pull, self.given, self.where, self.place, self.forces, P, Y, W, joints)
        backward(self.where, self.place, self.forces, P, Y, W, joints, d)
        places = [joints[j - 1, SHIFTED:] for j in range(1, self.spans) if self.place[j, 0]]
        return negative, np.concatenate((d.ravel(), joints[: self.forces, FORCE:SHIFTED].ravel(), *places))

    def dense(self) -> tuple[int, np.ndarray]:
        """The same by numpy."""
        n = 3 * (self.elements + 1)
        mask = np.ones(n)
        for j, node in enumerate(self.where):
            mask[3 * node : 3 * node + 3] = self.mask[j]
        moving = [j for j in range(1, self.spans) if self.place[j, 0]]
        size = n + 3 * self.forces
        K, r = np.zeros((size + 3 * len(moving),) * 2), np.zeros(size + 3 * len(moving))
        span_of = np.searchsorted(self.where, np.arange(self.elements), side="right") - 1
        for k in range(self.elements + 1):
            at = slice(3 * k, 3 * k + 3)
            around = 0.5 * ((self.h[k - 1] if k else 0.0) + (self.h[k] if k < self.elements else 0.0))
            K[at, at] = self.D[k] + self.shift * around * np.diag(mask[at])
            r[at] = self.G[k]
        for e, j in enumerate(span_of):
            a, b, force = slice(3 * e, 3 * e + 3), slice(3 * e + 3, 3 * e + 6), slice(n + 3 * j, n + 3 * j + 3)
            K[a, b] = self.U[e].reshape(3, 3) * mask[a, None] * mask[None, b]
            K[b, a] = K[a, b].T
            if j < self.forces:
                K[a, force] += self.parts[e, 9:18].reshape(3, 3) * mask[a, None]
                K[b, force] += self.parts[e, 18:27].reshape(3, 3) * mask[b, None]
        K[n:size, :n] = K[:n, n:size].T
        for j in range(self.forces):
            force = slice(n + 3 * j, n + 3 * j + 3)
            K[force, force], r[force] = self.sums[j, 3:].reshape(3, 3), self.sums[j, :3]
        keep, basis, part = list(range(size)), np.eye(len(r)), np.zeros(len(r))
        for i, j in enumerate(moving):
            y = slice(size + 3 * i, size + 3 * i + 3)
            K[y, y] = self.place[j, 1:10].reshape(3, 3) + self.shift / self.h.sum() * np.eye(3)
            r[y], part[y] = self.pull[j], self.given[j]
            for span, sign in ((j - 1, 1.0), (j, -1.0)):
                if span < self.forces:
                    force = slice(n + 3 * span, n + 3 * span + 3)
                    K[y, force] = K[force, y] = sign * np.eye(3)
            basis[y, y] = self.place[j, 13:22].reshape(3, 3).T
            keep += list(range(y.start, y.start + int(self.place[j, 0])))
        T = basis[:, keep]
        reduced = T.T @ K @ T
        x = part - T @ np.linalg.solve(reduced, T.T @ (r + K @ part))
        return int((np.linalg.eigvalsh(reduced) < 0.0).sum()), x


@pytest.mark.parametrize("definite", [6.0, 0.0])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("layout", LAYOUTS)
def test_factors_solve_the_system_in_spans_and_count_its_negative_eigenvalues(layout, seed, definite):
    system = System(layout, seed, definite)
    negative, x = system.solved()
    expected_negative, expected = system.dense()
    assert negative == expected_negative
    assert x == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


def test_a_pivot_next_to_singular_is_told_and_a_strip_is_not():
    """Elimination without pivoting loses the square of a pivot's condition; that of the stiffness itself is none."""
    rng = np.random.default_rng(8)
    stiff = np.array((1.0, 1e4, 30.0, 0.0, 0.0, 0.0))
    root = np.diag(np.sqrt(stiff[:3]))
    turns = Rotation.random(6, random_state=rng).as_matrix()
    for least, expected in ((0.1, False), (1e-3, False), (-1e-3, False), (1e-7, True), (-1e-7, True), (0.0, True)):
        pivots = [root @ R @ np.diag((1.0, -2.0, 0.7)) @ R.T @ root for R in turns]
        R = turns[3]
        pivots[3] = root @ R @ np.diag((1.0, least if least else 1e-300, 3.0)) @ R.T @ root
        P = np.array([np.linalg.inv(pivot).ravel() for pivot in pivots])
        assert shaky(P, stiff) is expected, least


class Chain:
    """A small rod in two spans whose middle support may move against a spring, as a function of all its unknowns."""

    def __init__(self) -> None:
        rng = np.random.default_rng(5)
        n = self.elements = 5
        self.where = np.array((0, 2, n))
        self.h = rng.uniform(0.2, 0.3, size=n)
        steps = Rotation.from_rotvec(0.3 * rng.normal(size=(n + 1, 3)))
        turned = steps[0]
        frames = [turned]
        for step in steps[1:]:
            turned = turned * step
            frames.append(turned)
        self.frames = frames
        self.load = rng.normal(size=(n, 9))
        self.rest = rng.normal(size=(n, 6))
        self.stiff = np.array((1.3, 0.7, 0.9, 0.02, 0.02, 0.01))
        self.force = rng.normal(size=(2, 3))
        self.corners = rng.normal(size=(3, 7))
        self.mask = np.ones((3, 3))
        A = rng.normal(size=(3, 3))
        self.place = np.zeros((3, PLACE))
        self.place[1, 0], self.place[1, 1:10], self.place[1, 10:13] = 3, (A + A.T).ravel(), rng.normal(size=3)
        self.place[1, 13:22] = np.eye(3).ravel()
        self.size = 3 * (n + 1) + 6 + 3

    def at(self, x) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """q, full, forces, corners after a step x."""
        n = 3 * (self.elements + 1)
        turns = Rotation.from_rotvec(np.reshape(x[:n], (-1, 3)))
        q = np.array([(f * t).as_quat() for f, t in zip(self.frames, turns, strict=True)])
        force = self.force + np.reshape(x[n : n + 6], (2, 3))
        corners = self.corners.copy()
        corners[1, :3] += x[n + 6 :]
        full = self.load + np.tile(np.repeat(force, np.diff(self.where), axis=0), 3)
        return q, full, force, corners

    def value(self, x) -> float:
        """The functional whose stationary point is sought."""
        q, full, force, corners = self.at(x)
        G, first, sums = np.empty((self.elements + 1, 3)), np.empty((self.elements, 9)), np.empty((2, 12))
        v = gradient(q, full, self.h, self.rest, self.stiff, np.zeros(3), self.where, self.mask, G, first, sums)
        y = corners[1, :3]
        spring = 0.5 * y @ self.place[1, 1:10].reshape(3, 3) @ y + self.place[1, 10:13] @ y
        return v + (force * np.diff(corners[:, :3], axis=0)).sum() + spring

    def system(self) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and dense Hessian from the kernels."""
        q, full, force, corners = self.at(np.zeros(self.size))
        n, m = self.elements, 3 * (self.elements + 1)
        D, U, G = np.empty((n + 1, 9)), np.empty((n, 9)), np.empty((n + 1, 3))
        parts, first, sums = np.empty((n, 36)), np.empty((n, 9)), np.empty((2, 21))
        assemble(
            q, full, self.h, self.rest, self.stiff, np.zeros(3), self.where, self.mask, D, U, G, parts, first, sums
        )  # fmt: skip
        pull, given = np.zeros((3, 3)), np.zeros((3, 3))
        balance(force, corners, self.place, sums, pull, given)
        H = np.zeros((self.size, self.size))
        for k in range(n + 1):
            H[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = D[k].reshape(3, 3)
        for e in range(n):
            a, b = slice(3 * e, 3 * e + 3), slice(3 * e + 3, 3 * e + 6)
            j = 0 if e < self.where[1] else 1
            c = slice(m + 3 * j, m + 3 * j + 3)
            H[a, b] = U[e].reshape(3, 3)
            H[a, c] += parts[e, 9:18].reshape(3, 3)
            H[b, c] += parts[e, 18:27].reshape(3, 3)
        y = slice(m + 6, m + 9)
        H[y, m : m + 3], H[y, m + 3 : m + 6] = np.eye(3), -np.eye(3)
        H = H + H.T
        for k in range(n + 1):
            H[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = D[k].reshape(3, 3)
        for j in range(2):
            H[m + 3 * j : m + 3 * j + 3, m + 3 * j : m + 3 * j + 3] = sums[j, 3:12].reshape(3, 3)
        H[y, y] = self.place[1, 1:10].reshape(3, 3)
        return np.concatenate((G.ravel(), sums[:, :3].ravel(), pull[1])), H


def test_gradient_and_matrix_of_two_spans_against_finite_differences():
    chain = Chain()
    slope, H = chain.system()
    unit = np.eye(chain.size)
    step = 1e-5
    differences = [(chain.value(step * e) - chain.value(-step * e)) / (2 * step) for e in unit]
    assert slope == pytest.approx(np.array(differences), abs=2e-8)
    step = 2e-4
    for i in range(chain.size):
        for j in range(i + 1):
            a, b = step * (unit[i] + unit[j]), step * (unit[i] - unit[j])
            difference = chain.value(a) - chain.value(b) - chain.value(-b) + chain.value(-a)
            assert H[i, j] == pytest.approx(difference / (4 * step**2), abs=1e-5), (i, j)
