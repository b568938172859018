"""A wire harness between two grippers: a trunk, two branches, a clip, and a connector that hangs free."""

import math

import cable_shape as cs

# The bundles: wires packed round, as stiff as when they slip on each other; the branch is a tube over thinner wires.
copper = cs.Wire(outside_diameter=0.002, linear_density=0.008, youngs_modulus=2e9, count=12)
signal = cs.Wire(outside_diameter=0.0013, linear_density=0.003, youngs_modulus=2e9, count=6)
trunk = cs.Cable.from_wires([copper, signal], length=0.5)
left = cs.Cable.from_wires([copper], length=0.4)
right = cs.Cable.from_wires([signal], length=0.35, covering=cs.Wire(0.006, 0.01, youngs_modulus=5e7))
print(f"trunk: {trunk.describe()}, EI {trunk.stiffness_interval[0]:.2g} to {trunk.stiffness_interval[1]:.2g} N m^2")

# A stiff protection over part of the trunk.
trunk = trunk.replace(sections=[cs.Section(0.10, 0.25, bending_stiffness=0.05, diameter=0.014)])

# The branches leave the trunk to its sides: frames turn the trunk's cable frame (d3 along the cable) into theirs.
turn = math.radians(25.0)
frames = {
    "left.start": cs.Pose(quaternion=(math.sin(turn), 0.0, 0.0, math.cos(turn))),
    "right.start": cs.Pose(quaternion=(-math.sin(turn), 0.0, 0.0, math.cos(turn))),
}
fork = cs.Junction("fork", ends=("trunk.end", "left.start", "right.start"), frames=frames, mass=0.01)
harness = cs.Harness({"trunk": trunk, "left": left, "right": right}, [fork])

# Two grippers hold two ends, a clip the trunk; the third end carries a connector and hangs.
along_x = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
clip = cs.Clip(0.25, cs.Pose((0.24, 0.0, 0.0), along_x), kind="hinge", segment="trunk", name="rail")
predictor = cs.Predictor(harness, scene=cs.Scene(clips=[clip]))
ends = {
    "trunk.start": cs.Grip(cs.Pose((0.0, 0.0, 0.0), along_x), kind="swivel"),
    "left.end": cs.Pose((0.70, -0.20, -0.05), along_x),
    "right.end": cs.FreeEnd(mass=0.03),
}
shape = predictor.predict(ends)
print(shape)
print("the junction is at", shape.junctions["fork"].position.round(3))
print("the connector hangs at", shape.segments["right"].positions[-1].round(3))
print("on the clip:", shape.clips[0].force.round(3), "N")
print("smallest bend radius of the left branch:", round(float(shape.segments["left"].bend_radius.min()), 3), "m")

# The gripper of the left branch moves: every shape starts from the last one.
for k in range(50):
    ends["left.end"] = cs.Pose((0.70, -0.20 + 0.002 * k, -0.05), along_x)
    shape = predictor.predict(ends)
    assert shape.usable, shape.detail
print(f"a step took {shape.solve_time * 1e6:.0f} us")

# How the connector moves with the grippers: columns are vx vy vz wx wy wz of each of `predictor.grips`.
columns = predictor.sensitivity()["right"][-1]
print(predictor.grips, columns.round(2), sep="\n")
