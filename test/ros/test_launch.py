"""The launch file where launch is not installed: its syntax, and that what it names exists."""

import ast
import importlib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TREE = ast.parse((ROOT / "launch" / "cable_shape.launch.py").read_text())


def keywords_of(name):
    """The keyword arguments, where they are constants, of each call of `name`."""
    calls = [node for node in ast.walk(TREE) if isinstance(node, ast.Call) and getattr(node.func, "id", "") == name]
    return [{k.arg: k.value.value for k in call.keywords if isinstance(k.value, ast.Constant)} for call in calls]


def test_it_compiles_and_makes_a_launch_description():
    compile(TREE, "cable_shape.launch.py", "exec")
    functions = {node.name: node for node in TREE.body if isinstance(node, ast.FunctionDef)}
    assert not functions["generate_launch_description"].args.args
    modules = {node.module for node in ast.walk(TREE) if isinstance(node, ast.ImportFrom)}
    assert modules == {"pathlib", "launch", "launch.actions", "launch.substitutions", "launch_ros.actions"}


def test_the_executable_that_it_starts_is_installed():
    (node,) = keywords_of("LifecycleNode")
    assert node["package"] == "cable_shape"
    setup = (ROOT / "setup.py").read_text() + (ROOT / "pyproject.toml").read_text()
    module, function = "cable_shape.command.cli", "run_node"
    assert (
        f"{node['executable']} = {module}:{function}" in setup
        or f'{node["executable"]} = "{module}:{function}"' in setup
    )
    assert callable(getattr(importlib.import_module(module), function))


def test_the_files_that_it_names_exist_and_each_scenario_has_one():
    described = " ".join(values.get("description", "") for values in keywords_of("DeclareLaunchArgument"))
    named = {word.strip(".,()").removeprefix("config/") for word in described.split() if ".yaml" in word}
    assert named == {file.name for file in (ROOT / "config").glob("node*.yaml")}
