"""The kernels of a batch: the shape at a cell's centre, and the way from there to a row."""

from __future__ import annotations

import numpy as np
import pytest
from rods import CABLE
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.network import batch_cells, beside, drive, newton, respond
from cable_shape.kernels.network.tables import NOW, model_of, solution_of
from cable_shape.pose import Grip, Pose
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

TOLERANCE = 1e-4 * CABLE.length
REACH, TURN, POINTS = 0.25 * CABLE.length, 0.3, 80
MASSES = cs.Scene(masses=[cs.PointMass(0.4, 0.02)])
ALONG_X = (0.5, 0.5, 0.5, 0.5)
NOTHING = np.empty(0)


def turned(pose: np.ndarray, by: tuple[float, float, float]) -> np.ndarray:
    """A pose (7,) turned in place."""
    return np.hstack((pose[:3], (Rotation.from_rotvec(by) * Rotation.from_quat(pose[3:])).as_quat()))


START = np.array((0.0, 0.0, 0.0, *ALONG_X))
END = turned(np.array((0.7, 0.2, -0.1, *ALONG_X)), (-0.1, 0.3, 0.4))


@pytest.fixture(params=[cs.Scene(), MASSES], ids=["bare", "mass"])
def scene(request: pytest.FixtureRequest) -> cs.Scene:
    """Without and with a node that must stay."""
    return request.param


def told_of(scene: cs.Scene) -> beside.Told:
    """What all grasps have in common."""
    network = Network(Problem(CABLE, scene=scene, tolerance=TOLERANCE))
    network.aim(Grip(Pose()), Grip(Pose()))
    return beside.Told(
        network.bare, network.held, network.knots, network.stops, network.finer(1.0), TOLERANCE, REACH, TURN,
        0.95 * CABLE.length,
    )  # fmt: skip


def start_of(told: beside.Told) -> tuple[tuple, np.ndarray, np.ndarray, np.ndarray]:
    """The shape at the centre of the cell of a grasp, its `info`, and the two poses there."""
    cell = np.empty((1, 9), np.int64)
    batch_cells.keys(START[None], END[None], REACH, TURN, cell)
    info = np.zeros(drive.INFO + 2)
    met, *arrays = beside.cell_shape(told, cell[0], NOTHING, info)
    assert met
    centre = np.empty((2, 7))
    batch_cells.grasp(cell[0], REACH, TURN, 0.95 * CABLE.length, *centre)
    return tuple(arrays), info, *centre


def exact(start: np.ndarray, end: np.ndarray, scene: cs.Scene) -> cs.CableShape:
    """The cold prediction."""
    poses = (cs.Pose(pose[:3], pose[3:]) for pose in (start, end))
    return cs.predict(CABLE, *poses, model="cosserat", tolerance=1e-8 * CABLE.length, points=POINTS, scene=scene)


def test_a_cells_start_is_the_equilibrium_there_on_a_mesh_of_its_own(scene: cs.Scene) -> None:
    (ints, floats, sols, space), info, start, end = start_of(told_of(scene))
    assert info[drive.I_ESTIMATE] < 0.5 * TOLERANCE
    assert info[drive.I_TURN] < 0.7
    nodes = model_of.py_func(ints, floats).s
    assert nodes[[0, -1]] == pytest.approx((0.0, CABLE.length))
    for mass in scene.masses:
        assert np.abs(nodes - mass.arc_length).min() < 1e-12
    shape = exact(start, end, scene)
    np.testing.assert_allclose(solution_of.py_func(ints, sols, NOW).lam[0], shape.force[-1], atol=2e-4)
    least = respond.smallest_eigenvalue(ints, floats, sols.copy(), space.copy())
    mode, eigen = np.zeros((len(nodes), 3)), np.empty(2)
    respond.softest_mode(ints, floats, sols, space, NOTHING, mode, 11, False, eigen)
    assert eigen[0] == pytest.approx(least, rel=5e-3)


@pytest.mark.parametrize(("far", "factored"), [(0.1, 1.0), (1.0, 2.0), (6.0, 3.0)])
def test_a_row_is_the_cold_prediction_and_is_factored_seldom(scene: cs.Scene, far: float, factored: float) -> None:
    """`far` counts 37 mm and 0.15 rad."""
    (ints, floats, sols, space), _, start, end = start_of(told_of(scene))
    there = turned(end, (0.1 * far, -0.1 * far, 0.05 * far))
    there[:3] -= far * np.array((0.02, 0.01, -0.03))
    poses, twists, own = np.empty((2, 7)), np.empty((2, 6)), np.zeros_like(sols)
    out, info = cs.CableShape.new_buffer(POINTS), np.zeros(drive.INFO + 2)
    assert beside.aim(ints, sols, start, there, poses)
    beside.lean(ints, floats, sols, space.copy(), poses, twists)
    beside.take_trial(ints, sols, own)
    code = drive.solve(
        ints, floats, own, space.copy(), out, info, np.empty((0, 7)), POINTS, 0, True, False, True, 25, 7.0
    )
    assert code == newton.CONVERGED
    assert info[newton.I_ASSEMBLIES] <= factored
    shape = exact(start, there, scene)
    apart = np.linalg.norm(out[POINTS : 4 * POINTS].reshape(-1, 3) - shape.positions, axis=1).max()
    assert apart < info[drive.I_ESTIMATE] < TOLERANCE
    moment = out[14 * POINTS : 17 * POINTS].reshape(-1, 3)
    np.testing.assert_allclose(moment, shape.moment, atol=1e-3 * np.abs(shape.moment).max())


def test_the_lean_is_right_to_first_order(scene: cs.Scene) -> None:
    """Halving the way to the ends quarters, at least, what Newton's method still turns."""
    (ints, floats, sols, space), _, start, end = start_of(told_of(scene))
    left = []
    for far in (0.08, 0.04, 0.02):
        there = turned(end, (2.0 * far, -far, 3.0 * far))
        there[:3] -= far * np.array((0.2, 0.1, -0.06))
        poses, twists, own = np.empty((2, 7)), np.empty((2, 6)), np.zeros_like(sols)
        out, info = np.empty(0), np.zeros(drive.INFO + 2)
        assert beside.aim(ints, sols, start, there, poses)
        beside.lean(ints, floats, sols, space.copy(), poses, twists)
        beside.take_trial(ints, sols, own)
        drive.solve(ints, floats, own, space.copy(), out, info, np.empty((0, 7)), 0, 0, True, False, True, 25, 7.0)
        left.append(info[drive.I_TURNED])
    assert left[-1] < 0.02
    assert np.all(np.array(left[:-1]) / left[1:] > 3.0), left
