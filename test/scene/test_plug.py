"""A plug against its socket."""

import math

import numpy as np
import pytest
from rods import CABLE, END, START
from scipy.spatial.transform import Rotation

import cable_shape as cs

OFFSET = cs.Pose((0.0, 0.01, 0.03), Rotation.from_rotvec((0.0, 0.0, 0.5)).as_quat())


def error(scene: cs.Scene, end=END, **keywords) -> cs.PlugError:
    cycle = cs.Cycle(CABLE, scene=scene, model="cosserat", **keywords)
    return cycle.step({"cable": (START, end)}, 0).plugs["cable"]


def socket_at(depth: float, side: float, turn=(0.0, 0.0, 0.0), plug: cs.Pose = END) -> cs.Pose:
    """A socket in which `plug` would have to go `depth` further along its z, `side` along x, and turn by `turn`."""
    return plug * cs.Pose((side, 0.0, depth), Rotation.from_rotvec(turn).as_quat())


def test_error_of_a_gripped_plug_is_split_along_and_across_the_socket():
    plug = END * OFFSET
    scene = cs.Scene(sockets={"port": socket_at(0.03, 0.004, plug=plug)}, plug=cs.Plug("port", OFFSET))
    found = error(scene)
    assert found.socket == "port"
    assert found.pose.distance(plug) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert found.position == pytest.approx(math.hypot(0.03, 0.004))
    assert found.axial == pytest.approx(-0.03), "3 cm to go"
    assert found.lateral == pytest.approx(0.004)
    assert found.angle == pytest.approx(0.0, abs=1e-9)


def test_angle_counts_all_rotation():
    turn = (0.1, -0.2, 0.3)
    found = error(cs.Scene(sockets={"port": socket_at(0.0, 0.0, turn)}), plugs={"cable": cs.Plug("port")})
    assert found.angle == pytest.approx(np.linalg.norm(turn))
    assert found.position == pytest.approx(0.0, abs=1e-12)


def test_a_plug_on_a_free_end_hangs_where_the_cable_ends():
    scene = cs.Scene(sockets={"port": cs.Pose((0.1, 0.0, -1.0))})
    end = cs.FreeEnd(mass=0.05)
    cycle = cs.Cycle(CABLE, scene=scene, model="cosserat", plugs={"cable": cs.Plug("port", OFFSET)})
    report = cycle.step({"cable": (START, end)}, 0)
    shape, found = report.shapes["cable"], report.plugs["cable"]
    frame = cs.Pose(shape.positions[-1], shape.quaternions[-1])
    assert found.pose == frame * OFFSET
    assert found.position == pytest.approx(math.dist(found.pose.position, (0.1, 0.0, -1.0)))
    assert math.hypot(found.axial, found.lateral) == pytest.approx(found.position)
    assert found.axial == pytest.approx(found.pose.position[2] + 1.0), "the socket's z is up"


def test_without_a_plug_or_a_shape_nothing_is_told():
    scene = cs.Scene(sockets={"port": END})
    assert cs.Cycle(CABLE, scene=scene).step({"cable": (START, END)}, 0).plugs == {}
    far = cs.Pose((2.0, 0.0, 0.0))
    assert cs.Cycle(CABLE, scene=scene.replace(plug=cs.Plug("port"))).step({"cable": (START, far)}, 0).plugs == {}


def test_from_yaml_and_back(tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_text(
        "sockets:\n  port: {position: [0.9, 0, 0.3], quaternion: [0, 0, 0, 1]}\n  other: {position: [0, 0, 1]}\n"
        "plug: {socket: port, position: [0, 0, 0.02]}\n"
    )
    scene = cs.Scene.from_yaml(file)
    assert scene.sockets["port"] == cs.Pose((0.9, 0.0, 0.3))
    assert scene.plug == cs.Plug("port", cs.Pose((0.0, 0.0, 0.02)))
    assert cs.Scene.from_mapping(scene.as_dict()) == scene
    assert cs.Scene.from_mapping(cs.Scene().as_dict()) == cs.Scene()
    assert hash(scene) == hash(cs.Scene.from_mapping(scene.as_dict()))


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"plug": {"socket": "port"}}, r"plug.socket = 'port' is not allowed: it must be one of "),
        ({"sockets": [1]}, r"sockets = \[1\] is not allowed: it must be a mapping"),
        ({"sockets": {"a": {"quaternion": [0, 0, 0, 1]}}}, r"sockets.a: the key 'position' is missing"),
        ({"sockets": {"a": {"position": [0, 0]}}}, r"sockets.a: position = \[0, 0\] is not allowed"),
        ({"plug": {"sokket": "a"}}, r"plug: unknown key 'sokket'. Did you mean 'socket'\?"),
    ],
)
def test_bad_sockets_are_refused(values, says):
    with pytest.raises(cs.ArgumentError, match=says):
        cs.Scene.from_mapping(values)


def test_a_cycle_refuses_an_unknown_socket_and_an_unknown_cable():
    with pytest.raises(cs.ArgumentError, match=r"plugs\['cable'\].socket = 'prot'"):
        cs.Cycle(CABLE, scene=cs.Scene(sockets={"port": END}), plugs={"cable": cs.Plug("prot")})
    with pytest.raises(cs.ArgumentError, match=r"plugs: unknown key 'c'"):
        cs.Cycle(CABLE, scene=cs.Scene(sockets={"port": END}), plugs={"c": cs.Plug("port")})
