"""Contact with meshes that are not convex: divided into convex parts, one obstacle all the same."""

from __future__ import annotations

import numpy as np
import pytest
from solids import CHANNEL, L_SHAPE, drawn_out, off_profile

import cable_shape as cs
from cable_shape.scene import mesh_parts, mesh_parts_cache
from cable_shape.solve.touching.touching import DEEPEST

ALONG_X, ALONG_Y = (0.5, 0.5, 0.5, 0.5), (-0.7071067811865476, 0.0, 0.0, 0.7071067811865476)
CABLE = cs.Cable(length=0.7, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
BRACKET, GUTTER = drawn_out(L_SHAPE, 0.4), drawn_out(CHANNEL, 0.4)


@pytest.fixture(autouse=True, scope="module")
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        mesh_parts.parts_of.cache_clear()
        yield


HERE = cs.Pose((0, 0, 0))


def scene_of(solid, pose=HERE, **options):
    return cs.Scene(obstacles=[cs.Obstacle("part", solid, pose, **options)], contact="solve")


def boxes(*entries):
    """Obstacles from low to high corners."""
    made = [(np.array(low), np.array(high)) for low, high in entries]
    return cs.Scene(
        obstacles=[
            cs.Obstacle(f"box{i}", cs.Box(high - low), cs.Pose(0.5 * (low + high)))
            for i, (low, high) in enumerate(made)
        ],
        contact="solve",
    )


L_BOXES = boxes(((0, -0.2, 0), (0.3, 0.2, 0.05)), ((0, -0.2, 0.05), (0.05, 0.2, 0.3)))


def across(predictor, x, z, apart=0.62):
    """The shape across the profile's plane, along y."""
    return predictor.predict(cs.Pose((x, -apart / 2, z), ALONG_Y), cs.Pose((x, apart / 2, z), ALONG_Y))


def into_the_corner(scene, cable=CABLE):
    """Lowered onto the floor of the L, then drawn against its wall; the shapes."""
    predictor = cs.Predictor(cable, scene=scene, model="cosserat")
    way = [(0.15, 0.3 - 0.01 * k) for k in range(13)] + [(0.15 - 0.01 * k, 0.18) for k in range(1, 16)]
    return [across(predictor, *at) for at in way]


def deepest(profile, shape, radius=0.004):
    inside = np.abs(shape.positions[:, 1]) < 0.2
    gaps = off_profile(profile, shape.positions[inside][:, [0, 2]]) - radius
    return -float(gaps.min())


def test_an_l_of_one_mesh_is_as_good_as_one_of_boxes():
    mesh, box = into_the_corner(scene_of(BRACKET)), into_the_corner(L_BOXES)
    off = mesh_parts.parts_of(BRACKET).deviation
    assert 0.0 < off < 3e-4
    corner = 0
    for k, (one, other) in enumerate(zip(mesh, box, strict=True)):
        assert one.usable, (k, one)
        assert {contact.body for contact in one.contacts} <= {"part"}
        gap = np.linalg.norm(one.positions - other.positions, axis=1).max()
        assert gap < 2.0 * one.error_estimate + other.error_estimate, (k, gap)  # in the corner two faces are off
        assert deepest(L_SHAPE, one) < off + DEEPEST, k
        pushes = [sum((c.force * c.normal for c in shape.contacts), np.zeros(3)) for shape in (one, other)]
        assert pushes[0] == pytest.approx(pushes[1], abs=0.01), k
        corner += len({tuple(c.normal.round(3)) for c in one.contacts}) > 1
    assert corner, "it is pressed against floor and wall"
    assert pushes[0][0] > 0.5


def test_what_the_parts_are_off_is_part_of_the_error():
    predictor = cs.Predictor(CABLE, scene=scene_of(GUTTER), model="cosserat")
    high, low = across(predictor, 0.0, 0.6), across(predictor, 0.0, 0.18)
    off = mesh_parts.parts_of(GUTTER).deviation
    assert not high.contacts
    assert low.contacts
    assert off > high.error_estimate
    assert low.error_estimate > off > 0.0


def test_a_cable_lies_in_a_channel_of_one_mesh_and_leaves_it():
    predictor = cs.Predictor(CABLE, scene=scene_of(GUTTER), model="cosserat")
    way = [(0.0, 0.4 - 0.02 * k) for k in range(12)] + [(0.01 * k, 0.18) for k in range(1, 6)]
    way += [(0.05, 0.18 + 0.03 * k) for k in range(1, 9)]
    touched = 0
    for at in way:
        shape = across(predictor, *at)
        assert shape.usable, (at, shape)
        assert deepest(CHANNEL, shape) < mesh_parts.parts_of(GUTTER).deviation + DEEPEST, at
        touched += bool(shape.contacts)
    assert touched > 5
    assert not shape.contacts


def test_a_shape_answers_the_whole_of_a_divided_body():
    solved, step = cs.Predictor(CABLE, scene=scene_of(BRACKET), model="cosserat"), 1e-5
    for k in range(13):
        shape = across(solved, 0.15 - 0.01 * k, 0.18)
    assert len({tuple(contact.normal.round(3)) for contact in shape.contacts}) > 1
    columns = solved.sensitivity(["body:part"])
    for axis in (0, 2):
        moved = []
        for sign in (1.0, -1.0):
            solved.scene = scene_of(BRACKET, cs.Pose(sign * step * np.eye(3)[axis]))
            moved.append(across(solved, 0.03, 0.18).positions)
        differences = (moved[0] - moved[1]) / (2.0 * step)
        assert np.abs(differences).max() > 0.5
        assert np.abs(columns[:, :, axis] - differences).max() < 0.02, axis


def test_another_body_that_comes_leaves_the_cable_where_it_lies():
    predictor = cs.Predictor(CABLE, scene=scene_of(BRACKET), model="cosserat")
    for k in range(13):
        before = across(predictor, 0.15 - 0.01 * k, 0.18)
    first, second = (cs.Obstacle(name, cs.Sphere(0.02), cs.Pose((1, 0, z))) for name, z in (("one", 0), ("two", 1)))
    (part,) = scene_of(BRACKET).obstacles
    predictor.scene = cs.Scene(obstacles=[first, part, second], contact="solve")
    after = across(predictor, 0.03, 0.18)
    assert after.status is cs.Status.OK
    assert {contact.body for contact in after.contacts} == {"part"}
    assert np.linalg.norm(after.positions - before.positions, axis=1).max() < 1e-5


def test_a_cable_on_it_may_carry_another_one():
    cycle = cs.Cycle({"high": CABLE, "low": CABLE}, scene=scene_of(BRACKET), model="cosserat")
    for k in range(10):
        height = 0.24 - 0.004 * k
        report = cycle.step(
            {
                "high": tuple(cs.Pose((0.25, y, height), ALONG_Y) for y in (-0.31, 0.31)),
                "low": tuple(cs.Pose((x, 0.01, height - 0.04), ALONG_X) for x in (0.06, 0.66)),
            },
            stamp=10_000_000 * k,
        )
        for name, shape in report.shapes.items():
            assert shape.usable, (k, name, shape)
    high, low = report.shapes["high"], report.shapes["low"]
    assert {contact.body for contact in high.contacts} == {"low"}
    assert {contact.body for contact in low.contacts} == {"high", "part"}
    assert low.presses("high").sum() == pytest.approx(high.presses("low").sum())
    assert low.error_estimate > mesh_parts.parts_of(BRACKET).deviation


def test_it_may_be_allowed_carried_and_swung_among_by_its_name():
    scene = scene_of(BRACKET, link="tool").replace(allow=[cs.Allow("part", max_force=5.0)])
    moving = cs.Predictor(CABLE, scene=scene, model="cosserat")
    ends = cs.Pose((0.15, -0.31, 0.2), ALONG_Y), cs.Pose((0.15, 0.31, 0.2), ALONG_Y)
    for height in np.linspace(-0.2, 0.03, 11):
        shape = moving.predict(*ends, {"tool": cs.Pose((0, 0, height))})
        assert shape.usable, (height, shape)
    assert shape.presses("part").sum() == pytest.approx(sum(contact.force for contact in shape.contacts))
    assert shape.presses("part").sum() > 0.0

    motion = cs.Motion(CABLE.replace(retardation_time=0.05, drag=0.3), scene_of(BRACKET))
    motion.begin(*(cs.Pose((0.15, y, 0.3), ALONG_Y) for y in (-0.31, 0.31)))
    for k in range(1, 41):
        x, z = 0.15 - 0.0024 * k, 0.3 - 0.003 * k
        swung = motion.step(*(cs.Pose((x, y, z), ALONG_Y) for y in (-0.31, 0.31)), 0.02)
        assert swung.usable, (k, swung)
        assert deepest(L_SHAPE, swung) < 1e-3, k
    assert {contact.body for contact in swung.contacts} == {"part"}


def test_a_mesh_is_divided_once(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    mesh_parts.parts_of.cache_clear()
    first = mesh_parts.parts_of(BRACKET)
    (kept,) = (tmp_path / "cable_shape" / "parts").glob("*.npz")
    whole = kept.read_bytes()

    def refuse(*_):
        raise AssertionError("it is divided again")

    with monkeypatch.context() as patch:
        patch.setattr(mesh_parts, "_divide", refuse)
        mesh_parts.parts_of.cache_clear()
        again = mesh_parts.parts_of(BRACKET)
    assert again == first
    for damaged in (whole[: len(whole) // 2], b"", whole[:-30] + bytes(30), b"x" * 100):
        kept.write_bytes(damaged)
        mesh_parts.parts_of.cache_clear()
        assert mesh_parts.parts_of(BRACKET) == first
        assert mesh_parts_cache.read(kept.stem) == (first.meshes, first.deviation), "it is kept anew"
    kept.chmod(0o400)
    monkeypatch.setenv("XDG_CACHE_HOME", str(kept))  # no folder
    mesh_parts.parts_of.cache_clear()
    assert mesh_parts.parts_of(BRACKET) == first


def test_what_is_no_solid_is_refused_by_name(monkeypatch):
    for mesh, said in (
        (cs.Mesh(BRACKET.vertices, BRACKET.faces[:-1]), "do not join two triangles"),
        (cs.Mesh(BRACKET.vertices, BRACKET.faces[:, ::-1]), "inside out"),
    ):
        with pytest.raises(cs.ArgumentError, match=f"obstacle 'part'.*{said}.*contact='warn'"):
            cs.Predictor(CABLE, scene=scene_of(mesh), model="cosserat")
        assert cs.Predictor(CABLE, scene=scene_of(mesh).replace(contact="warn"), model="cosserat").scene is not None
    mesh_parts.parts_of.cache_clear()
    monkeypatch.setitem(__import__("sys").modules, "coacd", None)
    with pytest.raises(cs.DependencyError, match=r"coacd is not installed.*cable_shape\[meshes\]"):
        cs.Predictor(CABLE, scene=scene_of(BRACKET), model="cosserat")
