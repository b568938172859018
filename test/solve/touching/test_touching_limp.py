"""Limp cables on a table: closed forms without stiffness, finer meshes, motions, clips, and what is told of errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from contact_reference import Tally
from scene_limp import CHORDS, DENSITY, LENGTH, TABLE, case, laid, lowered
from scipy.optimize import brentq

import cable_shape as cs
from cable_shape.kernels.contact import near as contact_near
from cable_shape.kernels.contact import sets as contact_set
from cable_shape.kernels.contact.carry import carry
from cable_shape.kernels.contact.near import BARE, GAP, ON, PRESS
from cable_shape.solve.touching import laid as laid_out
from cable_shape.solve.touching import mesh
from cable_shape.solve.touching.touching import ACCURACY, DEEPEST

ALONG_X = (0.5, 0.5, 0.5, 0.5)
WEIGHT = DENSITY * 9.81  # N/m
RADIUS = 0.002


def limp(limpness, **options):
    stiffness = limpness * WEIGHT * LENGTH**3
    return cs.Cable(LENGTH, DENSITY, stiffness, 0.8 * stiffness, diameter=2.0 * RADIUS, **options)


def pinned(x, z):
    return cs.Grip(cs.Pose((x, 0, z), ALONG_X), kind="pinned")


def test_a_taut_limp_cable_is_a_catenary_that_ends_on_the_table():
    chord, height = 0.92, 0.1

    def legs(pull):  # arc length and span of one, of a chain that leaves the table along it
        return math.sqrt(height**2 + 2.0 * height * pull / WEIGHT), (
            pull / WEIGHT * math.acosh(1.0 + WEIGHT * height / pull)
        )

    def slack(pull):
        arc, span = legs(pull)
        return LENGTH - chord - 2.0 * (arc - span)

    pull = brentq(slack, 1e-4, 10.0)
    arc, span = legs(pull)
    shape = cs.predict(
        limp(1e-6), pinned(0.0, height + RADIUS), pinned(chord, height + RADIUS), scene=TABLE, model="cosserat"
    )
    assert shape.status is cs.Status.OK
    middle = shape.points // 2
    assert shape.force[middle, 0] == pytest.approx(pull, rel=0.02)
    assert abs(shape.force[0, 2]) == pytest.approx(WEIGHT * arc, rel=0.01)
    assert sum(contact.force for contact in shape.contacts) == pytest.approx(WEIGHT * (LENGTH - 2.0 * arc), rel=0.01)
    x = np.linspace(0.0, 0.9 * span, 20)
    z = pull / WEIGHT * (np.cosh(WEIGHT / pull * (span - x)) - 1.0) + RADIUS
    assert np.interp(x, shape.positions[:, 0], shape.positions[:, 2]) == pytest.approx(z, abs=2e-3)


@pytest.mark.parametrize("limpness", [1e-5, 1e-6])
def test_a_slack_limp_cable_hangs_down_to_the_table_and_bows_on_it(limpness):
    chord, height = 0.5, 0.1
    shape = cs.predict(
        limp(limpness), pinned(0.0, height + RADIUS), pinned(chord, height + RADIUS), scene=TABLE, model="cosserat"
    )
    assert shape.status is cs.Status.OK
    bent = (limpness ** (1.0 / 3.0)) * LENGTH  # over which bending takes up the weight
    for grip in (0, -1):
        assert abs(shape.force[grip, 2]) == pytest.approx(WEIGHT * height, abs=0.5 * WEIGHT * bent)
        assert abs(shape.force[grip, 0]) < 0.05 * WEIGHT * height
    assert np.abs(shape.positions[:, 1]).max() > 0.2 * LENGTH
    assert shape.positions[:, 2].min() > RADIUS - 2.0 * DEEPEST


@pytest.mark.parametrize("limpness", [-5.0, -4.0])
@pytest.mark.parametrize("chords", CHORDS)
def test_limp_cables_are_laid_on_a_table_from_nothing(limpness, chords):
    tally = Tally()
    for seed in (40, 41):
        shape = laid(case(limpness, chords, seed), tally)
        assert shape.status is cs.Status.OK, shape
        assert shape.error_estimate <= ACCURACY * LENGTH
    assert tally.deepest < 2.0 * DEEPEST
    assert tally.lost == 0
    assert tally.honest == tally.compared


@pytest.mark.parametrize(("limpness", "chords", "seed"), [(-5.0, CHORDS[2], 50), (-4.0, CHORDS[1], 51)])
def test_limp_cables_are_lowered_onto_a_table(limpness, chords, seed):
    tally = Tally()
    shape = lowered(case(limpness, chords, seed), tally, every=16)
    assert tally.usable == tally.shapes
    assert tally.snapped == 0
    assert tally.deepest < 2.0 * DEEPEST
    assert tally.honest == tally.compared >= 2
    assert len(shape.contacts) > 20
    assert all(contact.force > -1e-6 * WEIGHT * LENGTH for contact in shape.contacts)


def test_the_shape_from_nothing_is_one_that_lowering_comes_to_up_to_its_mirror_image():
    given = case(-5.0, CHORDS[1], 50)
    cold, warm = laid(given, Tally(), judge=False), lowered(given, Tally(), every=100)
    mirrored = warm.positions * (1.0, -1.0, 1.0)
    apart = min(np.linalg.norm(cold.positions - other, axis=1).max() for other in (warm.positions, mirrored))
    assert apart < 0.02 * LENGTH


def test_a_limp_cable_in_a_clip_is_laid_on_a_table():
    clip = cs.Clip(0.5, cs.Pose((0.4, 0.05, 0.08), ALONG_X), kind="ball")
    scene = cs.Scene(obstacles=TABLE.obstacles, clips=[clip], contact="solve")
    start, end = (cs.Pose((x, 0, 0.06), ALONG_X) for x in (0.0, 0.75))
    shape = cs.predict(limp(3e-5), start, end, scene=scene, model="cosserat", points=201)
    assert shape.status is cs.Status.OK
    held = shape.positions[100]
    assert held == pytest.approx((0.4, 0.05, 0.08), abs=1e-4)
    assert shape.positions[:, 2].min() > RADIUS - 2.0 * DEEPEST
    assert len(shape.contacts) > 20


def test_an_error_that_is_too_large_is_told_with_its_bound_and_what_helps(monkeypatch):
    monkeypatch.setattr("cable_shape.solve.touching.step.MOST_ELEMENTS", mesh.ELEMENTS)  # no finer than at first
    given = case(-4.5, CHORDS[1], 62)
    shape = cs.predict(given.cable, given.start, given.end, scene=TABLE, model="cosserat")
    assert shape.status is cs.Status.NOT_CONVERGED
    assert f"{shape.error_estimate:.3g} m" in shape.detail
    assert "above 0.0005 m" in shape.detail
    assert "Raise `tolerance`" in shape.detail
    again = cs.predict(
        given.cable, given.start, given.end, scene=TABLE, model="cosserat", tolerance=1.01 * shape.error_estimate
    )
    assert again.status is cs.Status.OK


def test_a_limp_mesh_resolves_where_the_cable_meets_a_body():
    bend, weight = 1e-5 * WEIGHT, WEIGHT
    assert mesh.first_count(1.0, 1e-2 * WEIGHT, weight) == mesh.ELEMENTS
    assert mesh.first_count(1.0, bend, 0.0) == mesh.ELEMENTS
    count = mesh.first_count(1.0, bend, weight)
    shape = cs.predict(limp(1e-5), *(cs.Pose((x, 0, 0), ALONG_X) for x in (0.0, 0.5)), model="cosserat")
    nodes = mesh.first_nodes(np.array((0.0, 1.0)), np.empty(0), bend, (False, False), shape, count)
    assert nodes.size == count + 1
    assert np.diff(nodes).max() < 0.55 * (bend / weight) ** (1.0 / 3.0)


def test_forces_at_nodes_that_are_taken_away_stay_in_balance():
    old = np.linspace(0.0, 1.0, 11)
    near, on = np.zeros((11, contact_near.NEAR)), np.full((11, ON), BARE)
    near[2:9, PRESS], on[2:9] = np.arange(1.0, 8.0), 0
    left = np.delete(old, (3, 5))
    turns = np.tile((0.0, 0.0, 0.0, 1.0), (11, 1))
    fewer, where, new = np.zeros((9, contact_near.NEAR)), np.full((9, ON), BARE), np.empty(9, dtype=np.bool_)
    carry(old, turns, near, on, left, np.empty((9, 4)), fewer, where, 1e-9, new)
    assert fewer[:, PRESS].sum() == pytest.approx(near[:, PRESS].sum())
    assert left @ fewer[:, PRESS] == pytest.approx(old @ near[:, PRESS])


def test_nodes_that_lie_unpressed_in_a_row_are_taken_away_but_not_where_it_ends():
    nodes = np.sort(np.concatenate((np.linspace(0.0, 1.0, 21), (0.325, 0.475, 0.525))))
    near, on = np.zeros((nodes.size, contact_near.NEAR)), np.full((nodes.size, ON), BARE)
    on[:, :2] = 0
    near[:, GAP] = 1e-3
    row = (nodes > 0.29) & (nodes < 0.71)
    near[row, GAP] = 1e-9
    on[~row | (np.abs(nodes - 0.5) < 0.01), 0] = BARE
    spacing, middles = np.full(20, 0.05), np.linspace(0.025, 0.975, 20)
    fewer = mesh.thinned(nodes, near, on, spacing, middles, np.empty(0), full=True, coarse=True)
    assert fewer is not None
    assert mesh.thinned(nodes, near, on, spacing, middles, np.empty(0), full=False, coarse=True) is None
    gone = np.setdiff1d(nodes, fewer)
    assert gone.size == 2
    assert ((gone > 0.45) & (gone < 0.55)).all()


def test_nodes_are_no_contacts_where_places_are_not_known_that_well():
    near, on = np.zeros((8, contact_near.NEAR)), np.full((8, 2), 0)
    near[:, GAP] = (math.inf, -9e-4, -1e-3, -9e-4, -1e-3, -9e-4, -2e-3, math.inf)
    on[:, 0] = (BARE, BARE, 0, BARE, 0, BARE, BARE, BARE)
    on[(0, 7), 1] = BARE
    off = contact_set.misplaced(near, on)
    assert off == 1e-3
    assert contact_set.grow(near, on, 1e-6, off, False) == 2
    assert list(on[:, 0] != BARE) == [False, False, True, True, True, False, True, False]
    assert contact_set.misplaced(np.zeros((3, contact_near.NEAR)), np.full((3, 2), BARE)) == 0.0


def test_more_elements_than_allowed_are_not_asked_for():
    assert mesh.first_count(1.0, 1e-9 * WEIGHT, WEIGHT) == mesh.MOST_AT_FIRST < laid_out.MOST_ELEMENTS
