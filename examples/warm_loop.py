"""A control loop: every shape starts from the last one, and a cycle judges it against what is around."""

import numpy as np

import cable_shape as cs

cs.warm_up()  # compiles once, or loads what was compiled: no cycle waits for it
cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, min_bend_radius=0.08)
post = cs.Obstacle("post", cs.Cylinder(0.02, 1.0), cs.Pose((0.4, 0.25, 0.5)))
cycle = cs.Cycle(cable, scene=cs.Scene(obstacles=[post], warn_distance=0.05, error_distance=0.02))

along_x = (0.5, 0.5, 0.5, 0.5)
spent, told = [], set()
for k in range(500):  # 5 s at 100 Hz, both grippers towards the post
    y = 0.25 * (1.0 - np.cos(0.01 * np.pi * k)) / 2.0
    start, end = cs.Pose((0.0, y, 0.6), along_x), cs.Pose((0.8, y, 0.6), along_x)
    report = cycle.step({"cable": (start, end)}, stamp=10_000_000 * k)  # ns
    shape = report.shapes["cable"]
    assert shape.usable, shape.detail
    spent.append(report.times["total"])
    for warning in report.warnings:
        if (warning.kind, warning.severity) not in told:
            told.add((warning.kind, warning.severity))
            print(f"{0.01 * k:.2f} s  {warning.severity.name}: {warning.text}")

nearest = report.clearance["cable"].closest
print(f"at the end {nearest.distance * 1e3:.0f} mm to {nearest.body}, at {nearest.arc_length:.2f} m along the cable")
print(f"a cycle took {np.median(spent) * 1e3:.2f} ms, shape, clearance, margins and warnings together")
