"""Cables along each other and wound round each other: rows of contacts, the double helix, ends in circles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from test_crossing import HEAVY, SOLVE, across, grip_force, posed

import cable_shape as cs


def gap(a, b):
    """[m], least distance of the centrelines of two shapes, their points apart, and their diameters."""
    fine = np.linspace(0.0, a.length, 3001)
    one, other = (np.column_stack([np.interp(fine, s.arc_length, x) for x in s.positions.T]) for s in (a, b))
    return cKDTree(one).query(other)[0].min() - HEAVY.diameter


@pytest.mark.parametrize("angle", [2.2, 5.0])
def test_a_cable_laid_down_along_another_lies_on_it_in_a_row_of_contacts(angle):
    """What pushes it up is its own, and where it slides off, nothing goes through anything."""
    cycle = cs.Cycle({"under": HEAVY, "over": HEAVY}, scene=SOLVE, model="cosserat")
    most = 0
    for k, height in enumerate(np.linspace(0.015, 0.001, 29)):
        grips = {"under": across(0.0, 0.5, 0.0), "over": across(angle, 0.5, height, (0.0, 0.0005))}
        shapes = cycle.step(grips, stamp=k).shapes
        assert all(shape.usable for shape in shapes.values()), (height, shapes)
        assert gap(*shapes.values()) > -1.5e-4
        (under, over), weight = shapes.values(), HEAVY.linear_density * HEAVY.length * 9.81
        pushed = sum((c.force * c.normal for c in over.contacts), start=np.zeros(3))
        np.testing.assert_allclose(grip_force(over) + pushed, (0.0, 0.0, weight), atol=1e-5)
        np.testing.assert_allclose(grip_force(under) - pushed, (0.0, 0.0, weight), atol=1e-5)
        most = max(most, len(over.contacts))
    assert most >= (4 if angle < 3.0 else 2)


WOUND = cs.Cable(0.6, 0.0, 0.004, 0.003, diameter=0.008, axial_stiffness=200.0)


def wound(turns, apart=0.012):
    """Ends so far apart [m], those at one side turned round each other; cables wound like that stretch by 3 %: 6 N."""
    slope, turn = math.atan(0.5 * WOUND.diameter * 2.0 * math.pi * turns / WOUND.length), 2.0 * math.pi * turns
    there = Rotation.from_rotvec((turn, 0.0, 0.0))
    out = {}
    for name, side in (("a", 0.5 * apart), ("b", -0.5 * apart)):
        far = there.apply((0.0, side, 0.0)) + np.array((1.03 * WOUND.length * math.cos(slope), 0.0, 0.0))
        out[name] = posed((0.0, side, 0.0)), posed(far, there)
    return out


def test_cables_wound_round_each_other_press_as_the_double_helix_does():
    """p = F k - (GJ w - EI t) k t / e a metre: axial force F, twist rate w, curvature k and torsion t of the helix.

    All by the length of the cable as it was made, of which each metre has become e.
    """
    cycle = cs.Cycle({"a": WOUND, "b": WOUND}, scene=SOLVE, model="cosserat", gravity=(0, 0, 0))
    for k, turns in enumerate(np.arange(0.0, 3.01, 0.1)):
        shape = cycle.step(wound(turns), stamp=k).shapes["a"]
        assert shape.usable, (turns, shape)
    middle = np.abs(shape.arc_length - 0.3) < 0.06
    x, y, z = shape.positions[middle].T
    radius, rise = np.hypot(y, z), abs(np.polyfit(np.unwrap(np.arctan2(z, y)), x, 1)[0])
    np.testing.assert_allclose(radius, 0.5 * WOUND.diameter, rtol=0.003)
    twist = abs(shape.curvature[middle, 2].mean())
    pull = (shape.force[middle] * shape.tangents[middle]).sum(axis=1).mean()
    longer = 1.0 + pull / WOUND.axial_stiffness
    bend, torsion = longer * np.array((radius.mean(), rise)) / (radius.mean() ** 2 + rise**2)
    expected = pull * bend - (0.003 * twist - 0.004 * torsion) * bend * torsion / longer
    arcs, forces = np.array([(c.arc_length, c.force) for c in shape.contacts]).T
    (first, *_, last) = np.flatnonzero(np.abs(arcs - 0.3) < 0.06)
    length = 0.5 * (arcs[last + 1] + arcs[last] - arcs[first] - arcs[first - 1])
    assert forces[first : last + 1].sum() / length == pytest.approx(expected, rel=0.02)


def test_ends_that_go_round_each_other_while_nothing_is_known_ask_for_a_reset():
    """A full turn more, or less, looks the same from the ends: what cables do then nobody can tell."""
    cycle = cs.Cycle({"a": WOUND, "b": WOUND}, scene=SOLVE, model="cosserat", gravity=(0, 0, 0))
    stamps = iter(range(100))

    def step(turns, apart=0.012):
        return cycle.step(wound(turns, apart), stamp=next(stamps)).shapes["a"]

    known = [step(turns) for turns in (0.0, 0.2, 0.4, 0.6, 0.8)]
    assert all(shape.status is cs.Status.OK for shape in known)
    assert known[-1].contacts
    lost = [step(turns, 0.004) for turns in (0.8, 1.0, 1.2, 1.4, 1.6)]
    assert not any(shape.usable for shape in lost)
    assert "grips hold cable 'a' at its start inside 'b' at its start: 0.0040 m apart" in lost[0].detail
    back = step(1.6)
    assert back.status is cs.Status.NOT_CONVERGED
    assert "gone round each other" in back.detail
    *_, shape = (step(turns) for turns in (1.4, 1.2, 1.0, 0.8))
    assert shape.usable
    np.testing.assert_allclose(
        shape.positions, known[-1].positions, atol=shape.error_estimate + known[-1].error_estimate
    )
    assert not any(step(turns, 0.004).usable for turns in (0.8, 1.0, 1.2, 1.4, 1.6))
    cycle.reset()
    assert step(0.0).usable
