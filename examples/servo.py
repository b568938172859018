"""Two arms lay a cable into the mouth of a clip by what a camera sees, three times as stiff as they know."""

from pathlib import Path

import numpy as np

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.robots.steering import HeldCable

CONFIG = Path(__file__).resolve().parents[1] / "config"
DT = 0.02  # s, of a control cycle
robot = Robot.from_yaml(CONFIG / "robots/dual_arm.yaml")
known = cs.Cable.from_yaml(CONFIG / "cables/demo.yaml")
random = np.random.default_rng(0)

# the cable in the cell: its camera sees it with 2 mm of noise; a tracker's shape takes its place in a real one
cell = cs.Predictor(known.replace(length=1.01, bending_stiffness=0.03), model="cosserat", points=101)


def seen(q: np.ndarray) -> cs.CableShape:
    """Where the cable really is, but for noise."""
    points = cell.predict(*robot.grips(q)).positions
    return cs.CableShape.of_points(points + random.normal(0.0, 0.002, points.shape), known.length)


# the clip opens upwards and takes the middle of the cable, which runs along -y in it
clip = cs.Clip(0.5, cs.Pose((0.45, 0.02, 0.08), (0.70710678, 0.0, 0.0, 0.70710678)), "hinge")
post = cs.Obstacle("post", cs.Cylinder(0.03, 0.24), cs.Pose((0.517, 0.22, 0.12)))
targets = [cs.MouthTarget.of(clip, outward=(0.0, 0.0, 1.0)), cs.KeepClear(cs.Scene(obstacles=[post]), minimum=0.02)]

for name, closed in (("open loop", False), ("closed loop", True)):
    held = HeldCable(cs.Predictor(known, model="cosserat", points=101), robot)
    servo = cs.Servo(held, targets)
    cell.reset()
    for k in range(400):  # noqa: B007
        velocity = servo.step(seen(servo.q) if closed else None, DT)  # to the robot's drivers, [rad/s]
        if servo.reached or servo.stalled:
            break
    middle = cell.predict(*robot.grips(servo.q)).positions[50]
    off = np.linalg.norm(middle - clip.pose.position) * 1e3
    print(f"{name}: reached {servo.reached} after {k * DT:.1f} s, it says, and is {off:.1f} mm off; {servo.binds}")

# what no pose of the arms reaches: the nearest, and what holds the cable from it
servo = cs.Servo(held, cs.PointsTarget((0.0, 1.0), ((0.4, 0.8, 0.2), (0.4, -0.8, 0.2))))
while not (servo.reached or servo.stalled):
    servo.step(None, DT)
print(f"nearest: {servo.errors[0] * 1e3:.0f} mm off; {'; '.join(servo.binds)}")
