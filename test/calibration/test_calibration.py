"""Calibration: parameters put into synthetic observations are found again, with honest error bars."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from recordings import BEGIN, LEFT, PERIOD, RIGHT, markers_entry, pose_entry, write_bag
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.calibration import robust
from cable_shape.calibration.forward import Forward
from cable_shape.calibration.parameters import Parameters
from cable_shape.calibration.robust import TUNING, Robust
from cable_shape.command.cli import main
from cable_shape.errors import ArgumentError, BagError, UnknownKeyError
from cable_shape.kernels.distance.misses import misses
from cable_shape.replay.observations import load_observations

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
TRUE = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.004)


def grips(rng: np.random.Generator, length: float) -> tuple[cs.Pose, cs.Pose]:
    """Two ends with slack, their tangents up to some 30 degrees off the chord."""
    way = np.array((1.0, 0.0, 0.0)) + 0.3 * rng.normal(size=3)
    way *= length * rng.uniform(0.5, 0.9) / np.linalg.norm(way)
    ends = ((Rotation.from_rotvec(0.3 * rng.normal(size=3)) * ALONG_X).as_quat() for _ in range(2))
    return cs.Pose((0, 0, 0), next(ends)), cs.Pose(way, next(ends))


def observed(
    cable: cs.Cable,
    seed: int,
    count: int = 5,
    marks: int = 15,
    noise: float = 5e-4,
    stray: float = 0.05,
    known: bool = False,
) -> list[cs.Observation]:
    """Points of `cable` between random grips, with noise [m] and stray ones of 5 cm."""
    rng = np.random.default_rng(seed)
    out: list[cs.Observation] = []
    while len(out) < count:
        start, end = grips(rng, cable.length)
        shape = cs.predict(cable, start, end, model="cosserat", points=301)
        if shape.status is not cs.Status.OK:
            continue
        which = np.sort(rng.integers(15, 286, marks))
        points = shape.positions[which] + noise * rng.normal(size=(marks, 3))
        off = rng.random(marks) < stray
        points[off] += 0.05 * rng.normal(size=(int(off.sum()), 3))
        out.append(cs.Observation(start, end, points, shape.arc_length[which] if known else None))
    return out


def rough(cable: cs.Cable, factor: float = 2.0, **changes: float) -> cs.Cable:
    return cable.replace(bending_stiffness=factor * cable.mean_bending_stiffness, twisting_stiffness=None, **changes)


def test_misses_are_those_to_the_curve() -> None:
    start, end = cs.Pose((0, 0, 0), ALONG_X.as_quat()), cs.Pose((0.7, 0.1, 0.0), ALONG_X.as_quat())
    shape = cs.predict(TRUE, start, end, model="cosserat", points=41)
    fine = cs.predict(TRUE, start, end, model="cosserat", points=4001).positions
    seen = np.array([(0.1, 0.02, -0.05), (0.35, 0.0, -0.4), (0.7, 0.3, 0.1)])
    out = np.empty((3, 3))
    misses(shape.buffer, shape.points, seen, np.full(3, math.nan), out)
    nearest = np.linalg.norm(seen[:, None] - fine[None], axis=2).min(axis=1)
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), nearest, rtol=0.0, atol=1e-5)
    misses(shape.buffer, shape.points, seen, np.array((0.0, 0.5, 0.777)), out)
    np.testing.assert_allclose(out, seen - fine[[0, 2000, 3108]], rtol=0.0, atol=1e-5)


ENDS = ("start_offset", "start_tilt", "end_offset", "end_tilt", "roll", "start_roll")
AT_ENDS = (4e-3, -3e-3, 2e-3, 0.1, -0.2, 3e-3, 5e-3, -4e-3, 0.15, 0.1, 0.2, 0.1)
OWN = ("bending_stiffness", "twisting_stiffness", "axial_stiffness", "length", "rest_curvature")
AT_OWN = (math.log(0.005), math.log(0.003), math.log(300.0), 1.01, 0.3, -0.2)


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("kind", ["clamped", "swivel", "free"])
@pytest.mark.parametrize(("fit", "at"), [(ENDS, AT_ENDS), (OWN, AT_OWN)], ids=["ends", "cable"])
def test_derivatives_are_those_of_differences(
    fit: tuple, at: tuple, kind: str, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cable_shape.calibration.forward.TOLERANCE", 1e-8)  # differences hold what a mesh leaves, too
    turned = cs.Pose((0.01, -0.02, 0.03), Rotation.from_rotvec((0.2, -0.1, 0.3)).as_quat())
    of_end = ("end_x", "end_y", "end_z", "end_tilt_1", "end_tilt_2", "roll")
    unseen = {"clamped": (), "swivel": ("roll",), "free": of_end}[kind]
    rng, seen = np.random.default_rng(3), []
    parameters = Parameters(TRUE.replace(axial_stiffness=200.0), fit)
    at = np.array(at)
    cable = parameters.make_cable(at)
    for k in range(3):
        near, far = grips(rng, TRUE.length)
        start = cs.Grip(near * turned.inverse(), offset=turned)
        end = None if kind == "free" else cs.Grip(far, kind=kind)
        table = 2.0 * rng.normal(size=(5, 3)) if k == 0 else None
        shape = cs.predict(cable, start, end, model="cosserat", points=301, acceleration=table)
        points = shape.positions[15::30] + 5e-4 * rng.normal(size=(10, 3))
        seen.append(cs.Observation(start, end, points, shape.arc_length[15::30] if known else None, table))
    forward = Forward(parameters, seen)
    now = forward.misses(at)
    forward.misses(at + 1e-3)  # as after a step that was not taken
    derivatives = forward.jacobian(at, now)
    for j, parameter in enumerate(forward.parameters.each):
        step = np.zeros_like(at)
        step[j] = 0.2 * parameter.step
        wanted = (forward.misses(at + step) - forward.misses(at - step)) / (2.0 * step[j])
        size = float(np.abs(wanted).max())
        if parameter.name in unseen or size * parameter.step < 1e-6:
            assert size * parameter.step < 2e-6, parameter.name
            assert np.abs(derivatives[:, :, j]).max() * parameter.step < 2e-6, parameter.name
        else:
            np.testing.assert_allclose(derivatives[:, :, j], wanted, rtol=0.0, atol=0.01 * size, err_msg=parameter.name)


def test_robust_fit_against_a_line_in_closed_form() -> None:
    # with a scale that is huge beside the misses the loss is that of least squares, whose errors are known
    rng = np.random.default_rng(0)
    x = np.linspace(0.0, 1.0, 400)
    design = np.zeros((400, 3, 2))
    design[:, 0, 0], design[:, 1, 1] = 1.0, x
    truth = np.array((0.3, -0.7))
    seen = design @ truth + 1e-3 * rng.normal(size=(400, 3))
    one = np.ones(2)
    fit = Robust(
        lambda v: seen - design @ v, lambda v, r: -design, lambda v: seen - design @ v, np.full(400, 3),
        np.arange(400) % 5, 10.0 * one, np.zeros((2, 2)),
    ).run(np.zeros(2))  # fmt: skip
    assert fit.converged
    assert fit.scale == pytest.approx(1e-3, rel=0.1)
    exact = 1e-3 / np.sqrt(np.array((400.0, (x**2).sum())))
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), exact, rtol=0.12)
    assert (np.abs(fit.values - truth) < 3.0 * exact).all()
    assert TUNING > 1.0


def test_exact_points_give_the_exact_cable() -> None:
    found = cs.calibrate(
        observed(TRUE, 1, noise=0.0, stray=0.0, known=True),
        rough(TRUE, 5.0, length=1.004),
        ("bending_stiffness", "length"),
    )
    assert found.converged
    assert found["bending_stiffness"].value == pytest.approx(0.004, rel=2e-3)
    assert found["length"].value == pytest.approx(1.0, abs=5e-5)


def test_true_values_are_inside_their_intervals() -> None:
    inside = []
    for seed in range(40):
        rng = np.random.default_rng(1000 + seed)
        length, density = rng.uniform(0.5, 1.5), rng.uniform(0.02, 0.2)
        stiffness = density * 9.81 * (length * math.exp(rng.uniform(math.log(0.05), math.log(0.3)))) ** 3
        true = cs.Cable(length=length, linear_density=density, bending_stiffness=stiffness)
        begin = rough(true, math.exp(0.7 * rng.normal()), length=length * (1.0 + 0.003 * rng.normal()))
        found = cs.calibrate(observed(true, seed), begin, ("bending_stiffness", "length"))
        assert found.converged
        for name, value in (("bending_stiffness", stiffness), ("length", length)):
            estimate = found[name]
            inside.append(estimate.low <= value <= estimate.high)
    # of 80 intervals of 95 %, 76 on average; fewer than 70 has a chance of 0.4 %
    assert sum(inside) >= 70


def test_error_bars_shrink_with_the_square_root_of_the_points() -> None:
    few = cs.calibrate(observed(TRUE, 3, stray=0.0), rough(TRUE))
    many = cs.calibrate(observed(TRUE, 3, stray=0.0, marks=240), rough(TRUE))
    ratio = few["bending_stiffness"].relative / many["bending_stiffness"].relative
    assert 2.6 < ratio < 6.0, ratio  # 4, and how well 75 points know their scatter and where they lie


def test_stray_points_are_found() -> None:
    seen = observed(TRUE, 5, stray=0.0)
    clean = cs.calibrate(seen, rough(TRUE))
    seen[2].points[[3, 9]] += (0.0, 0.1, 0.1)
    dirty = cs.calibrate(seen, rough(TRUE))
    assert set(np.flatnonzero(dirty.weights < 0.05)) == {33, 39}
    moved = abs(math.log(dirty["bending_stiffness"].value / clean["bending_stiffness"].value))
    assert moved < 0.5 * clean["bending_stiffness"].relative


def test_tilt_offset_and_rest_curvature_come_back() -> None:
    bent = TRUE.replace(rest_curvature=(0.8, -0.5, 0.0))
    tilt = cs.Pose((0.002, -0.003, 0.001), Rotation.from_rotvec((0.05, -0.08, 0.0)).as_quat())
    seen = []
    rng = np.random.default_rng(8)
    for _ in range(6):
        start, end = grips(rng, 1.0)
        shape = cs.predict(bent, cs.Grip(start, offset=tilt), end, model="cosserat", points=301)
        which = rng.integers(10, 290, 30)
        seen.append(cs.Observation(start, end, shape.positions[which] + 1e-4 * rng.normal(size=(30, 3))))
    names = ("bending_stiffness", "rest_curvature", "start_tilt", "start_offset")
    found = cs.calibrate(seen, rough(TRUE, 1.3), names)
    truth = {
        "bending_stiffness": 0.004, "rest_curvature_1": 0.8, "rest_curvature_2": -0.5, "start_tilt_1": 0.05,
        "start_tilt_2": -0.08, "start_x": 0.002, "start_y": -0.003, "start_z": 0.001,
    }  # fmt: skip
    for name, value in truth.items():
        estimate = found[name]
        assert abs(estimate.value - value) < 4.0 * estimate.standard_error, (name, str(estimate), value)
        assert estimate.standard_error < 0.1 * max(abs(value), 0.02), (name, str(estimate))


def test_what_the_data_cannot_tell_is_said() -> None:
    # swivel grips let no twist in, so that GJ is not seen at all
    rng = np.random.default_rng(2)
    seen = []
    for _ in range(3):
        start, end = grips(rng, 1.0)
        shape = cs.predict(TRUE, start, cs.Grip(end, kind="swivel"), model="cosserat", points=101)
        points = shape.positions[10:-10:8] + 2e-4 * rng.normal(size=(11, 3))
        seen.append(cs.Observation(start, cs.Grip(end, kind="swivel"), points))
    found = cs.calibrate(seen, rough(TRUE), ("bending_stiffness", "twisting_stiffness"))
    assert found["twisting_stiffness"].standard_error == math.inf
    assert "not seen" in str(found["twisting_stiffness"])
    assert any("do not see twisting_stiffness" in remark for remark in found.remarks)
    assert found["bending_stiffness"].relative < 0.05
    with_prior = cs.calibrate(
        seen, rough(TRUE), ("bending_stiffness", "twisting_stiffness"), priors={"twisting_stiffness": 0.3}
    )
    assert with_prior["twisting_stiffness"].relative == pytest.approx(0.3, rel=0.01)
    assert any("by its prior" in remark for remark in with_prior.remarks)


def test_a_weightless_cable_has_no_stiffness_to_be_seen() -> None:
    free = TRUE.replace(linear_density=0.0)
    found = cs.calibrate(observed(free, 4), rough(free))
    assert any("do not see bending_stiffness" in remark for remark in found.remarks)


def test_groups_put_what_the_model_lacks_into_the_error_bars() -> None:
    # every observation has a bow of its own that no parameter makes; its many points repeat it
    rng = np.random.default_rng(6)
    seen = observed(TRUE, 6, count=16, marks=60, stray=0.0)
    for one in seen:
        one.points[:, 2] += 0.004 * rng.normal() * np.sin(np.pi * np.linspace(0.05, 0.95, 60))
    apart = cs.calibrate(seen, rough(TRUE))
    assert abs(math.log(apart["bending_stiffness"].value / 0.004)) < 3.0 * apart["bending_stiffness"].relative
    few = cs.calibrate(seen[:5], rough(TRUE))  # too few to judge by: as if points were independent
    assert apart["bending_stiffness"].relative > 1.2 * few["bending_stiffness"].relative / math.sqrt(16 / 5)


@pytest.mark.parametrize("kind", ["ball", "hinge", "slide"])
def test_a_cable_in_a_clip_is_found_with_the_clip(kind: str) -> None:
    rng = np.random.default_rng(8)
    start, end = cs.Pose((0, 0, 0), ALONG_X.as_quat()), cs.Pose((0.75, 0.1, 0.0), ALONG_X.as_quat())
    shape = cs.predict(TRUE, start, end, points=101)
    middle = cs.Pose(shape.positions[40] + (0.0, 0.03, 0.04), shape.quaternions[40])
    scene = cs.Scene(clips=[cs.Clip(0.4, middle, kind)], masses=[cs.PointMass(0.7, 0.005)])
    shape = cs.predict(TRUE, start, end, points=101, scene=scene)
    seen = [cs.Observation(start, end, shape.positions[3:-3:3] + 3e-4 * rng.normal(size=(32, 3)))]
    fit = ("bending_stiffness", "length")
    found = cs.calibrate(seen, rough(TRUE, 1.5, length=1.003), fit, scene=scene)
    assert found.converged
    assert not found.trouble
    assert abs(math.log(found["bending_stiffness"].value / 0.004)) < 3.0 * found["bending_stiffness"].relative
    assert abs(found["length"].value - 1.0) < 3.0 * found["length"].standard_error
    assert found["bending_stiffness"].relative < 0.2
    without = cs.calibrate(seen, rough(TRUE, 1.5, length=1.003), fit)
    assert np.median(without.distances) > 5.0 * np.median(found.distances)


def test_moving_cable_needs_its_acceleration() -> None:
    rng = np.random.default_rng(7)
    seen, still = [], []
    for k in range(4):
        start, end = grips(rng, 1.0)
        table = 3.0 * rng.normal(size=(7, 3))
        shape = cs.predict(TRUE, start, end, model="cosserat", points=101, acceleration=table)
        points = shape.positions[8:-8:6] + 2e-4 * rng.normal(size=(15, 3))
        seen.append(cs.Observation(start, end, points, acceleration=table, group=k))
        still.append(cs.Observation(start, end, points))
    found, wrong = cs.calibrate(seen, rough(TRUE)), cs.calibrate(still, rough(TRUE))
    assert abs(math.log(found["bending_stiffness"].value / 0.004)) < 3.0 * found["bending_stiffness"].relative
    assert np.median(wrong.distances) > 10.0 * np.median(found.distances)


def test_tube_holds_new_points() -> None:
    found = cs.calibrate(observed(TRUE, 11), rough(TRUE), ("bending_stiffness", "length"))
    rng = np.random.default_rng(12)
    held = total = 0
    for _ in range(10):
        start, end = grips(rng, 1.0)
        tube = cs.predict_tube(found, start, end)
        true = cs.predict(TRUE, start, end, model="cosserat", points=101)
        points = true.positions[5:-5] + 5e-4 * rng.normal(size=(91, 3))
        out = np.empty_like(points)
        misses(tube.shape.buffer, tube.shape.points, points, np.full(91, math.nan), out)
        held += int((np.linalg.norm(out, axis=1) <= tube.radius[5:-5]).sum())
        total += 91
    assert 0.88 < held / total < 1.0


@pytest.mark.parametrize("held", ["level", "pinned", "free"])
def test_sag_gives_the_stiffness(held: str) -> None:
    chord = None if held == "free" else 0.9
    start = cs.Pose((0, 0, 0), (0.5, 0.5, 0.5, 0.5))
    kind = "pinned" if held == "pinned" else "clamped"
    end = None if held == "free" else cs.Grip(cs.Pose((0.9, 0, 0), (0.5, 0.5, 0.5, 0.5)), kind=kind)
    shape = cs.predict(TRUE, cs.Grip(start, kind=kind), end, model="cosserat", points=801)
    found = cs.calibrate_sag(rough(TRUE, 30.0), -shape.positions[:, 2].min(), chord=chord, held=held)
    assert found.cable.mean_bending_stiffness == pytest.approx(0.004, rel=1e-2)
    estimate = found["bending_stiffness"]
    assert estimate.low < 0.004 < estimate.high
    # a sag alone: twice its error is twice that of the stiffness
    rougher = cs.calibrate_sag(
        rough(TRUE, 30.0),
        -shape.positions[:, 2].min(),
        chord=chord,
        held=held,
        sag_error=0.006,
        place_error=0.0,
        tilt_error=0.0,
    )
    finer = cs.calibrate_sag(
        rough(TRUE, 30.0),
        -shape.positions[:, 2].min(),
        chord=chord,
        held=held,
        sag_error=0.003,
        place_error=0.0,
        tilt_error=0.0,
    )
    assert rougher["bending_stiffness"].relative == pytest.approx(2.0 * finer["bending_stiffness"].relative, rel=1e-9)


def test_sag_of_a_cantilever_is_that_of_linear_theory() -> None:
    # a stiff short cantilever: w L^4 / 8 EI
    stiff = cs.Cable(length=0.3, linear_density=0.1, bending_stiffness=1.0)
    sag = 0.1 * 9.81 * 0.3**4 / (8.0 * 0.5)
    found = cs.calibrate_sag(stiff, sag, held="free", sag_error=1e-5)
    assert found.cable.mean_bending_stiffness == pytest.approx(0.5, rel=1e-3)


def test_sag_error_is_what_true_sags_scatter() -> None:
    """A cantilever held, cut and measured not quite right, many times over: the scatter of ln EI is its error."""
    rng = np.random.default_rng(21)
    found = []
    for _ in range(60):
        tilt = 0.02 * rng.normal()
        turn = (Rotation.from_rotvec((0.0, tilt, 0.0)) * ALONG_X).as_quat()
        held = TRUE.replace(length=0.5 + 0.002 * rng.normal())
        shape = cs.predict(held, cs.Pose((0, 0, 0), turn), None, model="cosserat", points=401)
        sag = -shape.positions[:, 2].min() + 0.003 * rng.normal()
        found.append(cs.calibrate_sag(TRUE.replace(length=0.5), sag, held="free")["bending_stiffness"])
    scatter = float(np.std([math.log(e.value) for e in found]))
    assert 0.75 < scatter / float(np.median([e.relative for e in found])) < 1.3


def test_impossible_sags_are_refused() -> None:
    with pytest.raises(ArgumentError, match=r"sag = 0\.8 .*between"):
        cs.calibrate_sag(TRUE, 0.8, chord=0.9)
    with pytest.raises(ArgumentError, match="chord"):
        cs.calibrate_sag(TRUE, 0.1)
    with pytest.raises(ArgumentError, match="chord"):
        cs.calibrate_sag(TRUE, 0.1, chord=1.2)


def test_yaml_comes_back_with_its_errors_beside(tmp_path: Path) -> None:
    found = cs.calibrate(
        observed(TRUE, 9), rough(TRUE), ("bending_stiffness", "length", "rest_curvature", "start_tilt")
    )
    file = found.save(tmp_path / "cable.yaml")
    again = cs.Cable.from_yaml(file)
    assert again == found.cable
    text = file.read_text()
    assert text.count("standard error") >= 6
    assert "start_tilt_1" in text
    assert json.loads(json.dumps(found.as_dict()))["estimates"]["length"]["unit"] == "m"


def arrays(seen: list[cs.Observation]) -> dict[str, np.ndarray]:
    return {
        "start": np.array([o.start.pose.array for o in seen]),
        "end": np.array([o.end.pose.array for o in seen if isinstance(o.end, cs.Grip)]),
        "points": np.array([o.points for o in seen]),
    }


def test_npz_csv_and_bag_give_the_same_cable(tmp_path: Path) -> None:
    seen = observed(TRUE, 13, stray=0.0)
    np.savez(tmp_path / "seen.npz", **arrays(seen))
    lines = ["observation,what,x,y,z,qx,qy,qz,qw"]
    entries = []
    for k, one in enumerate(seen):
        assert isinstance(one.end, cs.Grip)
        stamp = BEGIN + k * PERIOD * 100
        for what, topic, grip in (("start", LEFT, one.start), ("end", RIGHT, one.end)):
            lines.append(",".join([str(k), what, *(repr(float(x)) for x in grip.pose.array)]))
            entries.append(pose_entry(topic, stamp, grip.pose.position, grip.pose.quaternion))
        lines += [f"{k},point,{x!r},{y!r},{z!r},,,," for x, y, z in one.points.tolist()]
        ends = one.start.pose.position, one.end.pose.position
        entries.append(markers_entry(stamp, [ends[0], *one.points, ends[1]]))
    (tmp_path / "seen.csv").write_text("\n".join(lines) + "\n")
    write_bag(tmp_path / "bag", entries)
    direct = cs.calibrate(seen, rough(TRUE))["bending_stiffness"].value
    for name in ("seen.npz", "seen.csv", "bag"):
        read = load_observations(tmp_path / name)
        assert cs.calibrate(read, rough(TRUE))["bending_stiffness"].value == pytest.approx(direct, rel=1e-6), name


def test_accelerations_of_a_recording_are_those_of_the_motion(tmp_path: Path) -> None:
    entries = []
    for k in range(60):
        t = 0.01 * k
        lift = 0.5 * 2.0 * t**2  # 2 m/s^2 upwards
        stamp = BEGIN + k * PERIOD
        entries.append(pose_entry(LEFT, stamp, (0.0, 0.0, lift)))
        entries.append(pose_entry(RIGHT, stamp, (0.8, 0.0, lift)))
        entries.append(markers_entry(stamp, [(0.2 * i, 0.0, lift) for i in range(5)]))
    write_bag(tmp_path / "bag", entries)
    read = load_observations(tmp_path / "bag", inertia=True, frames=6)
    assert len(read) == 6
    for one, k in zip(read, (0, 12, 24, 35, 47, 59), strict=True):
        told = np.tile((0.0, 0.0, 2.0, 0.0, 0.0, 0.02 * k), (21, 1))
        np.testing.assert_allclose(one.acceleration, told, rtol=0.0, atol=1e-6)
    with pytest.raises(BagError, match="/other"):
        load_observations(tmp_path / "bag", markers_topic="/other")


def test_command_from_points_and_from_a_sag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.savez(tmp_path / "seen.npz", **arrays(observed(TRUE, 14)))
    (tmp_path / "rough.yaml").write_text("length: 1.0\nlinear_density: 0.06\nbending_stiffness: 0.01\n")
    out, picture, report = tmp_path / "cable.yaml", tmp_path / "report.png", tmp_path / "report.json"
    command = ["calibrate", str(tmp_path / "seen.npz"), "--cable", str(tmp_path / "rough.yaml"), "-o", str(out)]
    assert main([*command, "--report", str(picture)]) == 0
    assert main([*command, "--report", str(report), "--fit", "bending_stiffness,length", "--prior", "length=0.01"]) == 0
    assert cs.Cable.from_yaml(out).mean_bending_stiffness == pytest.approx(0.004, rel=0.05)
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert len(json.loads(report.read_text())["correlation"]) == 2
    capsys.readouterr()
    sag = ["calibrate", "--sag", "0.85", "--held", "free", "--length", "1.0", "--mass", "0.06", "-o", str(out)]
    assert main(sag) == 0
    assert "standard error" in capsys.readouterr().out
    assert cs.Cable.from_yaml(out).mean_bending_stiffness > 0.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "--sag"),
        (["--sag", "0.1"], "--length"),
        (["nowhere.npz", "--length", "1", "--mass", "0.1"], "no such file"),
        (["--sag", "0.1", "--length", "1", "--mass", "0.1"], "chord"),
        (["--sag", "0.1", "--report", "x.pdf", "--length", "1", "--mass", "0.1"], "ending"),
    ],
)
def test_command_says_what_is_wrong(options: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", *options]) == 2
    assert words in capsys.readouterr().err


def command_of(folder: Path, seen: list[cs.Observation]) -> list[str]:
    np.savez(folder / "seen.npz", **arrays(seen))
    (folder / "rough.yaml").write_text("length: 1.0\nlinear_density: 0.06\nbending_stiffness: 0.01\n")
    outputs = ["-o", str(folder / "cable.yaml"), "--uncertainty", str(folder / "spread.yaml")]
    report = ["--report", str(folder / "report.json")]
    return ["calibrate", str(folder / "seen.npz"), "--cable", str(folder / "rough.yaml"), *outputs, *report]


def no_fit(command: list[str], folder: Path, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The command says so first, exits with 2 and writes its report alone, unless it is forced."""
    assert main(command) == 2
    said = capsys.readouterr()
    assert re.match(rf"cable-shape: error: {words}", said.err)
    assert said.err.count("not written: ") == 2
    assert not (folder / "cable.yaml").exists()
    assert not (folder / "spread.yaml").exists()
    assert re.match(words, json.loads((folder / "report.json").read_text())["trouble"])
    assert main([*command, "--force"]) == 0
    assert re.match(rf"cable-shape: error: {words}", capsys.readouterr().err)
    assert re.search(rf"# not to be used: {words}", (folder / "cable.yaml").read_text())
    assert cs.Cable.from_yaml(folder / "cable.yaml").length == 1.0
    assert (folder / "spread.yaml").exists()


def test_a_fit_that_explains_nothing_is_not_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    away = np.array((0.0, 0.27, 0.0))
    seen = [cs.Observation(o.start, o.end, o.points + away) for o in observed(TRUE, 14)]
    no_fit(command_of(tmp_path, seen), tmp_path, "the fit explains nothing: the usual point .* 2[678] %", capsys)


def test_a_fit_that_did_not_converge_is_not_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robust, "_MOST_ITERATIONS", 1)
    no_fit(command_of(tmp_path, observed(TRUE, 14)), tmp_path, "the fit did not converge", capsys)


def test_a_good_fit_is_no_trouble(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(command_of(tmp_path, observed(TRUE, 14))) == 0
    assert "error" not in capsys.readouterr().err
    assert json.loads((tmp_path / "report.json").read_text())["trouble"] == ""


def test_bad_arguments_are_named() -> None:
    seen = observed(TRUE, 15, count=1)
    with pytest.raises(UnknownKeyError, match="bending_stiffness"):
        cs.calibrate(seen, TRUE, ("bending_stifness",))
    with pytest.raises(UnknownKeyError, match="priors"):
        cs.calibrate(seen, TRUE, priors={"length": 0.1})
    with pytest.raises(ArgumentError, match="axial_stiffness"):
        cs.calibrate(seen, TRUE, "axial_stiffness")
    with pytest.raises(ArgumentError, match="observations"):
        cs.calibrate([], TRUE)
    with pytest.raises(ArgumentError, match="usable shape"):
        cs.calibrate(seen, TRUE.replace(length=0.2))
    with pytest.raises(ArgumentError, match="points"):
        cs.Observation(cs.Pose(), cs.Pose(), (1.0, 2.0, 3.0))
    with pytest.raises(ArgumentError, match="arc_length"):
        cs.Observation(cs.Pose(), cs.Pose(), [(1.0, 2.0, 3.0)], [-0.1])


def test_a_cable_that_lies_on_a_table_is_found() -> None:
    """Also from shapes that a cable twice as stiff would not lie like; derivatives are those of differences."""
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.22)))
    scene = cs.Scene(obstacles=[table], contact="solve")
    along_x, rng, seen = (0.5, 0.5, 0.5, 0.5), np.random.default_rng(5), []
    for k in range(4):
        start, end = cs.Pose((0.0, 0.0, 0.02 * k), along_x), cs.Pose((0.55 + 0.03 * k, 0.05 * k, 0.0), along_x)
        shape = cs.predict(TRUE, start, end, model="cosserat", scene=scene, points=301)
        assert shape.contacts
        points = shape.positions[15::15] + 1e-4 * rng.normal(size=(20, 3))
        seen.append(cs.Observation(start, end, points, shape.arc_length[15::15]))
    fit = ("bending_stiffness", "length")
    forward = Forward(Parameters(TRUE, fit), seen, scene=scene)
    at = forward.parameters.start
    derivatives = forward.jacobian(at, forward.misses(at))
    for j, parameter in enumerate(forward.parameters.each):
        step = np.zeros_like(at)
        step[j] = 0.1 * parameter.step
        wanted = (forward.misses(at + step) - forward.misses(at - step)) / (2.0 * step[j])
        np.testing.assert_allclose(derivatives[:, :, j], wanted, rtol=0.0, atol=0.03 * float(np.abs(wanted).max()))
    begin = TRUE.replace(bending_stiffness=2.0 * TRUE.mean_bending_stiffness, length=TRUE.length * 1.01)
    found = cs.calibrate(seen, begin, fit, scene=scene)
    assert found.converged
    assert found.cable.mean_bending_stiffness == pytest.approx(TRUE.mean_bending_stiffness, rel=0.03)
    assert found.cable.length == pytest.approx(TRUE.length, abs=2e-4)
