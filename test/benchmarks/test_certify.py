"""The check behind `scripts/bench certify`: exact where the answer is known, and not to be deceived."""

import math
from pathlib import Path

import bench_certify
import numpy as np
import pytest
from certify_check import CLAMPED, PINNED, Certificate, Shapes, certify
from certify_grasps import MOST_HALVINGS, Grasp, in_clips, plain, points, stacked
from certify_reduction import solve
from certify_rows import SEED, certified, in_the_limit, looked_at_again, plain_block
from evidence_pages import CERTIFIED, END, put

import cable_shape as cs
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

TOLERANCE = 1e-5 * 1.2  # of random grasps


def changed(shape: cs.CableShape, **arrays: np.ndarray) -> cs.CableShape:
    """A shape with other numbers."""
    buffer = shape.buffer.copy()
    out = cs.CableShape(
        buffer, shape.points, length=shape.length, model=shape.model, status=shape.status,
        error_estimate=shape.error_estimate, force_error=shape.force_error, moment_error=shape.moment_error,
    )  # fmt: skip
    for name, values in arrays.items():
        getattr(out, name)[:] = values
    return out


@pytest.mark.parametrize("nodes", [1, 2, 3, 4, 7, 10, 150])
def test_reduction_solves_and_counts_as_a_dense_matrix_does(nodes: int) -> None:
    rng, rows, n = np.random.default_rng(nodes), 4, 3 * nodes
    whole = np.zeros((rows, n + 3, n + 3))
    for i in range(nodes):
        for j in (i, i + 1, nodes):
            a, b = slice(3 * i, 3 * i + 3), slice(3 * j, 3 * j + 3)
            whole[:, a, b] = rng.normal(size=(rows, 3, 3))
    whole[:, n:, n:] = rng.normal(size=(rows, 3, 3))
    whole += whole.transpose(0, 2, 1).copy()
    side = rng.normal(size=(rows, n + 3))
    parts = whole[:, :n, :].reshape(rows, nodes, 3, n + 3)
    D = np.stack([parts[:, i, :, 3 * i : 3 * i + 3] for i in range(nodes)]).transpose(2, 3, 1, 0)
    U = np.zeros((3, 3, rows, nodes - 1))
    for i in range(nodes - 1):
        U[..., i] = parts[:, i, :, 3 * i + 3 : 3 * i + 6].transpose(1, 2, 0)
    B = np.concatenate((parts[..., n:], side[:, :n].reshape(rows, nodes, 3, 1)), axis=3).transpose(2, 3, 0, 1)
    S = np.concatenate((whole[:, n:, n:], side[:, n:, None]), axis=2).transpose(1, 2, 0)
    found = solve(D.copy(), U, B.copy(), S.copy())
    exact = np.linalg.solve(whole, side[:, :, None])[:, :, 0]
    assert found.x.transpose(1, 2, 0).reshape(rows, n) == pytest.approx(exact[:, :n], rel=1e-6, abs=1e-6)
    assert found.y == pytest.approx(exact[:, n:], rel=1e-6, abs=1e-6)
    assert found.negative.tolist() == (np.linalg.eigvalsh(whole) < 0.0).sum(axis=1).tolist()


def coarse_and_fine(grasp: Grasp) -> tuple[cs.CableShape, cs.CableShape]:
    """A shape at a hundred times the default tolerance, and the same one as exact as may be."""
    step = grasp.cable.length / 149
    scene = cs.Scene(masses=[cs.PointMass(place * step, mass) for place, mass in grasp.masses])
    shapes, state = [], None
    for tolerance in (100.0 * TOLERANCE, 1e-4 * TOLERANCE):
        problem = Problem(grasp.cable, points=points(1), scene=scene, tolerance=tolerance)
        problem.move(grasp.start, grasp.end)
        state = state or Network(problem)
        shapes.append(cosserat.solve(problem, state))
        assert shapes[-1].status is cs.Status.OK
    return shapes[0], shapes[1]


def test_what_is_estimated_is_the_true_error_of_cables_of_all_kinds() -> None:
    seen: set[str] = set()
    for row in (1, 7, 8, 13, 15, 27, 31, 49):
        grasp = plain(SEED, row)
        wide, narrow = coarse_and_fine(grasp)
        found = certify(stacked([grasp], [wide], 1))
        true = np.linalg.norm(wide.positions - narrow.positions, axis=1).max()
        seen.update(grasp.what)
        assert found.away[0] == pytest.approx(true, rel=0.03), row
        assert found.force[0] == pytest.approx(np.linalg.norm(wide.force - narrow.force, axis=1)[0], rel=0.03), row
        moment = np.linalg.norm(wide.moment - narrow.moment, axis=1).max()
        assert found.moment[0] == pytest.approx(moment, rel=0.1), row
        assert found.stable[0]
        exact = certify(stacked([grasp], [narrow], 1))
        assert exact.away[0] < 0.01 * TOLERANCE
    assert seen == {"as it is", "elastic", "curved at rest", "of two stiffnesses", "other ends", "masses"}


def test_shapes_that_are_wrong_are_caught() -> None:
    grasp = plain(SEED, 8)
    shape = grasp.predict()
    (right,) = certified([grasp], [shape], 0, 0.0)
    assert not right.wrong
    bump = 3.0 * TOLERANCE * np.sin(np.linspace(0.0, math.pi, 150))[:, None] * (0.0, 0.0, 1.0)
    (moved,) = certified([grasp], [changed(shape, positions=shape.positions + bump)], 0, 0.0)
    assert moved.away == pytest.approx(3.0, abs=right.away)
    assert moved.wrong.startswith("away")
    again = looked_at_again(grasp, changed(shape, positions=shape.positions + bump), moved)
    assert again.away == pytest.approx(3.0, abs=right.away)
    assert looked_at_again(grasp, shape, right).away == pytest.approx(right.away, rel=0.03)
    for arrays, name in (
        ({"force": 1.01 * shape.force}, "off"),
        ({"force": shape.force + 0.01 * np.linalg.norm(shape.force[0])}, "force"),
        ({"moment": shape.moment + 0.01 * np.abs(shape.moment).max()}, "off"),
        ({"curvature": 1.001 * shape.curvature}, "off"),
        ({"quaternions": -1.001 * shape.quaternions}, "off"),
        ({"positions": shape.positions + 2.0 * TOLERANCE}, "away"),
        ({"quaternions": np.roll(shape.quaternions, 1, axis=0)}, "off"),
    ):
        (found,) = certified([grasp], [changed(shape, **arrays)], 0, 0.0)
        assert name in found.wrong, arrays.keys()
    elsewhere = Grasp(grasp.cable, grasp.start, cs.Grip(cs.Pose(grasp.end.pose.position)), (), ())
    (found,) = certified([elsewhere], [shape], 0, 0.0)
    assert "off" in found.wrong


def straight(force: float, kind: int, count: int = 150, reserve: float = 0.0) -> Certificate:
    """A column of length, EI and 1 / EA = 1, 1 and 1e-4, pressed or pulled along itself."""
    s = np.linspace(0.0, 1.0, count)
    stretch = 1.0 + 1e-4 * force
    r = np.stack((0.0 * s, 0.0 * s, s * stretch), axis=1)[None]
    q = np.tile((0.0, 0.0, 0.0, 1.0), (1, count, 1))
    zeros = np.zeros((1, count, 3))
    ends = np.array((((0, 0, 0, 0, 0, 0, 1.0), (0, 0, stretch, 0, 0, 0, 1.0)),))
    none = np.zeros((1, 3))
    n = zeros + np.array((0.0, 0.0, force))
    return certify(
        Shapes(np.ones(1), none, np.array(((1.0, 1.0, 0.8),)), np.array(((0.0, 0.0, 1e-4),)), none, none, ends,
               np.array(((CLAMPED, kind),)), r, q, zeros, n, zeros),
        reserve,
    )  # fmt: skip


@pytest.mark.parametrize(("kind", "critical"), [(CLAMPED, 4.0 * math.pi**2), (PINNED, 20.19)])
def test_a_pressed_column_is_a_minimum_up_to_eulers_load(kind: int, critical: float) -> None:
    for force in (10.0, -0.5 * critical, -0.985 * critical):
        assert straight(force, kind).stable[0], force
        assert straight(force, kind).away[0] < 1e-12
    for force in (-1.015 * critical, -2.0 * critical, -5.0 * critical):
        assert not straight(force, kind).stable[0], force


@pytest.mark.parametrize(("kind", "critical"), [(CLAMPED, 4.0 * math.pi**2), (PINNED, 20.19)])
@pytest.mark.parametrize("share", [1.01, 1.1, 3.0])
def test_a_saddle_is_none_in_the_limit_either(kind: int, critical: float, share: float) -> None:
    def stable(halvings: int, reserve: float) -> bool:
        return bool(straight(-share * critical, kind, 5 * 2**halvings + 1, reserve).stable[0])

    assert not stable(2, 0.0)
    assert not in_the_limit(stable, 2)


def test_a_broken_off_run_goes_on_and_a_row_depends_on_its_number_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench_certify, "BLOCK", 20)
    options = ["--rows", "60", "--clips", "8", "--out", str(tmp_path)]
    assert bench_certify.main(options) == 0
    kept = tmp_path / bench_certify.sources() / "plain.jsonl"
    lines = kept.read_text().splitlines(keepends=True)
    assert len(lines) == 3
    kept.write_text("".join(lines[:2]) + lines[2][:30])
    capsys.readouterr()
    monkeypatch.setattr(bench_certify, "clips_block", None)  # what is kept is not done again
    called: list[int] = []

    def block(first: int, last: int) -> dict:
        called.append(first)
        return plain_block(first, last)

    monkeypatch.setattr(bench_certify, "plain_block", block)
    assert bench_certify.main([*options, "--row", "7"]) == 0
    page = tmp_path / "page.md"
    page.write_text(f"{CERTIFIED}\n{END}\n")
    monkeypatch.setattr(bench_certify, "PAGE", page)
    assert bench_certify.main([*options, "--write"]) == 0
    assert called == [40]
    assert "| plain | 60 | 0.0000 % | OK 60 |" in page.read_text()
    assert "--rows 60 --clips 8" in page.read_text()
    assert kept.read_text().splitlines(keepends=True) == lines
    assert "60 certificates" in capsys.readouterr().out


def test_clips_and_eyelets_are_drawn_in_turn() -> None:
    for row in range(6):
        name, _, scene, _, _ = in_clips(1, row)
        assert ("slide" in [clip.kind for clip in scene.clips]) == (name == "eyelets") == (row % 2 == 1)


def test_the_counts_come_between_their_marks_on_the_page(tmp_path: Path) -> None:
    page = tmp_path / "stability.md"
    page.write_text(f"before\n\n{CERTIFIED}\nold\n{END}\nafter\n")
    put("counts", page, CERTIFIED)
    assert page.read_text() == f"before\n\n{CERTIFIED}\ncounts\n{END}\nafter\n"
    assert bench_certify.PAGE.read_text(encoding="utf-8").count(CERTIFIED) == 1


@pytest.mark.parametrize("row", [11401, 154535, 190188, 198213, 257951, 325615, 327873, 397846])
def test_rows_that_were_further_off_than_the_tolerance_are_no_more(row: int) -> None:
    """Where the correction is large, or modes are soft, the estimate alone was trusted once."""
    grasp = plain(SEED, row)
    shape, exact = grasp.predict(), grasp.predict(finer=1000.0)
    assert shape.status is cs.Status.OK
    assert exact.status is cs.Status.OK
    assert np.linalg.norm(shape.positions - exact.positions, axis=1).max() < 0.9 * TOLERANCE


@pytest.mark.parametrize("row", [230913, 320431])
def test_moments_of_limp_cables_between_ends_that_turn_are_as_exact_as_they_say(row: int) -> None:
    grasp = plain(SEED, row)
    shape, exact = (grasp.predict(grasp.halvings, finer) for finer in (1.0, 1000.0))
    assert np.linalg.norm(shape.moment - exact.moment, axis=1).max() < 2.0 * shape.moment_error


@pytest.mark.parametrize("row", [547425, 626721])
def test_cables_that_are_taut_within_a_boundary_layer_are_judged_in_the_limit(row: int) -> None:
    grasp = plain(SEED, row)
    shape = grasp.predict(MOST_HALVINGS)
    (found,) = certified([grasp], [shape], MOST_HALVINGS, 0.0)
    assert found.wrong == "no minimum"
    assert not looked_at_again(grasp, shape, found).wrong


def test_a_soft_mode_that_has_become_unstable_is_told() -> None:
    """Between pinned ends one below the other: the factors of the last but one iterate said that it is a minimum."""
    assert plain(SEED, 182895).predict().status is cs.Status.UNSTABLE


def test_a_look_at_the_stability_changes_no_energy() -> None:
    """Which a mass has in the corrected shape, not in the one that the factors are of."""
    scene = cs.Scene(masses=[cs.PointMass(62 * 1.2 / 149, 0.2)])
    cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.05)
    ends = cs.Grip(cs.Pose((0.0, 0.0, 0.0)), "pinned"), cs.Grip(cs.Pose((0.7, 0.1, 0.2)), "pinned")
    predictor = cs.Predictor(cable, scene=scene, model="cosserat", tolerance=1e-4)
    shape = predictor.predict(*ends)
    state = predictor.rod_state
    assert state is not None
    energy = state.energy_of_masses()
    assert energy == pytest.approx(0.2 * 9.81 * shape.positions[62, 2], abs=1e-6)
    assert state.is_minimum()
    assert state.smallest_eigenvalue() > 0.0
    assert state.energy_of_masses() == energy
