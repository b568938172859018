"""What the clearance checker tells, and shortcuts that change no bit of it."""

import math

import numpy as np
import pytest
from clearances import RADIUS, ball_mesh, box_mesh, few, random_pose, seeds, shape_through, straight, wavy
from hypothesis import given
from hypothesis import strategies as st

from cable_shape.errors import ArgumentError
from cable_shape.pose import IDENTITY, Pose
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.scene.scene import Box, Capsule, Cylinder, HalfSpace, Mesh, Obstacle, Scene, Sphere
from cable_shape.shape import CableShape, Status

# --- shortcuts --------------------------------------------------------------------------------------------------------


def crowd(rng: np.random.Generator) -> tuple[Scene, list[Obstacle], dict[str, Pose]]:
    solids = [Box((0.1, 0.2, 0.05)), Sphere(0.06), Cylinder(0.05, 0.2), Capsule(0.05, 0.2), ball_mesh(0.1)]
    obstacles = [Obstacle(f"obstacle{i}", solids[i % 5], random_pose(rng, 0.9)) for i in range(20)]
    obstacles += [Obstacle("floor", HalfSpace(), Pose((0, 0, -0.5))), Obstacle("ring", box_mesh((2, 2, 2)))]
    robot = [Obstacle(f"link{i}", solids[i % 5], random_pose(rng, 0.1), f"link{i}") for i in range(14)]
    return Scene(obstacles), robot, {f"link{i}": random_pose(rng, 0.9) for i in range(14)}


def tangled(rng: np.random.Generator, points: int) -> CableShape:
    """A random walk: no neighbour tells where the next point is."""
    return shape_through(np.cumsum(rng.normal(size=(points, 3)) * 0.08, axis=0))


@few
@given(seeds, st.sampled_from([wavy, tangled]))
def test_culling_changes_no_bit_and_fires(seed, curve):
    rng = np.random.default_rng(seed)
    scene, robot, links = crowd(rng)
    keywords = {"radius": RADIUS, "robot_links": robot, "gripping_links": ("link3", "link9"), "horizon": 0.2}
    shape = curve(rng, 41)
    quick = ClearanceChecker(scene, **keywords).check(shape, links)
    slow = ClearanceChecker(scene, **keywords, cull=False).check(shape, links)
    assert slow.pairs_culled == 0
    assert quick.pairs_culled > 0
    assert quick.pairs_culled + quick.pairs_exact == slow.pairs_exact
    assert quick.beyond == slow.beyond
    assert len(quick.bodies) == len(slow.bodies)
    for a, b in zip(quick.bodies, slow.bodies, strict=True):
        assert (a.body, a.distance, a.arc_length) == (b.body, b.distance, b.arc_length)
        assert a.point_on_cable.tobytes() == b.point_on_cable.tobytes()
        assert a.point_on_body.tobytes() == b.point_on_body.tobytes()


def test_a_far_scene_costs_no_exact_pair():
    scene = Scene([Obstacle("far", Sphere(0.1), Pose((0, 0, 5.0)))])
    found = ClearanceChecker(scene, radius=RADIUS).check(straight((0, 0, 0), (1, 0, 0)))
    assert found.bodies == ()
    assert found.pairs_exact == 0
    assert found.pairs_culled == 20
    assert found.beyond == 0.1
    assert found.closest is None


def test_horizon_lists_what_is_nearer_and_bounds_the_rest():
    scene = Scene(
        [Obstacle("near", Sphere(0.1), Pose((0.5, 0, 0.2))), Obstacle("far", Sphere(0.1), Pose((0.5, 0, -0.4)))]
    )
    cable = straight((0, 0, 0), (1, 0, 0))
    assert [b.body for b in ClearanceChecker(scene, radius=RADIUS, horizon=0.295).check(cable).bodies] == ["near"]
    both = ClearanceChecker(scene, radius=RADIUS, horizon=0.297).check(cable)
    assert [b.body for b in both.bodies] == ["near", "far"], "in the order of the scene"
    assert both.beyond == math.inf
    assert both.closest is both.bodies[0]


@pytest.mark.parametrize("swell", [None, np.full(41, 0.01)])
def test_beside_a_distance_beyond_the_horizon_nothing_is_told(swell):
    checker = ClearanceChecker(Scene([Obstacle("far", Sphere(0.1), Pose((0.0, 0.0, 5.0)))]), radius=RADIUS, horizon=0.2)
    table = checker.check(straight((0, 0, 0), (1, 0, 0), 41), swell=swell).table
    assert table[0, 0] == math.inf
    assert np.isnan(table[0, 1:]).all()


def test_nothing_to_check():
    checker = ClearanceChecker(Scene(), radius=RADIUS)
    cable = straight((0, 0, 0), (1, 0, 0))
    assert checker.check(cable).beyond == math.inf
    assert not checker.check(cable).robot_checked
    assert checker.check(cable, {}).robot_checked


# --- robot ------------------------------------------------------------------------------------------------------------


def test_bodies_move_with_their_links():
    tool = Obstacle("camera", Sphere(0.02), Pose((0.0, 0.0, 0.1)), link="tool")
    checker = ClearanceChecker(Scene([tool]), radius=RADIUS, horizon=1.0)
    cable = straight((-1, 0, 0), (1, 0, 0))
    half_turn = Pose((0.0, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0))
    assert checker.check(cable, {"tool": half_turn}).bodies[0].distance == pytest.approx(0.4 - 0.02 - RADIUS)
    assert checker.check(cable, {"tool": Pose((0, 0, 0.5))}).bodies[0].distance == pytest.approx(0.6 - 0.02 - RADIUS)


def test_without_links_the_robot_is_not_checked():
    scene = Scene([Obstacle("post", Sphere(0.05), Pose((0.5, 0, 0.1)))])
    arm = Obstacle("arm", Sphere(0.05), Pose((0.5, 0, 0.1)), link="arm")
    checker = ClearanceChecker(scene, radius=RADIUS, robot_links=[arm])
    cable = straight((0, 0, 0), (1, 0, 0))
    without, with_it = checker.check(cable), checker.check(cable, {"arm": IDENTITY, "other": IDENTITY})
    assert [b.body for b in without.bodies] == ["post"]
    assert not without.robot_checked
    assert without.beyond == math.inf, "bodies that were left out are not said to be far"
    assert [b.body for b in with_it.bodies] == ["post", "arm"]
    assert with_it.robot_checked


def test_a_missing_link_is_named():
    arm = Obstacle("upper arm", Sphere(0.05), link="left_upper_arm")
    checker = ClearanceChecker(Scene(), radius=RADIUS, robot_links=[arm])
    with pytest.raises(ArgumentError, match=r"left_upper_arm.*upper arm"):
        checker.check(straight((0, 0, 0), (1, 0, 0)), {"right_upper_arm": IDENTITY})


@pytest.mark.parametrize("points", [11, 150])
def test_gripping_links_are_left_out_near_the_grips_only(points):
    finger = Obstacle("finger", Sphere(0.01), link="hand")
    elbow = Obstacle("elbow", Sphere(0.01), link="forearm")
    cable = straight((0, 0, 0), (1, 0, 0), points)
    keywords = {"radius": RADIUS, "robot_links": [finger, elbow], "gripping_links": ["hand"], "horizon": 1.0}
    checker = ClearanceChecker(Scene(), **keywords, grip_exclusion=0.07)
    at_grip = {"hand": Pose((0, 0, 0.01)), "forearm": Pose((0, 0, 0.01))}
    hand, forearm = checker.check(cable, at_grip).bodies
    assert forearm.distance == pytest.approx(-RADIUS), "other links count everywhere"
    assert hand.arc_length == pytest.approx(0.07)
    assert hand.distance == pytest.approx(math.hypot(0.07, 0.01) - 0.01 - RADIUS)
    at_end = {"hand": Pose((1.0, 0, 0.01)), "forearm": IDENTITY}
    assert checker.check(cable, at_end).bodies[0].arc_length == pytest.approx(0.93)
    in_the_middle = {"hand": Pose((0.5, 0, 0.02)), "forearm": IDENTITY}
    assert checker.check(cable, in_the_middle).bodies[0].distance == pytest.approx(0.01 - RADIUS)
    everything = ClearanceChecker(Scene(), **keywords, grip_exclusion=0.0)
    assert everything.check(cable, at_grip).bodies[0].distance == pytest.approx(-RADIUS)


@pytest.mark.parametrize("points", [11, 150])
def test_a_table_on_a_gripping_link_is_left_out_near_the_grips_only(points):
    """A half-space that slopes up to the end: the least of what counts is where the excluded part begins."""
    plate = Obstacle("plate", HalfSpace(), link="hand")
    cable = straight((0, 0, 0), (1, 0, 0), points)
    keywords = {"radius": RADIUS, "robot_links": [plate], "gripping_links": ["hand"], "horizon": 1.0}
    slope = Pose((0, 0, -0.2), (0.0, -math.sin(0.1), 0.0, math.cos(0.1)))  # by 0.2 rad
    for exclusion in (0.07, 0.0):
        checker = ClearanceChecker(Scene(), **keywords, grip_exclusion=exclusion)
        (body,) = checker.check(cable, {"hand": slope}).bodies
        assert body.arc_length == pytest.approx(1.0 - exclusion)
        assert body.distance == pytest.approx(0.2 * math.cos(0.2) - (1.0 - exclusion) * math.sin(0.2) - RADIUS)


# --- what is refused or not judged ------------------------------------------------------------------------------------


@pytest.mark.parametrize("status", [Status.NOT_CONVERGED, Status.BUDGET_EXCEEDED])
def test_a_shape_that_is_none_is_not_judged(status):
    scene = Scene([Obstacle("post", Sphere(0.05))])
    cable = shape_through([(0, 0, 1.0), (math.nan, 0, 0)], status)
    found = ClearanceChecker(scene, radius=RADIUS).check(cable, {})
    assert found.bodies == ()
    assert found.beyond == 0.0
    assert not found.robot_checked


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("where", [0, 7, 19])
def test_positions_that_are_not_finite_are_refused(value, where):
    cable = straight((0, 0, 0), (1, 0, 0), 20)
    cable.positions[where, 1] = value
    with pytest.raises(ArgumentError, match=r"shape\.positions.*finite"):
        ClearanceChecker(Scene([Obstacle("floor", HalfSpace())]), radius=RADIUS).check(cable)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"radius": -0.001}, r"radius = -0\.001 .*at least 0 m"),
        ({"radius": RADIUS, "horizon": 0.02}, r"horizon = 0\.02 .*at least 0\.03 m"),
        ({"radius": RADIUS, "grip_exclusion": math.nan}, r"grip_exclusion = nan .*finite"),
        ({"radius": RADIUS, "robot_links": [Obstacle("arm", Sphere(0.1))]}, r"arm\.link = None"),
    ],
)
def test_bad_arguments(keywords, message):
    with pytest.raises(ArgumentError, match=message):
        ClearanceChecker(Scene(), **keywords)


def test_a_mesh_without_area_is_refused():
    flat = Obstacle("sliver", Mesh([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)]))
    with pytest.raises(ArgumentError, match=r"sliver.*no triangle with an area"):
        ClearanceChecker(Scene([flat]), radius=RADIUS)
