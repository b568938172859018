"""Von Mises stress: hand formulas, and brute force over all fibres of the section."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.safety.loads import most_loaded
from cable_shape.safety.stress import section_of

OUTER, INNER = 0.010, 0.007  # m
SOLID = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, diameter=OUTER, allowable_stress=1e7)
TUBE = SOLID.replace(inner_diameter=INNER)


def loaded(force, moment, quaternions=((0.0, 0.0, 0.0, 1.0),)) -> cs.CableShape:
    """A shape with these loads [N, N m] at its points, given in the cable frame."""
    force, moment, frames = np.atleast_2d(force), np.atleast_2d(moment), Rotation.from_quat(quaternions)
    points = len(force)
    shape = cs.CableShape(np.zeros(17 * points), points, length=1.0, model="test", status=cs.Status.OK)
    shape.arc_length[:] = np.linspace(0.0, 1.0, points)
    shape.quaternions[:] = frames.as_quat()
    shape.force[:] = frames.apply(force)
    shape.moment[:] = frames.apply(moment)
    return shape


def stress(cable: cs.Cable, force, moment) -> float:
    return float(cs.stress_of(cable, loaded(force, moment)).von_mises[0])


def section(outer: float, inner: float) -> tuple[float, float]:
    """Area and second moment of area."""
    return math.pi / 4 * (outer**2 - inner**2), math.pi / 64 * (outer**4 - inner**4)


@pytest.mark.parametrize(("cable", "inner"), [(SOLID, 0.0), (TUBE, INNER)])
def test_each_load_alone_is_the_hand_formula(cable, inner):
    area, inertia = section(OUTER, inner)
    r = 0.5 * OUTER
    assert stress(cable, (0, 0, 30.0), (0, 0, 0)) == pytest.approx(30.0 / area)
    assert stress(cable, (0, 0, -30.0), (0, 0, 0)) == pytest.approx(30.0 / area)
    assert stress(cable, (0, 0, 0), (0.3, -0.4, 0)) == pytest.approx(0.5 * r / inertia)
    assert stress(cable, (0, 0, 0), (0, 0, 0.2)) == pytest.approx(math.sqrt(3.0) * 0.2 * r / (2.0 * inertia))
    # V Q / (I b) at the neutral axis: Q the first moment of half the section, b its width there
    first = 2.0 / 3.0 * (r**3 - (0.5 * inner) ** 3)
    assert stress(cable, (3.0, 4.0, 0), (0, 0, 0)) == pytest.approx(
        math.sqrt(3.0) * 5.0 * first / (inertia * (OUTER - inner))
    )


def test_shear_factor_goes_from_a_solid_section_to_a_thin_tube():
    assert section_of(SOLID)[4] == pytest.approx(4.0 / 3.0)
    assert section_of(SOLID.replace(inner_diameter=0.9999 * OUTER))[4] == pytest.approx(2.0, abs=1e-3)


def test_tension_and_bending_add_on_the_pulled_side():
    area, inertia = section(OUTER, 0.0)
    both = 30.0 / area + 0.5 * 0.5 * OUTER / inertia
    assert stress(SOLID, (0, 0, 30.0), (0.3, 0.4, 0)) == pytest.approx(both)
    assert stress(SOLID, (0, 0, -30.0), (0.3, 0.4, 0)) == pytest.approx(both), "on the pressed side"


def brute_force(cable: cs.Cable, force: np.ndarray, moment: np.ndarray, inner: float) -> float:
    """The largest von Mises stress on a fine grid of fibres of the surface, from stress components in the section."""
    area, inertia = section(OUTER, inner)
    r = 0.5 * OUTER
    angle = np.linspace(0.0, 2.0 * np.pi, 200_001)
    x, y = r * np.cos(angle), r * np.sin(angle)
    sigma = force[2] / area + (moment[0] * y - moment[1] * x) / inertia
    along = np.stack((-np.sin(angle), np.cos(angle)))  # direction of increasing angle
    peak = 4.0 / 3.0 * (OUTER**2 + OUTER * inner + inner**2) / (OUTER**2 + inner**2) / area
    tau = moment[2] * r / (2.0 * inertia) + peak * (force[:2] @ along)
    return float(np.sqrt(sigma**2 + 3.0 * tau**2).max())


@pytest.mark.parametrize(("cable", "inner"), [(SOLID, 0.0), (TUBE, INNER)])
def test_worst_fibre_is_that_of_brute_force(cable, inner):
    rng = np.random.default_rng(3)
    for _ in range(60):
        force = rng.normal(size=3) * 10.0 ** rng.uniform(-1, 3)
        moment = rng.normal(size=3) * 10.0 ** rng.uniform(-3, 0)
        assert stress(cable, force, moment) == pytest.approx(brute_force(cable, force, moment, inner), rel=1e-8)


def test_the_world_frame_does_not_matter():
    rng = np.random.default_rng(4)
    force, moment = rng.normal(size=(20, 3)), 0.01 * rng.normal(size=(20, 3))
    frames = Rotation.random(20, random_state=5).as_quat()
    a = cs.stress_of(TUBE, loaded(force, moment, np.tile((0.0, 0.0, 0.0, 1.0), (20, 1)))).von_mises
    np.testing.assert_allclose(cs.stress_of(TUBE, loaded(force, moment, frames)).von_mises, a, rtol=1e-12)


def test_the_section_found_without_searching_all_fibres_is_the_most_stressed():
    rng = np.random.default_rng(6)
    for _ in range(30):
        shape = loaded(
            rng.normal(size=(40, 3)) * 100.0, rng.normal(size=(40, 3)), Rotation.random(40, random_state=7).as_quat()
        )
        stresses = cs.stress_of(TUBE, shape)
        *_, at, worst = most_loaded(shape.buffer, shape.points, 0, shape.points, section_of(TUBE))
        assert at == stresses.worst
        assert worst == stresses.von_mises.max()


def test_safety_factor():
    area, _ = section(OUTER, 0.0)
    shape = loaded((0, 0, 30.0), (0, 0, 0))
    assert cs.stress_of(SOLID, shape).safety_factor == pytest.approx(1e7 * area / 30.0)
    assert cs.stress_of(SOLID, loaded((0, 0, 0), (0, 0, 0))).safety_factor == math.inf
    assert math.isnan(cs.stress_of(SOLID.replace(allowable_stress=None), shape).safety_factor)


def test_a_cantilever_from_its_material_has_the_stress_of_beam_theory():
    """A tip load P on a stiff rod: M = P L at the clamp."""
    cable = cs.Cable.from_material(
        length=0.3, diameter=OUTER, inner_diameter=INNER, youngs_modulus=2e11, poisson_ratio=0.3, density=0.0,
        allowable_stress=2e8,
    )  # fmt: skip
    start = cs.Pose((0, 0, 0), (0.5, 0.5, 0.5, 0.5))
    shape = cs.predict(cable, start, cs.FreeEnd(force=(0, 0, -2.0)), model="cosserat")
    _, inertia = section(OUTER, INNER)
    bending = 2.0 * 0.3 * 0.5 * OUTER / inertia
    stresses = cs.stress_of(cable, shape)
    assert stresses.worst == 0
    assert stresses.von_mises[0] == pytest.approx(bending, rel=1e-3)
    assert cable.inner_diameter == INNER
    assert cable.allowable_stress == 2e8


@pytest.mark.parametrize(
    ("keywords", "says"),
    [
        ({"inner_diameter": 0.02}, r"inner_diameter = 0.02 is not allowed: it must be below diameter = 0.01 m"),
        ({"inner_diameter": -0.001}, "inner_diameter = -0.001 is not allowed: it must be at least 0 m"),
        ({"allowable_stress": 0.0}, "allowable_stress = 0.0 is not allowed: it must be above 0 Pa"),
    ],
)
def test_bad_sections_are_refused(keywords, says):
    with pytest.raises(cs.ArgumentError, match=says):
        SOLID.replace(**keywords)
