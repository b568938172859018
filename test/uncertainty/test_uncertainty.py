"""Tubes: covariance against drawn samples, clearance of a swollen cable against dense sampling, and who hears of it."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from clearances import RADIUS, box_mesh, random_pose, wavy
from reports import CABLE as DRAWN
from reports import columns, report, write
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

import cable_shape as cs
from cable_shape.command.cli import main
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.safety.report import WarningKind
from cable_shape.uncertainty.tube_watch import TubeWatch
from cable_shape.uncertainty.uncertainty import Tube, quantiles
from cable_shape.viewer.letters import decode, encode

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.004)
START = cs.Grip(cs.Pose((0.0, 0.0, 1.0), ALONG_X), offset=cs.Pose((0.0, 0.02, 0.05)))
END = cs.Grip(cs.Pose((0.75, 0.1, 1.05), ALONG_X), "swivel")


def tube_of(uncertainty: cs.Uncertainty, ends=(START, END), **options) -> Tube:
    options.setdefault("points", 41)
    predictor = cs.Predictor(CABLE, model="cosserat", **options)
    shape = predictor.predict(*ends)
    tube = TubeWatch(CABLE, uncertainty, **options).tube(predictor, shape, ends)
    assert tube is not None
    return tube


def moved(grip: cs.Grip, sample: np.ndarray) -> cs.Grip:
    """The gripper moved by (3,) and turned by the rotation vector (3,), world axes, about its own origin."""
    pose = grip.pose
    turned = Rotation.from_rotvec(sample[3:]) * Rotation.from_quat(pose.quaternion)
    return cs.Grip(cs.Pose(pose.position + sample[:3], turned.as_quat()), grip.kind, grip.offset)


def samples_of(draw, count: int = 1500) -> np.ndarray:
    """(count, 41, 3) positions of cables and grips drawn at random."""
    rng = np.random.default_rng(5)
    predictors: dict[float, cs.Predictor] = {}
    lines = []
    for _ in range(count):
        cable, start, end = draw(rng)
        predictor = predictors.get(0.0) if cable is CABLE else cs.Predictor(cable, model="cosserat", points=41)
        if predictor is None:
            predictor = predictors[0.0] = cs.Predictor(CABLE, model="cosserat", points=41)
        shape = predictor.predict(start, end)
        assert shape.status is cs.Status.OK
        lines.append(shape.positions.copy())
    return np.array(lines)


def covariance_of(lines: np.ndarray) -> np.ndarray:
    off = lines - lines.mean(axis=0)
    return np.einsum("kni,knj->nij", off, off) / (len(lines) - 1)


def near(a: np.ndarray, b: np.ndarray, share: float) -> None:
    np.testing.assert_allclose(a, b, rtol=0.0, atol=share * np.abs(b).max())


def test_covariance_of_grips_is_that_of_samples() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(6, 6)) * np.array((1, 1, 1, 5, 5, 5))[:, None] * 4e-4
    uncertainty = cs.Uncertainty(start=root @ root.T, end=(0.001, 0.004))

    def draw(rng):
        end = np.concatenate((0.001 * rng.normal(size=3), 0.004 * rng.normal(size=3)))
        return CABLE, moved(START, root @ rng.normal(size=6)), moved(END, end)

    near(tube_of(uncertainty).covariance, covariance_of(samples_of(draw)), 0.1)


def test_covariance_of_the_cable_is_that_of_samples() -> None:
    uncertainty = cs.Uncertainty({"bending_stiffness": 0.3, "length": 0.003})

    def draw(rng):
        factor = math.exp(0.3 * rng.normal())
        changed = CABLE.replace(length=1.0 + 0.003 * rng.normal(), bending_stiffness=0.004 * factor)
        return changed.replace(twisting_stiffness=CABLE.twisting_stiffness * factor), START, END

    near(tube_of(uncertainty).covariance, covariance_of(samples_of(draw)), 0.1)


def test_the_tube_holds_as_many_cables_as_it_says() -> None:
    uncertainty = cs.Uncertainty({"bending_stiffness": 0.2, "length": 0.002}, (0.001, 0.01), (0.001, 0.01))
    tube = tube_of(uncertainty)

    def draw(rng):
        cable = CABLE.replace(length=1.0 + 0.002 * rng.normal(), bending_stiffness=0.004 * math.exp(0.2 * rng.normal()))
        ends = (np.concatenate((0.001 * rng.normal(size=3), 0.01 * rng.normal(size=3))) for _ in range(2))
        return cable, moved(START, next(ends)), moved(END, next(ends))

    off = samples_of(draw) - tube.shape.positions
    along = np.einsum("kni,ni->kn", off, tube.shape.tangents)
    away = np.sqrt(np.maximum((off**2).sum(axis=2) - along**2, 0.0))
    inside = (away <= tube.radius).mean(axis=0)
    assert (inside > 0.93).all()
    assert (inside < 0.97).all()


def test_the_radius_is_that_of_both_directions_across() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(50, 3, 3)) * rng.uniform(0.01, 1.0, (50, 1, 3))
    tangents = rng.normal(size=(50, 3))
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    covariance = root @ root.transpose(0, 2, 1)
    plane = np.eye(3) - tangents[:, :, None] * tangents[:, None, :]
    sizes = np.linalg.eigvalsh(plane @ covariance @ plane)
    ratio = np.sqrt(sizes[:, 1] / sizes[:, 2])
    expected = 0.04 + sizes[:, 2] * np.interp(ratio, np.linspace(0.0, 1.0, 33), quantiles(0.95))
    found = cs.Uncertainty(misses=0.2).radius(covariance, tangents)
    np.testing.assert_allclose(found, np.sqrt(expected), rtol=1e-9)
    along_x = np.array(((1.0, 0.0, 0.0),))
    assert cs.Uncertainty().radius(np.diag((1.0, 0.0, 4.0))[None], along_x)[0] == pytest.approx(2.0 * 1.959964)


@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_the_quantiles_are_those_of_a_normal_vector_in_the_plane(confidence: float) -> None:
    squares = quantiles(confidence)
    assert squares[0] == pytest.approx(chi2.ppf(confidence, 1), rel=1e-6)
    assert squares[-1] == pytest.approx(chi2.ppf(confidence, 2), rel=1e-9)
    for row in (1, 4, 16, 28):
        narrow = row / 32.0

        def beside(x, r, narrow=narrow):
            return norm.pdf(x) * (2.0 * norm.cdf(math.sqrt(max(r * r - x * x, 0.0)) / narrow) - 1.0)

        radius = math.sqrt(squares[row])
        layer = radius - 2.0 * (row / 32.0) ** 2  # beyond, the plane is cut off within a standard deviation or two
        inside, _ = quad(beside, -radius, radius, args=(radius,), limit=400, points=(-layer, layer))
        assert inside == pytest.approx(confidence, abs=1e-5)


def test_exact_knowledge_leaves_the_misses() -> None:
    tube = tube_of(cs.Uncertainty(misses=0.002))
    np.testing.assert_array_equal(tube.radius, 0.002)
    assert not tube.covariance.any()
    free = tube_of(cs.Uncertainty(start=(0.0, 0.01)), (START.pose, None))
    assert free.radius[0] < 1e-9 < 1e-3 < free.radius[-1]


def test_a_calibrated_cable_has_the_tube_of_its_calibration() -> None:
    observations = []
    rng = np.random.default_rng(3)
    for x in (0.6, 0.7, 0.8):
        end = cs.Pose((x, 0.1, 1.0), ALONG_X)
        seen = cs.predict(CABLE, START.pose, end, model="cosserat").positions[10:-10:9]
        observations.append(cs.Observation(START.pose, end, seen + 5e-4 * rng.normal(size=seen.shape)))
    found = cs.calibrate(observations, CABLE.replace(bending_stiffness=0.006), ("bending_stiffness", "length"))
    plain = cs.predict_tube(found, START.pose, END)
    wider = cs.predict_tube(found, START.pose, END, start_error=(0.002, 0.0), end_error=(0.0, 0.02))
    assert (wider.radius[1:-1] > plain.radius[1:-1]).all()
    file = cs.Uncertainty.of(found).save
    report_of = cs.Cycle(found.cable, model="cosserat", points=101, uncertainty=cs.Uncertainty.of(found))
    same = report_of.step({"cable": (START.pose, END)}, 0).tubes["cable"]
    np.testing.assert_allclose(same.radius, plain.radius, rtol=1e-3)
    assert file is not None
    sag = cs.calibrate_sag(CABLE, 0.85, held="free")
    assert cs.predict_tube(sag, START.pose, END).radius.max() > 1e-3


def brute(shape, swell, radius, distance, pieces: int = 400) -> float:
    """The least of distance - swell over a densely sampled cable."""
    t = np.linspace(0.0, 1.0, pieces * (shape.points - 1) + 1) * (shape.points - 1)
    i = np.minimum(t.astype(int), shape.points - 2)
    x = (t - i)[:, None]
    places = shape.positions[i] * (1 - x) + shape.positions[i + 1] * x
    thick = np.interp(t, np.arange(shape.points), swell)
    return float((distance(places) - thick).min() - radius)


def test_clearance_of_a_swollen_cable_against_dense_sampling() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        shape = wavy(rng)
        swell = 0.03 * np.abs(np.sin(np.linspace(0.0, 5.0, shape.points) + rng.uniform(0, 3)))
        ball, box = random_pose(rng), random_pose(rng)
        size = rng.uniform(0.05, 0.2, 3)
        bodies = [
            cs.Obstacle("ball", cs.Sphere(0.07), ball),
            cs.Obstacle("box", cs.Box(size), box),
            cs.Obstacle("mesh", box_mesh(size), box),
        ]
        found = ClearanceChecker(cs.Scene(obstacles=bodies), radius=RADIUS, horizon=5.0).check(shape, swell=swell)
        told = {b.body: b for b in found.bodies}
        turn = Rotation.from_quat(box.quaternion).inv()

        def to_box(p, box=box, size=size, turn=turn):
            beyond = np.abs(turn.apply(p - box.position)) - 0.5 * size
            return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)

        ways = {"ball": lambda p, ball=ball: np.linalg.norm(p - ball.position, axis=1) - 0.07, "box": to_box}
        slack = np.abs(np.diff(swell)).max()  # a piece is as thick as its thicker end
        for name, distance in ways.items():
            least = brute(shape, swell, RADIUS, distance)
            assert least - slack - 1e-9 <= told[name].distance <= least + 1e-6, (seed, name)
            apart = np.linalg.norm(told[name].point_on_cable - told[name].point_on_body)
            assert apart == pytest.approx(abs(told[name].distance), abs=1e-9)
        if told["box"].distance > 0.04:  # inside a mesh depth is that of points
            assert told["mesh"].distance == pytest.approx(told["box"].distance, abs=1e-9)


def test_an_even_swelling_is_a_thicker_cable_and_keeps_off_the_grips() -> None:
    bodies = [cs.Obstacle(f"b{k}", cs.Sphere(0.05), random_pose(np.random.default_rng(k))) for k in range(6)]
    links = [cs.Obstacle("finger", cs.Capsule(0.02, 0.1), cs.Pose(), link="hand")]
    hand = {"hand": random_pose(np.random.default_rng(9))}
    for seed in range(5):
        shape = wavy(np.random.default_rng(seed))
        keywords = {"robot_links": links, "gripping_links": ("hand",), "horizon": 0.4}
        thin = ClearanceChecker(cs.Scene(obstacles=bodies), radius=RADIUS, **keywords)
        thick = ClearanceChecker(cs.Scene(obstacles=bodies), radius=RADIUS + 0.01, **keywords)
        a, b = thin.check(shape, hand, np.full(shape.points, 0.01)), thick.check(shape, hand)
        assert [x.body for x in a.bodies] == [x.body for x in b.bodies]
        for x, y in zip(a.bodies, b.bodies, strict=True):
            np.testing.assert_allclose(
                (x.distance, x.arc_length, *x.point_on_cable), (y.distance, y.arc_length, *y.point_on_cable), atol=1e-9
            )


def test_a_cycle_warns_by_the_tube_if_asked() -> None:
    line = cs.predict(CABLE, START, END, model="cosserat")
    lowest = int(line.positions[:, 2].argmin())
    floor = cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0, 0, float(line.positions[lowest, 2]) - 0.004 - 0.035)))
    scene = cs.Scene(obstacles=[floor])
    known = cs.Uncertainty({"length": 0.004}, (0.002, 0.0), (0.002, 0.0), confidence=0.99)
    plain = cs.Cycle(CABLE, scene=scene, model="cosserat").step({"cable": (START, END)}, 0)
    cycle = cs.Cycle(CABLE, scene=scene, model="cosserat", uncertainty=known)
    first, asked = (cycle.step({"cable": (START, END)}, stamp) for stamp in (0, 120_000_000))
    assert any("by a tube that may be too narrow to hold the cable with 99 %" in w.text for w in first.warnings)
    assert not plain.tubes
    assert plain.clearance["cable"].confidence == 0.0
    assert not plain.warnings
    tube, clearance = asked.tubes["cable"], asked.clearance["cable"]
    assert (tube.confidence, clearance.confidence) == (0.99, 0.99)
    body = clearance.closest
    at = round(body.arc_length * 149)
    lost = plain.clearance["cable"].closest.distance - body.distance
    assert lost == pytest.approx(tube.radius[at], rel=0.02)
    (margin,) = (m for m in asked.margins["cable"] if m.kind is WarningKind.CLEARANCE)
    assert margin.used == pytest.approx(2.0 - body.distance / 0.03)
    assert margin.used > 1.0
    (warning,) = asked.warnings
    assert "by the tube that holds the cable with 99 %" in warning.text
    np.testing.assert_allclose(asked.shapes["cable"].positions, plain.shapes["cable"].positions)


def test_a_body_that_the_cable_rests_on_is_no_nearer_for_its_tube() -> None:
    scene = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")
    ends = cs.Pose((0, 0, 0.2), ALONG_X), cs.Pose((0.7, 0, 0.2), ALONG_X)
    cycle = cs.Cycle(CABLE, scene=scene, model="cosserat", uncertainty=cs.Uncertainty({"length": 0.005}, (0.002, 0.01)))
    found = cycle.step({"cable": ends}, 0)
    assert found.shapes["cable"].contacts
    assert abs(found.clearance["cable"].closest.distance) < 2e-4
    assert found.tubes["cable"].radius.max() > 0.003


def test_cables_keep_both_their_tubes_apart() -> None:
    along_y = (-0.7071067811865476, 0.0, 0.0, 0.7071067811865476)
    x, y, z = cs.predict(CABLE, START, END, model="cosserat").positions[75]
    over = cs.Pose((x, y - 0.35, z + 0.06), along_y), cs.Pose((x, y + 0.35, z + 0.06), along_y)
    grips = {"a": (START, END), "b": over}
    cables = {"a": CABLE, "b": CABLE.replace(length=0.701)}
    plain = cs.Cycle(cables, model="cosserat").step(grips, 0)
    known = cs.Uncertainty(misses=0.004)
    both = cs.Cycle(cables, model="cosserat", uncertainty=known).step(grips, 0)
    one = cs.Cycle(cables, model="cosserat", uncertainty={"a": known}).step(grips, 0)

    def distance(of, name, other):
        return next(b.distance for b in of.clearance[name].bodies if b.body == other)

    for found, lost in ((both, 0.008), (one, 0.004)):
        for name, other in (("a", "b"), ("b", "a")):
            assert distance(plain, name, other) - distance(found, name, other) == pytest.approx(lost, abs=1e-12)


def test_one_side_is_enough_where_the_other_does_not_reach() -> None:
    """One standard deviation shorter, the cable is too short."""
    ends = cs.Pose((0, 0, 1), ALONG_X), cs.Pose((0.985, 0, 1), ALONG_X)
    cycle = cs.Cycle(CABLE, model="cosserat", uncertainty=cs.Uncertainty({"length": 0.02}, misses=0.001))
    found = cycle.step({"cable": ends}, 0)
    longer = cs.predict(CABLE.replace(length=1.02), *ends, model="cosserat")
    step = longer.positions - found.shapes["cable"].positions
    np.testing.assert_allclose(found.tubes["cable"].covariance, step[:, :, None] * step[:, None, :], atol=1e-8)
    again = cycle.step({"cable": ends}, 10_000_000)
    assert again.shapes["cable"].reused
    np.testing.assert_array_equal(again.tubes["cable"].radius, found.tubes["cable"].radius)
    apart = cycle.step({"cable": (ends[0], cs.Pose((1.1, 0, 1), ALONG_X))}, 20_000_000)
    assert not apart.tubes
    assert [w.kind for w in apart.warnings] == [WarningKind.OVERSTRETCHED], "that there is no shape is said already"


def test_files_come_back(tmp_path: Path) -> None:
    given = cs.Uncertainty({"bending_stiffness": 0.2, "end_tilt": 0.01}, (0.001, 0.02), confidence=0.9, misses=0.003)
    again = cs.Uncertainty.from_yaml(given.save(tmp_path / "known.yaml"))
    assert again.as_dict() == given.as_dict()
    full = cs.Uncertainty(start=np.diag((1.0, 2.0, 3.0, 4.0, 5.0, 6.0)) * 1e-6)
    np.testing.assert_array_equal(cs.Uncertainty.from_yaml(full.save(tmp_path / "full.yaml")).start, full.start)
    (tmp_path / "short.yaml").write_text("start: {position: 0.001, angle: 0.02}\ncable: {length: 0.002}\n")
    short = cs.Uncertainty.from_yaml(tmp_path / "short.yaml")
    np.testing.assert_allclose(np.diag(short.start), (1e-6,) * 3 + (4e-4,) * 3)
    assert (short.names, short.covariance.tolist()) == (("length",), [[4e-6]])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: cs.Uncertainty(confidence=1.0), "confidence = 1.0"),
        (lambda: cs.Uncertainty(start=(0.001, -0.1)), r"start\[1\]"),
        (lambda: cs.Uncertainty(end=np.ones((5, 5))), r"\(6, 6\)"),
        (lambda: cs.Uncertainty(end=-np.eye(6)), "no negative eigenvalue"),
        (lambda: cs.Uncertainty({"lenght": 0.1}), "'length'"),
        (lambda: cs.Uncertainty.from_mapping({"confidense": 0.9}), "'confidence'"),
        (lambda: cs.Uncertainty.from_mapping({"cable": {}, "covariance": {}}), "beside cable"),
        (lambda: cs.Cycle(CABLE, uncertainty={"other": cs.Uncertainty()}), "other"),
        (lambda: cs.Cycle(CABLE, model="catenary", uncertainty=cs.Uncertainty()), "only the Cosserat rod"),
        (lambda: cs.Cycle(CABLE, uncertainty=cs.Uncertainty({"length": 2.0})), "one standard deviation away"),
    ],
)
def test_bad_arguments_are_named(make, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        make()
    assert issubclass(UnknownKeyError, ArgumentError)


def with_tube(k: int):
    """A report of the viewer's tests with a tube, which is gone in the last ones."""
    plain = report(k)
    shape = plain.shapes["cable"]
    radius = np.linspace(0.001, 0.03, shape.points)
    covariance = radius[:, None, None] ** 2 * np.eye(3)
    tubes = {"cable": Tube(shape, covariance, radius, 0.9)} if k < 3 else {}
    hanging = {("cable", "end"): shape} if k < 4 else {}
    below = {("cable", "end"): Tube(shape, 4.0 * covariance, 2.0 * radius, 0.9)} if k < 3 else {}
    clearance = {"cable": dataclasses.replace(plain.clearance["cable"], confidence=0.9 if k < 3 else 0.0)}
    return dataclasses.replace(plain, tubes=tubes, tails=hanging, tail_tubes=below, clearance=clearance)


def test_a_tube_reaches_the_viewer() -> None:
    sent = with_tube(0)
    got = decode(encode(sent))
    np.testing.assert_array_equal(got.tubes["cable"].radius, sent.tubes["cable"].radius)
    np.testing.assert_array_equal(got.tubes["cable"].covariance, sent.tubes["cable"].covariance)
    assert (got.tubes["cable"].confidence, got.clearance["cable"].confidence) == (0.9, 0.9)
    assert got.tubes["cable"].shape is got.shapes["cable"]
    below = got.tail_tubes["cable", "end"]
    np.testing.assert_array_equal(below.radius, 2.0 * sent.tubes["cable"].radius)
    assert below.shape is got.tails["cable", "end"]


def test_a_tube_is_drawn_as_wide_as_it_is_and_goes(tmp_path: Path) -> None:
    write(tmp_path / "out.rrd", [with_tube(k) for k in range(5)])
    drawn = columns(tmp_path / "out.rrd")
    base = "/world/cables/cable/tube"
    assert [len(v) > 0 for _, v in drawn[f"{base}:Capsules3D:radii"]][:3] == [True] * 3
    radii = np.array(drawn[f"{base}:Capsules3D:radii"][0][1])
    assert radii.max() == pytest.approx(0.03 + 0.5 * DRAWN.diameter, rel=1e-5)
    lengths = np.array(drawn[f"{base}:Capsules3D:lengths"][0][1])
    line = report(0).shapes["cable"].positions
    assert lengths.sum() == pytest.approx(np.linalg.norm(np.diff(line, axis=0), axis=1).sum(), rel=1e-2)
    first = np.array(drawn[f"{base}:Capsules3D:translations"][0][1])
    turns = np.array(drawn[f"{base}:Capsules3D:quaternions"][0][1])
    tips = first + Rotation.from_quat(turns).apply(np.column_stack((0 * lengths, 0 * lengths, lengths)))
    np.testing.assert_allclose(tips[:-1], first[1:], atol=1e-5)
    cleared = [t for t, v in drawn[f"{base}:Clear:is_recursive"] if v]
    assert len(cleared) == 1
    below = drawn["/world/cables/cable/tails/end/tube:Capsules3D:radii"]
    assert np.array(below[0][1]).max() == pytest.approx(0.06 + 0.5 * DRAWN.diameter, rel=1e-5)


def test_a_replay_has_tubes_if_asked(tmp_path: Path) -> None:
    from recordings import motion, write_bag

    write_bag(tmp_path / "bag", motion(3))
    (tmp_path / "cable.yaml").write_text("length: 1.0\nlinear_density: 0.1\nbending_stiffness: 0.01\n")
    known = cs.Uncertainty({"length": 0.003}, (0.002, 0.0)).save(tmp_path / "known.yaml")
    command = [
        "replay",
        str(tmp_path / "bag"),
        "--cable",
        str(tmp_path / "cable.yaml"),
        "--no-picture",
        "--model",
        "auto",
    ]
    assert main([*command, "-o", str(tmp_path / "plain")]) == 0
    assert main([*command, "-o", str(tmp_path / "tubes"), "--uncertainty", str(known)]) == 0
    entity = "/world/cables/cable/tube:Capsules3D:radii"
    assert entity not in columns(tmp_path / "plain" / "replay.rrd")
    assert len(columns(tmp_path / "tubes" / "replay.rrd")[entity]) == 3
