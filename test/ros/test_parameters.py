"""Parameters: the table without a node, then refusal and change on a running one."""

import pytest
import yaml
from harness import values_of
from rclpy.parameter import Parameter

from cable_shape.errors import ArgumentError
from cable_shape.ros.parameters import BY_NAME, SPECS, Settings, config_folders, find_file, unknown_overrides, widened

CONFIGURE, CLEANUP, ACTIVATE = 1, 2, 3
DEFAULTS = {spec.name: spec.default for spec in SPECS}


@pytest.mark.parametrize("spec", SPECS, ids=lambda s: s.name)
def test_every_parameter_has_a_descriptor_and_a_valid_default(spec):
    descriptor = spec.descriptor()
    assert descriptor.description.startswith(spec.description)
    assert descriptor.type == Parameter(spec.name, value=spec.default).type_.value
    if isinstance(spec.default, float):
        assert descriptor.floating_point_range
        assert f"[{spec.unit}]" in descriptor.description
    assert spec.check(spec.default) == (tuple(spec.default) if isinstance(spec.default, list) else spec.default)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("rate", -1.0, r"rate = -1.0 is not allowed: it must be between 0 and 10000 Hz"),
        ("rate", float("nan"), r"rate = nan is not allowed: it must be finite"),
        ("max_skew", "wide", r"max_skew = 'wide' is not allowed: it must be a number"),
        ("points", 1, r"points = 1 is not allowed: it must be a whole number of at least 2"),
        ("model", "spline", r"model = 'spline' is not allowed: it must be one of catenary"),
        ("input", "bag", r"input = 'bag' is not allowed: it must be one of poses, joints"),
        ("grip_kind_left", "glued", r"grip_kind_left = 'glued' is not allowed"),
        ("gravity", [0.0, 0.0], r"gravity = \[0.0, 0.0\] is not allowed: it must have shape \(3,\)"),
        ("autostart", 1, r"autostart = 1 is not allowed: it must be true or false"),
        ("cable_file", 3, r"cable_file = 3 is not allowed: it must be text"),
        ("left_gripper.offset", [0.0] * 7, r"left_gripper.offset: quaternion = .* its length is 0"),
    ],
)
def test_a_bad_value_is_refused_with_its_bound(name, value, text):
    with pytest.raises(ArgumentError, match=text):
        Settings.of({**DEFAULTS, name: value})


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, "cable_file = '' is not allowed: it must be the path"),
        ({"cable_file": "c.yaml", "input": "joints"}, "robot_file = '' is not allowed: input = 'joints' needs a robot"),
    ],
)
def test_what_the_parameters_must_be_together(changes, text):
    with pytest.raises(ArgumentError, match=text):
        Settings.of({**DEFAULTS, **changes}).complete()


def test_unknown_names_are_refused_with_the_nearest():
    (text,) = unknown_overrides(
        ["max_skw", "rate", "use_sim_time", "qos_overrides./a.depth"], [*BY_NAME, "use_sim_time"]
    )
    assert "unknown key 'max_skw'. Did you mean 'max_skew'?" in text


def test_whole_numbers_are_widened_where_floating_point_is_wanted():
    given = [Parameter("rate", value=100), Parameter("gravity", value=[0, 0, -10]), Parameter("points", value=20)]
    rate, gravity, points, view = widened([*given, Parameter("view", value=False)])
    assert (view.type_, view.value) == (Parameter.Type.STRING, "off")  # what YAML makes of a bare off
    assert (rate.type_, rate.value) == (Parameter.Type.DOUBLE, 100.0)
    assert (gravity.type_, list(gravity.value)) == (Parameter.Type.DOUBLE_ARRAY, [0.0, 0.0, -10.0])
    assert points.type_ == Parameter.Type.INTEGER


def test_files_are_found_in_the_working_directory_and_in_config(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").touch()
    assert find_file("mine.yaml").resolve() == tmp_path / "mine.yaml"
    assert find_file("cables/demo.yaml").is_file()
    assert str(find_file("nowhere.yaml")) == "nowhere.yaml"


@pytest.mark.parametrize("name", sorted(file.name for file in config_folders()[0].glob("node*.yaml")))
def test_the_parameter_files_that_come_along_are_valid(name):
    nodes = yaml.safe_load((config_folders()[0] / name).read_text())
    assert list(nodes) == ["/**"]
    flat = flattened(nodes["/**"]["ros__parameters"])
    flat.pop("use_sim_time", None)  # of every node
    assert set(flat) <= set(BY_NAME)
    settings = Settings.of({**DEFAULTS, **flat})
    settings.complete()
    for file in (settings.cable_file, settings.harness_file, settings.scene_file, settings.robot_file):
        assert not file or find_file(file).is_file(), file


def test_the_documentation_lists_every_parameter_as_it_is():
    text = (config_folders()[0].parent / "docs" / "node.md").read_text()
    rows = {}
    for line in text.split("## Parameters")[1].split("##")[0].splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) > 5 and cells[1].startswith("`"):
            rows[cells[1].strip("`")] = cells[2:5]
    spelled = {True: "true", False: "false"}
    for spec in SPECS:
        default = spelled[spec.default] if isinstance(spec.default, bool) else str(spec.default)
        unit = "m" if spec.name.endswith("offset") else spec.unit
        assert rows.pop(spec.name) == [default, unit, "live" if spec.live else ""], spec.name
    assert not rows


def flattened(tree, prefix=""):
    out = {}
    for key, value in tree.items():
        out.update(flattened(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value})
    return out


def test_a_running_node_describes_and_changes_its_parameters(cell):
    (rate, skew) = cell.describe(["rate", "max_skew"])
    assert rate.floating_point_range[0].to_value == 10000.0
    assert "Fixed while the node is configured" in rate.additional_constraints
    assert skew.description == "Poses further apart in time are not paired. [s]"
    assert cell.set(max_skew=1).successful  # a whole number for a floating-point parameter
    assert cell.get("max_skew") == 1.0
    assert cell.set(max_skew=0.02).successful


def test_a_change_is_made_as_a_whole_or_not_at_all(cell):
    result = cell.set(stale_after=0.3, grip_kind_left="glued")
    assert not result.successful
    assert "grip_kind_left = 'glued' is not allowed: it must be one of clamped, swivel, pinned, auto" in result.reason
    assert cell.get("stale_after") == 0.4
    result = cell.set(max_skew=-1.0)
    assert not result.successful
    assert "max_skew" in result.reason
    cell.predicted()


def test_what_is_fixed_says_how_to_change_it(cell):
    result = cell.set(model="gradient6")
    assert not result.successful
    assert "model: fixed while the node is configured (it is active). Deactivate and clean it up first" in result.reason
    result = cell.set(autostart=False)
    assert not result.successful
    assert "read-only" in result.reason


def test_wrong_overrides_fail_configure_and_can_be_put_right(start):
    node = start(points=1, max_skew=-2.0, active=False)
    status = node.diagnosis("lifecycle", "configure failed", b"\x02")
    assert "points = 1 is not allowed" in status.message
    assert "max_skew = -2.0 is not allowed: it must be between 0 and 10 s" in status.message
    assert values_of(status)["state"] == "unconfigured"
    assert node.state() == "unconfigured"
    assert node.set(points=50, max_skew=0.1).successful
    assert node.transition(CONFIGURE)
    assert node.transition(ACTIVATE)
    assert len(node.predicted().arc_length) == 50
    assert node.process.stop() == 0


def test_an_unknown_override_fails_configure(start):
    node = start(max_skw=0.1, active=False)
    status = node.diagnosis("lifecycle", "unknown key 'max_skw'. Did you mean 'max_skew'?", b"\x02")
    assert status.message.startswith("configure failed: parameters:")
    assert not node.transition(CONFIGURE)
    assert node.state() == "unconfigured"
    assert node.process.stop() == 0


def test_a_bad_cable_file_fails_configure_and_can_be_corrected(start, tmp_path):
    file = tmp_path / "bad.yaml"
    node = start(cable_file=file, active=False)
    node.diagnosis("lifecycle", f"{file}: no such file", b"\x02")
    for text, message in (
        ("length: 1.2\nlinear_density: 0.1\nbending_stiffness: -0.01\n", "bending_stiffness = -0.01 is not allowed"),
        ("length: 1.2\nlinear_density: 0.1\nbending_stifness: 0.01\n", "unknown key 'bending_stifness'. Did you mean"),
        ("length: [", "not well formed"),
    ):
        file.write_text(text)
        assert not node.transition(CONFIGURE)
        status = node.diagnosis("lifecycle", message, b"\x02")
        assert str(file) in status.message
        assert node.state() == "unconfigured"
    file.write_text("length: 1.2\nlinear_density: 0.1\nbending_stiffness: 0.01\n")
    assert node.transition(CONFIGURE)
    assert node.process.stop() == 0
