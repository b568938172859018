"""What was told as OK and was not, and the reverse: each shape here was once wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rods import ALONG_X, rod_equations
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import cable_shape as cs

AT = cs.Pose((0.0, 0.0, 1.0), ALONG_X)


def drawn_on(cable: cs.Cable, shape: cs.CableShape, load: np.ndarray) -> float:
    """[m]: how far the rod's equations, integrated from each point to the next, miss the next at the worst."""
    table = np.atleast_2d(cable.rest_curvature)
    places = np.linspace(0.0, cable.length, len(table))
    straight = cable.replace(rest_curvature=(0.0, 0.0, 0.0))
    K = np.array((*cable.bending_stiffness, cable.twisting_stiffness))
    plain = rod_equations(straight, load)

    def slopes(s, y):
        R, u0 = y[3:12].reshape(3, 3), np.array([np.interp(s, places, x) for x in table.T])
        # with m' = R K u0 taken off the moment, u = K^-1 R^T m + u0 is that of a straight rod
        out = plain(s, np.concatenate((y[:15], y[15:] + R @ (K * u0))))
        out[15:] = plain(s, y)[15:]
        return out

    frames, worst = Rotation.from_quat(shape.quaternions).as_matrix(), 0.0
    for k in range(0, shape.points - 1):
        y = np.concatenate((shape.positions[k], frames[k].ravel(), shape.force[k], shape.moment[k]))
        span = (shape.arc_length[k], shape.arc_length[k + 1])
        kinks = [x for x in places if span[0] < x < span[1]]
        for a, b in zip((span[0], *kinks), (*kinks, span[1]), strict=True):
            y = solve_ivp(slopes, (a, b), y, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
        worst = max(worst, float(np.linalg.norm(y[:3] - shape.positions[k + 1])))
    return worst


@pytest.mark.parametrize("batch", [False, True])
@pytest.mark.parametrize("rows", [3, 7, 20, 60])
def test_a_table_of_rest_curvature_is_followed_kink_by_kink(rows, batch):
    """The error told was within tolerance, the true one a hundred times above it."""
    rng = np.random.default_rng(rows)
    end = cs.Pose((0.7, 0.1, 1.0), ALONG_X)
    for _ in range(2):
        table = 3.0 * rng.normal(size=(rows, 3)) * (1.0, 1.0, 0.3)
        cable = cs.Cable(1.0, 0.06, 0.004, rest_curvature=table)
        if batch:
            shape = cs.predict_batch(cable, AT.array[None], end.array[None], points=61)[0]
        else:
            shape = cs.predict(cable, AT, end, points=61)
        fine = cs.predict(cable, AT, end, points=61, tolerance=1e-9)
        assert shape.status is cs.Status.OK
        assert fine.status is cs.Status.OK
        assert drawn_on(cable, fine, 0.06 * np.array((0.0, 0.0, -9.81))) < 2e-9
        error = float(np.linalg.norm(shape.positions - fine.positions, axis=1).max())
        assert error <= shape.error_estimate <= 1e-5


@pytest.mark.parametrize("turns", [-50, -4, 4, 6, 11, 1000])
def test_windings_that_cannot_be_reached_are_no_others(turns):
    cable = cs.Cable(1.2, 0.1, 0.01)
    shape = cs.predict(cable, AT, cs.Pose((0.8, 0.0, 1.0), ALONG_X, turns=turns))
    assert shape.status is cs.Status.NOT_CONVERGED
    assert f"turns {turns}" in shape.detail
    for fewer in (-2, 3):
        kept = cs.predict(cable, AT, cs.Pose((0.8, 0.0, 1.0), ALONG_X, turns=fewer))
        assert kept.status is cs.Status.OK
        assert kept.turns == fewer
        assert fewer - 0.5 < kept.twist / (2.0 * math.pi) < fewer + 0.5


@pytest.mark.parametrize("kind", ["pinned", "swivel"])
@pytest.mark.parametrize("moment", [(0.0, 0.0, 0.05), (0.05, 0.0, 0.05)])
def test_a_start_that_holds_no_moment_is_given_none(kind, moment):
    cable = cs.Cable(1.0, 0.01, 0.3)
    start = cs.Grip(cs.Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)), kind=kind)
    shape = cs.predict(cable, start, cs.FreeEnd(moment=moment))
    assert not shape.usable
    assert "Clamp the start" in shape.detail
    if kind == "swivel":  # across its axis it holds
        assert cs.predict(cable, start, cs.FreeEnd(moment=(0.05, 0.0, 0.0))).status is cs.Status.OK


def test_a_strip_drawn_nearly_taut_moves_smoothly():
    """It was said to have snapped where its frames turn sharply, though it moved by a few millimetres."""
    bend = 0.05 * 9.81 / 21.172988500584797
    cable = cs.Cable(1.0, 0.05, bend)
    predictor, last = cs.Predictor(cable), None
    tilt = 1.1110001333116408
    for chord in 0.5080118347496867 + 0.0024709885799547175 * np.arange(200):
        if chord > 0.9999:
            break
        start, end = (
            cs.Pose((x, 0.0, 0.0), (0.0, math.sin(0.5 * (math.pi / 2 - a)), 0.0, math.cos(0.5 * (math.pi / 2 - a))))
            for x, a in ((0.0, tilt), (chord, -tilt))
        )
        shape = predictor.predict(start, end)
        assert shape.status is cs.Status.OK, chord
        if last is not None:
            assert np.abs(shape.positions - last).max() < 0.01
        last = shape.positions.copy()


def test_an_eyelet_that_runs_to_a_knot_is_told():
    """Of two eyelets one has run to the next clip, which ended in an error of numpy's."""
    cable = cs.Cable(
        length=1.784246,
        linear_density=0.086731,
        bending_stiffness=[15.079219, 55.20103],
        twisting_stiffness=27.030865,
        rest_curvature=[
            [0.019567, -0.022574, 0.062094],
            [0.074089, 0.012896, -0.061246],
            [0.04124, 0.029893, -0.047001],
        ],
    )
    clips = [
        (0.111134, ((-0.233028, 0.080809, -0.327837), (0.010578, -0.976348, 0.011278, 0.21565)), "slide"),
        (0.842504, ((-0.568928, 0.060937, -0.892748), (0.107623, -0.981418, 0.00539, 0.158765)), "fixed"),
        (1.020551, ((-0.589256, 0.071378, -1.052767), (-0.06203, -0.988415, -0.017852, 0.137367)), "ball"),
        (1.414719, ((-0.716559, 0.190676, -1.308071), (-0.247463, -0.942486, -0.02623, 0.223145)), "hinge"),
        (1.642549, ((-0.732334, 0.153982, -1.467785), (0.544833, -0.805707, -0.030254, 0.230386)), "slide"),
    ]
    ends = [
        (
            ((-0.245779, 0.136104, -0.20564), (0.169817, -0.950633, -0.057869, 0.253199)),
            ((-0.800429, 0.159935, -1.54133), (0.106324, -0.9513, 0.035029, 0.287221)),
        ),
        (
            ((-0.268132, 0.147934, -0.194641), (0.175125, -0.949747, -0.055817, 0.253371)),
            ((-0.787468, 0.183768, -1.533415), (0.110239, -0.948592, 0.038069, 0.294231)),
        ),
        (
            ((-0.314174, 0.175896, -0.193183), (0.178377, -0.949832, -0.052716, 0.251441)),
            ((-0.767251, 0.196034, -1.506122), (0.110158, -0.945135, 0.042625, 0.304578)),
        ),
    ]
    predictor = cs.Predictor(cable, scene=cs.Scene(clips=[cs.Clip(s, cs.Pose(*pose), kind) for s, pose, kind in clips]))
    shapes = [predictor.predict(cs.Pose(*start), cs.Pose(*end)) for start, end in ends]
    assert shapes[0].usable
    assert all(shape.usable or "eyelet" in shape.detail for shape in shapes)
