"""A cable that moves: its shape under density * (gravity - acceleration)."""

from itertools import pairwise

import numpy as np
import pytest
from clips import on_the_free_shape
from rods import ALONG_X, CABLE, END, LENGTH, START, moved
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.errors import ArgumentError
from cable_shape.solve.cosserat import solve
from cable_shape.solve.problem import Problem

GRAVITY = np.array((0.0, 0.0, -9.81))
PUSH = np.array((1.0, -2.0, 3.0))
LEVEL = cs.Pose((0.8, 0.0, 0.0), ALONG_X)


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


@pytest.mark.parametrize("columns", [3, 6])
def test_a_problem_accelerated_later_is_the_same_problem(columns: int) -> None:
    rng = np.random.default_rng(3)
    cable = CABLE.replace(rest_curvature=rng.normal(size=(5, 3)), drag=0.01, retardation_time=0.1)
    scene = cs.Scene(masses=[cs.PointMass(0.3, 0.02)])
    plain = Problem(cable, scene=scene)
    for rows in (9, 9, 4):  # what is made for so many rows is made once
        table = np.concatenate((rng.normal(size=(rows, 3)), 0.01 * rng.normal(size=(rows, 3))), axis=1)[:, :columns]
        whole, later = Problem(cable, scene=scene, acceleration=table), plain.accelerated(table)
        shapes = [solve(one.move(cs.Grip(START), cs.Grip(END))) for one in (whole, later)]
        assert shapes[0].status is cs.Status.OK
        np.testing.assert_array_equal(shapes[0].positions, shapes[1].positions)
    still = solve(plain.move(cs.Grip(START), cs.Grip(END)))
    np.testing.assert_array_equal(
        still.positions, solve(Problem(cable, scene=scene).move(cs.Grip(START), cs.Grip(END))).positions
    )


Joint = tuple[str, float, float, tuple[float, float]]


def planar_rod(table: np.ndarray, guess: cs.CableShape, *joints: Joint) -> np.ndarray:
    """(n, 3): the elastica of CABLE in the plane y = 0 under this acceleration, by solve_bvp at guess.arc_length.

    theta, the tangent's angle, theta' = m / EI, m' = n_x sin(theta) - n_z cos(theta), n' = -density (g - a), from each
    joint to the next: a clip's kind, its arc length, 0, and its place (x, z), or "mass", its arc length and its mass. A
    fixed clip is level. What is in an eyelet is found.
    """
    rows = np.linspace(0.0, LENGTH, len(table))
    density, EI = CABLE.linear_density, CABLE.mean_bending_stiffness
    kinds = [kind for kind, *_ in joints]
    rings = [i for i, kind in enumerate(kinds, 1) if kind == "slide"]
    spans = len(joints) + 1

    def field(s: np.ndarray) -> np.ndarray:
        return np.array((np.interp(s, rows, table[:, 0]), 9.81 + np.interp(s, rows, table[:, 2])))

    def arcs(p: np.ndarray) -> np.ndarray:
        found = np.array((0.0, *(arc for _, arc, *_ in joints), LENGTH))
        found[rings] = p
        return found

    def rates(x: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        out, at = [], arcs(p)
        for k, h in enumerate(np.diff(at)):
            states = y[6 * k : 6 * k + 6]
            c, d = np.cos(states[2]), np.sin(states[2])
            ax, az = field(at[k] + h * x)
            out += [h * c, h * d, h * states[3] / EI, h * (states[4] * d - states[5] * c),
                    h * density * ax, h * density * az]  # fmt: skip
        return np.array(out)

    def ends(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
        a, b, at = a.reshape(spans, 6), b.reshape(spans, 6), arcs(p)
        out = [*a[0, :3], b[-1, 0] - 0.8, *b[-1, 1:3]]
        for k, (kind, _, mass, place) in enumerate(joints):
            left, right = b[k], a[k + 1]
            if kind == "mass":
                out += [*(right[:4] - left[:4]), *(right[4:] - left[4:] - mass * field(at[k + 1]))]
                continue
            out += [*(left[:2] - place), *(right[:2] - place)]
            out += [left[2], right[2]] if kind == "fixed" else [*(right[2:4] - left[2:4])]
            if kind == "slide":
                out.append((left[4:] - right[4:]) @ (np.cos(left[2]), np.sin(left[2])))
        return np.array(out)

    clips = [kind for kind in kinds if kind != "mass"]
    at = arcs(np.array([load.arc_length for load, kind in zip(guess.clips, clips, strict=True) if kind == "slide"]))
    kinks = [(rows[(rows > low) & (rows < high)] - low) / (high - low) for low, high in pairwise(at)]
    x = np.unique(np.concatenate((np.linspace(0.0, 1.0, 101), *kinks)).round(12))
    t = guess.tangents
    columns = (
        guess.positions[:, 0], guess.positions[:, 2], np.arctan2(t[:, 2], t[:, 0]), -guess.moment[:, 1],
        guess.force[:, 0], guess.force[:, 2],
    )  # fmt: skip
    start = [
        np.interp(low + (high - low) * x, guess.arc_length, column) for low, high in pairwise(at) for column in columns
    ]
    if rings:
        answer = solve_bvp(rates, ends, x, np.array(start), p=at[rings], tol=1e-9, max_nodes=20_000)
    else:
        none = np.empty(0)
        answer = solve_bvp(
            lambda x, y: rates(x, y, none), lambda a, b: ends(a, b, none), x, np.array(start), tol=1e-9,
            max_nodes=20_000,
        )  # fmt: skip
    assert answer.success, answer.message
    at = arcs(np.empty(0) if answer.p is None else answer.p)
    span = np.clip(np.searchsorted(at, guess.arc_length) - 1, 0, spans - 1)
    y = answer.sol((guess.arc_length - at[span]) / np.diff(at)[span])
    i = np.arange(len(span))
    return np.stack((y[6 * span, i], np.zeros(len(span)), y[6 * span + 1, i]), axis=1)


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


def test_what_rounding_bends_in_a_linear_acceleration_makes_no_kinks() -> None:
    even = np.tile((0.0, 1.5, 0.0), (20, 1))
    shaken = even + 1e-11 * np.random.default_rng(0).normal(size=even.shape)  # positions at 100 Hz, differenced twice
    assert Problem(CABLE, acceleration=shaken).swing is None
    assert Problem(CABLE, acceleration=even + 1e-6 * np.eye(20)[:, :3]).swing is not None


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


@pytest.mark.parametrize("held", [(), ((120, "ball"),), ((100, "slide"),)])
def test_a_large_change_of_acceleration_is_followed(held: tuple[tuple[int, str], ...]) -> None:
    """By which the cable swings aside: it is where many small steps lead, and has not snapped."""
    table = np.array(((0.0, -30.0, 2.0), (0.0, -20.0, 0.0), (5.0, -25.0, 2.0)))
    scene = cs.Scene(clips=on_the_free_shape(*held).clips, masses=[cs.PointMass(0.9, 0.01)])
    start, end = (START, END) if held else (cs.Pose((0, 0, 0), ALONG_X), LEVEL)
    slow, fast = (cs.Predictor(CABLE, model="cosserat", scene=scene) for _ in range(2))
    still = fast.predict(start, end)
    for share in np.linspace(0.0, 1.0, 41):
        wanted = slow.predict(start, end, acceleration=share * table)
        assert wanted.status is cs.Status.OK
    found = fast.predict(start, end, acceleration=table)
    assert found.status is cs.Status.OK
    np.testing.assert_allclose(found.positions, wanted.positions, rtol=0.0, atol=2e-5 * LENGTH)
    back = fast.predict(start, end)
    assert back.status is cs.Status.OK
    np.testing.assert_allclose(back.positions, still.positions, rtol=0.0, atol=2e-5 * LENGTH)


def test_out_of_time_on_the_way_to_another_acceleration() -> None:
    predictor = cs.Predictor(CABLE, model="cosserat", time_budget=1e-9)
    start, push = cs.Pose((0, 0, 0), ALONG_X), (0.0, -40.0, 2.0)
    predictor.predict(start, LEVEL)
    late = predictor.predict(start, LEVEL, acceleration=push)
    assert late.status is cs.Status.BUDGET_EXCEEDED
    predictor.time_budget = predictor._solver._time_budget = np.inf  # type: ignore[union-attr]
    found = predictor.predict(start, LEVEL, acceleration=push)
    assert found.reused  # of the same input the same shape
    found = predictor.predict(start, cs.Pose((0.8, 1e-6, 0.0), ALONG_X), acceleration=push)
    wanted = cs.predict(CABLE, start, LEVEL, model="cosserat", acceleration=push)
    assert found.status is cs.Status.OK
    np.testing.assert_allclose(found.positions, wanted.positions, rtol=0.0, atol=2e-5 * LENGTH)


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


@pytest.mark.parametrize("kinds", [("ball",), ("fixed",), ("slide",), ("fixed", "ball"), ("ball", "slide")])
def test_varying_acceleration_in_clips_and_with_a_mass_against_solve_bvp(kinds: tuple[str, ...]) -> None:
    s = np.linspace(0.0, 1.0, 9)
    table = np.stack((2.0 * s + 1.5 * np.sin(5.0 * s), 0.0 * s, 4.0 * np.cos(7.0 * s)), axis=1)
    places = [(0.28, -0.24), (0.54, -0.22)][-len(kinds) :]
    joints = [
        (kind, arc, 0.0, place) for kind, arc, place in zip(kinds, (0.4, 0.8)[-len(kinds) :], places, strict=True)
    ]
    clips = [cs.Clip(arc, cs.Pose((x, 0.0, z), ALONG_X), kind) for kind, arc, _, (x, z) in joints]
    scene = cs.Scene(clips=clips, masses=[cs.PointMass(1.0, 0.02)])
    start = cs.Pose((0, 0, 0), ALONG_X)
    options = {"model": "cosserat", "scene": scene, "tolerance": 1e-9}
    shape = cs.predict(CABLE, start, LEVEL, acceleration=table, **options)
    assert shape.status is cs.Status.OK
    still = cs.predict(CABLE, start, LEVEL, **options)
    assert np.abs(still.positions - shape.positions).max() > 1e-3, "the load must matter"
    exact = planar_rod(table, shape, *joints, ("mass", 1.0, 0.02, (0.0, 0.0)))
    assert np.abs(exact - shape.positions).max() < 2e-8
    again = cs.predict(CABLE, start, LEVEL, acceleration=table, **{**options, "tolerance": None})
    assert np.abs(exact - again.positions).max() <= 1e-5 * LENGTH


def test_a_linear_acceleration_in_clips_is_a_linear_load() -> None:
    scene = on_the_free_shape((80, "hinge"), (160, "slide"), shift=(0.01, 0.0, 0.02))
    table = np.linspace(PUSH, -2.0 * PUSH, 7)
    moved = cs.predict(CABLE, START, END, model="cosserat", scene=scene, acceleration=table)
    ends = -CABLE.linear_density * table[[0, -1]]
    loaded = cs.predict(CABLE, START, END, model="cosserat", scene=scene, distributed_load=ends)
    np.testing.assert_allclose(moved.positions, loaded.positions, rtol=0.0, atol=1e-12)


def test_a_fixed_clip_cuts_a_moving_cable_in_two() -> None:
    table = np.random.default_rng(2).normal(size=(7, 3)) * 4.0
    scene = on_the_free_shape((80, "fixed"), shift=(0.02, 0.03, 0.01))
    (clip,) = scene.clips
    assert clip.arc_length == pytest.approx(LENGTH / 3.0)
    options = {"model": "cosserat", "tolerance": 1e-9}
    whole = cs.predict(CABLE, START, END, scene=scene, points=301, acceleration=table, **options)
    for part, rows, held in (
        (slice(0, 101), table[:3], (START, clip.pose)),
        (slice(100, 301), table[2:], (clip.pose, END)),
    ):
        length = clip.arc_length if part.start == 0 else LENGTH - clip.arc_length
        count = part.stop - part.start
        alone = cs.predict(CABLE.replace(length=length), *held, points=count, acceleration=rows, **options)
        np.testing.assert_allclose(whole.positions[part], alone.positions, rtol=0.0, atol=5e-9)


@pytest.mark.parametrize("kinds", [("ball", "fixed"), ("slide", "slide")])
def test_the_error_of_a_rough_field_in_clips_is_known(kinds: tuple[str, ...]) -> None:
    scene = on_the_free_shape((80, kinds[0]), (160, kinds[1]), shift=(0.01, 0.02, 0.02))
    for seed in range(3):
        table = np.random.default_rng(seed).normal(size=(30, 3)) * 9.0
        coarse = cs.predict(CABLE, START, END, model="cosserat", scene=scene, acceleration=table)
        fine = cs.predict(CABLE, START, END, model="cosserat", scene=scene, acceleration=table, tolerance=1e-9)
        assert coarse.status is fine.status is cs.Status.OK
        error = np.linalg.norm(coarse.positions - fine.positions, axis=1).max()
        assert error <= coarse.error_estimate <= 1e-5 * LENGTH


@pytest.mark.parametrize("kinds", [("hinge", "ball"), ("slide", "ball")])
def test_warm_in_clips_is_cold(kinds: tuple[str, ...]) -> None:
    scene = on_the_free_shape((80, kinds[0]), (160, kinds[1]), shift=(0.01, 0.02, 0.02))
    scene = scene.replace(masses=[cs.PointMass(1.0, 0.01)])
    rng = np.random.default_rng(4)
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat")
    for k in range(8):
        end = moved(END, (-0.003 * k, 0.001 * k, 0.002 * k), (0.0, 0.01 * k, 0.0))
        table = rng.normal(size=(5 + 4 * (k % 3), 3)) * 2.0
        warm = predictor.predict(START, end, acceleration=table)
        cold = cs.predict(CABLE, START, end, model="cosserat", scene=scene, acceleration=table)
        assert warm.status is cs.Status.OK
        assert np.linalg.norm(warm.positions - cold.positions, axis=1).max() < 2e-5 * LENGTH


@pytest.mark.parametrize("held", [(), ((80, "ball"), (160, "ball"))])
def test_more_rows_than_the_last_mesh_has_nodes(held: tuple[tuple[int, str], ...]) -> None:
    scene = on_the_free_shape(*held)
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat")
    predictor.predict(START, END)
    for rows in (60, 200):
        table = np.random.default_rng(rows).normal(size=(rows, 3))
        warm = predictor.predict(START, END, acceleration=table)
        cold = cs.predict(CABLE, START, END, model="cosserat", scene=scene, acceleration=table)
        assert warm.status is cs.Status.OK
        assert np.linalg.norm(warm.positions - cold.positions, axis=1).max() < 2e-5 * LENGTH


def test_what_knows_no_varying_acceleration_says_so() -> None:
    table = ((0, 0, 0), (0, 0, 3), (0, 0, 0))
    with pytest.raises(ArgumentError, match=r"gradient4.*linear.*model='cosserat'"):
        cs.predict(CABLE, START, END, model="gradient4", acceleration=table)
    ball = cs.Obstacle("ball", cs.Sphere(0.1), cs.Pose((0.4, 0.0, 3.0)))
    clip = cs.Clip(0.5, cs.Pose((0.3, 0.1, -0.2)))
    for scene in (cs.Scene(contact="solve"), cs.Scene(obstacles=[ball], clips=[clip], contact="solve")):
        with pytest.raises(ArgumentError, match=r"contact='solve' knows.*linear.*contact='warn'"):
            cs.predict(CABLE, START, END, scene=scene, acceleration=table)
        assert cs.predict(CABLE, START, END, scene=scene, acceleration=table[:2]).status
        assert cs.predict(CABLE, START, END, scene=scene.replace(contact="warn"), acceleration=table).status
    # nothing to touch, and a cable that runs through eyelets is not kept out of itself
    alone = cs.Scene(clips=[cs.Clip(0.5, cs.Pose((0.3, 0.1, -0.2)), "slide")], contact="solve")
    assert cs.predict(CABLE, START, END, scene=alone, acceleration=table).status


def test_what_is_refused_leaves_the_predictor_as_it_was() -> None:
    predictor = cs.Predictor(CABLE, scene=cs.Scene(contact="solve"))
    before = predictor.predict(START, END)
    with pytest.raises(ArgumentError, match="linear"):
        predictor.predict(START, END, acceleration=((0, 0, 0), (0, 0, 3), (0, 0, 0)))
    np.testing.assert_array_equal(predictor.predict(START, END).positions, before.positions)
