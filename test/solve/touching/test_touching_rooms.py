"""Where three bodies meet: free ends that are poked into the corner of a room, by balance and by differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.contact import near as columns
from cable_shape.kernels.contact import sets

CABLE = cs.Cable(0.4, 0.1, 2e-3, diameter=0.008)
RADIUS = 0.004
SQUARE = np.eye(3)
LEANING = np.array(((1.0, 0.1, 0.2), (-0.2, 1.0, 0.1), (0.1, -0.1, 1.0)))


def looking(way) -> tuple:
    """The quaternion of a frame whose third axis points there."""
    way = np.asarray(way, dtype=float)
    return tuple(Rotation.align_vectors([way / np.linalg.norm(way)], [(0.0, 0.0, 1.0)])[0].as_quat())


def room(normals=SQUARE, friction=0.0, moved=(0.0, 0.0, 0.0)) -> cs.Scene:
    """Two walls and a floor through the origin; `moved`: the first wall."""
    walls = [
        cs.Obstacle(name, cs.HalfSpace(), cs.Pose(at, looking(n)), friction=friction)
        for name, n, at in zip(("x", "y", "floor"), normals, (moved, (0, 0, 0), (0, 0, 0)), strict=True)
    ]
    return cs.Scene(obstacles=walls, contact="solve")


def corner(normals=SQUARE) -> np.ndarray:
    """(3,) [m], where a cable's middle is that touches all three."""
    units = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return np.linalg.solve(units, np.full(3, RADIUS))


def poked(way, steps, normals=SQUARE, cable=CABLE, **options):
    """Shapes of a cable that is pushed along `way`, until its tip would be behind the corner, and its predictor."""
    way = np.asarray(way, dtype=float) / np.linalg.norm(way)
    predictor = cs.Predictor(cable, scene=room(normals, **options), model="cosserat", points=161, tolerance=4e-4)
    poses = [cs.Pose(corner(normals) + way * (far - cable.length - 0.01), looking(way)) for far in steps]
    return predictor, poses, [predictor.predict(pose, None) for pose in poses]


def at_tip(shape) -> dict[str, float]:
    """[N], by body, what pushes the last node that a body can press, 0.05 mm from the tip."""
    return {c.body: c.force for c in shape.contacts if c.arc_length > shape.length - 1e-4}


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("normals", [SQUARE, LEANING], ids=["square", "leaning"])
@pytest.mark.parametrize("way", [(-1.0, -0.8, -0.35), (-0.4, -1.0, -0.6), (-1.0, -0.3, -0.2)])
def test_what_presses_in_the_corner_balances_the_cable(way, normals, friction):
    _, _, shapes = poked(way, np.arange(0.0, 0.1, 0.005), normals, friction=friction)
    assert sum(shape.usable for shape in shapes) >= len(shapes) - 1
    for shape in shapes:
        if not shape.usable:
            continue
        weight = np.array((0.0, 0.0, -0.1 * 9.81 * 0.4))
        pushes = [contact.force * contact.normal + contact.tangential_force for contact in shape.contacts]
        assert shape.force[0] == pytest.approx(weight + sum(pushes, np.zeros(3)), abs=2e-3)
        start, places = shape.positions[0], shape.positions
        spots = [[np.interp(contact.arc_length, shape.arc_length, x) for x in places.T] for contact in shape.contacts]
        moments = [np.cross(spot - start, push) for spot, push in zip(spots, pushes, strict=True)]
        moments.append(np.cross(np.trapezoid(places - start, shape.arc_length, axis=0), (0.0, 0.0, -0.981)))
        assert shape.moment[0] == pytest.approx(sum(moments), abs=2e-3)
        assert all(contact.force > 0.0 for contact in shape.contacts)
        units = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        assert (places[1:-1] @ units.T).min() > RADIUS - 3e-4


def test_random_pokes_find_the_corner():
    rng, lost, count, together = np.random.default_rng(1), 0, 0, 0
    for _ in range(12):
        way = -np.abs(rng.normal(size=3)) * (1.0, 1.0, 0.4)
        cable = CABLE.replace(bending_stiffness=10 ** rng.uniform(-3.5, -1.5))
        _, _, shapes = poked(way, np.arange(0.0, 0.1, 0.004), cable=cable, friction=float(rng.choice((0.0, 0.3))))
        lost += sum(not shape.usable for shape in shapes)
        together += sum(len(at_tip(shape)) == 3 for shape in shapes)
        count += len(shapes)
    assert together > 20
    assert lost <= 0.02 * count  # 6 % where two bodies at most hold a node


#: A rod without weight, which is pushed into the corner until it gives way as Euler's, clamped here and pinned there.
ROD = cs.Cable(0.4, 0.0, (0.5, 0.8), diameter=0.008)
EULER = 4.493409**2 * 0.5 / 0.4**2
STEPS = (0.0, 0.008, 0.0095, 0.01, 0.0101, 0.0102, 0.0105, 0.011, 0.012)


@pytest.mark.parametrize("normals", [SQUARE, LEANING], ids=["square", "leaning"])
def test_a_rod_is_held_in_the_corner_by_three_pushes_up_to_eulers_load(normals):
    way = -np.array((1.0, 1.0, 1.0)) / np.sqrt(3.0)
    _, _, shapes = poked(way, STEPS, normals, ROD)
    last = shapes[-1]
    assert last.status is cs.Status.OK
    assert set(at_tip(last)) == {"x", "y", "floor"}
    units = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    pushes = np.array([at_tip(last)[name] for name in ("x", "y", "floor")])
    assert -last.force[0] @ way == pytest.approx(EULER, rel=5e-3)
    assert pushes == pytest.approx(np.linalg.solve(units.T, last.force[0]), rel=1e-3)
    assert last.positions[-1] == pytest.approx(corner(normals), abs=1e-4)


def test_derivatives_in_the_corner_are_those_of_differences():
    way = -np.array((1.0, 1.0, 1.0)) / np.sqrt(3.0)
    predictor, poses, shapes = poked(way, STEPS, SQUARE, ROD)
    assert len(at_tip(shapes[-1])) == 3
    columns = predictor.sensitivity(("start", "body:x"))
    h = 2e-7

    def after(shift=(0.0, 0.0, 0.0), moved=(0.0, 0.0, 0.0)):
        other = poked(way, STEPS, SQUARE, ROD)[0]
        other.scene = room(moved=moved)
        shape = other.predict(cs.Pose(poses[-1].position + np.array(shift), poses[-1].quaternion), None)
        assert len(at_tip(shape)) == 3
        return shape.positions

    for column, key, axis in ((0, "shift", 0), (1, "shift", 1), (2, "shift", 2), (6, "moved", 0)):
        d = h * np.eye(3)[axis]
        slope = (after(**{key: d}) - after(**{key: -d})) / (2.0 * h)
        assert columns[:, :, column] == pytest.approx(slope, abs=2e-2 * np.abs(slope).max())


# -- the tables


def tables(bodies: int, normals, presses):
    """Three nodes, the middle one pressed by so many bodies."""
    near, on = np.zeros((3, columns.NEAR)), np.full((3, columns.ON), columns.BARE)
    for row, (body, at, press) in enumerate(
        ((0, columns.NORMAL, columns.PRESS), (columns.SECOND, columns.SECOND_NORMAL, columns.SECOND_PRESS),
         (columns.THIRD, columns.THIRD_NORMAL, columns.THIRD_PRESS))[:bodies]
    ):  # fmt: skip
        on[1, body] = 10 + row
        near[1, at : at + 3], near[1, press] = normals[row], presses[row]
    on[1, 1] = 10
    return near, on


@pytest.mark.parametrize("bodies", [1, 2, 3])
def test_pushes_and_ways_out_are_those_of_the_least_squares(bodies):
    rng = np.random.default_rng(bodies)
    for _ in range(20):
        normals = np.linalg.qr(rng.normal(size=(3, 3)))[0] + 0.2 * rng.normal(size=(3, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        near, on = tables(bodies, normals, np.ones(3))
        own, force, gaps = normals[:bodies], rng.normal(size=3), rng.normal(size=3)
        told = columns.shares.py_func(near, on, 1, tuple(force))
        assert told[:bodies] == pytest.approx(np.linalg.lstsq(own.T, force, rcond=None)[0])
        assert told[bodies:] == (0.0,) * (3 - bodies)
        out = columns.way_out.py_func(near, on, 1, *gaps)
        assert out == pytest.approx(np.linalg.lstsq(own, gaps[:bodies], rcond=None)[0])


@pytest.mark.parametrize("pulls", [0, 1, 2])
def test_of_three_bodies_the_one_that_pulls_lets_go(pulls):
    presses = np.array((3.0, 4.0, 5.0))
    presses[pulls] = -1.0
    near, on = tables(3, SQUARE, presses)
    assert sets.drop(near, on, np.arange(3.0), 1e-6, False) == 1
    assert {on[1, 0], on[1, columns.SECOND]} == {10, 11, 12} - {10 + pulls}
    assert on[1, columns.THIRD] == columns.BARE
    assert near[1, columns.THIRD_PRESS] == 0.0
    for body, at, press in (
        (0, columns.NORMAL, columns.PRESS),
        (columns.SECOND, columns.SECOND_NORMAL, columns.SECOND_PRESS),
    ):
        which = int(on[1, body]) - 10
        assert near[1, press] == presses[which]
        assert near[1, at : at + 3].tolist() == SQUARE[which].tolist()


def test_a_third_body_holds_a_node_only_where_it_closes_the_edge_of_the_others():
    for third, closes in (((0.0, 0.0, 1.0), True), ((-1.0, 0.0, 0.0), False), ((-0.7071, -0.7071, 0.0), False)):
        near, on = tables(2, SQUARE, np.ones(3))
        on[1, 1] = 12
        near[1, columns.STEP : columns.STEP + 3] = SQUARE[0]  # as `look` leaves it
        near[1, columns.NORMAL : columns.NORMAL + 3], near[1, columns.GAP] = third, -1e-3
        assert sets.meet(near, on, 1e-6) == int(closes)
        assert bool(on[1, columns.THIRD] == 12) is closes
