"""Rest curvature along a cable with any number of supports, found again and chosen, and errors told truthfully."""

import math
from pathlib import Path

import numpy as np
import pytest
from test_calibration import TRUE, grips, rough
from truth_data import DATA, load
from truth_synthetic import drawn, recovered_along

import cable_shape as cs
from cable_shape.calibration.forward import Forward
from cable_shape.calibration.parameters import Parameters, along, smoothness, supports_in
from cable_shape.calibration.robust import Robust
from cable_shape.calibration.supports import parts_of
from cable_shape.errors import ArgumentError

ALONG = "rest_curvature_along"
recorded = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recordings of real cables at {DATA.parent.name}/{DATA.name}"
)


def seen_of(cable: cs.Cable, count: int, seed: int = 4, noise: float = 5e-4, groups: int = 6) -> list[cs.Observation]:
    """Observations of 20 points each, in groups."""
    rng, out = np.random.default_rng(seed), []
    while len(out) < count:
        start, end = grips(rng, cable.length)
        shape = cs.predict(cable, start, end, model="cosserat", points=301)
        if shape.status is cs.Status.OK:
            points = shape.positions[10:-10:14]
            points = points + noise * rng.normal(size=points.shape)
            out.append(cs.Observation(start, end, points, group=len(out) % groups))
    return out


def test_a_curvature_at_nine_supports_is_in_its_intervals() -> None:
    inside = np.concatenate([recovered_along(seed) for seed in range(6)])
    # of 6 * 19 intervals of 95 %, which go together within a cable
    assert len(inside) == 6 * 19
    assert inside.sum() >= 101


def test_auto_takes_as_many_supports_as_the_data_carry() -> None:
    wavy = TRUE.replace(rest_curvature=drawn(np.random.default_rng(1), 9, TRUE.length))
    seen = seen_of(wavy, 9)
    found = cs.calibrate(seen, rough(TRUE, 1.2), ("bending_stiffness", ALONG), supports="auto")
    assert len(found.cable.rest_curvature) == 9
    assert any(remark.startswith("9 supports by cross validation") for remark in found.remarks)
    same = cs.calibrate(seen, rough(TRUE, 1.2), ("bending_stiffness", ALONG), supports=9)
    np.testing.assert_array_equal(same.cable.rest_curvature, found.cable.rest_curvature)
    even = TRUE.replace(rest_curvature=(1.0, -0.5, 0.0))
    found = cs.calibrate(seen_of(even, 9), rough(TRUE, 1.2), ("bending_stiffness", ALONG), supports="auto")
    assert len(found.cable.rest_curvature) == 3


def test_parts_keep_groups_whole() -> None:
    groups = np.array((5, 5, 5, 5, 1, 1, -3, 2, 2, 2, -9))
    part = parts_of(groups)
    assert set(part) == {0, 1, 2}
    assert all(len(set(part[groups == g])) == 1 for g in groups)
    assert max((part == k).sum() for k in range(3)) == 4
    assert parts_of(np.array((1, 1, 2))).max() == 1


def test_the_prior_means_the_same_with_any_number_of_supports() -> None:
    x = {rows: np.linspace(0.0, 1.0, rows) for rows in (17, 33)}
    for shape in (lambda x: np.sin(2.0 * math.pi * x), lambda x: 2.0 * x, lambda x: x**2 - x):
        few, many = (shape(x[rows]) @ smoothness(rows, 3.0) @ shape(x[rows]) for rows in (17, 33))
        assert few == pytest.approx(many, rel=0.05)
    assert np.ones(9) @ smoothness(9, 3.0) @ np.ones(9) == pytest.approx(0.0, abs=1e-12)
    rough_one = np.tile((1.0, -1.0), 9)[:17]
    assert rough_one @ smoothness(17, 3.0) @ rough_one > 50.0 * few


def test_names_tell_where_supports_are() -> None:
    assert along(9)[2:4] == ("rest_curvature_1_at_12.5", "rest_curvature_2_at_12.5")
    assert len(set(along(33))) == 66
    assert supports_in(("length", ALONG, "roll"), 20) == 9
    assert supports_in(("length", ALONG), 20) == 0
    assert supports_in(("length",), 3) == 0


def test_values_go_over_to_another_number_of_supports() -> None:
    few, many = (Parameters(TRUE, ("length", ALONG, "roll"), supports=rows) for rows in (3, 5))
    values = np.array((1.01, 0.0, 1.0, 2.0, 1.0, 0.0, 3.0, 0.2))
    taken = many.taken(few, values)
    np.testing.assert_allclose(taken, (1.01, 0.0, 1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 2.0, 0.0, 3.0, 0.2))
    np.testing.assert_allclose(many.make_cable(taken).rest_curvature[::2], few.make_cable(values).rest_curvature)


@pytest.mark.parametrize(
    ("fit", "supports", "words"),
    [
        (ALONG, 2, "supports = 2 .* at least 3"),
        (ALONG, 34, "supports = 34 .* at most 33"),
        (ALONG, 5.5, "supports = 5.5"),
        (ALONG, "many", "'auto'"),
        ("length", "auto", "not fitted"),
    ],
)
def test_bad_supports_are_named(fit: str, supports: int | str, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        cs.calibrate(seen_of(TRUE, 2), TRUE, fit, supports=supports)  # type: ignore[arg-type]


def test_auto_needs_two_groups() -> None:
    with pytest.raises(ArgumentError, match="two groups"):
        cs.calibrate(seen_of(TRUE, 2, groups=1), TRUE, ALONG, supports="auto")


def test_nine_supports_make_a_tube_and_a_file(tmp_path: Path) -> None:
    found = cs.calibrate(seen_of(TRUE, 4), rough(TRUE), ("bending_stiffness", ALONG), supports=9)
    known = cs.Uncertainty.of(found)
    again = cs.Uncertainty.from_yaml(known.save(tmp_path / "spread.yaml"))
    np.testing.assert_allclose(again.covariance, known.covariance)
    assert found.yaml().count("% of the length: ") == 18
    start, end = grips(np.random.default_rng(9), 1.0)
    tube = cs.predict_tube(found, start, end)
    assert np.isfinite(tube.radius).all()
    report = cs.Cycle(found.cable, uncertainty=again).step({"cable": (start, end)}, stamp=0)
    np.testing.assert_allclose(report.tubes["cable"].radius[75], tube.radius[50], rtol=0.05)


def test_where_no_grip_holds_the_roll_the_direction_is_said_to_be_unknown() -> None:
    bent = TRUE.replace(rest_curvature=(1.0, 0.0, 0.0))
    start, end = grips(np.random.default_rng(3), 1.0)
    for kinds, unknown in ((("swivel", "swivel"), True), (("clamped", "swivel"), False)):
        ends = cs.Grip(start, kind=kinds[0]), cs.Grip(end, kind=kinds[1])
        shape = cs.predict(bent, *ends, points=61)
        found = cs.calibrate([cs.Observation(*ends, shape.positions[5:-5:5])], bent, ("length", "rest_curvature"))
        assert any("no grip holds the cable's roll" in remark for remark in found.remarks) == unknown


def test_the_roll_of_the_start_comes_back_where_the_rest_curvature_is_known() -> None:
    bent = TRUE.replace(rest_curvature=(1.5, 0.5, 0.0))
    turned = cs.Pose((0, 0, 0), (0, 0, math.sin(0.15), math.cos(0.15)))
    rng, seen = np.random.default_rng(7), []
    for _ in range(8):
        start, end = grips(rng, 1.0)
        shape = cs.predict(bent, cs.Grip(start, offset=turned), cs.Grip(end, kind="swivel"), points=101)
        points = shape.positions[5:-5:5] + 2e-4 * rng.normal(size=shape.positions[5:-5:5].shape)
        seen.append(cs.Observation(start, cs.Grip(end, kind="swivel"), points))
    found = cs.calibrate(seen, bent, ("bending_stiffness", "start_roll"))
    assert abs(found["start_roll"].value - 0.3) < 3.0 * found["start_roll"].standard_error
    assert found["start_roll"].standard_error < 0.02


def test_the_loss_that_counts_is_of_what_is_predicted_from_nothing() -> None:
    """Two branches: the one that is followed fits at -1, the one from nothing at 1; below 0 it is another one."""
    x = np.linspace(-1.0, 1.0, 50)
    design = np.zeros((50, 3, 1))
    design[:, 0, 0] = 1.0
    noise = 1e-3 * np.random.default_rng(0).normal(size=(50, 3))
    follows = [False]

    def shape(v: np.ndarray, followed: bool) -> np.ndarray:
        off = np.zeros((50, 3))
        off[:, 0] = v[0] + 1.0 if followed else v[0] - 1.0
        off[:, 1] = 0.0 if followed else 0.02 * x
        return noise - off

    def afresh(v: np.ndarray) -> np.ndarray:
        follows[0] = v[0] == -3.0  # where the fit begins
        return shape(v, follows[0])

    fit = Robust(
        lambda v: shape(v, follows[0]), lambda v, r: -design, afresh, np.full(50, 3), np.arange(50),
        np.array((10.0,)), np.zeros((1, 1)),
    ).run(np.array((-3.0,)))  # fmt: skip
    assert fit.converged
    assert fit.values[0] == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_array_equal(fit.misses, shape(fit.values, False))


def test_what_was_tried_does_not_change_where_shapes_are_followed_from() -> None:
    """Beyond a snap the other shape is found; back at once the first one is followed again, from where it was kept."""
    bent = TRUE.replace(rest_curvature=(0.0, 6.0, 0.0))
    start, end = cs.Pose((0, 0, 0), (0.5, 0.5, 0.5, 0.5)), cs.Pose((0.75, 0.0, 0.0), (0.5, 0.5, 0.5, 0.5))
    shape = cs.predict(bent, start, end, points=61)
    forward = Forward(Parameters(bent, "rest_curvature"), [cs.Observation(start, end, shape.positions[5:-5:5])])
    at = forward.parameters.start
    first = forward.misses(at)
    forward.jacobian(at, first)
    step = np.array((0.0, 0.3))
    near = forward.misses(at + step)
    far = forward.misses(at + np.array((0.0, -13.0)))
    assert np.abs(far).max() > 0.1
    np.testing.assert_array_equal(forward.misses(at + step), near)


@recorded
def test_the_error_told_is_that_of_predictions_from_nothing() -> None:
    frames = load(1, 3)
    which = np.flatnonzero(frames.kind == "quasi")[::5]
    seen = [frames.moving[i] for i in which]
    found = cs.calibrate(seen, frames.cable, ("bending_stiffness", "rest_curvature"))
    told = found.distances.reshape(len(seen), -1).mean(axis=1)
    for one, mean in zip(seen, told, strict=True):
        shape = cs.predict(found.cable, one.start, one.end, model="cosserat", points=401, acceleration=one.acceleration)
        nearest = np.linalg.norm(one.points[:, None] - shape.positions[None], axis=2).min(axis=1).mean()
        assert abs(mean - nearest) < 1e-4
