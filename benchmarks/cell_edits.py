"""What twenty edits a second cost the cycles of a node whose cable lies on a table, beside an empty echo node."""

from __future__ import annotations

import itertools
import os
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import final

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import rclpy
import yaml
from cable_shape_msgs.srv import EditCable
from cell_beside import TURN_S, Side, Work, compare, measuring, poses, work_when_told
from cell_node import STARTUP_S, FedNode
from figures import Figures, heading

import cable_shape as cs
from cable_shape.ros.conversions import edit_message

ECHO = Path(__file__).with_name("cell_echo.py")
P99_ALLOWED, OVERTAKEN_ALLOWED, FASTEST, EDIT_ALLOWED = 3.0, 0.02, 500.0, 5.0
EDITS = 20.0  # Hz
CABLE = {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.01, "diameter": 0.008, "tails": {"end": 0.1}}
TABLE = {"name": "table", "box": [2.0, 2.0, 0.04], "position": [0.35, 0.0, 0.18]}
SCENE = {"obstacles": [TABLE], "contact": "solve", "allow": [{"body": "table"}]}
PLAIN = 500  # cycles in a row, and as many between two edits
LAPS = 40  # of all edits
PAUSE = 100_000_000  # ns, without input


def edits(middle: cs.Pose) -> Iterator[cs.Edit]:
    """What a routing task asks for, on and on; middle: where the cable's middle is."""
    beside = cs.Pose((0.35, 0.3, 0.25))
    nearer = cs.Pose(beside.position + np.array((0.0, -0.05, 0.0)), beside.quaternion)
    higher = cs.Pose(middle.position + np.array((0.0, 0.0, 0.002)), middle.quaternion)
    lap = (
        cs.Add(cs.Obstacle("post", cs.Capsule(0.02, 0.1), beside)),
        cs.Insert(cs.Clip(0.6, middle, "ball", name="clip")),
        cs.Move("post", nearer), cs.Move("clip", higher), cs.Regrip("end", 1.205), cs.Release("clip"),
        cs.Regrip("end", 1.2), cs.SetCable(cs.Cable.from_mapping({**CABLE, "bending_stiffness": 0.011})),
        cs.Remove("post"), cs.SetCable(cs.Cable.from_mapping(CABLE)),
    )  # fmt: skip
    return itertools.cycle(lap)


@final
class Going:
    """The grips' way, from stamp 0 on, which stands still while the node is not fed.

    Where they began elsewhere, or jumped, the cable might come to lie on the other side, where the post is to stand.
    """

    def __init__(self) -> None:
        self._way = self._last = 0  # ns

    def __call__(self, stamp: int) -> tuple[list[tuple[float, ...]]]:
        """The poses at a stamp [ns] of the input."""
        step, self._last = stamp - self._last, stamp
        self._way += step if step < PAUSE else 0
        return poses(self._way)


def grips(stamp: int) -> tuple[cs.Pose, cs.Pose]:
    """As the node is fed at a stamp [ns]."""
    (rows,) = poses(stamp)
    start, end = (cs.Pose(row[:3], row[3:]) for row in rows)
    return start, end


def cycle_at(stamp: int) -> tuple[cs.Cycle, cs.Pose]:
    """A cycle like the node's, and where the cable's middle is."""
    cycle = cs.Cycle(cs.Cable.from_mapping(CABLE), scene=cs.Scene.from_mapping(SCENE))
    shape = cycle.step({"cable": grips(stamp)}, stamp).shapes["cable"]
    i = shape.points // 2
    return cycle, cs.Pose(shape.positions[i], shape.quaternions[i])


def ask(namespace: str) -> None:
    """Asks for edits while it is told to."""
    node = rclpy.create_node("editing", namespace=namespace)
    client = node.create_client(EditCable, "cable_shape_node/edit")
    client.wait_for_service(STARTUP_S)
    asked = edits(cycle_at(0)[1])
    due = 0.0

    def one() -> float:
        nonlocal due
        due = max(due + 1.0 / EDITS, time.monotonic() - 1.0)
        time.sleep(max(0.0, due - time.monotonic()))
        began = time.monotonic()
        edit = next(asked)
        future = client.call_async(EditCable.Request(edits=[edit_message(edit)]))
        rclpy.spin_until_future_complete(node, future, timeout_sec=STARTUP_S)
        took, answer = time.monotonic() - began, future.result()
        if answer is None or not answer.done:
            why = "no answer" if answer is None else answer.reason
            print(f"refused: {type(edit).__name__}: {why}", file=sys.stderr, flush=True)
        return took

    work_when_told(one)


def print_cycles(figures: Figures) -> None:
    """What an edit takes beside a cycle without one, in this process and of its processor time."""
    cycle, middle = cycle_at(0)
    plain: list[float] = []
    spent: dict[str, list[float]] = defaultdict(list)
    stamp, asked, refused = 0, edits(middle), 0

    def step() -> float:
        nonlocal stamp
        stamp += 4_000_000
        given = {"cable": grips(stamp % 400_000_000)}
        began = time.process_time()
        cycle.step(given, stamp)
        return time.process_time() - began

    for lap in range(LAPS + 2):
        for _ in range(10):
            edit = next(asked)
            between = [step() for _ in range(PLAIN // 100)]
            began = time.process_time()
            done = cycle.edit(edit)
            took = time.process_time() - began + step()
            refused += not done
            if lap > 1:  # kernels of edits may have been compiled
                plain += between
                spent[type(edit).__name__].append(took)
    usual = float(np.median(plain))
    print(f"a cycle {1e3 * usual:.2f} ms; {refused} of {10 * (LAPS + 2)} edits refused")
    for name, each in spent.items():
        p50, p99 = np.percentile(each, (50, 99))
        print(f"{name:9} and its cycle: p50 {1e3 * p50:.2f}, p99 {1e3 * p99:.2f} ms, {p50 / usual:.1f} cycles")
    every = float(np.median([x for each in spent.values() for x in each]))
    figures.at_most("an edit and its cycle / a cycle, in contact, medians", every / usual, EDIT_ALLOWED, "{:.1f}")


def print_edits(figures: Figures, rates: list[float], seconds: float) -> None:
    """All of it."""
    heading("Edits of a cable on a table, and its cycles")
    print_cycles(figures)
    heading(f"From the second pose to the shape, in contact, over DDS, {EDITS:g} edits a second beside")
    with measuring() as (stack, folder):
        files = {"cable_file": folder / "cable.yaml", "scene_file": folder / "scene.yaml"}
        for (_, file), values in zip(files.items(), (CABLE, SCENE), strict=True):
            file.write_text(yaml.safe_dump(values))
        echo = stack.enter_context(FedNode("echo", folder, {}, program=(str(ECHO),)))
        node = stack.enter_context(FedNode("edited", folder, files))
        for one in (echo, node):
            one.wait()
        work = stack.enter_context(Work(__file__, "edited"))
        work.wait()
        going = Going()
        for rate in rates:
            sides = [Side("echo", echo), Side("node", node, going), Side("node, edited", node, going, work.going)]
            found = compare(sides, max(1, round(seconds / TURN_S)), rate)
            ratio = found["node, edited"].p99 / found["echo"].p99
            figures.at_most(
                f"{rate:g} Hz, contact and edits: p99 of the node / of the echo", ratio, P99_ALLOWED, "{:.2f}"
            )
            overtaken = found["node, edited"].overtaken
            print(f"inputs overtaken: {found['node'].overtaken:.1%} without edits, {overtaken:.1%} with them")
            if rate == FASTEST:
                text = f"{rate:g} Hz, contact and edits: share of inputs overtaken"
                figures.at_most(text, overtaken, OVERTAKEN_ALLOWED, "{:.1%}")
        values = node.fresh()
        done, refused = (int(values[f"edits {name}"]) for name in ("done", "refused"))
        took = 1e3 * np.percentile(work.spent, (50, 99))
        print(f"{done} edits done, {refused} refused, answered after {took[0]:.1f} ms (p99 {took[1]:.1f})")
        figures.check("edits are done, none is refused", done > 0 and refused == 0)


if __name__ == "__main__":
    rclpy.init()
    ask(sys.argv[1])
