"""Published reference shapes as cases: the field names of rod theory in JSON, mapped onto this package's arguments.

The file has `cable` (length, linear_density, EI1, EI2, GJ, EA, GA, rest_curvature), `gravity`, `start`, `end`
(position, quaternion_xyzw; `end` null: free), `end_mass`, `end_force`, `end_moment`, `clips` (s, type, position,
quaternion_xyzw, and `retraction` of an eyelet), `point_masses` (s, mass), and the answer in `solution` (s, r). The end
frame's winding is in the sign of its quaternion and in `twist`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.command.case import Case, Reference
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose, multiply
from cable_shape.scene.scene import Clip, PointMass, Scene

_IDENTITY = (0.0, 0.0, 0.0, 1.0)
_CONJUGATE = np.array((-1.0, -1.0, -1.0, 1.0))


def reference_case(values: Mapping[str, Any]) -> Case:
    """The case that a reference file describes, with its answer."""
    if values.get("kind") == "critical_value":
        raise ArgumentError(
            f"it holds a critical load ({values.get('quantity')}), not a shape: there is nothing to predict. "
            "Give a case of kind 'shape' or 'catenary'."
        )
    try:
        return _case(values)
    except (KeyError, TypeError) as error:
        raise ArgumentError(f"not a complete reference case: {type(error).__name__} {error}.") from None


def _case(values: Mapping[str, Any]) -> Case:
    start, end = values["start"], values["end"]
    options: dict[str, Any] = {"gravity": values["gravity"]}
    if values.get("kind") == "catenary":
        options["model"] = "catenary"
    far: Grip | FreeEnd
    if end is None:
        far = FreeEnd(values["end_mass"], values["end_force"], values["end_moment"])
    else:
        far = _grip(end, _turns(start["quaternion_xyzw"], end["quaternion_xyzw"], values.get("twist")))
    solution = values.get("solution")
    return Case(
        name=str(values.get("name", "reference")),
        cable=_cable(values["cable"]),
        start=_grip(start),
        end=far,
        scene=_scene(values),
        options=options,
        reference=Reference(np.array(solution["s"], float), np.array(solution["r"], float)) if solution else None,
    )


def _cable(fields: Mapping[str, Any]) -> Cable:
    return Cable(
        length=fields["length"],
        linear_density=fields["linear_density"],
        bending_stiffness=(fields["EI1"], fields["EI2"]),
        twisting_stiffness=fields["GJ"],
        axial_stiffness=fields["EA"],
        shear_stiffness=fields["GA"],
        rest_curvature=fields["rest_curvature"],
    )


def _grip(fields: Mapping[str, Any], turns: int = 0) -> Grip:
    """Clamped in the frame given; without one, pinned."""
    quaternion = fields["quaternion_xyzw"]
    pose = Pose(fields["position"], quaternion or _IDENTITY, turns=turns)
    return Grip(pose, kind="clamped" if quaternion else "pinned")


def _scene(values: Mapping[str, Any]) -> Scene | None:
    """The clips and point masses; None without any."""
    clips = tuple(
        Clip(
            clip["s"],
            Pose(clip["position"], clip["quaternion_xyzw"] or _IDENTITY),
            clip["type"],
            retraction=clip.get("retraction", 0.0),
        )
        for clip in values.get("clips") or ()
    )
    masses = tuple(PointMass(mass["s"], mass["mass"]) for mass in values.get("point_masses") or ())
    return Scene(clips=clips, masses=masses) if clips or masses else None


def _turns(start: Any, end: Any, twist: Mapping[str, Any] | None) -> int:
    """The winding of the end frame: even or odd by the sign of its quaternion, and that nearest to the twist put in."""
    if start is None or end is None:
        return 0
    _, _, z, w = multiply(np.array(start, float) * _CONJUGATE, np.array(end, float))
    odd = 1 if w < 0.0 else 0
    if twist is None:
        return odd
    angle = 2.0 * math.atan2(-z if odd else z, abs(w))  # twist of the winding 0
    put_in = float(twist["integral_u3"] if twist.get("end_twist") is None else twist["end_twist"])
    return odd + 2 * round(((put_in - angle) / (2.0 * math.pi) - odd) / 2.0)
