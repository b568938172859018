"""mink steers the cable: two arms bring its middle to a place, within their limits, and keep it off a post."""

from pathlib import Path

import mink
import numpy as np

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.robots.steering import CableChordLimit, CableClearanceLimit, CablePointTask, HeldCable

CONFIG = Path(__file__).resolve().parents[1] / "config"
robot = Robot.from_yaml(CONFIG / "robots/dual_arm.yaml")
cable = cs.Cable.from_yaml(CONFIG / "cables/demo.yaml")
post = cs.Obstacle("post", cs.Capsule(0.03, 0.3), cs.Pose((0.55, 0.0, 0.15)))

held = HeldCable(cs.Predictor(cable, model="cosserat"), robot)
configuration = held.configuration()  # at home
middle = CablePointTask(held, 0.5 * cable.length)
middle.set_target((0.42, -0.03, 0.2))
posture = mink.PostureTask(held.model, cost=1e-4)  # far below the cable's own cost, else it holds it off
posture.set_target_from_configuration(configuration)
limits = [
    mink.ConfigurationLimit(held.model),
    mink.VelocityLimit(held.model, dict.fromkeys(robot.single_joints, 0.05)),
    CableChordLimit(held),  # never pulled taut
    CableClearanceLimit(held, cs.Scene(obstacles=[post]), minimum=0.02),
]
for k in range(31):
    if k % 10 == 0:
        print(f"step {k}: the middle is {np.linalg.norm(middle.compute_error(configuration)) * 1e3:.1f} mm off")
    velocity = mink.solve_ik(configuration, [middle, posture], 1.0, solver="daqp", limits=limits)
    configuration.integrate_inplace(velocity, 1.0)
print("joints:", held.q(configuration).round(3))
