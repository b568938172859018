"""Several cables on one node beside one cable on another: cycle time, and the time until the last shape has come.

The two nodes are fed in turns; a turn is `ROUNDS` rounds of poses of every cable, each round under one stamp.
"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
import yaml
from cell_node import DAY, FedNode

TURNS, ROUNDS = 6, 150
ALONG_X = (0.5, 0.5, 0.5, 0.5)
APART = 0.3  # m, between the cables
CABLE = {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.01, "diameter": 0.008}


def poses(cables: int, rate: float, stamp: int) -> list[tuple[float, ...]]:
    """Left and right of each cable at a stamp [ns] of a motion out of the plane, 0.05 rad a round."""
    rows: list[tuple[float, ...]] = []
    for i in range(cables):
        y, phase = APART * i, 0.05e-9 * rate * (stamp % DAY) + i
        rows.append((0.0, y + 0.02 * np.sin(phase), 0.5, *ALONG_X))
        rows.append((0.8 + 0.05 * np.cos(phase), y, 0.5, *ALONG_X))
    return rows


def compare(several: int, rates: list[float]) -> None:
    """Prints the table."""
    with tempfile.TemporaryDirectory(prefix="bench_cell_") as place:
        folder = Path(place)
        names = [f"c{i}" for i in range(several)]
        (folder / "one.yaml").write_text(yaml.safe_dump(CABLE))
        (folder / "several.yaml").write_text(yaml.safe_dump({"cables": dict.fromkeys(names, CABLE)}))
        with (
            FedNode("one", folder, {"cable_file": folder / "one.yaml"}) as one,
            FedNode("several", folder, {"cable_file": folder / "several.yaml"}, names, several) as many,
        ):
            nodes = ((1, one), (several, many))
            for cables, node in nodes:
                node.wait()
                node.feed(partial(poses, cables, 25.0), 25.0, ROUNDS, cables)
            print("| rate | cables | in time | p50 | p99 ms until all shapes came | cycle p50 | p99 ms | overtaken |")
            print("| --- | --- | --- | --- | --- | --- | --- | --- |")
            for rate in rates:
                waits: dict[int, list[float]] = {cables: [] for cables, _ in nodes}
                said: dict[int, dict[str, str]] = {}
                for _ in range(TURNS):
                    for cables, node in nodes:
                        waits[cables] += node.feed(partial(poses, cables, rate), rate, ROUNDS, cables)
                        said[cables] = dict(node.fresh())
                for cables, _ in nodes:
                    values = said[cables]
                    p50, p99 = np.percentile(1e3 * np.array(waits[cables]), (50, 99))
                    overtaken = sum(int(v) for k, v in values.items() if k.startswith("overtaken"))
                    cycle = " | ".join(f"{float(values[f'cycle time {name} [ms]']):.2f}" for name in ("p50", "p99"))
                    answered = np.mean(np.array(waits[cables]) < 1.0 / rate)
                    print(
                        f"| {rate:g} Hz | {cables} | {answered:.1%} | {p50:.2f} | {p99:.2f} | {cycle} | {overtaken} |"
                    )


def run(several: int, rates: list[float]) -> bool:
    """See the module."""
    rclpy.init()
    try:
        compare(several, rates)
    finally:
        rclpy.try_shutdown()
    return True
