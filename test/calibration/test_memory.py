"""Rest curvature along the cable: fitted under load, and learned from a rest pose."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_calibration import TRUE, grips, rough

import cable_shape as cs
from cable_shape.calibration.parameters import ROWS, SWERVES, WANDERS, Parameters
from cable_shape.command.cli import main
from cable_shape.errors import ArgumentError

TABLE = np.array([(0.5, 3.0, 0.0), (2.0, 2.5, 0.0), (1.0, -1.0, 0.0), (-0.5, -2.5, 0.0), (-1.0, 0.0, 0.0)])
BENT = TRUE.replace(rest_curvature=TABLE)
#: d1 = z, d3 = x
UPRIGHT = Rotation.from_matrix(np.array(((0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)))).as_quat()
NAMES = [f"rest_curvature_{axis}_at_{place}" for place in (0, 25, 50, 75, 100) for axis in (1, 2)]


def at_rest(points: int = 61, cable: cs.Cable = BENT) -> np.ndarray:
    shape = cs.predict(
        cable, cs.Pose((0.1, 0.2, 0.3), UPRIGHT), None, model="cosserat", gravity=(0, 0, 0), points=points
    )
    assert shape.status is cs.Status.OK
    return shape.positions.copy()


def within(found: cs.Calibration, table: np.ndarray = TABLE) -> list[bool]:
    truth = table[:, :2].ravel().tolist()
    return [found[name].low <= value <= found[name].high for name, value in zip(NAMES, truth, strict=True)]


def test_a_rest_curvature_along_the_cable_comes_back_from_shapes_under_load() -> None:
    seen, rng = [], np.random.default_rng(8)
    for _ in range(8):
        start, end = grips(rng, 1.0)
        shape = cs.predict(BENT, start, end, model="cosserat", points=301)
        which = rng.integers(10, 290, 40)
        seen.append(cs.Observation(start, end, shape.positions[which] + 2e-4 * rng.normal(size=(40, 3))))
    found = cs.calibrate(seen, rough(TRUE, 1.3), ("bending_stiffness", "rest_curvature_along"))
    assert found.converged
    assert sum(within(found)) >= 8, [str(found[name]) for name in NAMES]
    assert max(found[name].standard_error for name in NAMES) < 0.05
    assert not any("by its prior" in remark for remark in found.remarks)
    text = found.yaml()
    assert text.count("% of the length: ") == 10
    constant = cs.calibrate(seen, rough(TRUE, 1.3), ("bending_stiffness", "rest_curvature"))
    assert constant.distances.mean() > 20.0 * found.distances.mean()


def test_where_no_point_was_seen_the_prior_is_said_to_speak() -> None:
    start, end = grips(np.random.default_rng(1), 1.0)
    shape = cs.predict(TRUE, start, end, model="cosserat", points=301)
    points = shape.positions[40:90:5] + 1e-3 * np.random.default_rng(2).normal(size=(10, 3))
    seen = cs.Observation(start, end, points, shape.arc_length[40:90:5])
    narrow = cs.calibrate([seen], TRUE, "rest_curvature_along", priors={"rest_curvature_along": 0.01})
    assert sum("known by its prior" in remark for remark in narrow.remarks) >= 4
    change = narrow["rest_curvature_1_at_75"].value - narrow["rest_curvature_1_at_100"].value
    assert abs(change) < 0.005, "a random walk of 0.01 over the length"


def test_the_prior_is_a_random_walk_of_curvature_and_slope_along_the_cable() -> None:
    parameters = Parameters(TRUE.replace(length=2.0), ("length", "rest_curvature_along"), {"length": 0.1})
    precision = parameters.precision
    assert precision[0, 0] == pytest.approx(100.0)
    rng = np.random.default_rng(0)
    nodes = rng.normal(size=(ROWS, 2))
    energy = sum((ROWS - 1) / (WANDERS / 2.0) ** 2 * ((nodes[i + 1] - nodes[i]) ** 2).sum() for i in range(ROWS - 1))
    turns = nodes[2:] - 2.0 * nodes[1:-1] + nodes[:-2]
    energy += (ROWS - 1) ** 3 / (SWERVES * WANDERS / 2.0) ** 2 * (turns**2).sum()
    moved = np.concatenate(((0.0,), nodes.ravel()))
    assert moved @ precision @ moved == pytest.approx(energy)
    level = np.concatenate(((0.0,), np.tile((1.0, -2.0), ROWS)))
    assert abs(level @ precision @ level) < 1e-12


def test_a_table_of_the_cables_own_keeps_its_kinks() -> None:
    own = TRUE.replace(rest_curvature=np.array([(0, 0, 0.1), (1, 0, 0.1), (0, 2, 0.1), (0, 0, 0.4)], dtype=float))
    parameters = Parameters(own, ("rest_curvature_along",))
    table = parameters.make_cable(parameters.start).rest_curvature
    assert table.shape == (13, 3)
    np.testing.assert_allclose(table[::4], own.rest_curvature, atol=1e-12)
    moved = parameters.start.copy()
    moved[4] += 0.5  # about d1 in the middle
    change = parameters.make_cable(moved).rest_curvature - table
    np.testing.assert_allclose(change[:, 0], 0.5 * np.maximum(0.0, 1.0 - np.abs(np.arange(13) - 6) / 3.0), atol=1e-12)
    assert not change[:, 1:].any()


def test_a_rest_pose_is_remembered_with_error_bars() -> None:
    inside = []
    for seed in range(10):
        points = at_rest()[::2]
        points += 5e-4 * np.random.default_rng(seed).normal(size=points.shape)
        found = cs.rest_curvature_from(points, TRUE)
        assert found.converged
        inside += within(found)
    # of 100 intervals of 95 %; correlated within a pose
    assert sum(inside) >= 85
    np.testing.assert_allclose(found.cable.rest_curvature, TABLE, atol=0.5)
    assert found.distances.mean() < 1e-3


def test_exact_points_are_remembered_exactly() -> None:
    found = cs.rest_curvature_from(at_rest(201), TRUE)
    np.testing.assert_allclose(found.cable.rest_curvature, TABLE, atol=0.02)
    circle = TRUE.replace(rest_curvature=(0.0, 4.0, 0.0))
    found = cs.rest_curvature_from(at_rest(201, circle))
    assert found.cable.length == pytest.approx(1.0, rel=1e-4)
    np.testing.assert_allclose(found.cable.rest_curvature, np.tile((0.0, 4.0, 0.0), (5, 1)), atol=0.02)


def test_the_side_that_is_up_is_chosen_by_d1() -> None:
    """Another d1 turns the table about d3: here by a quarter."""
    points = at_rest(101)
    up = cs.rest_curvature_from(points, TRUE).cable.rest_curvature
    side = cs.rest_curvature_from(points, TRUE, d1=(0.0, -1.0, 0.0)).cable.rest_curvature  # was d2
    np.testing.assert_allclose(side[:, 0], up[:, 1], atol=0.02)
    np.testing.assert_allclose(side[:, 1], -up[:, 0], atol=0.02)


def test_bad_points_are_named() -> None:
    points = at_rest()
    for wrong, words in (
        (points[:5], "m >= 8"),
        (2.0 * points, "as long as the cable"),
        (np.where(points > 0.5, math.nan, points), "finite"),
        (np.repeat(points, 2, axis=0), "apart"),
        ("points", "numbers"),
    ):
        with pytest.raises(ArgumentError, match=words):
            cs.rest_curvature_from(wrong, TRUE)
    with pytest.raises(ArgumentError, match="along the cable"):
        cs.rest_curvature_from(np.linspace((0, 0, 0), (1, 0, 0), 20), TRUE, d1=(1.0, 0.0, 0.0))
    with pytest.raises(ArgumentError, match="Fit one of them"):
        Parameters(TRUE, ("rest_curvature", "rest_curvature_along"))


def test_the_command_learns_from_a_rest_pose(tmp_path: Path, capsys) -> None:
    np.savetxt(tmp_path / "rest.csv", at_rest(), delimiter=",", header="x,y,z", comments="")
    out = tmp_path / "cable.yaml"
    command = ["calibrate", str(tmp_path / "rest.csv"), "--rest", "--length", "1.0", "--mass", "0.06", "-o", str(out)]
    assert main(command) == 0
    assert cs.Cable.from_yaml(out).rest_curvature.shape == (5, 3)
    (tmp_path / "wrong.csv").write_text("a,b\n1,2\n")
    assert main(["calibrate", str(tmp_path / "wrong.csv"), *command[2:]]) == 2
    assert "columns x, y, z" in capsys.readouterr().err
