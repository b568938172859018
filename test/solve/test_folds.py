"""Folds of branches where theory has them: what hangs on one snaps there, and nowhere else."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.shape import Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
STIFFNESS, LENGTH, WEIGHT = 0.01, 1.0, 0.981
#: A strip that stays in its plane.
STRIP = cs.Cable(LENGTH, WEIGHT / 9.81, (STIFFNESS, 100.0 * STIFFNESS), 100.0 * STIFFNESS)


def followed(cable: cs.Cable, asked: Iterator[tuple[tuple[float, float, float], cs.Pose, cs.Pose | None]]) -> list:
    """Status and smallest eigenvalue [N m / m] of shapes that follow each other; of each gravity and ends."""
    state, out = None, []
    for gravity, start, end in asked:
        problem = Problem(cable, points=41, gravity=gravity).move(start, end)
        state = state or Network(problem)
        shape = cosserat.solve(problem, state)
        out.append((shape.status, cosserat.smallest_eigenvalue(state.copied()) if shape.status else math.nan))
    return out


def pull(ratio: float) -> float:
    """Gravity [m/s^2] under which (EI/w)^(1/3) of the strip is `ratio` of its length."""
    return 9.81 * STIFFNESS / (WEIGHT * (ratio * LENGTH) ** 3)


@pytest.mark.parametrize(("chord", "told"), [(0.9, True), (0.97, False)])
def test_a_strip_bowed_upwards_snaps_where_the_shallow_elastica_says(chord: float, told: bool) -> None:
    """EI v'''' + P v'' = -w, clamped, v' antisymmetric: the symmetric branch ends at w L^3 / EI = k^2 sqrt(48 D / 5).

    There P reaches the antisymmetric Euler load, tan(k/2) = k/2; D is the shortening. At 0.97 no frame turns far enough
    for the snap to be told: the eigenvalue tells it.
    """
    k = 8.986818915818128
    exact = (k**2 * math.sqrt(48.0 * (1.0 - chord) / 5.0)) ** (-1.0 / 3.0)
    ends = cs.Pose((0, 0, 0), ALONG_X.as_quat()), cs.Pose((chord * LENGTH, 0, 0), ALONG_X.as_quat())
    hung = [(0.0, 0.0, part * pull(1.0)) for part in (20.0, 5.0, 1.0, 0.0)]  # upwards, then let go
    ratios = exact * np.geomspace(1.6, 0.8, 41)
    found = followed(STRIP, ((g, *ends) for g in (*hung, *((0.0, 0.0, -pull(ratio)) for ratio in ratios))))[len(hung) :]
    eigenvalue = np.array([value for _, value in found])
    jump = int(np.diff(eigenvalue).argmax()) + 1
    assert eigenvalue[jump] > 20.0 * eigenvalue[jump - 1] > 0.0
    assert ratios[jump] == pytest.approx(exact, rel=0.03)  # shallow theory, and steps of 1.7 %
    assert [k for k, (status, _) in enumerate(found) if status is Status.SNAPPED] == ([jump] if told else [])


def test_a_twisted_cable_pops_into_a_loop_where_the_long_rod_does() -> None:
    """The homoclinic shape: M = 2 sqrt(EI T) cos(psi), D = 4 sqrt(EI/T) sin(psi), the ends' turn M L / GJ + 4 psi.

    At a given D that is largest where cos(2 psi) = -GJ D / (2 EI L) (Coyne 1990, van der Heijden et al. 2003).
    """
    twisting, chord = 0.8 * STIFFNESS, 0.75
    D = 1.0 - chord
    double = math.acos(-twisting * D / (2.0 * STIFFNESS * LENGTH))
    exact = (4.0 * STIFFNESS * LENGTH / (twisting * D) * math.sin(double) + 2.0 * double) / (2.0 * math.pi)
    cable = cs.Cable(LENGTH, STIFFNESS / (9.81 * LENGTH**3), STIFFNESS, twisting)
    start = cs.Pose((0, 0, 0), ALONG_X.as_quat())

    def end(chord: float, turns: float) -> cs.Pose:
        turned = ALONG_X * Rotation.from_euler("z", 2.0 * math.pi * turns)
        return cs.Pose((chord * LENGTH, 0, 0), turned.as_quat())

    down = (0.0, 0.0, -9.81)
    nearer = [end(near, 0.0) for near in np.arange(0.97, chord, -0.02)]
    turns = np.arange(0.0, 1.2 * exact, 0.1)
    ways = [*nearer, *(end(chord, turn) for turn in turns)]
    found = followed(cable, ((down, start, way) for way in ways))[len(nearer) :]
    snapped = [turn for turn, (status, _) in zip(turns, found, strict=True) if status is Status.SNAPPED]
    assert len(snapped) == 1
    assert snapped[0] == pytest.approx(exact, rel=0.08)


@pytest.mark.parametrize(("stiffness", "snaps"), [(0.95, 1), (1.01, 0)])
def test_a_standing_strip_snaps_only_below_greenhills_stiffness(stiffness: float, snaps: int) -> None:
    """Heavy column, clamped and free: w L^3 / EI = 7.837347 (Greenhill 1881), as gravity swings from side to side."""
    strength = pull(stiffness * 7.837347438943483 ** (-1.0 / 3.0))
    tilts = np.radians(np.linspace(-20.0, 20.0, 21))
    grown = [(part * strength, tilts[0]) for part in np.linspace(0.1, 1.0, 10)]
    ways = [*grown, *((strength, tilt) for tilt in tilts)]
    asked = (((0.0, g * math.sin(tilt), -g * math.cos(tilt)), cs.Pose(), None) for g, tilt in ways)
    found = followed(STRIP, asked)[len(grown) :]
    assert sum(status is Status.SNAPPED for status, _ in found) == snaps
