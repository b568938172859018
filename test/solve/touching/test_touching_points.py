"""Contact with point clouds and height fields."""

from __future__ import annotations

import numpy as np
import pytest

import cable_shape as cs

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
PLACE = cs.Pose((0.55, 0, 0))


def over(solid, pose=PLACE, **options):
    return cs.Scene(obstacles=[cs.Obstacle("scan", solid, pose, **options)], contact="solve")


def lowered(scene, heights, cable=CABLE, apart=1.1):
    predictor = cs.Predictor(cable, scene=scene, model="cosserat")
    shapes = [predictor.predict(cs.Pose((0, 0.01, z), ALONG_X), cs.Pose((apart, 0.01, z), ALONG_X)) for z in heights]
    for z, shape in zip(heights, shapes, strict=True):
        assert shape.usable, (z, shape)
    assert shapes[-1].contacts
    assert {contact.body for contact in shapes[-1].contacts} == {"scan"}
    return predictor, shapes


def push(shape):
    return sum((contact.force * contact.normal for contact in shape.contacts), np.zeros(3))


def apart(shape, other):
    """[m], of the shapes or, across y = 0.01, mirror images."""
    mirrored = shape.positions * (1, -1, 1) + (0, 0.02, 0)
    return min(np.linalg.norm(p - other.positions, axis=1).max() for p in (shape.positions, mirrored))


@pytest.mark.parametrize(("spacing", "radius"), [(0.002, 0.004), (0.01, 0.01)])
def test_a_flat_height_field_is_a_table(spacing, radius):
    shape = (round(0.3 / spacing) + 1, round(0.8 / spacing) + 1)
    heights = [0.35 - 0.01 * k for k in range(15)]
    field = lowered(over(cs.HeightField(np.full(shape, 0.02), spacing, radius)), heights)[1]
    table = lowered(cs.Scene([cs.Obstacle("scan", cs.Box((0.8, 0.3, 0.04)), PLACE)], contact="solve"), heights)[1]
    for one, other in zip(field, table, strict=True):
        assert apart(one, other) < one.error_estimate + other.error_estimate
        assert push(one) == pytest.approx(push(other), abs=0.01)


def test_a_cloud_on_a_sphere_is_the_sphere_around_it():
    k = np.arange(20_000) + 0.5
    polar, around = np.arccos(1.0 - k / 10_000), np.pi * (1.0 + np.sqrt(5.0)) * k
    points = 0.145 * np.stack((np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)), axis=1)
    pose, heights = cs.Pose((0.55, 0.04, -0.04)), [0.35 - 0.01 * k for k in range(20)]
    _, cloud = lowered(over(cs.Points(points, 0.005), pose), heights)
    _, ball = lowered(cs.Scene([cs.Obstacle("scan", cs.Sphere(0.15), pose)], contact="solve"), heights)
    for one, other in zip(cloud, ball, strict=True):
        assert np.linalg.norm(one.positions - other.positions, axis=1).max() < 1e-6 + one.error_estimate
        assert push(one) == pytest.approx(push(other), abs=0.01)
    off = one.error_estimate - other.error_estimate
    assert 1e-4 < off < 1e-3, "the dents between the points are part of it"


def test_over_waves_a_cable_stays_outside_and_in_balance():
    x = 0.005 * (np.arange(161) - 80)
    waves = np.tile(0.02 * np.sin(2.0 * np.pi * x / 0.2)[None], (61, 1))
    _, shapes = lowered(over(cs.HeightField(waves, 0.005)), [0.35 - 0.01 * k for k in range(17)])
    for shape in shapes:
        near = np.abs(shape.positions[:, 0] - 0.55) < 0.39
        seen = shape.positions[near]
        there = np.linspace(-0.42, 0.42, 4001)
        line = np.stack((there + 0.55, 0.02 * np.sin(2.0 * np.pi * there / 0.2)), axis=1)
        gaps = np.linalg.norm(seen[:, None, [0, 2]] - line[None], axis=2).min(axis=1) - 0.004
        above = seen[:, 2] > 0.02 * np.sin(2.0 * np.pi * (seen[:, 0] - 0.55) / 0.2)
        assert above.all()
        assert gaps.min() > -3e-4
    assert len({tuple(contact.normal.round(2)) for contact in shape.contacts}) > 1


def test_a_scan_moves_answers_and_is_swung_among():
    y = 0.005 * (np.arange(61) - 30)
    trough = np.tile((2.0 * y**2)[:, None], (1, 161))
    field = cs.HeightField(trough, 0.005)
    moving = cs.Predictor(CABLE, scene=over(field, cs.Pose((0, 0, 0)), link="tool", friction=0.3), model="cosserat")
    ends = cs.Pose((0, 0.01, 0.3), ALONG_X), cs.Pose((1.1, 0.01, 0.3), ALONG_X)
    for height in np.linspace(-0.1, 0.08, 19):
        shape = moving.predict(*ends, {"tool": cs.Pose((0.55, 0, height))})
        assert shape.usable, (height, shape)
    assert push(shape)[2] > 0.01

    smooth, step = cs.Predictor(CABLE, scene=over(field, cs.Pose((0.55, 0, 0.08))), model="cosserat"), 1e-5
    smooth.predict(*ends)
    columns = smooth.sensitivity(["body:scan"])
    for axis in (1, 2):
        moved = []
        for sign in (1.0, -1.0):
            smooth.scene = over(field, cs.Pose(np.array((0.55, 0, 0.08)) + sign * step * np.eye(3)[axis]))
            moved.append(smooth.predict(*ends).positions)
        differences = (moved[0] - moved[1]) / (2.0 * step)
        assert np.abs(differences).max() > 0.05
        assert np.abs(columns[:, :, axis] - differences).max() < 0.03 * np.abs(differences).max(), axis

    motion = cs.Motion(CABLE.replace(retardation_time=0.05, drag=0.3), over(field))
    motion.begin(*(cs.Pose((x, 0.01, 0.3), ALONG_X) for x in (0.0, 1.1)))
    for k in range(1, 61):
        swung = motion.step(*(cs.Pose((x, 0.01, 0.3 - 0.002 * k), ALONG_X) for x in (0.0, 1.1)), 0.01)
        assert swung.usable, (k, swung)
    assert swung.contacts
    near = np.abs(swung.positions[:, 0] - 0.55) < 0.39
    assert (swung.positions[near, 2] - 2.0 * swung.positions[near, 1] ** 2).min() > 0.004 - 1e-3


def test_points_with_gaps_are_refused_by_name():
    with pytest.raises(cs.ArgumentError, match=r"obstacle 'scan': radius = 0.005 .*0.01 m apart.*contact='warn'"):
        cs.Predictor(CABLE, scene=over(cs.HeightField(np.zeros((9, 9)), 0.01, 0.005)), model="cosserat")
    scene = over(cs.HeightField(np.zeros((9, 9)), 0.01, 0.005)).replace(contact="warn")
    assert cs.Predictor(CABLE, scene=scene, model="cosserat").scene is not None
