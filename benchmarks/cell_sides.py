"""Nodes beside others in `scripts/bench cell`: several cables, a viewer, a real-time priority on a busy machine."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import yaml
from cell_beside import Side, compare, measuring, poses
from cell_node import FedNode
from cell_scene import CONFIG, motion, node_parameters

from cable_shape.robots.robot import Robot
from cable_shape.ros.diagnostics import TIMES_WINDOW

CABLE = {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.01, "diameter": 0.008}
STATES = {"attached": signal.SIGCONT, "blocked": signal.SIGSTOP, "killed": signal.SIGKILL}
VIEWER_ALLOWED = 1.1  # times the median cycle without a viewer
VIEWER_RATE = 125.0  # Hz
#: of the node as in config/systemd/cable_shape.service, and of this process, which must not be late itself
NODE, SELF = 50, 60


def cables(several: int, rates: list[float], rounds: int) -> bool:
    """So many cables on one node beside one on another: times until the last shape has come, and of cycles."""
    names = [f"c{i}" for i in range(several)]
    with measuring() as (stack, folder):
        (folder / "one.yaml").write_text(yaml.safe_dump(CABLE))
        (folder / "several.yaml").write_text(yaml.safe_dump({"cables": dict.fromkeys(names, CABLE)}))
        one = stack.enter_context(FedNode("one", folder, {"cable_file": folder / "one.yaml"}))
        many = stack.enter_context(FedNode("several", folder, {"cable_file": folder / "several.yaml"}, names))
        sides = [Side("one cable", one), Side(f"{several} cables", many, partial(poses, cables=several))]
        for side in sides:
            side.node.wait()
        for rate in rates:
            compare(sides, rounds, rate)
    return True


def child_of(pid: int) -> int:
    """The viewer's process."""
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_text().rsplit(")", 1)[1].split()[1])
        except OSError:  # it has ended
            continue
        if parent == pid:
            return int(stat.parent.name)
    raise RuntimeError("the node has no viewer")


def viewer(rounds: int) -> bool:
    """Cycles with a viewer attached, blocked (SIGSTOP) and killed, beside a node without; whether the bound holds."""
    robot = Robot.from_yaml(CONFIG / "robots" / "dual_arm.yaml")
    given = motion(robot, round(4.0 * VIEWER_RATE))
    holds = True
    with measuring() as (stack, folder):
        without = stack.enter_context(FedNode("without", folder, node_parameters(folder, "off")))
        viewed = stack.enter_context(FedNode("viewed", folder, node_parameters(folder, str(folder / "seen.rrd"))))
        for node in (without, viewed):
            node.wait()
        for state, number in STATES.items():
            os.kill(child_of(viewed.process.pid), number)
            sides = [Side("without", without, given), Side(state, viewed, given)]
            found = compare(sides, rounds, VIEWER_RATE, TIMES_WINDOW + 1.0)
            holds &= found[state].cycle_p50 <= VIEWER_ALLOWED * found["without"].cycle_p50
    print(f"cycle p50 at most {VIEWER_ALLOWED:g} times that without a viewer: {'yes' if holds else 'NO'}")
    return holds


def give_priority(process: int, priority: int) -> None:
    """SCHED_FIFO for every thread that the process has; those that it starts have it, too."""
    for thread in os.listdir(f"/proc/{process}/task"):
        os.sched_setscheduler(int(thread), os.SCHED_FIFO, os.sched_param(priority))


@contextlib.contextmanager
def busy(processes: int) -> Iterator[None]:
    """So many processes without a priority that do nothing but compute."""
    program = "import os; os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))\nwhile True: pass"
    started = [subprocess.Popen([sys.executable, "-S", "-c", program]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in started:
            process.kill()
            process.wait()


def priority(rates: list[float], rounds: int) -> bool:
    """A node with a real-time priority beside one without, fed by this process, while none, one or four busy processes
    for each core run."""
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, *before)
    except PermissionError:
        print("A real-time priority needs root, CAP_SYS_NICE or a limit (ulimit -r) of 60 or more.", file=sys.stderr)
        return False
    cores = len(os.sched_getaffinity(0))
    with measuring() as (stack, folder):
        (folder / "cable.yaml").write_text(yaml.safe_dump(CABLE))
        given = {"cable_file": folder / "cable.yaml"}
        plain, first = (stack.enter_context(FedNode(name, folder, given)) for name in ("plain", "first"))
        for node in (plain, first):
            node.wait()
        give_priority(first.process.pid, NODE)
        give_priority(os.getpid(), SELF)
        for rate in rates:
            for load in (0, cores, 4 * cores):
                print(f"\n{load} busy processes:", end="")
                with busy(load):
                    compare([Side("no priority", plain), Side(f"SCHED_FIFO {NODE}", first)], rounds, rate)
    return True
