"""Random problems for the Cosserat predictor: success from nothing, honesty of the error estimate, a sweep."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

import numpy as np
from cosserat_cases import ALONG_X
from figures import Figures, heading
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from cable_shape.cable.cable import Cable
from cable_shape.pose import Pose
from cable_shape.shape import CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

LENGTH = 1.2


def random_quaternion(rng: np.random.Generator) -> np.ndarray:
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def random_grasp(rng: np.random.Generator) -> tuple[Cable, Pose, Pose]:
    """Chord 0.02 to 0.9999 L, any rotations, (EI/w)^(1/3) from 0.01 to 3 L."""
    bend = 0.981 * (LENGTH * math.exp(rng.uniform(math.log(0.01), math.log(3.0)))) ** 3
    cable = Cable(
        length=LENGTH, linear_density=0.1, bending_stiffness=bend, twisting_stiffness=bend * rng.uniform(0.5, 1.0)
    )
    direction = rng.normal(size=3)
    chord = rng.uniform(0.02, 0.9999) * LENGTH * direction / np.linalg.norm(direction)
    return cable, Pose((0, 0, 0), random_quaternion(rng)), Pose(chord, random_quaternion(rng))


def taut_grasp(rng: np.random.Generator) -> tuple[Cable, Pose, Pose]:
    """Chord 0.97 to 0.9999 L, log-uniform in the slack, any rotations, (EI/w)^(1/3) from 0.005 to 0.3 L."""
    bend = 0.981 * (LENGTH * math.exp(rng.uniform(math.log(0.005), math.log(0.3)))) ** 3
    cable = Cable(
        length=LENGTH, linear_density=0.1, bending_stiffness=bend, twisting_stiffness=bend * rng.uniform(0.5, 1.0)
    )
    direction = rng.normal(size=3)
    slack = math.exp(rng.uniform(math.log(1e-4), math.log(0.03)))
    chord = (1.0 - slack) * LENGTH * direction / np.linalg.norm(direction)
    return cable, Pose((0, 0, 0), random_quaternion(rng)), Pose(chord, random_quaternion(rng))


def off_the_equations(cable: Cable, shape: CableShape) -> float:
    """How far a shape is from its equations, integrated from each point to the next (RK4); above 1 is bad.

    The largest of the distance / 1e-5 of the length, the turn / 1e-3 rad and the moment / 1e-2 of the largest. Points
    must be nearer to each other than the boundary layer, over which an integration forward multiplies errors.
    """
    h = cable.length / (shape.points - 1)
    q, n = shape.quaternions[:-1], shape.force[:-1]
    M = Rotation.from_quat(q).inv().apply(shape.moment[:-1])
    flex = 1.0 / np.array((*cable.bending_stiffness, cable.twisting_stiffness))
    load = np.array((0.0, 0.0, -9.81 * cable.linear_density))

    def slopes(q: np.ndarray, M: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        R = Rotation.from_quat(q)
        u, N = M * flex, R.inv().apply(n)
        x, y, z, w = q.T
        a, b, c = 0.5 * u.T
        dq = np.array((w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a, -x * a - y * b - z * c)).T
        return dq, np.cross(M, u) + np.stack((N[:, 1], -N[:, 0], 0.0 * N[:, 0]), axis=1), R.apply((0.0, 0.0, 1.0))

    middle, far = n - 0.5 * h * load, n - h * load
    k1 = slopes(q, M, n)
    k2 = slopes(q + 0.5 * h * k1[0], M + 0.5 * h * k1[1], middle)
    k3 = slopes(q + 0.5 * h * k2[0], M + 0.5 * h * k2[1], middle)
    k4 = slopes(q + h * k3[0], M + h * k3[1], far)
    q, M, r = (
        y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        for y, a, b, c, d in zip((q, M, shape.positions[:-1]), k1, k2, k3, k4, strict=True)
    )
    there = Rotation.from_quat(shape.quaternions[1:])
    turn = (there.inv() * Rotation.from_quat(q)).magnitude().max()
    moment = (
        np.linalg.norm(there.apply(M) - shape.moment[1:], axis=1).max() / np.linalg.norm(shape.moment, axis=1).max()
    )
    distance = np.linalg.norm(r - shape.positions[1:], axis=1).max() / cable.length
    return float(max(distance / 1e-5, turn / 1e-3, moment / 1e-2))


def print_grasps(count: int, figures: Figures) -> None:
    """Grasps from nothing, and whether their error estimates are honest."""
    heading(f"{count} random grasps from nothing; the true error is against a mesh for a tolerance 1000 times finer")
    _grade("random grasps", count, random_grasp, figures)


def print_taut_grasps(count: int, figures: Figures) -> None:
    """The same where the boundary layers are as thin as 1e-5 of the length."""
    heading(f"{count} taut grasps of any stiffness: chord 0.97 to 0.9999 L, clamped in any direction")
    _grade("taut grasps", count, taut_grasp, figures)


def _grade(
    name: str, count: int, make: Callable[[np.random.Generator], tuple[Cable, Pose, Pose]], figures: Figures
) -> None:
    rng = np.random.default_rng(2024)
    statuses: Counter[str] = Counter()
    ratios, errors, residuals, apart, times, elements = [], [], [], [], [], []
    for _ in tqdm(range(count), desc=name, leave=False, disable=None):
        cable, start, end = make(rng)
        problem = Problem(cable).move(start, end)
        state = Network(problem)
        shape = cosserat.solve(problem, state)
        statuses[shape.status.name] += 1
        times.append(shape.solve_time)
        elements.append(state.elements)
        if shape.status is not Status.OK:
            continue
        residuals.append(shape.residual)
        layer = math.sqrt(min(cable.bending_stiffness) / float(np.linalg.norm(shape.force, axis=1).max()))
        dense = Problem(cable, points=min(40_000, max(1000, math.ceil(5.0 * cable.length / layer)))).move(start, end)
        apart.append(off_the_equations(cable, cosserat.solve(dense, state)))
        # what the most elements cannot bring to 1e-8 still serves where it is far better than the shape in question
        fine = cosserat.solve(Problem(cable, tolerance=1e-8 * cable.length).move(start, end), state)
        error = float(np.linalg.norm(shape.positions - fine.positions, axis=1).max())
        if fine.error_estimate < 0.1 * max(error, shape.error_estimate):
            ratios.append(shape.error_estimate / error)
            errors.append(error / problem.tolerance)
    ratio = np.array(ratios)
    print(
        f"status {dict(statuses)}; median {np.median(times) * 1e3:.2f} ms, 99 % {np.percentile(times, 99) * 1e3:.2f} "
        f"ms, {np.median(elements):.0f} elements; largest local residual of an OK {max(residuals):.1e}, "
        f"off the equations at most {max(apart):.2f} of what is bad;\n"
        f"{len(ratios)} judged; largest true error / estimate {1.0 / ratio.min():.2f}"
    )
    usable = 100.0 * sum(statuses[s.name] for s in Status if s) / count
    within = 100.0 * (np.array(errors) <= 1.0).mean()
    honest, sharp = 100.0 * (ratio >= 1.0).mean(), 100.0 * (ratio <= 10.0).mean()
    figures.at_least(f"{name} solved from nothing", usable, 99.5, "{:.1f}", " %")
    figures.at_least(f"{name}: of those OK, true error at most the tolerance", within, 100.0, "{:.1f}", " %")
    figures.at_least(f"{name}: true error at most the estimate", honest, 99.0, "{:.1f}", " %")
    off = sum(a > 1.0 for a in apart)
    if make is random_grasp:
        figures.at_most(f"{name}: OK, yet off the equations from point to point", off, 0, "{:.0f}")
        figures.at_least(f"{name}: estimate at most 10 times the true error", sharp, 80.0, "{:.1f}", " %")
    else:
        print(
            f"{name}: estimate at most 10 times the true error: {sharp:.1f} %; off the equations within layers: {off}"
        )


def print_sweep(figures: Figures) -> None:
    """Chord 0.05 to 1.05 L and back."""
    heading("Chord 0.05 to 1.05 L and back in 400 steps, EA infinite and 1 kN")
    for axial in (None, 1e3):
        cable = Cable(length=LENGTH, linear_density=0.1, bending_stiffness=0.01, axial_stiffness=axial)
        problem = Problem(cable)
        state, statuses, broken, wrong = None, Counter(), 0, 0
        for chord in np.concatenate((np.linspace(0.05, 1.05, 200), np.linspace(1.05, 0.05, 200))):
            q = ALONG_X.as_quat()
            problem.move(Pose((0, 0, 0), q), Pose((chord * LENGTH, 0, 0), q))
            state = state or Network(problem)
            shape = cosserat.solve(problem, state)
            statuses[shape.status.name] += 1
            broken += not np.isfinite(shape.buffer).all()
            right = Status.OVERSTRETCHED if axial is None and chord >= 1.0 else Status.OK
            wrong += shape.status is not right
        print(f"EA {axial}: {dict(statuses)}")
        figures.at_most(f"sweep, EA {axial}: shapes with a number that is not finite", broken, 0, "{:.0f}")
        figures.at_most(f"sweep, EA {axial}: shapes of another status than right", wrong, 0, "{:.0f}")
