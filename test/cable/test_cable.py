"""The cable: defaults, refusals by name, files, and what it says of itself."""

import copy
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cable_shape as cs

GOOD: dict[str, Any] = {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.01, "twisting_stiffness": 0.008}


def test_one_stiffness_means_both_and_defaults_are_documented_ones() -> None:
    cable = cs.Cable(1.2, 0.1, 0.013)
    assert cable.bending_stiffness == (0.013, 0.013)
    assert math.isclose(cable.twisting_stiffness, 0.01)
    assert cable.gradient_length == cable.diameter == 0.008
    assert cable.axial_stiffness is None
    assert cable.shear_stiffness is None


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("length", 0.0, r"length = 0.0 .*above 0 m"),
        ("length", -1.0, r"length = -1.0 .*above 0 m"),
        ("length", math.nan, r"length = nan .*finite"),
        ("length", "long", r"length = 'long' .*number"),
        ("linear_density", -0.1, r"linear_density = -0.1 .*at least 0 kg/m"),
        ("bending_stiffness", -0.01, r"bending_stiffness = -0.01 .*at least 0 N m\^2.*Give EI"),
        ("bending_stiffness", (0.01, -0.01), r"bending_stiffness = .*at least 0"),
        ("bending_stiffness", (0.01, 0.0), r"bending_stiffness = .*both or neither"),
        ("bending_stiffness", (1, 2, 3), r"bending_stiffness = .*shape \(2,\)"),
        ("twisting_stiffness", -1.0, r"twisting_stiffness = -1.0 .*above 0 N m\^2"),
        ("twisting_stiffness", 0.0, r"twisting_stiffness = 0.0 .*above 0"),
        ("axial_stiffness", 0.0, r"axial_stiffness = 0.0 .*above 0 N"),
        ("shear_stiffness", math.inf, r"shear_stiffness = inf .*finite"),
        ("rest_curvature", (0, 0), r"rest_curvature = .*\(3,\) or \(n, 3\)"),
        ("rest_curvature", [[0, 0, 0]], r"rest_curvature = .*\(3,\) or \(n, 3\)"),
        ("rest_curvature", (0, math.nan, 0), r"rest_curvature = .*finite"),
        ("diameter", 0.0, r"diameter = 0.0 .*above 0 m"),
        ("min_bend_radius", -1.0, r"min_bend_radius = -1.0 .*above 0 m"),
    ],
)
def test_bad_values_are_refused_with_value_bound_and_remedy(key: str, value: Any, message: str) -> None:
    with pytest.raises(cs.ArgumentError, match=message):
        cs.Cable(**{**GOOD, key: value})


def test_yaml_round_trip_and_errors_that_name_the_file(tmp_path: Path) -> None:
    file = tmp_path / "cable.yaml"
    file.write_text("length: 1.2\nlinear_density: 0.1\nbending_stiffness: 0.01\ntwisting_stiffness: 0.008\n")
    assert cs.Cable.from_yaml(file) == cs.Cable(**GOOD)
    file.write_text("length: 1.2\nlinear_density: 0.1\nbending_stifness: 0.01\n")
    with pytest.raises(
        cs.UnknownKeyError, match=r"cable.yaml: unknown key 'bending_stifness'. Did you mean 'bending_s"
    ):
        cs.Cable.from_yaml(file)
    file.write_text("length: 1.2\nlinear_density: 0.1\n")
    with pytest.raises(cs.ArgumentError, match=r"cable.yaml: .*bending_stiffness.*Add the missing key"):
        cs.Cable.from_yaml(file)
    file.write_text("length: -1.2\nlinear_density: 0.1\nbending_stiffness: 0.01\n")
    with pytest.raises(cs.ArgumentError, match=r"cable.yaml: length = -1.2 is not allowed"):
        cs.Cable.from_yaml(file)
    file.write_text("length: [1\n")
    with pytest.raises(cs.ArgumentError, match=r"cable.yaml, line 2, key 'length': not well formed: .* expected ','"):
        cs.Cable.from_yaml(file)
    with pytest.raises(cs.ArgumentError, match="no such file"):
        cs.Cable.from_yaml(tmp_path / "none.yaml")


def test_from_material_uses_the_formulas_of_a_tube() -> None:
    cable = cs.Cable.from_material(
        1.0,
        diameter=0.01,
        inner_diameter=0.006,
        youngs_modulus=2e7,
        poisson_ratio=0.4,
        density=1200.0,
        allowable_stress=1e6,
    )
    # independent: integrate over the section numerically
    r = np.linspace(0.003, 0.005, 200_001)
    area = np.trapezoid(2 * np.pi * r, r)
    polar = np.trapezoid(2 * np.pi * r**3, r)
    assert math.isclose(cable.linear_density, 1200.0 * area, rel_tol=1e-9)
    assert math.isclose(cable.bending_stiffness[0], 2e7 * polar / 2, rel_tol=1e-9)
    assert math.isclose(cable.twisting_stiffness, 2e7 / 2.8 * polar, rel_tol=1e-9)
    assert cable.axial_stiffness is not None
    assert cable.max_tension is not None
    assert cable.min_bend_radius is not None
    assert math.isclose(cable.axial_stiffness, 2e7 * area, rel_tol=1e-9)
    assert math.isclose(cable.max_tension, 1e6 * area, rel_tol=1e-9)
    assert math.isclose(cable.min_bend_radius, 2e7 * 0.01 / 2e6, rel_tol=1e-9)
    with pytest.raises(cs.ArgumentError, match=r"inner_diameter = 0.02 .*below diameter"):
        cs.Cable.from_material(1.0, 0.01, 1e7, 0.4, 1200.0, inner_diameter=0.02)
    with pytest.raises(cs.ArgumentError, match=r"poisson_ratio = 0.6 .*at most 0.5"):
        cs.Cable.from_material(1.0, 0.01, 1e7, 0.6, 1200.0)


def test_describe_catches_a_slip_of_units() -> None:
    rope = cs.Cable(1.0, 0.1, 0.01)
    pipe = cs.Cable(1.0, 0.1, 2e4)
    assert "hang down" in rope.describe()
    assert "would sag 0.00613 mm" in pipe.describe()
    assert "weightless" in cs.Cable(1.0, 0.0, 1.0).describe()
    assert "chain" in cs.Cable(1.0, 0.1, 0.0).describe()


def test_a_cable_is_fixed_and_replace_makes_another() -> None:
    cable = cs.Cable(**GOOD)
    with pytest.raises(AttributeError, match=r"cable.replace\(length="):
        cable.length = 2.0
    longer = cable.replace(length=2.0)
    assert longer.length == 2.0
    assert cable.length == 1.2
    assert longer != cable
    assert longer.replace(length=1.2) == cable
    assert copy.deepcopy(cable) == cable
    assert pickle.loads(pickle.dumps(cable)) == cable
