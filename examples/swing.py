"""A cable that is moved fast: how far it swings from where it would hang, and when it hangs still again."""

import numpy as np

import cable_shape as cs

cable = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, retardation_time=0.05, drag=0.05)
along_x = (0.5, 0.5, 0.5, 0.5)


def ends(t: float) -> tuple[cs.Pose, cs.Pose]:
    """Both grippers: half a metre sideways in 0.6 s, as smoothly as can be."""
    x = min(t / 0.6, 1.0)
    y = 0.5 * (10 * x**3 - 15 * x**4 + 6 * x**5)
    return cs.Pose((0.0, y, 1.0), along_x), cs.Pose((0.7, y, 1.0), along_x)


motion, rest = cs.Motion(cable, points=101), cs.Predictor(cable, points=101)
shape = motion.begin(*ends(0.0))
dt, farthest, still, spent = 0.01, 0.0, 0.0, []
for k in range(1, 1001):
    shape = motion.step(*ends(k * dt), dt)
    assert shape.usable, shape.detail
    spent.append(shape.solve_time)
    swing = np.linalg.norm(shape.positions - rest.predict(*ends(k * dt)).positions, axis=1).max()
    if swing > farthest:
        farthest, when = swing, k * dt
    if swing > 0.002:
        still = k * dt

print(f"{farthest * 1e3:.0f} mm from where it would hang at {when:.2f} s, within 2 mm of it from {still:.2f} s on")
print(f"at last it moves at {np.abs(shape.velocity).max() * 1e3:.2f} mm/s")
print(f"a step of {dt * 1e3:.0f} ms took {np.median(spent) * 1e6:.0f} us")
