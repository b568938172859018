"""Random grasps by their number, plain and in clips, and their shapes as the certificate takes them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from certify_check import CLAMPED, NO_ROLL, PINNED, SWIVEL, Shapes
from cosserat_random import random_grasp, random_scene

import cable_shape as cs

#: Intervals of the default number of points; finer ones halve them again and again.
INTERVALS, MOST_HALVINGS = 149, 9
#: Spacing of the points, of the boundary layer as it is guessed before the shape is known.
SPACING = 0.7
#: Of the rows with something beyond the plain grasp: how many have each of these.
SHARES = {"elastic": 0.3, "curved at rest": 0.3, "of two stiffnesses": 0.3, "other ends": 0.4, "masses": 0.3}
KINDS = {"clamped": CLAMPED, "swivel": SWIVEL, "pinned": PINNED}
CLIPS = ("ball", "fixed", "hinge")
GRAVITY = np.array((0.0, 0.0, -9.81))


class Grasp(NamedTuple):
    """A cable between two grips; masses: (arc length in intervals of the default points, kg)."""

    cable: cs.Cable
    start: cs.Grip
    end: cs.Grip
    masses: tuple[tuple[int, float], ...]
    what: tuple[str, ...]

    def predict(self, halvings: int = 0, finer: float = 1.0) -> cs.CableShape:
        """From nothing, at the default tolerance or one so many times as fine."""
        step = self.cable.length / INTERVALS
        masses = [cs.PointMass(place * step, mass) for place, mass in self.masses]
        scene = cs.Scene(masses=masses) if masses else None
        tolerance = 1e-5 * self.cable.length / finer
        return cs.predict(self.cable, self.start, self.end, points=points(halvings), scene=scene, tolerance=tolerance)

    @property
    def halvings(self) -> int:
        """How often the default spacing is to be halved to be within the boundary layers, as far as that is known."""
        cable = self.cable
        weight = 9.81 * (cable.linear_density + sum(mass for _, mass in self.masses) / cable.length)
        chord = float(np.linalg.norm(self.end.pose.position - self.start.pose.position))
        slack = max(1.0 - chord / cable.length, 1e-5)
        bend = min(cable.bending_stiffness)
        bent = 0.5 * bend / (slack * cable.length) ** 2
        tension = max(weight * cable.length * max(1.0, 1.0 / math.sqrt(24.0 * slack)), bent)
        if cable.axial_stiffness is not None:
            tension = min(tension, slack * cable.axial_stiffness + weight * cable.length + bent)
        return halvings_for(SPACING * math.sqrt(bend / tension) / (cable.length / INTERVALS))


def halvings_for(spacing: float) -> int:
    """For a spacing so many times the default one, at most."""
    return min(max(math.ceil(-math.log2(spacing)), 0), MOST_HALVINGS)


def points(halvings: int) -> int:
    """Of a shape whose default spacing is halved so often."""
    return INTERVALS * 2**halvings + 1


def plain(seed: int, row: int) -> Grasp:
    """Every other row is clamped, inextensible, straight at rest and round; the others have more, see SHARES."""
    rng = np.random.default_rng((seed, row))
    cable, start, end = random_grasp(rng)
    if row % 2 == 0:
        return Grasp(cable, cs.Grip(start), cs.Grip(end), (), ("as it is",))
    what = [name for name, share in SHARES.items() if rng.random() < share]
    L, weight = cable.length, cable.linear_density * 9.81
    more: dict[str, object] = {}
    if "elastic" in what:
        axial = (40.0 * cable.mean_bending_stiffness / L**2 + weight * L) * 10.0 ** rng.uniform(1.0, 4.0)
        more |= {"axial_stiffness": axial, "shear_stiffness": axial * rng.uniform(0.2, 0.5)}
    if "curved at rest" in what:
        rows = rng.uniform(-1.0, 1.0, (2, 3)) * (3.0 / L, 3.0 / L, 2.0 / L)
        more["rest_curvature"] = rows if rng.random() < 0.5 else rows[0]
    if "of two stiffnesses" in what:
        bend = cable.mean_bending_stiffness
        more["bending_stiffness"] = (bend, bend * rng.uniform(0.3, 1.0))
        if rng.random() < 0.5:
            more["bending_stiffness"] = more["bending_stiffness"][::-1]  # type: ignore[index]
    kinds = ["clamped", "clamped"]
    if "other ends" in what:
        kinds = [("clamped", "swivel", "pinned")[k] for k in divmod(int(rng.integers(1, 9)), 3)]
    masses: tuple[tuple[int, float], ...] = ()
    if "masses" in what:
        places = np.sort(rng.choice(np.arange(8, INTERVALS - 8), rng.integers(1, 3), replace=False))
        masses = tuple((int(place), cable.linear_density * L * rng.uniform(0.1, 1.0)) for place in places)
    if more:
        cable = cable.replace(**more)
    return Grasp(cable, cs.Grip(start, kinds[0]), cs.Grip(end, kinds[1]), masses, tuple(what) or ("as it is",))


def in_clips(seed: int, row: int) -> tuple[str, cs.Cable, cs.Scene, cs.Pose, cs.Pose]:
    """One to four clips of all kinds; in every other row eyelets among them, or alone."""
    rng = np.random.default_rng((seed, row))
    if row % 2 == 0:
        return "clips", *random_scene(rng, CLIPS)
    while True:
        found = random_scene(rng, ("slide",) if rng.random() < 0.5 else ("slide", *CLIPS))
        if any(clip.kind == "slide" for clip in found[1].clips):
            return "eyelets", *found


def _kinds(grasp: Grasp) -> tuple[int, int]:
    """Of the ends; where nothing holds the roll of a cable that is the same all around, the start is made to."""
    first, last = KINDS[grasp.start.kind], KINDS[grasp.end.kind]
    cable = grasp.cable
    same = cable.bending_stiffness[0] == cable.bending_stiffness[1] and not cable.rest_curvature[..., :2].any()
    if same and CLAMPED not in (first, last):
        first = CLAMPED if first == SWIVEL else NO_ROLL
    return first, last


def stacked(grasps: list[Grasp], shapes: list[cs.CableShape], halvings: int) -> Shapes:
    """The shapes of one number of points, and either all or none with masses."""
    cables = [grasp.cable for grasp in grasps]
    lengths = np.array([cable.length for cable in cables])
    rest = [np.atleast_2d(cable.rest_curvature) for cable in cables]
    loads = None
    if grasps[0].masses:
        loads = np.zeros((len(grasps), points(halvings), 3))
        for row, grasp in zip(loads, grasps, strict=True):
            for place, mass in grasp.masses:
                row[place * 2**halvings] = mass * GRAVITY
    return Shapes(
        lengths,
        np.array([cable.linear_density * GRAVITY for cable in cables]),
        np.array([(*cable.bending_stiffness, cable.twisting_stiffness) for cable in cables]),
        np.array([_compliance(cable) for cable in cables]),
        np.array([table[0] for table in rest]),
        np.array([table[-1] - table[0] for table in rest]) / lengths[:, None],
        np.array([(grasp.start.cable_frame.array, grasp.end.cable_frame.array) for grasp in grasps]),
        np.array([_kinds(grasp) for grasp in grasps]),
        *(np.array([getattr(shape, name) for shape in shapes]) for name in
          ("positions", "quaternions", "curvature", "force", "moment")),
        loads,
    )  # fmt: skip


def _compliance(cable: cs.Cable) -> tuple[float, float, float]:
    shear = 0.0 if cable.shear_stiffness is None else 1.0 / cable.shear_stiffness
    return shear, shear, 0.0 if cable.axial_stiffness is None else 1.0 / cable.axial_stiffness
