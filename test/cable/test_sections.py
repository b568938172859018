"""Cables whose properties change along them, and bundles of wires."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.cable.pieces import changed, pieces_of
from cable_shape.cable.wires import packed

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
        (lambda: CABLE.replace(sections="stiff"), r"sections = 'stiff' .* a list"),
        (lambda: cs.predict(CABLE, START, END, model="gradient4"), r"cable.sections = 2 .* model 'gradient4'"),
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


# -- what is judged by local values

LIMITED = cs.Cable(
    1.2, 0.1, 0.01, 0.008, diameter=0.01, min_bend_radius=0.05, max_tension=30.0, max_twist_rate=9.0,
    allowable_stress=5e6,
    sections=[
        cs.Section(0.3, 0.5, bending_stiffness=0.05, diameter=0.03, min_bend_radius=0.3, max_tension=3.0),
        cs.Section(0.9, 1.0, diameter=0.006, allowable_stress=1e5, max_twist_rate=1e-3),
    ],
)  # fmt: skip
TURNED = cs.Pose((0.7, 0.1, 0.0), (0.0, 0.6, 0.0, 0.8))


def local(values: dict[tuple[float, float], float], arc_length: np.ndarray, base: float) -> np.ndarray:
    """A property at arc lengths: that of the stretches named, else the base."""
    out = np.full(len(arc_length), base)
    for (start, end), value in values.items():
        out[(arc_length >= start) & (arc_length <= end)] = value
    return out


def test_margins_are_those_of_the_piece_that_uses_most_of_its_limit():
    cycle = cs.Cycle(LIMITED, points=241)
    report = cycle.step({"cable": (START, TURNED)}, stamp=0)
    shape = report.shapes["cable"]
    assert shape.status is cs.Status.OK
    s, found = shape.arc_length, {margin.kind.name: margin for margin in report.margins["cable"]}
    bend = np.hypot(shape.curvature[:, 0], shape.curvature[:, 1])
    inside = local({(0.3, 0.5): 1.0}, s, 0.0) > 0.0
    used = {
        "BEND_RADIUS": np.where(inside, 0.3, 0.05) * bend,
        "TENSION": shape.tension / np.where(inside, 3.0, 30.0),
        "TWIST_RATE": np.abs(shape.curvature[:, 2]) / local({(0.9, 1.0): 1e-3}, s, 9.0),
    }
    for name, along in used.items():
        i = int(along.argmax())
        assert found[name].used == pytest.approx(along[i], rel=1e-12), name
        assert found[name].arc_length == pytest.approx(s[i])
    stress = cs.stress_of(LIMITED, shape).von_mises / local({(0.9, 1.0): 1e5}, s, 5e6)
    assert found["STRESS"].used == pytest.approx(stress.max(), rel=0.05)  # at borders both pieces are judged
    assert found["STRESS"].used >= stress.max() * (1.0 - 1e-12)
    assert math.isfinite(found["STABILITY"].value)


def test_a_thick_section_is_as_near_as_it_is_thick():
    floor = cs.Scene(obstacles=[cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.6)))], warn_distance=2.0)
    report = cs.Cycle(LIMITED, scene=floor, points=241).step({"cable": (START, TURNED)}, stamp=0)
    shape, near = report.shapes["cable"], report.clearance["cable"].closest
    radius = 0.5 * local({(0.3, 0.5): 0.03, (0.9, 1.0): 0.006}, shape.arc_length, 0.01)
    heights = shape.positions[:, 2] + 0.6 - radius
    assert near.distance == pytest.approx(heights.min(), abs=1e-4)
    thin = cs.Cycle(LIMITED.replace(sections=[]), scene=floor, points=241).step({"cable": (START, TURNED)}, stamp=0)
    assert near.distance < thin.clearance["cable"].closest.distance


def test_batches_and_motions_of_sections_are_those_of_single_shapes():
    ends = np.array([TURNED.array, END.array])
    batch = cs.predict_batch(LIMITED, np.array([START.array] * 2), ends)
    for row, end in enumerate((TURNED, END)):
        assert batch.status[row] == cs.Status.OK.value
        shape = cs.predict(LIMITED, START, end)
        np.testing.assert_allclose(batch.positions[row], shape.positions, atol=1e-9)
    path = cs.GripPath(np.array([START.array] * 2), ends)
    found = cs.check_trajectory(LIMITED.replace(sections=[cs.Section(0.3, 0.5, min_bend_radius=0.9)]), None, None, path)
    assert found.first is not None
    assert found.first.reason.name == "BEND_RADIUS"
    assert cs.check_trajectory(CABLE, None, None, path).valid


def test_a_harness_with_a_protection_and_a_tail_of_sections_go_through_cycles():
    harness = cs.Harness({"x": LIMITED, "y": CABLE.replace(length=0.9)}, [cs.Junction("j", ends=("x.end", "y.start"))])
    report = cs.Cycle({"h": harness}).step({"h": {"x.start": START, "y.end": cs.Pose((1.4, 0.0, 0.0), ALONG)}}, stamp=0)
    assert report.shapes["h"].usable
    assert {margin.kind.name for margin in report.margins["h/x"]} >= {"BEND_RADIUS", "TENSION", "STRESS"}
    tailed = LIMITED.replace(tails={"end": 0.2})
    report = cs.Cycle(tailed).step({"cable": (START, TURNED)}, stamp=0)
    assert [tail.length for tail in report.tails.values()] == [0.2]


def test_what_a_cable_is_made_of_is_found_once():
    """Every cycle asks for it."""
    assert pieces_of(CABLE) is pieces_of(CABLE)
    assert pieces_of(CABLE.replace(sections=PARTS[:1])) != pieces_of(CABLE)


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
    each = np.log(np.linspace(1.0, 55.0 / 7.0, 100_001))
    assert cable.stiffness_spread == pytest.approx(np.sqrt((each**2).mean()), rel=1e-4)
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


def test_a_calibration_of_a_cable_with_sections_means_all_of_it():
    """Sections keep their ratio to the rest, and where along it they are."""
    true = changed(CABLE, bending_stiffness=0.014, twisting_stiffness=0.0112)
    assert true.sections[0].as_dict() == {
        key: 1.4 * x if "stiffness" in key else x for key, x in CABLE.sections[0].as_dict().items()
    }
    looks = []
    for y in (-0.1, 0.0, 0.15):
        end = cs.Pose(END.position + np.array((0.0, y, 0.05)), END.quaternion)
        looks.append(cs.Observation(START, end, cs.predict(true, START, end).positions[10:-10:12]))
    found = cs.calibrate(looks, CABLE)
    assert found["bending_stiffness"].value == pytest.approx(0.014, rel=5e-3)
    assert found.cable.sections[0].properties["bending_stiffness"] == pytest.approx(
        true.sections[0].properties["bending_stiffness"], rel=5e-3
    )
    longer = changed(CABLE, length=2.4)
    assert [(one.start, one.end) for one in longer.sections] == [(2 * p.start, 2 * p.end) for p in CABLE.sections]
