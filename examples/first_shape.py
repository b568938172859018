"""A cable between two hands: its shape, what it pulls with, and whether the answer is good."""

import cable_shape as cs

# SI units, z up, quaternions x, y, z, w. A cable is its length, its weight [kg/m] and its stiffness EI [N m^2].
cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
print(cable.describe())

# The third axis of each pose points along the cable, from its start to its end: here along x at both.
along_x = (0.5, 0.5, 0.5, 0.5)
left, right = cs.Pose((0.0, 0.0, 1.0), along_x), cs.Pose((0.8, 0.0, 1.0), along_x)
shape = cs.predict(cable, left, right)
print(f"{shape.model}: {shape.status.name}, off by at most some {shape.error_estimate:.1e} m")
print(f"lowest point at z = {shape.positions[:, 2].min():.3f} m, tightest bend {shape.bend_radius.min():.3f} m")
print(f"force at the end {shape.force[-1].round(3)} N, moment {shape.moment[-1].round(4)} N m")

# What cannot be is no exception: a status with its remedy. Look at `usable` before anything moves.
taut = cs.predict(cable, left, cs.Pose((1.3, 0.0, 1.0), along_x))
print(f"{taut.status.name}, usable: {taut.usable}. {taut.detail or taut.status.remedy}")

# A wrong argument is: an error with the name, the value, the bound and what to write instead.
try:
    cs.Cable(length=-1.2, linear_density=0.1, bending_stiffness=0.01)
except cs.ArgumentError as error:
    print(error)
