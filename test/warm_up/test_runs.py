"""warm_up leaves nothing to be compiled when a cable first touches something, is passed by it, or is drawn too far."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import numpy as np

import cable_shape as cs
from cable_shape.kernels import _jit

asked, load = [], _jit._Cache.load_overload

def counted(self, signature, context):
    asked.append(self._impl.filename_base)
    return load(self, signature, context)

_jit._Cache.load_overload = counted
cs.warm_up()
assert len(asked) > 30
asked.clear()
along = (0.5, 0.5, 0.5, 0.5)
cable = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
for solid in (cs.HalfSpace(), cs.Box((0.3, 0.3, 0.1)), cs.Sphere(0.1), cs.Capsule(0.05, 0.4), cs.Cylinder(0.1, 0.2)):
    body = cs.Obstacle("body", solid, cs.Pose((0.4, 0.0, 0.0)), link="tool")
    scene = cs.Scene(obstacles=[body], contact="solve")
    cycle = cs.Cycle(cable, scene=scene, uncertainty=cs.Uncertainty({"length": 1e-3}))
    touched = 0
    for k, height in enumerate((*np.linspace(-0.4, -0.2, 10), 1.5, -0.4)):  # pushed, driven through it, and away
        ends = cs.Pose((0.0, 0.0, 0.0), along), cs.Pose((0.8, 0.0, 0.0), along)
        report = cycle.step({"cable": ends}, 10_000_000 * k, links={"tool": cs.Pose((0.0, 0.0, height))})
        touched += len(report.shapes["cable"].contacts)
    assert touched
two = cs.Cycle({"a": cable, "b": cable}, scene=cs.Scene(contact="solve"))
across = (-0.7071067811865476, 0.0, 0.0, 0.7071067811865476)
for k in range(30):
    height = 0.5 + 0.02 - 0.002 * k
    over = cs.Pose((0.4, -0.4, height), across), cs.Pose((0.42, 0.4, height), across)
    under = cs.Pose((0.0, 0.0, 0.5), along), cs.Pose((0.8, 0.0, 0.5), along)
    report = two.step({"a": under, "b": over}, 10_000_000 * k)
assert report.shapes["a"].contacts
far = cs.Predictor(cable).predict(cs.Pose((0.0, 0.0, 0.0), along), cs.Pose((1.2, 0.0, 0.0), along))
assert far.status is cs.Status.OVERSTRETCHED
print("asked for later:", *asked)
"""


def test_what_a_cell_meets_first_was_compiled_before() -> None:
    told = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr
    assert told.stdout.strip() == "asked for later:"
