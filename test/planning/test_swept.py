"""Swept spaces: closed, holding every instant and what lies between, as loose as told; which body is met where."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

import cable_shape as cs
from cable_shape.planning.study_near import nearest

ALONG = (0.5, 0.5, 0.5, 0.5)


def assert_closed(mesh):
    """Every edge has its two triangles, one either way."""
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    there, back = (np.unique(e, axis=0) for e in (edges, edges[:, ::-1]))
    assert len(there) == len(edges)
    assert np.array_equal(there, back)
    assert mesh.volume > 0.0


def assert_holds(mesh, lines, tolerance=1e-9):
    """No line (k, n, 3) is nearer to the mesh than its margin, and the mesh is no further than its looseness."""
    pieces = int(np.ceil(np.linalg.norm(np.diff(lines, axis=1), axis=2).max() / 0.002))
    finer = np.linspace(0.0, 1.0, pieces + 1)[:-1, None, None, None]
    dense = ((1.0 - finer) * lines[None, :, :-1] + finer * lines[None, :, 1:]).reshape(-1, 3)
    dense = np.concatenate((dense, lines[:, -1]))
    step = np.linalg.norm(np.diff(lines, axis=1), axis=2).max() / pieces
    corners = mesh.vertices[mesh.faces]
    looked = np.concatenate((mesh.vertices, corners.mean(axis=1)))
    distance = cKDTree(dense).query(looked)[0]
    assert np.sqrt(distance.min() ** 2 - (0.5 * step) ** 2) > mesh.margin - tolerance
    inside = dense[:: max(1, len(dense) // 8)]
    assert np.allclose([winding(mesh, point) for point in inside], 1.0, atol=1e-6)
    return distance.max() - mesh.margin


def winding(mesh, point):
    """How often the mesh goes round a point: the sum of solid angles (van Oosterom and Strackee, 1983) over 4 pi."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] - point for i in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    top = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = ((x * y).sum(axis=1) for x, y in ((a, b), (b, c), (c, a)))
    return float(2.0 * np.arctan2(top, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (4.0 * np.pi))


def waving(instants, points=40):
    """A line that turns and bends; (instants, points, 3)."""
    t, s = np.linspace(0.0, 1.0, instants)[:, None], np.linspace(0.0, 1.0, points)[None]
    x = 0.5 * s + 0.05 * np.sin(3.0 * t) * s
    y = 0.2 * np.sin(2.5 * t) * s**2
    z = 0.1 * np.cos(2.0 * t + 3.0 * s)
    return np.stack((x + 0.0 * y, y + 0.0 * x, z), axis=-1)


@pytest.mark.parametrize("looseness", [0.006, 0.012])
def test_it_holds_a_motion_many_times_finer(looseness):
    mesh = cs.swept(waving(60), 0.02, looseness=looseness)
    assert_closed(mesh)
    worst = assert_holds(mesh, waving(296))
    assert worst <= mesh.looseness <= looseness
    assert mesh.beside < 1e-3


def test_coarse_instants_are_held_with_what_lies_between():
    mesh = cs.swept(waving(12), 0.02, looseness=0.01)
    assert mesh.beside > 1e-3
    assert_holds(mesh, waving(221))


def test_a_tube_has_the_volume_of_a_tube():
    line = np.stack([np.linspace(0.0, 1.0, 30), np.zeros(30), np.zeros(30)], axis=1)[None]
    mesh = cs.swept(line, 0.05, looseness=0.004)
    assert_closed(mesh)
    least = np.pi * 0.05**2 + 4.0 / 3.0 * np.pi * 0.05**3
    most = np.pi * (0.05 + mesh.looseness) ** 2 + 4.0 / 3.0 * np.pi * (0.05 + mesh.looseness) ** 3
    assert least < mesh.volume < most
    assert mesh.bounds[0] == pytest.approx((-0.05, -0.05, -0.05), abs=mesh.looseness)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 4), st.integers(2, 5))
def test_whatever_moves_is_held(seed, instants, points):
    random = np.random.default_rng(seed)
    lines = random.uniform(-0.1, 0.1, (1, points, 3)) + random.uniform(-0.02, 0.02, (instants, points, 3))
    mesh = cs.swept(lines, 0.03, looseness=0.02)
    assert_closed(mesh)
    t = np.linspace(0.0, instants - 1.0, 9)
    i = np.minimum(t.astype(int), max(instants - 2, 0))
    x = (t - i)[:, None, None]
    between = lines[i] if instants == 1 else (1.0 - x) * lines[i] + x * lines[i + 1]
    assert_holds(mesh, between)


def study(instants):
    ends = np.array([(0.8, 0.0, 1.0, *ALONG), (0.95, 0.1, 1.05, *ALONG), (0.75, -0.1, 0.9, *ALONG)])
    starts = np.tile((0.0, 0.0, 1.0, *ALONG), (3, 1))
    return cs.Study(
        cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.02, diameter=0.01),
        scene=cs.Scene(
            obstacles=[
                cs.Obstacle("ball", cs.Sphere(0.05), cs.Pose((0.45, 0.06, 0.72))),
                cs.Obstacle("rod", cs.Cylinder(0.01, 0.5), cs.Pose((0.6, -0.05, 0.5))),
                cs.Obstacle("far", cs.Sphere(0.05), cs.Pose((5, 5, 5))),
            ]
        ),
        motion={"start": starts, "end": ends, "times": [0, 1, 2], "instants": instants},
        points=80,
    )


def test_a_study_sweeps():
    rows = study(50).rows([])[""]
    mesh = cs.swept(rows, 0.005, looseness=0.01)
    assert (
        mesh.vertices.tolist() == cs.swept([rows.shape(i) for i in range(50)], 0.005, looseness=0.01).vertices.tolist()
    )
    assert_closed(mesh)
    assert_holds(mesh, study(491).rows([])[""].part(1, 3))


def test_the_worst_instant_is_that_of_a_scan_a_hundred_times_finer():
    coarse, fine = study(21), study(2001)
    found = nearest(coarse.cases.at([]), coarse.rows([]))
    rows = fine.rows([])[""]
    assert [one.body for one in found][2] == "far"
    assert found[2].distance == np.inf
    for one in found[:2]:
        column = rows.tables[:, rows.bodies.index(one.body), 0]
        assert one.distance == pytest.approx(column.min(), abs=2e-5)
        assert one.instant == pytest.approx(column.argmin() / 100, abs=0.1)
        apart = np.linalg.norm(one.point_on_cable - one.point_on_body)
        assert apart == pytest.approx(abs(one.distance), abs=1e-4) or one.distance < 0.0


@pytest.mark.parametrize(
    ("shapes", "more", "words"),
    [
        (np.zeros((2, 3)), {}, r"shape \(m, n, 3\)"),
        (np.full((2, 3, 3), np.nan), {}, "finite"),
        ([], {}, r"shape \(m, n, 3\)"),
        ("many", {}, "it must be a list"),
        (waving(3), {"margin": 0.0}, "above 0"),
        (waving(1), {"looseness": 1e-5}, "Allow more looseness"),
    ],
)
def test_what_is_wrong_is_refused(shapes, more, words):
    with pytest.raises(cs.ArgumentError, match=words):
        cs.swept(shapes, **{"margin": 0.01, **more})
