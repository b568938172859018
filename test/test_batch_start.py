"""The kernels of a batch: the shape at a cell's centre, and the way from there to a row."""

from __future__ import annotations

import numpy as np
import pytest
from rods import CABLE
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.batch_seed import Seed, seed_at
from cable_shape.kernels import batch_cells, batch_lean, batch_newton, batch_start, response, rod_drive, rod_stability
from cable_shape.kernels.rod_newton import CONVERGED
from cable_shape.problem import Problem

TOLERANCE = 1e-4 * CABLE.length
REACH, TURN, POINTS = 0.25 * CABLE.length, 0.3, 80
MASSES = cs.Scene(masses=[cs.PointMass(0.4, 0.02)])
ALONG_X = (0.5, 0.5, 0.5, 0.5)


def turned(pose: np.ndarray, by: tuple[float, float, float]) -> np.ndarray:
    """A pose (7,) turned in place."""
    return np.hstack((pose[:3], (Rotation.from_rotvec(by) * Rotation.from_quat(pose[3:])).as_quat()))


START = np.array((0.0, 0.0, 0.0, *ALONG_X))
END = turned(np.array((0.7, 0.2, -0.1, *ALONG_X)), (-0.1, 0.3, 0.4))


def start_of(seed: Seed, start: np.ndarray, end: np.ndarray) -> tuple[tuple, np.ndarray, np.ndarray, np.ndarray]:
    """The start of the cell of a grasp, its `info`, and the two poses at the cell's centre."""
    x, key = np.empty(9), np.empty(9, np.int64)
    batch_cells.coordinates(start, end, REACH, TURN, x)
    batch_cells.nearest(x, key)
    state, info = seed.state, np.zeros(rod_drive.INFO)
    found = batch_start.start_at(
        key, REACH, TURN, 0.95 * CABLE.length, state.par, state.mesh, state.sol, state.work, state.elements, seed.mode,
        state.info[rod_drive.ESTIMATE], TOLERANCE, seed.loads, info,
    )  # fmt: skip
    centre = np.empty((2, 7))
    batch_cells.grasp(key, REACH, TURN, 0.95 * CABLE.length, *centre)
    return found, info, *centre


@pytest.fixture(params=[cs.Scene(), MASSES], ids=["bare", "mass"])
def scene(request: pytest.FixtureRequest) -> cs.Scene:
    """Without and with a node that must stay."""
    return request.param


@pytest.fixture
def seed(scene: cs.Scene) -> Seed:
    """The shape of another grasp, a coarse cell's."""
    problem = Problem(CABLE, scene=scene, tolerance=TOLERANCE)
    start = np.array((0.0, 0.0, 0.0, *ALONG_X))
    end = turned(np.array((0.6, 0.0, 0.0, *ALONG_X)), (0.1, 0.2, -0.2))
    found = seed_at(problem, start, end)
    assert found is not None
    return found


def exact(start: np.ndarray, end: np.ndarray, scene: cs.Scene) -> cs.CableShape:
    """The cold prediction."""
    poses = (cs.Pose(pose[:3], pose[3:]) for pose in (start, end))
    return cs.predict(CABLE, *poses, model="cosserat", tolerance=1e-8 * CABLE.length, points=POINTS, scene=scene)


def test_a_cells_start_is_the_equilibrium_there_on_a_mesh_of_its_own(seed: Seed, scene: cs.Scene) -> None:
    (met, elements, mesh, sol, work, mode), info, start, end = start_of(seed, START, END)
    assert met
    assert info[rod_drive.ESTIMATE] < 0.5 * TOLERANCE
    assert info[rod_drive.TURN] < 0.65
    nodes = mesh[: elements + 1]
    assert nodes[[0, -1]] == pytest.approx((0.0, CABLE.length))
    for mass in scene.masses:
        assert np.abs(nodes - mass.arc_length).min() < 1e-12
    shape = exact(start, end, scene)
    np.testing.assert_allclose(sol[4 * elements + 4 : 4 * elements + 7], shape.force[-1], atol=2e-4)
    rod = seed.state.par, mesh, sol
    least = rod_stability.smallest_eigenvalue(*rod, work.copy(), elements, batch_lean.WIDTH)
    value, _ = response.smallest_eigenvalue(*rod, work, elements, batch_lean.WIDTH, mode, 1, False)
    assert value == pytest.approx(least, rel=5e-3)


@pytest.mark.parametrize(("far", "factored"), [(0.3, 1.0), (3.0, 1.0), (6.0, 2.0)])
def test_a_row_is_the_cold_prediction_and_is_factored_once_nearby(
    seed: Seed, scene: cs.Scene, far: float, factored: float
) -> None:
    """`far` counts 37 mm and 0.15 rad."""
    (_, elements, mesh, sol, work, _), _, start, end = start_of(seed, START, END)
    there = turned(end, (0.1 * far, -0.1 * far, 0.05 * far))
    there[:3] -= far * np.array((0.02, 0.01, -0.03))
    size = rod_drive.slot_size(elements)
    target, trial, own = np.empty(15), np.zeros(3 * size), np.zeros_like(work)
    out, info = cs.CableShape.new_buffer(POINTS), np.empty(rod_drive.INFO)
    assert batch_lean.aim(start, there, sol[size - 15 : size], target)
    batch_lean.lean(sol, work, elements, target, trial)
    code = batch_newton.solve_beside(
        seed.state.par, mesh, trial, work, own, out, info, elements, POINTS, TOLERANCE, 7.0
    )
    assert code == CONVERGED
    assert info[4] == factored
    shape = exact(start, there, scene)
    apart = np.linalg.norm(out[POINTS : 4 * POINTS].reshape(-1, 3) - shape.positions, axis=1).max()
    assert apart < info[rod_drive.ESTIMATE] < TOLERANCE
    moment = out[14 * POINTS : 17 * POINTS].reshape(-1, 3)
    np.testing.assert_allclose(moment, shape.moment, atol=1e-3 * np.abs(shape.moment).max())
