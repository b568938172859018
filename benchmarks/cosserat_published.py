"""Exact and published problems: what the package gives beside the exact value and what was printed.

Through the public API: `cs.predict` from nothing, or a `Predictor` under a load that grows from zero where the end is
free. The clamped elastica alone is started beside the answer, since its plane is arbitrary. The clamped-hinged arch of
DaDeppo and Schmidt, whose hinge is a clip, is in test/solve/test_arch.py.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from figures import Figures, heading
from scipy.spatial.transform import Rotation, Slerp

import cable_shape as cs
from cable_shape.command.reference_case import reference_case
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

Values = dict[str, Any]
STEPS = 20  # of a load that grows

#: name, ours, exact, what was published (None: only the exact value is)
Row = tuple[str, float, float, str | None]
#: Stiffness of the rod that stands for a cable without any, N m^2: nothing at these tensions.
LIMP = 1e-7


def load(folder: Path, kind: str = "shape") -> list[Values]:
    """The cases of one kind, by name; those held in clips, which no model of this version knows, are left out."""
    cases = [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]
    return [values for values in cases if values.get("kind", "shape") == kind and not values.get("clips")]


def beside(values: Values, tolerance: float | None = None) -> cs.CableShape:
    """The shape found from a start beside the answer: the frames of the solution, interpolated and disturbed."""
    case, solution = reference_case(values), values["solution"]
    options = {} if tolerance is None else {"tolerance": tolerance}
    problem = Problem(case.cable, points=41, gravity=values["gravity"], **options).move(case.start, case.end)

    def frames(s: np.ndarray) -> np.ndarray:
        between = Slerp(solution["s"], Rotation.from_quat(solution["q_xyzw"]))(np.clip(s, 0.0, solution["s"][-1]))
        bump = 0.02 * np.sin(math.pi * s / s[-1])[:, None] * np.array((1.0, 0.6, 0.3))
        q = (Rotation.from_rotvec(bump) * between).as_quat()
        q[1:] *= np.cumprod(np.sign((q[1:] * q[:-1]).sum(axis=1)))[:, None]
        return q

    return cosserat.solve_beside(problem, Network(problem), frames, solution["n"][-1])


def error_of(positions: np.ndarray, values: Values) -> float:
    """Mean distance at equal arc length / length; where the plane is free, after the best turn about the chord."""
    expected = np.array(values["solution"]["r"])
    length = values["cable"]["length"]
    direct = np.linalg.norm(positions - expected, axis=1).mean() / length
    chord = expected[-1] - expected[0]
    if not values["name"].startswith(("elastica", "postbuckled")) or not np.any(chord):
        return float(direct)
    axis = chord / np.linalg.norm(chord)
    if values["end"] is None:
        axis = Rotation.from_quat(values["start"]["quaternion_xyzw"]).apply((0.0, 0.0, 1.0))
    a, b = positions - expected[0], expected - expected[0]
    flat_a, flat_b = a - np.outer(a @ axis, axis), b - np.outer(b @ axis, axis)
    angle = math.atan2((np.cross(flat_a, flat_b) @ axis).sum(), (flat_a * flat_b).sum())
    turned = Rotation.from_rotvec(angle * np.asarray(axis)).apply(a)
    return float(min(direct, np.linalg.norm(turned - b, axis=1).mean() / length))


def predicted(values: Values, tolerance: float | None = None) -> cs.CableShape:
    """The shape, through the public API where a case has one answer there."""
    case = reference_case(values)
    if values["name"].startswith("elastica"):
        return beside(values, tolerance)
    if not isinstance(case.end, cs.FreeEnd):
        return case.predict(model="cosserat", points=41, tolerance=tolerance)
    predictor = cs.Predictor(case.cable, model="cosserat", gravity=values["gravity"], points=41, tolerance=tolerance)
    for t in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        end = cs.FreeEnd(case.end.mass, t * case.end.force, t * case.end.moment)
        shape = predictor.predict(case.start, end)
    return shape


def rows_of(values: Values, shape: cs.CableShape) -> list[Row]:
    """The quantities that the literature gives of a case."""
    ours = next(quantities for start, quantities in FAMILIES.items() if values["name"].startswith(start))
    exact = exact_of(values)
    found = ours(values, shape, values["cable"]["length"])
    return [(key, float(value), exact[key], printed(values, key)) for key, value in found.items() if exact.get(key)]


def exact_of(values: Values) -> dict[str, float]:
    """Exact values by quantity."""
    if "tip" in values:
        return dict(zip(TIP, values["tip"], strict=True))
    if "exact" in values:
        return values["exact"]  # type: ignore[no-any-return]
    force, lowest = values["solution"]["force_start"], np.array(values["solution"]["r"])[:, 2].min()
    return dict(zip(HANGING, (force[0], force[2], float(lowest)), strict=True))


def printed(values: Values, key: str) -> str | None:
    """A number of the published table with as many digits as that table has, or the span of several papers."""
    if key in TIP:
        tips = np.array(list(values["published_tip"].values()))[:, TIP.index(key)]
        return f"{tips.min():g} to {tips.max():g} ({len(tips)} papers)"
    published = values.get("published") or {}
    digits = max((len(repr(v).partition(".")[2]) for v in published.values() if isinstance(v, float)), default=0)
    return None if key not in published else f"{published[key]:.{digits}f}"


TIP = ("tip x", "tip y", "tip z")
HANGING = ("horizontal force", "vertical force at the start", "height of the lowest of 41 points")
Quantities = dict[str, float]


def end_load(values: Values, shape: cs.CableShape, length: float) -> Quantities:
    tip, tangent = shape.positions[-1] / length, shape.tangents[-1]
    return {
        "tip_drop_over_L": -tip[2],
        "tip_shortening_over_L": 1.0 - tip[0],
        "tip_slope_rad": math.atan2(-tangent[2], tangent[0]),
    }


def heavy(values: Values, shape: cs.CableShape, length: float) -> Quantities:
    tip = shape.positions[-1] / length
    return {"tip_x_over_L": tip[0], "tip_z_over_L": tip[2]}


def postbuckled(values: Values, shape: cs.CableShape, length: float) -> Quantities:
    tip = shape.positions[-1] / length
    along = Rotation.from_quat(values["start"]["quaternion_xyzw"]).apply((0.0, 0.0, 1.0))
    return {
        "end_slope_deg": math.degrees(math.acos(shape.tangents[-1] @ along)),
        "tip_x_over_L": tip @ along,
        "tip_lateral_over_L": np.linalg.norm(tip - (tip @ along) * along),
    }


def elastica(values: Values, shape: cs.CableShape, length: float) -> Quantities:
    chord = shape.positions[-1] - shape.positions[0]
    along = chord / np.linalg.norm(chord)
    middle = shape.positions[shape.points // 2] - shape.positions[0]
    return {
        "end_thrust_L2_over_EI": -(shape.force[-1] @ along) * length**2 / values["cable"]["EI2"],
        "mid_height_over_L": np.linalg.norm(middle - (middle @ along) * along) / length,
    }


def helix(values: Values, shape: cs.CableShape, length: float) -> Quantities:
    """About the z axis."""
    return {
        "radius": np.hypot(shape.positions[:, 0], shape.positions[:, 1]).mean(),
        "pitch_angle_from_axis": np.arccos(shape.tangents[:, 2]).mean(),
        "curvature": np.hypot(shape.curvature[:, 0], shape.curvature[:, 1]).mean(),
        "u3": shape.curvature[:, 2].mean(),
        "axial_force": shape.force[-1, 2],
    }


def localised(values: Values, shape: cs.CableShape, length: float) -> Quantities:
    """Tension and twisting moment along z; the shortening is put in by the ends."""
    return {"tension": shape.force[-1, 2], "moment": abs(shape.moment[-1, 2])}


def pure_bending(values: Values, shape: cs.CableShape, length: float) -> Quantities:
    """Radius of the circle through three points."""
    r = shape.positions[:: (shape.points - 1) // 5][:3]
    a, b, c = r[1] - r[0], r[2] - r[1], r[2] - r[0]
    radius = np.prod([np.linalg.norm(v) for v in (a, b, c)]) / (2.0 * np.linalg.norm(np.cross(a, b)))
    return {"radius_over_L": radius / length}


def catenary(values: Values, shape: cs.CableShape, length: float) -> Quantities:
    return dict(zip(HANGING, (shape.force[0, 0], shape.force[0, 2], shape.positions[:, 2].min()), strict=True))


FAMILIES = {
    "bend45": lambda values, shape, length: dict(zip(TIP, shape.positions[-1], strict=True)),
    "cantilever_end_load": end_load,
    "heavy_cantilever": heavy,
    "postbuckled": postbuckled,
    "elastica": elastica,
    "helix": helix,
    "localised": localised,
    "pure_bending": pure_bending,
    "catenary": catenary,
}


def rounds_to(ours: float, text: str) -> bool:
    """Whether a number agrees with a printed one to the digits printed, rounded or cut."""
    digits = len(text.partition(".")[2])
    return abs(ours - float(text)) < 10.0**-digits


def print_published(folder: Path, figures: Figures) -> None:
    """One line a quantity, and of every case the mean error of the whole shape."""
    heading("Exact and published problems, default tolerance; difference = (ours - exact) / |exact|")
    print(f"{'case':38} {'quantity':34} {'ours':>13} {'exact':>13} {'difference':>11}  published")
    differences: list[float] = []
    agree: list[bool] = []
    shapes = [
        _print_case(values["name"], values, predicted(values), differences, agree)
        for values in load(folder / "published")
    ]
    limp = []
    for values in load(folder / "published", "catenary"):
        case = reference_case(values)
        _print_case(values["name"], values, case.predict(points=41), differences, [])
        rod = case.cable.replace(bending_stiffness=LIMP, twisting_stiffness=LIMP)
        shape = cs.predict(rod, case.start, case.end, model="cosserat", points=41)
        limp.append(_print_case(f"{values['name']}, rod of EI {LIMP:g}", values, shape, [], []))
    figures.at_most(f"mean error / L, worst of {len(shapes)} published shapes", max(shapes), 1e-5)
    figures.at_most(f"relative difference from exact, worst of {len(differences)} quantities", max(differences), 1e-4)
    figures.at_most(f"mean error / L of {len(limp)} catenaries by a rod of next to no stiffness", max(limp), 1e-5)
    held = 100.0 * sum(agree) / len(agree)
    figures.at_least(f"of {len(agree)} printed figures those met to their last digit", held, 100.0, "{:.0f}", " %")


def _print_case(name: str, values: Values, shape: cs.CableShape, differences: list[float], agree: list[bool]) -> float:
    for quantity, ours, exact, published in rows_of(values, shape):
        difference = (ours - exact) / abs(exact)
        differences.append(abs(difference))
        note = ""
        if published is not None and "to" not in published:
            agree.append(rounds_to(ours, published))
            note = "" if agree[-1] else "  (differs)"
        print(f"{name:38} {quantity:34} {ours:13.7g} {exact:13.7g} {difference:11.1e}  {published or '-'}{note}")
    error = error_of(shape.positions, values)
    print(f"{name:38} {'mean error / L, ' + shape.status.name:34} {error:13.1e}", flush=True)
    return error
