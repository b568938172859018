"""What a cell is given: the service of systemd, and processes beside the node that give up its priority."""

import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cable_shape.ros.parameters import BY_NAME

ROOT = Path(__file__).resolve().parents[2]
SERVICE = ROOT / "config" / "systemd" / "cable_shape.service"
TEXT = SERVICE.read_text(encoding="utf-8").replace("\\\n", " ")


def setting(name):
    (value,) = re.findall(rf"^{name}=(.*)$", TEXT, flags=re.MULTILINE)
    return value


def test_the_service_starts_the_node_with_parameters_that_it_has():
    command = shlex.split(setting("ExecStart"))
    assert Path(command[0]).name == "cable_shape_node"
    assert command[1:3] == ["--ros-args", "--params-file"]
    names = [command[i + 1].partition(":=")[0] for i, word in enumerate(command) if word == "-p"]
    assert names
    assert set(names) <= set(BY_NAME)
    folder = f"/var/lib/{setting('StateDirectory')}"
    assert f"output_folder:={folder}" in command
    assert all(word.partition("=")[2].startswith(f"{folder}/") for word in setting("Environment").split())


def test_the_bench_measures_the_priority_of_the_service():
    text = (ROOT / "benchmarks" / "cell_sides.py").read_text(encoding="utf-8")
    assert setting("CPUSchedulingPolicy") == "fifo"
    assert re.search(r"^NODE, SELF = (\d+),", text, flags=re.MULTILINE)[1] == setting("CPUSchedulingPriority")
    assert setting("LimitRTPRIO") == setting("CPUSchedulingPriority")


def test_systemd_takes_the_service(tmp_path):
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("no systemd-analyze")
    there = tmp_path / SERVICE.name
    there.write_text(TEXT.replace(shlex.split(setting("ExecStart"))[0], "/bin/true"))
    done = subprocess.run([analyze, "verify", there], capture_output=True, text=True, timeout=120, check=False)
    if "Failed to" in done.stderr and "manager" in done.stderr:
        pytest.skip(done.stderr)
    assert str(there.name) not in done.stderr, done.stderr


def test_a_process_beside_the_node_gives_up_its_priority():
    program = """
import os, threading
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
wait = threading.Event()
threading.Thread(target=wait.wait, daemon=True).start()
from cable_shape.viewer.children import be_ordinary
be_ordinary()
print({os.sched_getscheduler(int(thread)) for thread in os.listdir("/proc/self/task")} == {os.SCHED_OTHER})
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False)
    if "PermissionError" in done.stderr:
        pytest.skip("this user may not have a real-time priority")
    assert (done.returncode, done.stdout) == (0, "True\n"), done.stderr


@pytest.mark.parametrize("module", ["cable_shape.ros.serving", "cable_shape.viewer.child"])
def test_every_process_beside_the_node_does_so(module):
    source = Path(importlib.util.find_spec(module).origin).read_text(encoding="utf-8")
    before, _, after = source.partition("    be_ordinary()\n")
    assert after
    assert "make_way()\n" not in before.partition("def serve")[2]


def test_the_priority_of_an_ordinary_process_stays():
    from cable_shape.viewer.children import be_ordinary

    before = os.sched_getscheduler(0)
    be_ordinary()
    assert os.sched_getscheduler(0) == before
