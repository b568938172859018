"""PyElastica's Cosserat rod, relaxed by damped explicit steps: a worker of `scripts/bench rivals`.

A setting: the strain that the greatest tension makes (its rods must stretch and shear; the softer, the larger the time
step), damping [1/s], and the time [s] in which the end is carried from the first guess to its place. The time step is
0.8 of the limit of stability. The rotational inertia of an element is that of a thin link, density * h^3 / 12, about
all axes, which changes no equilibrium and allows larger time steps.
"""

from __future__ import annotations

import math
from importlib.metadata import version
from typing import Any

import elastica as ea
import numpy as np
from rivals_common import GRAVITY, Rod, Setting, Swing, serve
from scipy.spatial.transform import Rotation, Slerp

RADIUS = 0.004
#: Shear stiffness / axial stiffness.
SHEAR = 1.0 / 3.0
#: Of the limit of stability.
STABLE = 0.8
#: s, simulated, and of how many we look at one.
DURATION, LOOK = 3.0, 0.02


class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
    """What PyElastica is asked to do."""


class Held(ea.ConstraintBase):
    """First and last link held; the last is carried from where the first guess has it to its place."""

    def __init__(
        self, rod: Rod, link: float, guess: tuple[np.ndarray, Rotation], duration: float, swing: Swing | None,
        **more: Any,
    ) -> None:  # fmt: skip
        super().__init__(**more)
        self.link, self.duration, self.swing = link, duration, swing
        self.places = np.array((guess[0], rod.end[0]))
        self.turns = Slerp((0.0, 1.0), Rotation.concatenate((guess[1], rod.end[1])))
        self.start, self.end = self.nodes(*rod.start), self.nodes(*rod.end)

    def nodes(self, place: np.ndarray, turn: Rotation) -> tuple[np.ndarray, np.ndarray]:
        """(3, 2) both nodes of a link centred there, and its (3, 3) directors as rows."""
        half = turn.apply((0.0, 0.0, 0.5 * self.link))
        return np.column_stack((place - half, place + half)), turn.as_matrix().T

    def constrain_values(self, system: Any, time: float) -> None:
        end = self.end
        if time < self.duration:
            t = time / self.duration
            x = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
            end = self.nodes((1.0 - x) * self.places[0] + x * self.places[1], self.turns(x))
        elif self.swing is not None:
            end = (end[0] + (self.swing.share(time) * self.swing.way)[:, None], end[1])
        system.position_collection[:, :2], system.director_collection[:, :, 0] = self.start
        system.position_collection[:, -2:], system.director_collection[:, :, -1] = end

    def constrain_rates(self, system: Any, time: float) -> None:
        for side in (slice(None, 2), slice(-2, None)):
            system.velocity_collection[:, side] = 0.0
        system.omega_collection[:, 0] = system.omega_collection[:, -1] = 0.0


class Cable:
    """One rod at its first guess; or at `rest`, without damping, with an end that goes its way."""

    def __init__(
        self, rod: Rod, joints: int, setting: Setting, rest: Cable | None = None, swing: Swing | None = None
    ) -> None:
        h, links = rod.length / joints, joints + 1
        axial = rod.tension / setting["strain"]
        shear = SHEAR * axial
        inertia = rod.linear_density * h**3 / 12.0
        stiffest = max(rod.bending_stiffness, rod.twisting_stiffness)
        squared = 4.0 * (axial + shear) / (rod.linear_density * h**2) + (shear * h + 4.0 * stiffest / h) / inertia
        self.dt = STABLE * 2.0 / math.sqrt(squared)
        frames = rod.links(joints)
        tangents = frames.apply((0.0, 0.0, 1.0))
        nodes = np.vstack((np.zeros(3), np.cumsum(h * tangents, axis=0))) + rod.start[0] - 0.5 * h * tangents[0]
        self.rod = ea.CosseratRod.straight_rod(
            links, nodes[0], tangents[0], frames[0].apply((1.0, 0.0, 0.0)), links * h, RADIUS,
            rod.linear_density / (math.pi * RADIUS**2), youngs_modulus=1e6, shear_modulus=1e6, position=nodes.T.copy(),
            directors=np.stack([turn.T for turn in frames.as_matrix()], axis=2),
        )  # fmt: skip
        bending, twisting = rod.bending_stiffness, rod.twisting_stiffness
        for matrix, diagonal in (
            (self.rod.shear_matrix, (shear, shear, axial)),
            (self.rod.bend_matrix, (bending, bending, twisting)),
            (self.rod.mass_second_moment_of_inertia, (inertia,) * 3),
            (self.rod.inv_mass_second_moment_of_inertia, (1.0 / inertia,) * 3),
        ):
            for i, value in enumerate(diagonal):
                matrix[i, i] = value
        self.rod.rest_lengths[:] = self.rod.rest_voronoi_lengths[:] = h
        self.rod.rest_kappa[:] = self.rod.rest_sigma[:] = 0.0
        self.simulator = Simulator()
        self.simulator.append(self.rod)
        guess = (0.5 * (nodes[-1] + nodes[-2]), frames[-1])
        carry = setting["carry"] if rest is None else 0.0
        self.simulator.constrain(self.rod).using(Held, rod=rod, link=h, guess=guess, duration=carry, swing=swing)
        self.simulator.add_forcing_to(self.rod).using(ea.GravityForces, acc_gravity=np.array((0.0, 0.0, -GRAVITY)))
        if rest is None:
            self.simulator.dampen(self.rod).using(
                ea.AnalyticalLinearDamper, uniform_damping_constant=setting["damping"], time_step=self.dt
            )
        else:
            self.rod.position_collection[:] = rest.rod.position_collection
            self.rod.director_collection[:] = rest.rod.director_collection
        self.simulator.finalize()
        self.stepper, self.time = ea.PositionVerlet(), 0.0

    def step(self, count: int) -> None:
        time, step = self.time, self.stepper.step
        for _ in range(count):
            time = step(self.simulator, time, self.dt)
        self.time = time

    def joints(self) -> np.ndarray:
        return self.rod.position_collection[:, 1:-1].T.copy()


def make(rod: Rod, joints: int, setting: Setting) -> tuple:
    """A maker of simulations, how many steps to run, and how often to look."""
    dt = Cable(rod, joints, setting).dt
    return lambda: Cable(rod, joints, setting), round(DURATION / dt), max(round(LOOK / dt), 1)


def swinging(rod: Rod, joints: int, setting: Setting, swing: Swing) -> tuple:
    """A maker of simulations at rest, and their time step [s]."""
    rest = Cable(rod, joints, setting)
    rest.step(round(DURATION / rest.dt))
    return lambda: Cable(rod, joints, setting, rest, swing), rest.dt


if __name__ == "__main__":
    serve(make, version("pyelastica"), swinging)
