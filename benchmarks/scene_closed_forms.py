"""Contact beside closed forms: a heavy cable lifted off a table, and a taut one around a drum."""

from __future__ import annotations

import math

import numpy as np
from figures import Figures, heading
from scipy.optimize import brentq

import cable_shape as cs
from cable_shape.solve.touching import mesh

ALONG_X = (0.5, 0.5, 0.5, 0.5)
ACROSS_Y = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # the drum's axis along -y of the world
#: N/m, m, m, N m^2: slopes stay small, as the closed form has it
WEIGHT, LENGTH, LIFT, STIFFNESS = 0.981, 0.8, 0.3, 0.05


def lifted(kind: str, share: float, part: float, grip: float) -> dict[str, float]:
    """Of a cable lifted by one grip: force and moment there and the table's reactions, over the closed form.

    share: w l^4 / (share EI) is the height; part, grip: of w l, the reaction at lift-off and the grip's force.
    """
    cable = cs.Cable(LENGTH, 0.1, STIFFNESS, 0.8 * STIFFNESS, diameter=0.004)
    scene = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")
    height = 0.002 + WEIGHT * LIFT**4 / (share * STIFFNESS)
    start = cs.Grip(cs.Pose((0, 0, height), ALONG_X), kind=kind)
    shape = cs.predict(cable, start, None, scene=scene, model="cosserat")
    found = {
        "force of the grip": -shape.force[0, 2] / (grip * WEIGHT * LIFT),
        "reactions": sum(c.force for c in shape.contacts) / (WEIGHT * (LENGTH - LIFT + part * LIFT)),
        "length to lift-off": lift_off(shape) / LIFT,
    }
    if kind == "clamped":
        found["moment of the grip"] = float(np.linalg.norm(shape.moment[0])) / (WEIGHT * LIFT**2 / 6)
    return found


def lift_off(shape: cs.CableShape) -> float:
    """Arc length [m] of the reaction concentrated where the cable lifts off, which the first two contacts share.

    From their force F and its first moment, beyond the weight w that they carry up to half way to the third, x:
    F s = F l + w (x - l)^2 / 2 for the centroid s.
    """
    at, forces = (np.array([getattr(c, name) for c in shape.contacts[:3]]) for name in ("arc_length", "force"))
    force, moment, x = forces[:2].sum(), (forces * at)[:2].sum(), 0.5 * (at[1] + at[2])
    return float(brentq(lambda off: force * off + 0.5 * WEIGHT * (x - off) ** 2 - moment, at[0], at[1]))


def around_a_drum() -> float:
    """Pressure of a taut cable without weight on a drum, over (T - EI kappa^2 / 2) kappa, on a mesh of 320 elements.

    From the forces of single contacts, which scatter on coarser meshes.
    """
    mesh.ELEMENTS, before = 320, mesh.ELEMENTS
    radius, drum, stiffness, tension = 0.002, 0.1, 0.001, 2.0
    cable = cs.Cable(LENGTH, 0.1, stiffness, stiffness, diameter=2.0 * radius)
    scene = cs.Scene(
        obstacles=[cs.Obstacle("drum", cs.Cylinder(drum, 0.6), cs.Pose((0, 0, 0), ACROSS_Y))], contact="solve"
    )
    start = cs.Grip(cs.Pose((-0.3, 0.0, 0.09), ALONG_X), kind="pinned")
    predictor = cs.Predictor(cable, scene=scene, model="cosserat", gravity=(0, 0, 0))
    for angle in np.radians(np.arange(-20.0, 61.0, 2.0)):
        end = cs.FreeEnd(force=(tension * math.cos(angle), 0.0, -tension * math.sin(angle)))
        shape = predictor.predict(start, end)
    mesh.ELEMENTS = before
    at = np.array([c.arc_length for c in shape.contacts])
    forces = np.array([c.force for c in shape.contacts])
    pressure = np.median(forces[1:-1] / (0.5 * (at[2:] - at[:-2])))  # a node carries that of half a cell either side
    curvature = 1.0 / (drum + radius)
    return float(pressure / ((tension - 0.5 * stiffness * curvature**2) * curvature))


def print_closed_forms(figures: Figures) -> None:
    """All of them."""
    heading("Contact beside closed forms")
    for kind, share, part, grip in (("clamped", 72, 1 / 3, 2 / 3), ("pinned", 24, 1 / 2, 1 / 2)):
        for what, ratio in lifted(kind, share, part, grip).items():
            figures.at_most(f"lifted off a table, {kind}: {what}, off", 100.0 * abs(ratio - 1.0), 0.5, "{:.3f}", " %")
    figures.at_most("around a drum: pressure, off T kappa", 100.0 * abs(around_a_drum() - 1.0), 0.5, "{:.3f}", " %")
