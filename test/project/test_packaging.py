"""The package as pip sees it: the wheel in a venv of its own, and that all the lists of versions and names agree."""

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from recordings import motion, write_bag

import cable_shape as cs
from cable_shape.command import doctor
from cable_shape.errors import EXTRAS, lacking

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CASE = {
    "cable": {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.01},
    "start": {"position": [0, 0, 0]},
    "end": {"position": [0, 0.8, 0]},
}


def requirements(*extras):
    """What these extras ask for, and those that they name, by name."""
    found = {}
    for text in (text for extra in extras for text in PROJECT["optional-dependencies"][extra]):
        asked = Requirement(text)
        if asked.name == PROJECT["name"]:
            found.update(requirements(*asked.extras))
        else:
            found[canonicalize_name(asked.name)] = asked
    return found


def pins():
    """What requirements.txt installs, by name."""
    lines = (line.partition("#")[0].strip() for line in (ROOT / "requirements.txt").read_text().splitlines())
    return {canonicalize_name(pin.name): pin for pin in map(Requirement, filter(None, lines))}


def test_the_pins_are_the_dependencies_and_the_extras_that_developers_have():
    asked = {canonicalize_name(r.name): r for r in map(Requirement, PROJECT["dependencies"])} | requirements("dev")
    assert {name: sorted(pin.extras) for name, pin in pins().items()} == {n: sorted(r.extras) for n, r in asked.items()}
    for name, pin in pins().items():
        (exact,) = pin.specifier
        assert exact.operator == "=="
        assert asked[name].specifier.contains(exact.version), f"{asked[name]} leaves out {pin}"


def test_the_extra_all_holds_all_that_ros_and_development_are_not_part_of():
    extras = set(PROJECT["optional-dependencies"]) - {"all", "dev", "ros", "docs", "cad"}
    assert requirements("all") == requirements(*extras)


def test_a_missing_library_is_named_with_the_extra_that_brings_it():
    """Each library that an extra brings and doctor looks for."""
    for distribution, module in doctor.LIBRARIES.items():
        named = [
            extra for extra in ("replay", "viewer", "robots") if canonicalize_name(distribution) in requirements(extra)
        ]
        assert [EXTRAS[module]] == named if module in EXTRAS else not named
    assert "Run: pip install 'cable_shape[robots]'" in str(lacking(ModuleNotFoundError(name="pinocchio.visualize")))
    assert "Source a ROS 2 Jazzy" in str(lacking(ModuleNotFoundError(name="tf2_msgs")))
    assert lacking(ModuleNotFoundError(name="no_such_module")) is None


def test_one_version_everywhere():
    versions = {PROJECT["version"], cs.__version__}
    for file in ("package.xml", "msg_defs/package.xml"):
        versions.add(ElementTree.parse(ROOT / file).findtext("version"))
    versions.add(yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"])
    assert versions == {cs.__version__}
    assert f"## {cs.__version__} " in (ROOT / "CHANGELOG.md").read_text()


def test_the_files_that_tools_read_are_well_formed():
    for file in (".pre-commit-config.yaml", ".github/ISSUE_TEMPLATE/config.yml"):
        assert yaml.safe_load((ROOT / file).read_text())
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    checks = re.findall(r"^\"\$venv/bin/(\w+)\"", (ROOT / "scripts" / "test").read_text(), flags=re.MULTILINE)
    assert {hook["entry"].split()[0].removeprefix(".venv/bin/") for hook in hooks} == {*checks}
    assert json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text())["name"] == "cable_shape"
    for copied in re.findall(r"^COPY (\S+) ", (ROOT / "docker" / "Dockerfile").read_text(), flags=re.MULTILINE):
        assert (ROOT / copied).exists()


def copy_of_sources(folder):
    """What the package is built from, so that building leaves nothing in this tree."""
    folder.mkdir()
    for name in ("cable_shape", "config", "launch", "resource", "msg_defs"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "setup.cfg", "package.xml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / name)
    return folder


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A venv with the wheel of this tree, and the libraries of the running one behind it."""
    folder = tmp_path_factory.mktemp("wheel")
    venv = folder / "venv"
    run([sys.executable, "-m", "venv", "--without-pip", str(venv)])
    site = next((venv / "lib").glob("python*/site-packages"))
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib"))  # its own .pth files are not read there
    pip = [
        str(venv / "bin" / "python"),
        "-m",
        "pip",
        "--disable-pip-version-check",
        "-q",
        "install",
        "--ignore-installed",
    ]
    offline = ["--no-deps", "--no-index", "--no-build-isolation", "--no-compile"]
    run([*pip, *offline, str(copy_of_sources(folder / "sources"))])
    return venv


def run(command, code=0, **keywords):
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, **keywords)
    assert done.returncode == code, done.stdout + done.stderr
    return done


def python(venv, text, tmp_path):
    """What a program prints in the venv, from a folder in which no sources lie."""
    return run([str(venv / "bin" / "python"), "-I", "-c", text], cwd=tmp_path).stdout


def test_the_wheel_holds_every_module_and_file(installed, tmp_path):
    (package,) = (installed / "lib").glob("python*/site-packages/cable_shape")
    modules = {file.relative_to(ROOT / "cable_shape") for file in (ROOT / "cable_shape").rglob("*.py")}
    assert {file.relative_to(package) for file in package.rglob("*.py")} == modules
    assert (package / "py.typed").is_file()
    share = installed / "share" / "cable_shape"
    for folder in ("config", "launch"):
        assert files(share, folder) == files(ROOT, folder)


def files(base, folder):
    """What lies below a folder, but for what Python compiles there by itself."""
    found = {file.relative_to(base) for file in (base / folder).rglob("*") if file.is_file()}
    return {file for file in found if "__pycache__" not in file.parts}


def test_the_installed_package_plans_and_predicts_without_ros(installed, tmp_path):
    text = """
import sys
import numpy as np
import cable_shape as cs
cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
along = (0.5, 0.5, 0.5, 0.5)
start, end, later = (cs.Pose((x, 0, 1), along) for x in (0.0, 0.8, 0.79))
assert cs.predict(cable, start, end)
starts, ends = (np.array([pose.array for pose in poses]) for poses in ((start, start), (end, later)))
assert cs.predict_batch(cable, starts, ends).usable.all()
assert cs.check_trajectory(cable, cs.Scene(), None, cs.GripPath(starts, ends)).valid
ros = ("rclpy", "rosbags", "rerun", "pinocchio", "mujoco", "matplotlib", "cable_shape_msgs")
print(cs.__file__, [module for module in ros if module in sys.modules])
"""
    file, loaded = python(installed, text, tmp_path).split(maxsplit=1)
    assert Path(file).is_relative_to(installed)
    assert loaded.strip() == "[]"


def test_the_installed_command_predicts_a_case_and_replays_a_recording(installed, tmp_path):
    """Without a ROS and without the sources: the messages that a replay writes came with the wheel."""
    (tmp_path / "cable.yaml").write_text(yaml.safe_dump(CASE["cable"]))
    bag = write_bag(tmp_path / "bag", motion(3))
    places = ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR")  # of kernels, which would all be compiled here otherwise
    kept = {name: os.environ[name] for name in places if name in os.environ}
    command, plain = str(installed / "bin" / "cable-shape"), {"cwd": tmp_path, "env": kept}
    assert "status                     OK" in run([command, "predict", "cases/harness.yaml"], **plain).stdout  # its own
    replayed = run([command, "replay", str(bag), "-o", "out", "--cable", "cable.yaml", "--no-rrd"], **plain)
    assert "cycles                     3" in replayed.stdout


def test_what_an_extra_would_bring_is_said_on_one_line(installed, tmp_path):
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(CASE))
    (tmp_path / "cable.yaml").write_text(yaml.safe_dump(CASE["cable"]))
    program = """
import sys
from cable_shape.command import cli
for module, entry, arguments in (
    ("rosbags", cli.main, ["replay", "bag", "-o", "out", "--cable", "cable.yaml"]),
    ("matplotlib", cli.main, ["predict", "case.yaml", "-o", "a.png"]),
    ("rclpy", cli.run_node, []),
):
    assert module not in sys.modules
    sys.modules[module] = None
    sys.argv[1:] = arguments
    assert entry() == 2, module  # that of the node ends the process
"""
    done = run([str(installed / "bin" / "python"), "-I", "-c", program], code=2, cwd=tmp_path)
    replay, picture, node = done.stderr.splitlines()
    assert "pip install 'cable_shape[replay]'" in replay
    assert "pip install 'cable_shape[replay]'" in picture
    assert "rclpy is not installed, which the node and what hears it need. Source a ROS 2 Jazzy" in node
    assert "Traceback" not in done.stderr


def test_colcon_builds_the_package(tmp_path):
    """It reads what setup.py and pyproject.toml say together, and puts the executables where `ros2 run` looks."""
    sources, prefix = copy_of_sources(tmp_path / "sources"), tmp_path / "install"
    colcon = [str(Path(sys.executable).with_name("colcon")), "--log-base", str(tmp_path / "log")]
    build = ["build", "--paths", str(sources), "--install-base", str(prefix), "--build-base", str(tmp_path / "build")]
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "AMENT_PREFIX_PATH": sys.prefix, "COLCON_DEFAULTS_FILE": os.devnull}
    run([*colcon, *build], cwd=tmp_path, env=environment)
    installed = {file.name for file in (prefix / "cable_shape" / "lib" / "cable_shape").iterdir()}
    assert installed == {*PROJECT["scripts"]}
    assert files(prefix / "cable_shape" / "share" / "cable_shape", "config") == files(ROOT, "config")


def test_doctor_asks_of_a_wheel_only_what_everybody_needs(monkeypatch):
    monkeypatch.setattr(doctor, "_in_sources", lambda: False)
    monkeypatch.setattr(doctor, "LIBRARIES", {"no-such-distribution": "rosbags", "no-such-other": "numpy"})
    optional, needed = doctor._libraries()
    assert (optional.remedy, optional.found) == ("", "not installed; what needs it: pip install 'cable_shape[replay]'")
    assert needed.remedy == "Run pip install no-such-other."
