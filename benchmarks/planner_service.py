"""What the planner's service costs over DDS, and what it costs the cycles of the node beside it."""

from __future__ import annotations

import array
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import planner_batch
import rclpy
import yaml
from cable_shape_msgs.srv import PredictShapes
from cell_beside import P99_ALLOWED, Side, Work, compare, measuring, work_when_told
from cell_node import STARTUP_S, FedNode
from figures import Figures, heading
from rclpy.executors import ExternalShutdownException

import cable_shape as cs
from cable_shape.ros.parameters import find_file
from cable_shape.ros.planner_messages import ARRAYS, fill_shapes
from cable_shape.ros.workers import PROFILES

OVER, MORE_S = 1.5, 0.02
SPREAD = planner_batch.SPREADS[0]
SHIPPED = "fastdds_planner.xml"
#: what is asked for, bits of PredictShapes.arrays, and whether it is judged with the shipped profiles
ANSWERS = (("status and margins", 0, False), ("and positions", 1, False), ("and all arrays", sum(ARRAYS), True))


def parameters(folder: Path, **more: Any) -> dict[str, Any]:
    """Of a node with the cable of the batches."""
    file = folder / "cable.yaml"
    file.write_text(yaml.safe_dump({k: v for k, v in planner_batch.CABLE.as_dict().items() if v is not None}))
    return {"cable_file": file, "model": "cosserat", "tolerance": planner_batch.TOLERANCE, **more}


def predicted(starts: np.ndarray, ends: np.ndarray, threads: int) -> cs.ShapeBatch:
    """What the service is asked for, in process."""
    return cs.predict_batch(
        planner_batch.CABLE, starts, ends, model="cosserat", tolerance=planner_batch.TOLERANCE, threads=threads
    )


class Client:
    """Of a service of the type of the planner's."""

    def __init__(self, name: str) -> None:
        self.node = rclpy.create_node(f"client_{name}", namespace=name)
        self.client = self.node.create_client(PredictShapes, "cable/predict_shapes")

    def wait(self) -> None:
        """Until it is there."""
        if not self.client.wait_for_service(STARTUP_S):
            raise TimeoutError("the planner did not come")
        time.sleep(0.5)  # it may still be looking for this client

    def ask(self, starts: np.ndarray, ends: np.ndarray, arrays: int) -> float:
        """[s], from flat arrays to the answer."""
        request = PredictShapes.Request(
            starts=array.array("d", starts.tobytes()), ends=array.array("d", ends.tobytes()), arrays=arrays
        )
        began = time.perf_counter()
        future = self.client.call_async(request)
        rclpy.spin_until_future_complete(self.node, future)
        spent = time.perf_counter() - began
        answer = future.result()
        if not answer.success or answer.partial:
            raise RuntimeError(answer.error or "the answer is partial")
        return spent


def echo(name: str, rows: int) -> None:
    """The least that a service in Python can do: answers as large as the planner's, made before."""
    batch = predicted(*planner_batch.grasps(rows, *SPREAD[1:]), 1)
    ready = {arrays: PredictShapes.Response() for _, arrays, _ in ANSWERS}
    for arrays, answer in ready.items():
        fill_shapes(answer, batch, arrays)
    node = rclpy.create_node("echo", namespace=name)
    node.create_service(PredictShapes, "cable/predict_shapes", lambda request, _: ready[request.arrays])
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    node.destroy_node()


@contextmanager
def echoing(name: str, rows: int, profiles: bool) -> Iterator[Client]:
    """The client of an echo in a process of its own."""
    shipped = {PROFILES: str(find_file(SHIPPED))} if profiles else {}
    child = subprocess.Popen([sys.executable, __file__, "echo", name, str(rows)], env={**os.environ, **shipped})
    try:
        yield Client(name)
    finally:
        child.send_signal(signal.SIGINT)  # to be killed would leave its shared memory behind
        child.wait(30)


def print_service(figures: Figures, repeats: int, rows: int = 1000) -> None:
    """How long a call takes over DDS beside the same call in process."""
    starts, ends = planner_batch.grasps(rows, *SPREAD[1:])
    threads = max(1, len(os.sched_getaffinity(0)) - 1)
    heading(f"PredictShapes: {rows} grasps, {threads} thread(s), medians of {repeats} in turns [ms]")
    print(f"{'':20s} in process   by service, with {SHIPPED}   an echo as large, with it   allowed")
    with measuring() as (stack, folder):
        own = parameters(folder, planner="true")
        for name, more in (("plain", {}), ("profiled", {"planner_profiles": SHIPPED})):
            stack.enter_context(FedNode(name, folder, {**own, **more}))
        clients = [Client("plain"), Client("profiled")]
        clients += [stack.enter_context(echoing(f"echo_{i}", rows, bool(i))) for i in range(2)]
        for client in clients:
            client.wait()
        for name, arrays, shipped in ANSWERS:
            spent = []
            for _ in range(repeats + 2):
                began = time.perf_counter()
                predicted(starts, ends, threads)
                spent.append([time.perf_counter() - began, *(c.ask(starts, ends, arrays) for c in clients)])
            within, plain, profiled, echo_plain, echo_profiled = 1e3 * np.median(spent[2:], axis=0)
            bound = OVER * within + 1e3 * MORE_S
            print(
                f"{name:20s} {within:10.1f} {plain:12.1f} {profiled:25.1f} {echo_plain:18.1f} {echo_profiled:9.1f} "
                f"{bound:9.1f} {'with it' if shipped else 'without it'}"
            )
            figures.at_most(f"service, {name}", profiled if shipped else plain, bound, "{:.1f}", " ms")


def load(name: str, rows: int) -> None:
    """Asks for `rows` grasps again and again while it is told to."""
    client = Client(name)
    client.wait()
    starts, ends = planner_batch.grasps(rows, *SPREAD[1:])
    work_when_told(lambda: client.ask(starts, ends, 1))


def print_cycles(figures: Figures, rounds: int, rows: int = 10_000) -> None:
    """The cycles' p99 with and without calls of the service beside."""
    heading(f"Cycles while {rows} grasps are served without a pause")
    with measuring() as (stack, folder):
        alone = stack.enter_context(FedNode("alone", folder, parameters(folder)))
        serving = {"planner": "true", "planner_rows": rows}
        planning = stack.enter_context(FedNode("planning", folder, parameters(folder, **serving)))
        work = stack.enter_context(Work(__file__, "load", "planning", str(rows)))
        for node in (alone, planning):
            node.wait()
        found = compare([Side("nothing", alone), Side("planner", planning, work=work.wait().going)], rounds)
    print(f"{len(work.spent)} calls answered in {sum(work.spent):.1f} s, with the positions of all points")
    ratio = found["planner"].cycle_p99 / found["nothing"].cycle_p99
    figures.at_most("cycles while grasps are served: p99 / without", ratio, P99_ALLOWED, "{:.2f}")


if __name__ == "__main__":
    rclpy.init()
    {"load": load, "echo": echo}[sys.argv[1]](sys.argv[2], int(sys.argv[3]))
    rclpy.try_shutdown()
