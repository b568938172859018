"""What the reference shapes of this folder are of: cables, ends, clips and loads, in the fields of reference_case.py.

Along the approach of a case a straight cable along x, whose frame has d2 = y, becomes the case: start and end turn, the
end about its own d3, too, and the end and the clips go in straight lines from 0.97 of their arc length.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from collocation import conjugate, product
from scipy.spatial.transform import Rotation

Values = dict[str, Any]
ALONG_X = Rotation.from_quat((0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)))
DOWN = (0.0, 0.0, -9.81)
NOTHING = (0.0, 0.0, 0.0)


def cable(length: float, density: float, EI: float | tuple[float, float], GJ: float, rest: tuple = NOTHING,
          EA: float | None = None, GA: float | None = None) -> Values:  # fmt: skip
    EI1, EI2 = EI if isinstance(EI, tuple) else (EI, EI)
    return {"length": length, "linear_density": density, "EI1": EI1, "EI2": EI2, "GJ": GJ, "EA": EA, "GA": GA,
            "rest_curvature": list(rest)}  # fmt: skip


def quaternion(rotvec: tuple, twist: float = 0.0) -> np.ndarray:
    return (Rotation.from_rotvec(rotvec) * ALONG_X * Rotation.from_rotvec((0.0, 0.0, twist))).as_quat()


def followed(start: tuple, end: tuple, twist: float) -> np.ndarray:
    """The end's quaternion with the sign that it has along the approach: the winding."""
    relative = np.array((0.0, 0.0, 0.0, 1.0))
    for t in np.linspace(0.0, 1.0, 201):
        here, there = quaternion(t * np.array(start)), quaternion(t * np.array(end), t * twist)
        step = product(conjugate(here), there)
        relative = step * math.copysign(1.0, step @ relative)
    return product(quaternion(start), relative)


def case(name: str, cable: Values, start: tuple, place: tuple | None = None, end: tuple = NOTHING, twist: float = 0.0,
         clips: tuple = (), masses: tuple = (), plug: float = 0.0, force: tuple = NOTHING, moment: tuple = NOTHING,
         gravity: tuple = DOWN) -> Values:  # fmt: skip
    """One case; `start` and `end` are rotation vectors, `clips` (s, place, kind or a fixed one's rotation vector)."""
    first, gripped = quaternion(start), None
    if place:
        gripped = {"position": list(place), "quaternion_xyzw": followed(start, end, twist).tolist()}
    return {
        "name": name,
        "kind": "shape",
        "source": "collocation: test/references/make.py",
        "cable": cable,
        "gravity": list(gravity),
        "start": {"position": [0.0, 0.0, 0.0], "quaternion_xyzw": first.tolist()},
        "end": gripped,
        "end_mass": plug,
        "end_force": list(force),
        "end_moment": list(moment),
        "clips": [
            {"s": s, "type": held if isinstance(held, str) else "fixed", "position": list(r),
             "quaternion_xyzw": None if isinstance(held, str) else quaternion(held).tolist()}
            for s, r, held in clips
        ],
        "point_masses": [{"s": s, "mass": mass} for s, mass in masses],
        "approach": {"start_rotvec": list(start), "end_rotvec": list(end) if place else None,
                     "end_twist": twist if place else None},
    }  # fmt: skip


def drawn(values: Values, *pulls: float) -> Values:
    """The same whose eyelets draw the cable towards its start."""
    for clip, pull in zip(values["clips"], pulls, strict=True):
        clip["retraction"] = pull
    return values


def arch(load: float) -> Values:
    """The clamped-hinged arch of 215 degrees of DaDeppo and Schmidt (1975), as in test/solve/test_arch.py."""
    angle, tail = math.radians(215.0), 0.02
    frames = [Rotation.from_rotvec((0.0, 0.5 * math.pi + side * 0.5 * angle, 0.0)) for side in (-1, 1)]
    feet = [(side * math.sin(0.5 * angle), 0.0, math.cos(0.5 * angle)) for side in (-1, 1)]
    values = case(f"arch_load_{load:g}", cable(angle + tail, 0.0, (50.0, 1.0), 50.0, rest=(0.0, 1.0, 0.0)), NOTHING,
                  clips=((angle, feet[1], "ball"),), masses=((0.5 * angle, load),),
                  gravity=(0.0, 0.0, -1.0))  # fmt: skip
    start = {"position": list(feet[0]), "quaternion_xyzw": frames[0].as_quat().tolist()}
    return {**values, "start": start, "approach": None}


def catenary(name: str, length: float, density: float, place: tuple, EA: float | None = None) -> Values:
    values = case(f"catenary_{name}", cable(length, density, 0.0, 0.0, EA=EA), NOTHING, place)
    for side in ("start", "end"):
        values[side]["quaternion_xyzw"] = None
    return {**values, "kind": "catenary", "approach": None}


#: A strap: ten times as stiff one way as the other.
STRAP = (0.9, 0.18, (0.002, 0.02), 0.006)
COIL = (0.8, 0.09, 0.012, 0.009)


def all_cases() -> list[Values]:
    return [
        case("grasp_1", cable(1.1, 0.21, 0.03, 0.02), (0.1, 0.2, -0.1), (0.8, 0.12, -0.06), (-0.2, 0.3, 0.25), 0.3),
        case("grasp_2", cable(0.6, 0.5, 0.004, 0.003), (0.0, -0.3, 0.2), (0.35, -0.08, 0.11), (0.1, 0.4, -0.3), -0.5),
        case("grasp_taut", cable(1.3, 0.05, 0.02, 0.015), NOTHING, (1.29, 0.01, -0.02), (0.05, 0.1, 0.0), 0.2),
        case("grasp_soft", cable(0.9, 0.08, 2e-5, 1.4e-5), (0.2, 0.4, 0.1), (0.55, 0.1, 0.15), (0.1, -0.5, 0.4), 0.6),
        case("grasp_twisted", cable(1.25, 0.15, 0.06, 0.04), (0.1, 0.0, 0.1), (0.95, 0.05, 0.08), (0.1, -0.1, 0.2),
             4.1),
        case("grasp_turned", cable(1.5, 0.03, 1.2, 0.9), (0.4, -0.6, 0.5), (1.05, -0.2, 0.3), (-0.7, 0.2, 0.8), 0.4),
        case("extreme_near", cable(1.0, 0.12, 0.008, 0.006), (0.0, -0.9, 0.2), (0.2, 0.06, 0.03), (0.2, 0.9, 0.1), 0.3),
        case("extreme_bent", cable(1.4, 0.09, 0.05, 0.035), (0.3, 1.2, -0.4), (0.8, 0.2, -0.3), (-0.5, -1.1, 0.7), 1.2),
        case("strap_1", cable(*STRAP), (0.1, 0.2, 0.1), (0.7, -0.1, 0.05), (0.0, -0.2, -0.3), 0.5),
        case("strap_2", cable(1.6, 0.1, (0.08, 0.03), 0.05), (-0.2, 0.1, 0.3), (1.2, 0.3, -0.2), (0.3, 0.2, -0.2),
             -0.8),
        case("rubber", cable(0.7, 0.12, 6e-4, 5e-4, EA=9.0), NOTHING, (0.74, 0.02, 0.01), (0.1, -0.1, 0.1), 0.2),
        case("rubber_shear", cable(1.0, 0.2, (0.02, 0.03), 0.015, rest=(0.4, -0.3, 0.5), EA=40.0, GA=25.0),
             (0.1, 0.1, -0.2), (0.75, 0.1, -0.1), (-0.1, 0.3, 0.2), 0.4),
        case("coil_1", cable(*COIL, rest=(1.5, -0.8, 0.0)), (0.1, 0.0, 0.1), (0.5, 0.1, -0.1), (0.0, 0.2, 0.3), 0.2),
        case("coil_2", cable(*COIL, rest=(-0.9, 1.1, 0.7)), (0.0, 0.3, 0.0), (0.6, -0.1, 0.1), (0.2, -0.1, 0.0), -0.3),
        case("weightless", cable(0.95, 0.0, 0.1, 0.08), (0.1, -0.3, 0.2), (0.7, 0.1, -0.1), (0.0, 0.3, 0.4), 0.9,
             gravity=NOTHING),
        case("free_end", cable(0.7, 0.1, 0.02, 0.015), (0.3, -0.4, 0.5)),
        case("free_plug", cable(0.5, 0.2, 0.05, 0.04), (0.2, 0.7, 0.1), plug=0.06),
        case("free_pulled", cable(0.9, 0.1, (0.04, 0.06), 0.03, rest=(0.6, 0.2, 0.4)), (0.0, -0.2, 0.6), plug=0.02,
             force=(0.3, 0.2, 0.1)),
        case("free_moment", cable(0.8, 0.05, 0.03, 0.02), NOTHING, force=(0.0, 0.05, 0.0), moment=(0.01, -0.03, 0.02)),
        case("mass", cable(1.1, 0.15, 0.04, 0.03), (0.1, 0.1, 0.2), (0.85, 0.1, 0.1), (0.0, 0.2, -0.2), 0.4,
             masses=((0.4, 0.05), (0.83, 0.03))),
        case("ball_clip", cable(1.4, 0.2, 0.05, 0.03), (0.0, 0.2, 0.1), (1.0, 0.1, -0.15), (0.1, -0.2, 0.1), 0.3,
             clips=((0.62, (0.45, -0.08, -0.1), "ball"),)),
        case("ball_clips", cable(2.0, 0.1, 0.08, 0.06), (0.1, 0.1, 0.1), (1.5, 0.0, 0.1), (0.0, 0.1, -0.2), -0.2,
             clips=((0.57, (0.42, 0.06, -0.05), "ball"), (1.33, (1.02, -0.05, 0.06), "ball"))),
        case("fixed_clip", cable(1.2, 0.1, 0.06, 0.04), (0.1, -0.1, 0.0), (0.85, 0.1, 0.1), (0.0, 0.3, 0.2), 0.4,
             clips=((0.53, (0.4, -0.05, 0.06), (0.2, 0.1, -0.3)),)),
        case("clip_free_end", cable(0.9, 0.12, 0.03, 0.02), (0.0, -0.2, 0.1), plug=0.02,
             clips=((0.37, (0.29, 0.05, 0.04), "ball"),)),
        case("eyelet", cable(1.3, 0.15, (0.02, 0.03), 0.02, EA=60.0), (0.1, -0.2, 0.1), (0.9, 0.1, 0.05),
             (0.0, 0.1, -0.2), 0.3, clips=((0.6, (0.4, -0.05, 0.2), "slide"),)),
        case("eyelets", cable(1.8, 0.1, 0.05, 0.03), (0.0, 0.1, 0.2), (1.2, 0.1, -0.1), (0.1, 0.2, 0.0), -0.2,
             clips=((0.6, (0.4, 0.05, 0.1), "slide"), (1.2, (0.8, -0.05, 0.12), "slide"))),
        drawn(case("eyelets_drawn", cable(1.8, 0.1, 0.05, 0.03), (0.0, 0.1, 0.2), (1.2, 0.1, -0.1), (0.1, 0.2, 0.0),
                   -0.2, clips=((0.6, (0.4, 0.05, 0.1), "slide"), (1.2, (0.8, -0.05, 0.12), "slide"))), 0.4, -0.25),
        arch(4.0), arch(8.5),
        catenary("level", 1.1, 0.3, (0.8, 0.0, 0.0)),
        catenary("inclined", 1.4, 0.2, (0.9, 0.3, 0.4)),
        catenary("elastic", 0.9, 0.4, (0.95, 0.1, -0.1), EA=50.0),
    ]  # fmt: skip
