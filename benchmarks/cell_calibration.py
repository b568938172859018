"""What a calibration costs the cycles of the node beside it: the action, goal after goal, and the topic of points."""

from __future__ import annotations

import array
import os
import sys
import time
from typing import Any

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import rclpy
import yaml
from builtin_interfaces.msg import Time
from cable_shape_msgs.action import CalibrateCable
from cable_shape_msgs.msg import CableCalibration
from cell_beside import P99_ALLOWED, Side, Work, compare, measuring, poses, work_when_told
from cell_node import SENSOR, STARTUP_S, FedNode
from figures import Figures, heading
from rclpy.action import ActionClient
from sensor_msgs.msg import PointCloud2, PointField

import cable_shape as cs

GIVEN = {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.01, "diameter": 0.008}
TRUE = cs.Cable(**{**GIVEN, "bending_stiffness": 0.006})
CLOUDS = 10.0  # Hz
OBSERVATIONS = 30  # of a goal
NOISE = 5e-4  # m
FIT = ("bending_stiffness", "length")
ONLINE = {"calibration_points": "points", "calibration_period": 0.5, "calibration_fit": ",".join(FIT)}


def seen(stamp: int, noise: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Ends (2, 7) at a stamp [ns], and points (m, 3) of the true cable between them."""
    ends = np.array(*poses(stamp))
    start, end = (cs.Pose(row[:3], row[3:]) for row in ends)
    points = cs.predict(TRUE, start, end, model="cosserat").positions[10:-10:3]
    return ends, points + noise.normal(0.0, NOISE, points.shape)


def goal() -> Any:
    """One to be fitted."""
    noise = np.random.default_rng(1)
    rows = [seen(round(2e8 * k), noise) for k in range(OBSERVATIONS)]
    numbers = {
        "starts": [ends[0] for ends, _ in rows],
        "ends": [ends[1] for ends, _ in rows],
        "points": [points.ravel() for _, points in rows],
    }
    flat = {name: array.array("d", np.concatenate(values).tobytes()) for name, values in numbers.items()}
    return CalibrateCable.Goal(fit=list(FIT), counts=array.array("I", [len(p) for _, p in rows]), **flat)


def fit(namespace: str) -> None:
    """Sends goal after goal while it is told to."""
    node = rclpy.create_node("fitting", namespace=namespace)
    client = ActionClient(node, CalibrateCable, "cable/calibrate")
    if not client.wait_for_server(STARTUP_S):
        raise TimeoutError("the calibrator did not come")
    asked = goal()

    def piece() -> float:
        began = time.monotonic()
        sent = client.send_goal_async(asked)
        rclpy.spin_until_future_complete(node, sent)
        answer = sent.result().get_result_async()
        rclpy.spin_until_future_complete(node, answer)
        result = answer.result().result
        if not result.success:
            raise RuntimeError(result.error)
        return time.monotonic() - began

    work_when_told(piece)


def look(namespace: str) -> None:
    """Publishes clouds of points at `CLOUDS` while it is told to."""
    node = rclpy.create_node("looking", namespace=namespace)
    publisher = node.create_publisher(PointCloud2, "points", SENSOR)
    noise = np.random.default_rng(2)
    fields = [PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1) for i, name in enumerate("xyz")]

    def piece() -> float:
        began = time.monotonic()
        stamp = time.time_ns()
        points = seen(stamp, noise)[1].astype(np.float32)
        cloud = PointCloud2(height=1, width=len(points), fields=fields, point_step=12, row_step=12 * len(points))
        cloud.header.frame_id, cloud.header.stamp = "world", Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        cloud.data = array.array("B", points.tobytes())
        publisher.publish(cloud)
        spent = time.monotonic() - began
        time.sleep(max(0.0, 1.0 / CLOUDS - spent))
        return spent

    work_when_told(piece)


def print_calibration(figures: Figures, rounds: int) -> None:
    """The table, and what is asked of both."""
    heading("Cycles beside a calibration")
    with measuring() as (stack, folder):
        file = folder / "cable.yaml"
        file.write_text(yaml.safe_dump(GIVEN))
        alone, fitted, online = (
            stack.enter_context(FedNode(name, folder, {"cable_file": file, "model": "cosserat", **parameters}))
            for name, parameters in (("alone", {}), ("fitted", {"calibration": "true"}), ("online", ONLINE))
        )
        fitting, looking = (
            stack.enter_context(Work(__file__, role, name)) for role, name in (("fit", "fitted"), ("look", "online"))
        )
        for node in (alone, fitted, online):
            node.wait()
        sides = [
            Side("nothing", alone),
            Side("goal after goal", fitted, work=fitting.wait().going),
            Side("points at 10 Hz", online, work=looking.wait().going),
        ]
        fits: list[CableCalibration] = []
        online.node.create_subscription(CableCalibration, "cable/calibration", fits.append, 10)
        found = compare(sides, rounds)
    print(f"{len(fitting.spent)} goals of {OBSERVATIONS} observations, {np.median(fitting.spent):.2f} s each; ", end="")
    print(f"{len(fits)} fits of points at {CLOUDS:g} Hz")
    figures.check("points are fitted beside the cycles", bool(fits))
    for side in sides[1:]:
        ratio = found[side.name].p99 / found["nothing"].p99
        figures.at_most(f"cycles beside {side.name}: p99 / beside nothing", ratio, P99_ALLOWED, "{:.2f}")


if __name__ == "__main__":
    rclpy.init()
    {"fit": fit, "look": look}[sys.argv[1]](sys.argv[2])
    rclpy.try_shutdown()
