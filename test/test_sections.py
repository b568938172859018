"""Cables whose properties change along them, and bundles of wires."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.wires import packed

ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
START, END = cs.Pose((0.0, 0.0, 0.0), ALONG), cs.Pose((0.8, 0.05, 0.1), ALONG)
PARTS = (
    cs.Section(0.3, 0.7, bending_stiffness=0.03, linear_density=0.2, rest_curvature=(1.0, 0.0, 0.0)),
    cs.Section(0.7, 0.8, bending_stiffness=(0.005, 0.007)),
)
CABLE = cs.Cable(1.2, 0.1, 0.01, 0.008, sections=PARTS)


def split() -> cs.Harness:
    """The same, a segment a section."""
    plain = cs.Cable(0.3, 0.1, 0.01, 0.008)
    segments = {
        "a": plain,
        "b": cs.Cable(0.4, 0.2, 0.03, 0.008, rest_curvature=(1.0, 0.0, 0.0)),
        "c": cs.Cable(0.1, 0.1, (0.005, 0.007), 0.008),
        "d": plain.replace(length=0.4),
    }
    joints = [cs.Junction(x + y, (f"{x}.end", f"{y}.start")) for x, y in ("ab", "bc", "cd")]
    return cs.Harness(segments, joints)


@pytest.mark.parametrize("of_harness", [False, True])
def test_sections_are_segments_in_a_row(of_harness):
    """Which are checked against collocation: to 1e-9 of the length, with forces, moments and energy; masses too."""
    mass = {"masses": [cs.PointMass(0.4, 0.05, segment="x" if of_harness else None)]}
    other = cs.Scene(masses=[cs.PointMass(0.1, 0.05, segment="b")])
    acceleration = np.array((0.5, -1.0, 2.0))
    two = cs.predict(
        split(), {"a.start": START, "d.end": END}, tolerance=1e-9, points=41, scene=other,
        acceleration=dict.fromkeys("abcd", acceleration),
    )  # fmt: skip
    scene, whole = cs.Scene(**mass), cs.Harness({"x": CABLE}) if of_harness else CABLE
    one = cs.Predictor(whole, tolerance=1e-9, points=241, scene=scene)
    if of_harness:
        found = one.predict({"x.start": START, "x.end": END}, acceleration={"x": acceleration})
        shape = found.segments["x"]
        assert found.energy == pytest.approx(two.energy, abs=1e-8)
    else:
        shape = one.predict(START, END, acceleration=acceleration)
        assert shape.energy == pytest.approx(two.energy, abs=1e-8)
    assert shape.status is cs.Status.OK
    for name, first in (("a", 0.0), ("b", 0.3), ("c", 0.7), ("d", 0.8)):
        part = two.segments[name]
        i = round(first / 0.005)
        j = i + round(part.length / 0.005)
        assert np.abs(shape.positions[[i, j]] - part.positions[[0, -1]]).max() < 1e-9
        assert np.abs(shape.force[[i, j]][1:] - part.force[-1]).max() < 1e-7
        assert np.abs(shape.moment[[i, j]] - part.moment[[0, -1]]).max() < 1e-8


def test_a_warm_start_and_a_table_of_accelerations_keep_sections():
    """A table linear between its rows, with kinks inside sections, against many short rows of the same."""
    table = np.array(((0.0, 0.0, 0.0), (4.0, 1.0, 0.0), (0.0, 0.0, 2.0), (1.0, 0.0, 0.0)))
    fine = np.stack([np.interp(np.linspace(0, 3, 31), range(4), column) for column in table.T], axis=1)
    predictor = cs.Predictor(CABLE, tolerance=1e-8)
    predictor.predict(START, END)
    one = predictor.predict(START, END, acceleration=table)
    other = cs.predict(CABLE, START, END, acceleration=fine, tolerance=1e-8)
    assert one.status is cs.Status.OK
    assert np.abs(one.positions - other.positions).max() < 1e-7
    near = predictor.predict(START, cs.Pose(END.position + 1e-3, ALONG))
    assert near.iterations <= 8


@pytest.mark.parametrize("by", ["length", "linear_density", "bending_stiffness", "twisting_stiffness"])
def test_derivatives_by_numbers_of_the_rest_of_the_cable_are_differences(by):
    predictor = cs.Predictor(CABLE, tolerance=1e-9, points=31)
    predictor.predict(START, END)
    found = predictor.sensitivity(by=(by,))[:, :, 0]
    shapes, step = [], 1e-4
    for sign in (1.0, -1.0):
        factor = 1.0 + sign * step
        if by == "length":
            parts = [cs.Section(factor * one.start, factor * one.end, **one.properties) for one in PARTS]
            other = CABLE.replace(sections=None).replace(length=factor * 1.2, sections=parts)
        else:
            value = CABLE.mean_bending_stiffness if by == "bending_stiffness" else getattr(CABLE, by)
            other = CABLE.replace(**{by: factor * value})
        shapes.append(cs.predict(other, START, END, tolerance=1e-9, points=31).positions)
    unit = CABLE.mean_bending_stiffness if by == "bending_stiffness" else getattr(CABLE, by)
    difference = (shapes[0] - shapes[1]) / (2.0 * step * unit)
    np.testing.assert_allclose(found, difference, rtol=1e-3, atol=1e-3 * np.abs(found).max())


def test_stress_is_that_of_the_section():
    thick = cs.Cable(1.0, 0.1, 0.01, diameter=0.008, sections=[cs.Section(0.4, 0.6, diameter=0.016)])
    shape = cs.predict(thick, START, END, points=101)
    whole = cs.stress_of(thick.replace(sections=None), shape).von_mises
    other = cs.stress_of(thick.replace(sections=None, diameter=0.016), shape).von_mises
    found = cs.stress_of(thick, shape).von_mises
    np.testing.assert_array_equal(found[:40], whole[:40])
    np.testing.assert_array_equal(found[41:60], other[41:60])


def test_a_cable_with_sections_is_read_as_it_is_written(tmp_path):
    assert cs.Cable.from_mapping(CABLE.as_dict()) == CABLE
    assert pickle.loads(pickle.dumps(CABLE)) == CABLE
    file = tmp_path / "cable.yaml"
    file.write_text(
        "length: 1.2\nlinear_density: 0.1\nbending_stiffness: 0.01\ntwisting_stiffness: 0.008\nsections:\n"
        "  - {start: 0.7, end: 0.8, bending_stiffness: [0.005, 0.007]}\n"
        "  - {start: 0.3, end: 0.7, bending_stiffness: 0.03, linear_density: 0.2, rest_curvature: [1, 0, 0]}\n"
    )
    assert cs.Cable.from_yaml(file) == CABLE


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: cs.Section(0.5, 0.5), r"Section.end = 0.5 .* above 0.5 m"),
        (lambda: cs.Section(0.1, 0.2, length=1.0), r"unknown key 'length'"),
        (lambda: CABLE.replace(sections=[cs.Section(0.1, 1.3)]), r"sections: end = 1.3 .* at most the length .* 1.2 m"),
        (
            lambda: CABLE.replace(sections=[cs.Section(0.1, 0.5), cs.Section(0.4, 0.6)]),
            r"sections: start = 0.4 .* overlaps the section that ends at 0.5 m",
        ),
        (lambda: CABLE.replace(sections=[cs.Section(0.1, 0.5, diameter=-1.0)]), r"sections\[0\]: .*diameter = -1.0"),
        (
            lambda: CABLE.replace(sections=[cs.Section(0.1, 0.5, bending_stiffness=0.0, twisting_stiffness=0.0)]),
            r"needs it above 0 N m\^2",
        ),
        (
            lambda: cs.predict_batch(CABLE, np.array([START.array]), np.array([END.array])),
            r"cable.sections = 2 .* knows no sections",
        ),
        (lambda: CABLE.replace(sections="stiff"), r"sections = 'stiff' .* a list"),
        (lambda: cs.predict(CABLE, START, END, model="gradient4"), r"cable.sections = 2 .* model 'gradient4'"),
        (lambda: cs.predict(CABLE, START, END, scene=cs.Scene(contact="solve")), r"contact='solve' knows no sections"),
        (lambda: cs.Cycle(CABLE), r"cable.sections = 2 .* knows no sections"),
        (lambda: cs.Wire(0.001, 0.01), r"one of the two is needed"),
        (lambda: cs.Wire(0.001, 0.01, youngs_modulus=1e9, count=0), r"Wire.count = 0"),
        (lambda: cs.Cable.from_wires([], 1.0), r"1 to 400 wires"),
        (
            lambda: cs.Cable.from_wires([cs.Wire(0.002, 0.01, 1e-4, count=7)], 1.0, cs.Wire(0.005, 0.01, 1e-4)),
            r"covering.outside_diameter = 0.005 .* 0.006 m",
        ),
        (lambda: CABLE.replace(stiffness_interval=(2.0, 1.0)), r"stiffness_interval = \[2.0, 1.0\]"),
    ],
)  # fmt: skip
def test_bad_input_names_the_part(make, told):
    with pytest.raises(cs.ArgumentError, match=told):
        make()


# -- bundles


def test_equal_wires_are_packed_in_hexagons():
    for count, layers in ((7, 1), (19, 2), (37, 3)):
        places, diameter = packed([1.0] * count)
        assert diameter == pytest.approx(2 * layers + 1, rel=1e-9)
        apart = np.linalg.norm(places[:, None] - places, axis=2)[np.triu_indices(count, 1)]
        assert apart.min() == pytest.approx(1.0)
    mixed, diameter = packed([2.0, 1.0, 1.5, 1.0, 0.5, 1.2])
    gaps = np.linalg.norm(mixed[:, None] - mixed, axis=2)
    radii = 0.5 * np.array([2.0, 1.0, 1.5, 1.0, 0.5, 1.2])
    assert (gaps + 10.0 * np.eye(6) - radii[:, None] - radii).min() > -1e-9
    assert (np.linalg.norm(mixed, axis=1) + radii).max() <= 0.5 * diameter + 1e-12


def test_the_stiffness_of_a_bundle_is_from_full_slip_to_full_stick():
    """Seven alike: 7 EI, and 7 EI + EA 6 d^2 / 2 with EA = 16 EI / d^2, that is 55 EI; a tube adds its own."""
    young, d = 2e9, 0.002
    own = young * math.pi / 64.0 * d**4
    cable = cs.Cable.from_wires([cs.Wire(d, 0.01, youngs_modulus=young, count=7)], 1.5)
    low, high = cable.stiffness_interval
    assert cable.mean_bending_stiffness == low == pytest.approx(7 * own)
    assert high == pytest.approx(55 * own)
    assert cable.diameter == pytest.approx(3 * d)
    assert cable.linear_density == pytest.approx(0.07)
    assert cable.stiffness_spread == pytest.approx(48.0 / 7.0 / math.sqrt(12.0))
    single = cs.Cable.from_wires([cs.Wire(d, 0.01, 1e-4)], 1.5)
    assert single.stiffness_interval == (1e-4, 1e-4)
    taped = cs.Cable.from_wires(
        [cs.Wire(d, 0.01, youngs_modulus=young, count=7)], 1.5, cs.Wire(0.007, 0.02, youngs_modulus=1e8)
    )
    tube = 1e8 * math.pi / 64.0 * (0.007**4 - 0.006**4)
    assert taped.mean_bending_stiffness == pytest.approx(7 * own + tube)
    assert taped.diameter == 0.007
    assert cs.Cable.from_mapping(taped.as_dict()) == taped
    assert cs.predict(taped, START, END).usable
