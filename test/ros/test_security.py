"""The policies for SROS 2 name what the nodes really have, neither less nor more: compared with a live node's graph."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from cable_shape.ros.parameters import config_folders

POLICIES = config_folders()[0] / "security" / "policies.xml"
DOCS = Path(__file__).resolve().parents[2] / "docs" / "security.md"
KINDS = {"topics": {"publish", "subscribe"}, "services": {"reply", "request"}, "actions": {"execute", "call"}}
#: Only with use_sim_time, with input tf, or where moveit_msgs is installed and moveit_rate set.
NOT_ALWAYS = {"/clock", "/tf", "/tf_static", "collision_object"}


def enclaves():
    """path -> (node, {what is allowed: names as they stand})"""
    root = ElementTree.parse(POLICIES).getroot()
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    found = {}
    for enclave in root.iterfind("enclaves/enclave"):
        (profile,) = enclave.iterfind("profiles/profile")
        allowed = {}
        for group in profile:
            (expression,) = group.attrib
            assert expression in KINDS[group.tag]
            assert group.attrib[expression] == "ALLOW"
            assert {entry.tag for entry in group} == {group.tag[:-1]}
            names = [entry.text for entry in group]
            assert len(set(names)) == len(names)
            allowed[expression] = set(names)
        assert profile.attrib["ns"] == "/"
        found[enclave.attrib["path"]] = (profile.attrib["node"], allowed)
    return found


ENCLAVES = enclaves()
OURS = {path: entry for path, entry in ENCLAVES.items() if path.startswith("/cable_shape/node")}


def full(name, space, node):
    """A name of the policy in the namespace of the node under test."""
    if name.startswith("~/"):
        return f"{space}/{node}/{name[2:]}"
    return name if name.startswith("/") else f"{space}/{name}"


def wanted(space, node, allowed):
    """What the graph should show of the node: kind -> names."""
    names = {kind: {full(n, space, node) for n in allowed.get(kind, set()) - NOT_ALWAYS} for kind in allowed}
    replies, publishes = names.get("reply", set()), names.get("publish", set())
    for action in names.get("execute", ()):
        replies |= {f"{action}/_action/{part}" for part in ("send_goal", "get_result", "cancel_goal")}
        publishes |= {f"{action}/_action/{part}" for part in ("feedback", "status")}
    return {"service": replies, "publisher": publishes, "subscriber": names.get("subscribe", set()), "client": set()}


@pytest.fixture(scope="module")
def node(start_for_all):
    node = start_for_all(
        "--enclave", "/cable_shape/node",
        planner="true", calibration="true", calibration_points="seen/points", robot_file="robots/dual_arm.yaml",
        points_seen="true",
    )  # fmt: skip
    counted = ("cable/predict_shapes", "cable/calibrate/_action/send_goal")
    node.until(lambda: all(node.node.count_services(name) == 2 for name in counted), "the workers and their stand-ins")
    names = {name for name, _ in OURS.values()}  # whose node a service is may be known later than the service
    node.until(lambda: set(enclaves_seen(node)) >= names, f"{names} by name")
    return node


def enclaves_seen(node):
    """name -> enclave of the nodes under test"""
    nodes = node.node.get_node_names_and_namespaces_with_enclaves()
    return {n: enclave for n, space, enclave in nodes if space == f"/{node.process.namespace}" and n != "cell"}


@pytest.mark.parametrize("path", OURS)
def test_a_policy_allows_what_its_node_has(node, path):
    name, allowed = OURS[path]
    space = f"/{node.process.namespace}"
    expected = wanted(space, name, allowed)

    def seen():
        return {
            kind: {n for n, _ in getattr(node.node, f"get_{kind}_names_and_types_by_node")(name, space)}
            for kind in expected
        }

    node.until(lambda: all(seen()[kind] >= expected[kind] for kind in expected), f"all of {expected}")
    assert seen() == expected


def test_the_workers_are_in_enclaves_of_their_own(node):
    assert enclaves_seen(node) == {name: path for path, (name, _) in OURS.items()}


def test_the_others_are_allowed_nothing_but_what_our_nodes_offer_or_take():
    offered = {kind: set() for kind in ("publish", "subscribe", "reply", "execute")}
    for name, allowed in OURS.values():
        for kind, names in allowed.items():
            offered[kind] |= {full(n, "", name) for n in names}
    own = {"/parameter_events", "/rosout"}
    for path, (name, allowed) in ENCLAVES.items():
        if path in OURS:
            continue
        asked = {kind: {full(n, "", name) for n in names} for kind, names in allowed.items()}
        assert asked.get("publish", set()) - own <= offered["subscribe"], path
        assert asked.get("subscribe", set()) <= offered["publish"], path
        assert asked.get("request", set()) <= offered["reply"], path
        assert asked.get("call", set()) <= offered["execute"], path
        assert all(n.startswith(f"/{name}/") for n in asked.get("reply", set())), path
    writers = [path for path, (_, allowed) in ENCLAVES.items() if "left_gripper/pose" in allowed.get("publish", set())]
    assert writers == ["/cable_shape/pose_source"]
    changers = [path for path, (_, a) in ENCLAVES.items() if "/cable_shape_node/set_parameters" in a.get("request", ())]
    assert changers == ["/cable_shape/operator"]


def test_the_documentation_names_every_enclave():
    text = DOCS.read_text(encoding="utf-8")
    assert all(f"`{path}`" in text for path in ENCLAVES)
