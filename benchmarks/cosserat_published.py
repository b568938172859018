"""Exact and published problems: what the package gives beside the exact value and what was printed.

Through the public API: `cs.predict` from nothing, or a `Predictor` under a load that grows from zero where the end is
free. The clamped elastica alone is started beside the answer, since its plane is arbitrary. The clamped-hinged arch of
DaDeppo and Schmidt, whose hinge is a clip, is in `scripts/bench scene`.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from cosserat_cases import STEPS, Values, beside, error_of, load
from figures import Figures, heading
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.command.reference_case import reference_case

#: name, ours, exact, what was published (None: only the exact value is)
Row = tuple[str, float, float, str | None]
#: Stiffness of the rod that stands for a cable without any, N m^2: nothing at these tensions.
LIMP = 1e-7


def predicted(values: Values, tolerance: float | None = None) -> cs.CableShape:
    """The shape, through the public API where a case has one answer there."""
    case = reference_case(values)
    if values["name"].startswith("elastica"):
        return beside(values, tolerance)[0]
    if not isinstance(case.end, cs.FreeEnd):
        return case.predict(model="cosserat", points=41, tolerance=tolerance)
    predictor = cs.Predictor(case.cable, model="cosserat", gravity=values["gravity"], points=41, tolerance=tolerance)
    for t in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        end = cs.FreeEnd(case.end.mass, t * case.end.force, t * case.end.moment)
        shape = predictor.predict(case.start, end)
    return shape


def rows_of(values: Values, shape: cs.CableShape) -> list[Row]:
    """The quantities that the literature gives of a case."""
    name, length = values["name"], values["cable"]["length"]
    for start, rows in FAMILIES.items():
        if name.startswith(start):
            return rows(values, shape, length)
    raise LookupError(name)


def printed(values: Values, key: str) -> str | None:
    """A number of the published table with as many digits as that table has."""
    published = values.get("published") or {}
    digits = max((len(repr(v).partition(".")[2]) for v in published.values() if isinstance(v, float)), default=0)
    return None if key not in published else f"{published[key]:.{digits}f}"


def bend45(values: Values, shape: cs.CableShape, length: float) -> list[Row]:
    tips = np.array(list(values["published_tip"].values()))
    spans = [f"{a:g} to {b:g} ({len(tips)} papers)" for a, b in zip(tips.min(axis=0), tips.max(axis=0), strict=True)]
    return [(f"tip {axis}", shape.positions[-1, i], values["tip"][i], spans[i]) for i, axis in enumerate("xyz")]


def end_load(values: Values, shape: cs.CableShape, length: float) -> list[Row]:
    tip, exact, tangent = shape.positions[-1] / length, values["exact"], shape.tangents[-1]
    ours = {
        "tip_drop_over_L": -tip[2],
        "tip_shortening_over_L": 1.0 - tip[0],
        "tip_slope_rad": math.atan2(-tangent[2], tangent[0]),
    }
    return [(key, value, exact[key], printed(values, key)) for key, value in ours.items()]


def heavy(values: Values, shape: cs.CableShape, length: float) -> list[Row]:
    tip, exact = shape.positions[-1] / length, values["exact"]
    return [(key, tip[i], exact[key], None) for key, i in (("tip_x_over_L", 0), ("tip_z_over_L", 2))]


def postbuckled(values: Values, shape: cs.CableShape, length: float) -> list[Row]:
    tip, exact = shape.positions[-1] / length, values["exact"]
    along = Rotation.from_quat(values["start"]["quaternion_xyzw"]).apply((0.0, 0.0, 1.0))
    slope = math.degrees(math.acos(shape.tangents[-1] @ along))
    lateral = float(np.linalg.norm(tip - (tip @ along) * along))
    return [
        ("end_slope_deg", slope, exact["end_slope_deg"], None),
        ("tip_x_over_L", float(tip @ along), exact["tip_x_over_L"], printed(values, "tip_x_over_L")),
        ("tip_lateral_over_L", lateral, exact["tip_lateral_over_L"], printed(values, "tip_lateral_over_L")),
    ]


def elastica(values: Values, shape: cs.CableShape, length: float) -> list[Row]:
    exact = values["exact"]
    chord = shape.positions[-1] - shape.positions[0]
    along = chord / np.linalg.norm(chord)
    middle = shape.positions[shape.points // 2] - shape.positions[0]
    thrust = -float(shape.force[-1] @ along) * length**2 / values["cable"]["EI2"]
    height = float(np.linalg.norm(middle - (middle @ along) * along)) / length
    return [
        ("end_thrust_L2_over_EI", thrust, exact["end_thrust_L2_over_EI"], None),
        ("mid_height_over_L", height, exact["mid_height_over_L"], None),
    ]


def helix(values: Values, shape: cs.CableShape, length: float) -> list[Row]:
    """About the z axis."""
    exact = values["exact"]
    ours = {
        "radius": float(np.hypot(shape.positions[:, 0], shape.positions[:, 1]).mean()),
        "pitch_angle_from_axis": float(np.arccos(shape.tangents[:, 2]).mean()),
        "curvature": float(np.hypot(shape.curvature[:, 0], shape.curvature[:, 1]).mean()),
        "u3": float(shape.curvature[:, 2].mean()),
        "axial_force": float(shape.force[-1, 2]),
    }
    return [(key, value, exact[key], None) for key, value in ours.items() if exact.get(key)]


def localised(values: Values, shape: cs.CableShape, length: float) -> list[Row]:
    """Tension and twisting moment along z; the shortening is put in by the ends."""
    exact = values["exact"]
    rows: list[Row] = [("tension", float(shape.force[-1, 2]), exact["tension"], None)]
    if exact["moment"]:
        rows.append(("moment", abs(float(shape.moment[-1, 2])), exact["moment"], None))
    return rows


def pure_bending(values: Values, shape: cs.CableShape, length: float) -> list[Row]:
    """Radius of the circle through three points."""
    r = shape.positions[:: (shape.points - 1) // 5][:3]
    a, b, c = r[1] - r[0], r[2] - r[1], r[2] - r[0]
    radius = np.prod([np.linalg.norm(v) for v in (a, b, c)]) / (2.0 * np.linalg.norm(np.cross(a, b)))
    return [("radius_over_L", float(radius) / length, values["exact"]["radius_over_L"], None)]


def catenary(values: Values, shape: cs.CableShape, length: float) -> list[Row]:
    force, lowest = values["solution"]["force_start"], np.array(values["solution"]["r"])[:, 2].min()
    rows: list[Row] = [
        ("horizontal force", float(shape.force[0, 0]), force[0], None),
        ("vertical force at the start", float(shape.force[0, 2]), force[2], None),
    ]
    return [*rows, ("height of the lowest of 41 points", float(shape.positions[:, 2].min()), float(lowest), None)]


FAMILIES = {
    "bend45": bend45,
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
