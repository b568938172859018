"""What holds a cable that swings may not be inside a body: named, and the state is kept."""

from __future__ import annotations

import cable_shape as cs

ALONG = (0.5, 0.5, 0.5, 0.5)  # d3 along x
CABLE = cs.Cable(1.0, linear_density=0.1, bending_stiffness=0.01, retardation_time=0.05, drag=0.05, diameter=0.01)
TABLE = cs.Obstacle("table", cs.HalfSpace())


def at(x: float, z: float) -> cs.Pose:
    return cs.Pose((x, 0.0, z), ALONG)


def test_a_grip_inside_a_body_is_named():
    """And once it is out again the cable swings on."""
    motion = cs.Motion(CABLE, cs.Scene(obstacles=[TABLE], contact="solve"))
    motion.begin(at(0.0, 0.3), at(0.7, 0.02))
    last = motion.step(at(0.0, 0.3), at(0.7, 0.0049), 0.01)  # as deep as a contact may be
    assert last.usable, last.detail
    for z in (-0.01, -0.02):
        shape = motion.step(at(0.0, 0.3), at(0.7, z), 0.01)
        assert shape.status is cs.Status.NOT_CONVERGED
        assert f"the cable at the end grip is {5.0 - 1e3 * z:.1f} mm inside obstacle 'table'" in shape.detail
        assert "Move the grip out of it" in shape.detail
        assert "The state is kept" in shape.detail
        assert (shape.positions == last.positions).all()
    assert motion.step(at(0.0, 0.3), at(0.7, 0.01), 0.01).usable


def test_a_clip_into_which_a_link_comes_is_named():
    """A body on a link, at the end of the step, and an eyelet before the clip, which is no knot."""
    clips = [cs.Clip(0.32, at(0.3, 0.25), "slide"), cs.Clip(0.55, at(0.5, 0.25))]
    ball = cs.Obstacle("hand", cs.Sphere(0.05), cs.Pose((0.0, 0.0, 0.0)), link="hand")
    motion = cs.Motion(CABLE, cs.Scene(clips=clips, contact="solve"), robot_links=[ball])
    ends = at(0.0, 0.3), at(0.9, 0.3)
    assert motion.begin(*ends, links={"hand": cs.Pose((0.5, 0.5, 0.25))}).usable
    assert motion.step(*ends, 0.01, {"hand": cs.Pose((0.5, 0.4, 0.25))}).usable
    shape = motion.step(*ends, 0.01, {"hand": cs.Pose((0.5, 0.04, 0.25))})
    assert shape.status is cs.Status.NOT_CONVERGED
    assert "the cable at the clips[1] is 15.0 mm inside obstacle 'hand'. Move the clip out of it" in shape.detail


def test_a_grip_of_a_harness_is_named():
    """By the names of its open ends."""
    arm = CABLE.replace(length=0.5)
    harness = cs.Harness(dict.fromkeys("abc", arm), [cs.Junction("j", ("a.end", "b.start", "c.start"))])
    motion = cs.Motion(harness, cs.Scene(obstacles=[TABLE], contact="solve"))
    ends = {"a.start": at(0.0, 0.3), "b.end": at(0.8, 0.3), "c.end": cs.Pose((0.4, 0.3, 0.3))}
    assert motion.begin(ends).usable
    shape = motion.step(ends | {"c.end": cs.Pose((0.4, 0.3, -0.02))}, 0.01)
    assert shape.status is cs.Status.NOT_CONVERGED
    assert "the cable at the grip 'c.end' is 25.0 mm inside obstacle 'table'" in shape.detail
