"""Cables that are made up and found again: how often true numbers are in their intervals, and how long a fit takes."""

from __future__ import annotations

import math
import time

import numpy as np
from clocks import clocked
from figures import Figures, heading
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs
from cable_shape.calibration.parameters import STIFFENS, WANDERS, along, pieces, smoothness

#: Supports of the rest curvature, observations of such a cable and points of each.
ROWS, SEEN, MARKS = 9, 8, 20
NOISE = 5e-4  # m
SYNTHETIC, ALONG = 200, 100


def ends_of(rng: np.random.Generator, length: float) -> tuple[cs.Pose, cs.Pose]:
    """Two ends with slack, their tangents up to some 30 degrees off the chord."""
    way = np.array((1.0, 0.0, 0.0)) + 0.3 * rng.normal(size=3)
    way *= length * rng.uniform(0.5, 0.9) / np.linalg.norm(way)
    along_x = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
    turns = [(Rotation.from_rotvec(0.3 * rng.normal(size=3)) * along_x).as_quat() for _ in range(2)]
    return cs.Pose((0, 0, 0), turns[0]), cs.Pose(way, turns[1])


def wandering(rng: np.random.Generator, rows: int, wanders: float, width: int) -> np.ndarray:
    """(rows, width): what varies along a cable as the prior of calibrations says, about 0."""
    sizes, vectors = np.linalg.eigh(smoothness(rows, wanders))
    return np.asarray((vectors[:, 1:] / np.sqrt(sizes[1:])) @ rng.normal(size=(rows - 1, width)))


def drawn(rng: np.random.Generator, rows: int, length: float) -> np.ndarray:
    """(rows, 3) [1/m]: a rest curvature, its mean about 1 / length."""
    out = np.zeros((rows, 3))
    out[:, :2] = wandering(rng, rows, WANDERS / length, 2)
    out[:, :2] += rng.normal(size=2) / length
    return out


def straight(rng: np.random.Generator) -> cs.Cable:
    """0.5 to 1.5 m, (EI/w)^(1/3) of 0.05 to 0.3 lengths."""
    length, density = rng.uniform(0.5, 1.5), rng.uniform(0.02, 0.2)
    stiffness = density * 9.81 * (length * math.exp(rng.uniform(math.log(0.05), math.log(0.3)))) ** 3
    return cs.Cable(length=length, linear_density=density, bending_stiffness=stiffness)


def watched(rng: np.random.Generator, true: cs.Cable, count: int, points: int, edge: int) -> list[cs.Observation]:
    """So many observations of so many points with noise, 5 % of them stray by 5 cm; none nearer to an end than `edge`
    of 300 parts of the cable."""
    seen: list[cs.Observation] = []
    while len(seen) < count:
        start, end = ends_of(rng, true.length)
        shape = cs.predict(true, start, end, model="cosserat", points=301)
        if shape.status is cs.Status.OK:
            places = np.sort(rng.integers(edge, 301 - edge, points))
            marks = shape.positions[places] + NOISE * rng.normal(size=(points, 3))
            stray = rng.random(points) < 0.05
            marks[stray] += 0.05 * rng.normal(size=(int(stray.sum()), 3))
            seen.append(cs.Observation(start, end, marks))
    return seen


def recovered(seed: int) -> dict[str, bool]:
    """Whether the true stiffness and length of one random cable are in their 95 % intervals."""
    rng = np.random.default_rng(seed)
    true = straight(rng)
    seen = watched(rng, true, 5, 15, 15)
    truth = {"bending_stiffness": true.mean_bending_stiffness, "length": true.length}
    begin = true.replace(
        bending_stiffness=truth["bending_stiffness"] * math.exp(0.7 * rng.normal()), twisting_stiffness=None,
        length=true.length * (1.0 + 0.003 * rng.normal()),
    )  # fmt: skip
    found = cs.calibrate(seen, begin, ("bending_stiffness", "length"))
    return {name: found.converged and found[name].low <= x <= found[name].high for name, x in truth.items()}


def recovered_along(seed: int) -> np.ndarray:
    """(19,) bool: whether stiffness and rest curvature of a random cable are in their 95 % intervals."""
    rng = np.random.default_rng(seed)
    true = straight(rng)
    stiffness, table = true.mean_bending_stiffness, drawn(rng, ROWS, true.length)
    seen = watched(rng, true.replace(rest_curvature=table), SEEN, MARKS, 10)
    begin = true.replace(bending_stiffness=stiffness * math.exp(0.5 * rng.normal()), twisting_stiffness=None)
    found = cs.calibrate(seen, begin, ("bending_stiffness", "rest_curvature_along"), supports=ROWS)
    truth = dict(zip(along(ROWS), table[:, :2].ravel().tolist(), strict=True)) | {"bending_stiffness": stiffness}
    return np.array([found[name].low <= x <= found[name].high for name, x in truth.items()])


def recovered_stiffness(seed: int, rows: int = ROWS) -> np.ndarray:
    """(rows,) bool: whether the stiffness of each piece of a random cable is in its 95 % interval."""
    rng = np.random.default_rng(seed)
    plain = straight(rng)
    truth = plain.mean_bending_stiffness * np.exp(wandering(rng, rows, STIFFENS, 1)[:, 0])
    edges = np.linspace(0.0, plain.length, rows + 1).tolist()
    parts = zip(edges, edges[1:], truth.tolist(), strict=False)
    true = plain.replace(
        sections=[cs.Section(low, high, bending_stiffness=x, twisting_stiffness=x / 1.3) for low, high, x in parts]
    )
    begin = plain.replace(bending_stiffness=plain.mean_bending_stiffness * math.exp(0.5 * rng.normal()),
                          twisting_stiffness=None)  # fmt: skip
    found = cs.calibrate(watched(rng, true, SEEN, MARKS, 10), begin, "bending_stiffness_along", supports=rows)
    return np.array([found[name].low <= x <= found[name].high for name, x in zip(pieces(rows), truth, strict=True)])


def synthetic(figures: Figures, count: int) -> dict[str, float]:
    """Coverage of the intervals, and the time of a fit."""
    heading(f"Synthetic recovery: {count} cables, 5 observations of 15 points, noise 0.5 mm, 5 % stray by 5 cm")
    results = [recovered(seed) for seed in tqdm(range(count), desc="synthetic", unit="cable")]
    out = {}
    for name in results[0]:
        out[name] = 100.0 * sum(r[name] for r in results) / count
        figures.at_least(f"true {name} in its 95 % interval", out[name], 90.0, "{:.1f}", " %")
        figures.at_most(f"true {name} in its 95 % interval", out[name], 99.0, "{:.1f}", " %")
    many = max(8, count * ALONG // SYNTHETIC)
    heading(
        f"Rest curvature at {ROWS} supports and stiffness: {many} cables, {SEEN} observations of {MARKS} points, noise "
        f"{1e3 * NOISE:g} mm, 5 % stray by 5 cm"
    )
    inside = np.concatenate([recovered_along(seed) for seed in tqdm(range(many), desc="supports", unit="cable")])
    out["along"] = 100.0 * float(inside.mean())
    figures.at_least("true numbers with nine supports in their 95 % intervals", out["along"], 93.0, "{:.1f}", " %")
    figures.at_most("true numbers with nine supports in their 95 % intervals", out["along"], 97.0, "{:.1f}", " %")
    inside = np.concatenate([recovered_stiffness(seed) for seed in tqdm(range(many), desc="stiffness", unit="cable")])
    out["stiffness"] = 100.0 * float(inside.mean())
    figures.at_least(f"true stiffness of {ROWS} pieces in their 95 % intervals", out["stiffness"], 93.0, "{:.1f}", " %")
    figures.at_most(f"true stiffness of {ROWS} pieces in their 95 % intervals", out["stiffness"], 97.0, "{:.1f}", " %")
    rng = np.random.default_rng(0)
    true = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.004)
    for loaded in (False, True):
        seen = []
        for _ in range(50):
            start, end = ends_of(rng, 1.0)
            table = 2.0 * rng.normal(size=(11, 3)) if loaded else None
            shape = cs.predict(true, start, end, model="cosserat", points=301, acceleration=table)
            seen.append(cs.Observation(start, end, shape.positions[20:-20:26] + 5e-4 * rng.normal(size=(11, 3)),
                                       acceleration=table))  # fmt: skip
        begin = true.replace(bending_stiffness=0.008, twisting_stiffness=None)
        times = [clocked(lambda o=seen, c=begin: cs.calibrate(o, c), time.process_time)[0] for _ in range(5)]
        told = "with accelerations" if loaded else "at rest"
        figures.at_most(
            f"one parameter on 50 frames {told}, time of one core", float(np.median(times)), 0.5, "{:.2f}", " s"
        )
    return out
