"""What RViz and Foxglove are told to draw: topics that a live node or a replay has, of types that the displays take."""

import importlib
import json
import re

import pytest
import yaml
from cable_shape_msgs.msg import CableMargin
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from recordings import motion, write_bag
from rosbags.rosbag2 import Reader

from cable_shape.command.cli import main
from cable_shape.ros.parameters import config_folders

CONFIG = config_folders()[0]
RVIZ = yaml.safe_load((CONFIG / "rviz" / "cable_shape.rviz").read_text())["Visualization Manager"]
FOXGLOVE = json.loads((CONFIG / "foxglove" / "cable_shape.json").read_text())
PANELS = FOXGLOVE["configById"]

#: what each display of rviz_default_plugins subscribes to (its plugins_description.xml); None: no topic of its own
DISPLAYS = {
    "Grid": None,
    "TF": None,
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "PointCloud2": "sensor_msgs/msg/PointCloud2",
    "Path": "nav_msgs/msg/Path",
    "Pose": "geometry_msgs/msg/PoseStamped",
}
#: what Foxglove's 3D panel draws of ROS 2
DRAWN = {*DISPLAYS.values()} - {None}
POLICIES = {
    "Reliable": ReliabilityPolicy.RELIABLE,
    "Best Effort": ReliabilityPolicy.BEST_EFFORT,
    "Volatile": DurabilityPolicy.VOLATILE,
}


@pytest.fixture(scope="module")
def live(shared):
    """topic -> type of a node without a namespace, and who publishes there."""
    space = f"/{shared.process.namespace}"
    wanted = {f"{space}{topic}" for topic in ("/cable/markers", "/cable/points", "/cable/path", "/cable/margins")}
    known = shared.node.get_topic_names_and_types
    shared.until(lambda: wanted <= {topic for topic, _ in known()}, "the topics of the node")
    topics = {}
    for topic, (kind, *others) in known():
        if topic.startswith(f"{space}/") or topic == "/diagnostics":
            assert not others
            topics[topic.removeprefix(space)] = kind, shared.node.get_publishers_info_by_topic(topic)
    return topics


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    """topic -> type of what a replay writes."""
    folder = tmp_path_factory.mktemp("replay")
    (folder / "cable.yaml").write_text("length: 1.2\nlinear_density: 0.1\nbending_stiffness: 0.01\n")
    arguments = ["--cable", str(folder / "cable.yaml"), "--no-rrd", "--no-picture"]
    assert main(["replay", str(write_bag(folder / "bag", motion(3))), "-o", str(folder / "out"), *arguments]) == 0
    with Reader(folder / "out" / "replay") as reader:
        return {connection.topic: connection.msgtype for connection in reader.connections}


@pytest.mark.parametrize("display", RVIZ["Displays"], ids=lambda display: display["Name"])
def test_rviz_draws_what_the_node_publishes(live, display):
    library, _, name = display["Class"].partition("/")
    assert library == "rviz_default_plugins"
    kind = DISPLAYS[name]
    assert ("Topic" in display) == (kind is not None)
    if kind is None:
        return
    topic = display["Topic"]
    found, publishers = live[topic["Value"]]
    assert found == kind
    asked = POLICIES[topic["Reliability Policy"]]
    assert POLICIES[topic["Durability Policy"]] == DurabilityPolicy.VOLATILE  # all publishers match it
    for publisher in publishers:
        assert asked in (ReliabilityPolicy.BEST_EFFORT, publisher.qos_profile.reliability)


def test_a_replay_can_be_drawn_and_plotted(replayed):
    for config in RVIZ["Displays"]:
        if config["Class"].endswith("/PointCloud2"):
            assert replayed[config["Topic"]["Value"]] == DISPLAYS["PointCloud2"]
    assert replayed["/cable/points"] in DRAWN & {"sensor_msgs/msg/PointCloud2"}
    plotted = {path.partition(".")[0] for path in paths()}
    assert plotted <= set(replayed)


def paths():
    """Every message path of Foxglove's panels."""
    found = [path["value"] for panel in PANELS.values() for path in panel.get("paths", ())]
    return [*found, *(panel["topicPath"] for panel in PANELS.values() if "topicPath" in panel)]


def test_foxglove_draws_what_the_node_publishes(live):
    for topic in PANELS["3D!cable"]["topics"]:
        assert live[topic][0] in DRAWN
    assert live[PANELS["DiagnosticSummary!node"]["topicToRender"]][0] == "diagnostic_msgs/msg/DiagnosticArray"


def message_class(kind):
    package, _, name = kind.rpartition("/")
    return getattr(importlib.import_module(f"{package.removesuffix('/msg')}.msg"), name)


@pytest.mark.parametrize("path", paths())
def test_a_path_of_foxglove_leads_to_a_field(live, path):
    topic, _, rest = path.partition(".")
    kind = live[topic][0]
    for part in rest.split("."):
        name, several, condition = re.fullmatch(r"(\w+)(\[:\])?(?:\{(\w+)==\d+\})?", part).groups()
        fields = message_class(kind).get_fields_and_field_types()
        kind = fields[name]
        assert bool(several) == kind.startswith("sequence")
        kind = re.sub(r"sequence<(.*)>", r"\1", kind)
        if condition:
            assert condition in message_class(kind).get_fields_and_field_types()
    assert kind in ("double", "string", "boolean", "uint8")


def test_the_kinds_of_margins_are_those_of_the_messages():
    shown = {}
    for panel in ("Plot!margins", "Plot!time"):
        for path in PANELS[panel]["paths"]:
            number = int(re.search(r"kind==(\d+)", path["value"])[1])
            assert getattr(CableMargin, path["label"]) == number
            shown.setdefault(panel, set()).add(path["label"])
    kinds = {n for n in vars(type(CableMargin)) if n.isupper()} | {n for n in dir(CableMargin) if n.isupper()}
    assert shown["Plot!margins"] == {name for name in kinds if isinstance(getattr(CableMargin, name), int)}


def test_every_panel_has_its_place():
    def leaves(tree):
        return [tree] if isinstance(tree, str) else [*leaves(tree["first"]), *leaves(tree["second"])]

    assert sorted(leaves(FOXGLOVE["layout"])) == sorted(PANELS)
