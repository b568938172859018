"""Figures of cables that touch each other and bodies at once, or are held in a clip there: seeded motions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from figures import Figures, heading
from scene_crossing import Grips, Tally, posed, smooth
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs

CABLE = cs.Cable(1.0, 0.1, 0.008, 0.006, diameter=0.008)
CABLES = {"under": CABLE, "over": CABLE}
ALONG_Y = (0.70710678, 0.0, 0.0, 0.70710678)  # z of the obstacle along -y of the world
CHORD = 0.9  # m, of the grips


@dataclass(frozen=True)
class Motion:
    """A cable let down onto another.

    obstacle: what both may lie on; height [m] of the lower one's grips; way [m]: heights of the upper one's grips, at
    first and at last; aside [m]: how far its middle is off at most; turned: how much of the angle the lower one is
    turned back; clip: in which the lower one is held.
    """

    obstacle: cs.Obstacle | None
    height: float
    way: tuple[float, float]
    aside: float = 0.05
    turned: float = 0.0
    clip: cs.Clip | None = None

    @property
    def scene(self) -> cs.Scene:
        """What both cables are in."""
        return cs.Scene(obstacles=[] if self.obstacle is None else [self.obstacle], contact="solve")

    @property
    def clips(self) -> dict[str, list[cs.Clip]]:
        """What the lower one is held in."""
        return {} if self.clip is None else {"under": [self.clip]}


TABLE = cs.Obstacle("table", cs.HalfSpace())
BOX = cs.Obstacle("box", cs.Box((0.3, 0.5, 0.2)))
POST = cs.Obstacle("post", cs.Capsule(0.03, 0.8), cs.Pose((0.0, 0.0, -0.08), ALONG_Y))
LOW, HIGH = cs.Clip(0.3, cs.Pose((-0.18, 0.0, 0.02))), cs.Clip(0.3, cs.Pose((-0.18, 0.0, 0.0)))

MOTIONS = {
    "on a table": Motion(TABLE, 0.05, (0.22, 0.07)),
    "over the edges of a box": Motion(BOX, 0.1, (0.32, 0.14)),
    "over a post": Motion(POST, 0.1, (0.27, 0.12), aside=0.02, turned=0.5),
    "on a table, one in a clip": Motion(TABLE, 0.05, (0.22, 0.07), clip=LOW),
    "one in a clip": Motion(None, 0.1, (0.22, 0.0), clip=HIGH),
}


def lowered(rng: np.random.Generator, steps: int, motion: Motion) -> list[Grips]:
    """The grips: across the other cable at 60 to 120 degrees, let down, and moved about."""
    angle = math.radians(rng.uniform(60.0, 120.0))
    off = rng.uniform(-motion.aside, motion.aside, 2)
    down = np.concatenate((np.linspace(*motion.way, steps // 2), np.full(steps - steps // 2, motion.way[1])))
    wander = [smooth(rng, steps, 0.01) for _ in range(2)]
    half = np.array((0.5 * CHORD, 0.0, 0.0))
    lower = Rotation.from_rotvec((0.0, 0.0, -motion.turned * angle))
    lift = np.array((0.0, 0.0, motion.height))
    path = []
    for k in range(steps):
        upper = Rotation.from_rotvec((0.0, 0.0, angle)) * lower * Rotation.from_rotvec(3.0 * wander[0][k, 3:])
        middle = np.array((*off, down[k])) + wander[0][k, :3] * (1.0, 1.0, 0.3)
        bent = Rotation.from_rotvec(3.0 * wander[1][k, 3:]) * lower
        path.append({
            "under": (posed(lift - lower.apply(half), lower), posed(lift + lower.apply(half) + wander[1][k, :3], bent)),
            "over": (posed(middle - upper.apply(half), upper), posed(middle + upper.apply(half), upper)),
        })  # fmt: skip
    return path


def unbalanced(shapes: Mapping[str, cs.CableShape]) -> float:
    """All that acts on the cables from outside: grips, weight, clips and bodies, over their weight."""
    total, weight = np.zeros(3), 9.81 * CABLE.linear_density * CABLE.length
    for shape in shapes.values():
        total += shape.force[-1] - shape.force[0] - (0.0, 0.0, weight)
        total += sum((c.force * c.normal for c in shape.contacts if c.body not in shapes), np.zeros(3))
        total -= sum((clip.force for clip in shape.clips), np.zeros(3))
    return float(np.linalg.norm(total)) / (weight * len(shapes))


def print_both(figures: Figures, motions: int = 10, steps: int = 160) -> None:
    """The figures of cables that touch each other and something else."""
    heading("Cables on each other and on bodies or in clips: one let down onto another at 60 to 120 degrees")
    for name, motion in MOTIONS.items():
        tally, worst = Tally(), 0.0
        for seed in tqdm(range(motions), desc=name, unit="motion", leave=False, disable=None):
            cycle = cs.Cycle(CABLES, scene=motion.scene, clips=motion.clips, model="cosserat")
            for k, grips in enumerate(lowered(np.random.default_rng(seed), steps, motion)):
                report = cycle.step(grips, stamp=10_000_000 * k)
                if tally.add(report):
                    worst = max(worst, unbalanced(report.shapes))
        tally.tell(f"two cables {name}", figures)
        figures.at_most(f"two cables {name}: deepest in a body", 1e3 * tally.in_bodies, 0.2, "{:.3f}", " mm")
        figures.at_most(f"two cables {name}: forces out of balance / weight", worst, 1e-3)
