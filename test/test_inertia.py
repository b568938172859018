"""A cable that moves: its shape under density * (gravity - acceleration)."""

import numpy as np
import pytest
from rods import ALONG_X, CABLE, END, LENGTH, START
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.errors import ArgumentError

GRAVITY = np.array((0.0, 0.0, -9.81))
PUSH = np.array((1.0, -2.0, 3.0))


@pytest.mark.parametrize("model", ["cosserat", "auto", "catenary", "gradient4", "gradient6"])
def test_constant_acceleration_is_another_gravity(model: str) -> None:
    moved = cs.predict(CABLE, START, END, model=model, acceleration=PUSH)
    tilted = cs.predict(CABLE, START, END, model=model, gravity=GRAVITY - PUSH)
    tabled = cs.predict(CABLE, START, END, model=model, acceleration=np.tile(PUSH, (9, 1)))
    np.testing.assert_allclose(moved.positions, tilted.positions, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(tabled.positions, tilted.positions, rtol=0.0, atol=1e-13)


def test_masses_and_plugs_move_along() -> None:
    scene = cs.Scene(masses=[cs.PointMass(0.5, 0.02)])
    plug = cs.FreeEnd(mass=0.03)
    moved = cs.predict(CABLE, START, plug, model="cosserat", scene=scene, acceleration=PUSH)
    tilted = cs.predict(CABLE, START, plug, model="cosserat", scene=scene, gravity=GRAVITY - PUSH)
    np.testing.assert_allclose(moved.positions, tilted.positions, rtol=0.0, atol=1e-12)
    # the plug alone tells what pulls at the end
    np.testing.assert_allclose(moved.force[-1], 0.03 * (GRAVITY - PUSH), rtol=0.0, atol=1e-12)


def test_linear_acceleration_is_a_linear_load() -> None:
    table = np.linspace(PUSH, -2.0 * PUSH, 7)
    moved = cs.predict(CABLE, START, END, model="cosserat", acceleration=table)
    ends = -CABLE.linear_density * table[[0, -1]]
    loaded = cs.predict(CABLE, START, END, model="cosserat", distributed_load=ends)
    np.testing.assert_allclose(moved.positions, loaded.positions, rtol=0.0, atol=1e-13)


def planar_rod(table: np.ndarray, guess: cs.CableShape) -> np.ndarray:
    """(n, 3): the elastica of CABLE in the plane y = 0 under this acceleration, by solve_bvp at guess.arc_length.

    theta, the tangent's angle, theta' = m / EI, m' = n_x sin(theta) - n_z cos(theta), n' = -density (g - a).
    """
    rows = np.linspace(0.0, LENGTH, len(table))
    density, EI = CABLE.linear_density, CABLE.mean_bending_stiffness

    def rates(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        ax, az = np.interp(s, rows, table[:, 0]), np.interp(s, rows, table[:, 2])
        c, d = np.cos(y[2]), np.sin(y[2])
        return np.array((c, d, y[3] / EI, y[4] * d - y[5] * c, density * ax, density * (9.81 + az)))

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array((a[0], a[1], a[2], b[0] - 0.8, b[1], b[2]))

    s = np.unique(np.concatenate((guess.arc_length, rows)))
    start = np.zeros((6, len(s)))
    t = guess.tangents
    columns = (
        guess.positions[:, 0], guess.positions[:, 2], np.arctan2(t[:, 2], t[:, 0]), -guess.moment[:, 1],
        guess.force[:, 0], guess.force[:, 2],
    )  # fmt: skip
    for row, column in zip(start, columns, strict=True):
        row[:] = np.interp(s, guess.arc_length, column)
    answer = solve_bvp(rates, ends, s, start, tol=1e-9, max_nodes=200_000)
    assert answer.success, answer.message
    y = answer.sol(guess.arc_length)
    return np.stack((y[0], np.zeros_like(y[0]), y[1]), axis=1)


@pytest.mark.parametrize("rows", [2, 3, 8, 40])
def test_varying_acceleration_against_solve_bvp(rows: int) -> None:
    s = np.linspace(0.0, 1.0, rows)
    # a cable that swings in its plane: a rotating frame's field is linear, the rest is not
    table = np.stack((4.0 * s + 3.0 * np.sin(5.0 * s), 0.0 * s, 5.0 * np.cos(7.0 * s)), axis=1)
    start, end = cs.Pose((0, 0, 0), ALONG_X), cs.Pose((0.8, 0, 0), ALONG_X)
    shape = cs.predict(CABLE, start, end, model="cosserat", acceleration=table, tolerance=1e-8)
    assert shape.status is cs.Status.OK
    still = cs.predict(CABLE, start, end, model="cosserat")
    assert np.abs(still.positions - shape.positions).max() > 5e-3, "the load must matter"
    exact = planar_rod(table, shape)
    assert np.abs(exact - shape.positions).max() < 2e-8


def test_default_tolerance_is_kept_with_a_rough_field() -> None:
    table = np.random.default_rng(3).normal(size=(30, 3)) * 5.0
    coarse = cs.predict(CABLE, START, END, model="cosserat", acceleration=table)
    fine = cs.predict(CABLE, START, END, model="cosserat", acceleration=table, tolerance=1e-9)
    assert np.linalg.norm(coarse.positions - fine.positions, axis=1).max() <= 1e-5 * LENGTH


def test_warm_with_changing_acceleration_is_cold() -> None:
    rng = np.random.default_rng(5)
    predictor = cs.Predictor(CABLE)
    for k in range(8):
        table = rng.normal(size=(5 + 3 * (k % 3), 3)) * 2.0
        warm = predictor.predict(START, END, acceleration=table)
        cold = cs.predict(CABLE, START, END, model="cosserat", acceleration=table)
        assert warm.status is cs.Status.OK
        assert np.linalg.norm(warm.positions - cold.positions, axis=1).max() < 2e-5 * LENGTH
    still = predictor.predict(START, END)
    np.testing.assert_allclose(still.positions, cs.predict(CABLE, START, END).positions, rtol=0.0, atol=2e-5 * LENGTH)


def test_the_same_acceleration_gives_the_same_shape_again() -> None:
    predictor = cs.Predictor(CABLE, model="cosserat")
    table = np.outer(np.sin(np.arange(6.0)), PUSH)
    first = predictor.predict(START, END, acceleration=table)
    assert not first.reused
    assert predictor.predict(START, END, acceleration=table).reused
    assert not predictor.predict(START, END, acceleration=1.1 * table).reused
    assert not predictor.predict(START, END).reused


def test_rotating_with_the_cable_is_equivariant() -> None:
    turn = Rotation.from_rotvec((0.3, -0.8, 0.5))
    table = np.random.default_rng(1).normal(size=(6, 3)) * 3.0
    there = cs.predict(CABLE, START, END, model="cosserat", acceleration=table, tolerance=1e-8)
    turned = [
        cs.Pose(turn.apply(p.position.copy()), (turn * Rotation.from_quat(p.quaternion.copy())).as_quat())
        for p in (START, END)
    ]
    here = cs.predict(
        CABLE, *turned, model="cosserat", gravity=turn.apply(GRAVITY), acceleration=turn.apply(table), tolerance=1e-8
    )
    np.testing.assert_allclose(here.positions, turn.apply(there.positions), rtol=0.0, atol=3e-8)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ((1.0, 2.0), "shape"),
        (np.zeros((1, 3)), "shape"),
        (np.zeros((201, 3)), "shape"),
        (((0, 0, np.nan), (0, 0, 0)), "finite"),
        ("fast", "numbers"),
    ],
)
def test_bad_accelerations_are_named(value: object, words: str) -> None:
    with pytest.raises(ArgumentError, match="acceleration.*" + words):
        cs.predict(CABLE, START, END, model="cosserat", acceleration=value)  # type: ignore[arg-type]


def test_what_knows_no_varying_acceleration_says_so() -> None:
    table = ((0, 0, 0), (0, 0, 3), (0, 0, 0))
    with pytest.raises(ArgumentError, match="gradient4"):
        cs.predict(CABLE, START, END, model="gradient4", acceleration=table)
    scene = cs.Scene(clips=[cs.Clip(0.5, cs.Pose((0.3, 0.1, -0.2)))])
    with pytest.raises(ArgumentError, match="clips"):
        cs.predict(CABLE, START, END, scene=scene, acceleration=table)
