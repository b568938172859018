"""Stiffness from a photograph: points clicked on a cable that hangs in a plane, and four whose places are known."""

from pathlib import Path

import numpy as np

import cable_shape as cs

# The photograph is made here: a camera that looks askew at a cable whose stiffness we pretend not to know.
true = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.004)
down = (0.0, 0.5**0.5, 0.0, 0.5**0.5)  # d3 along x
shape = cs.predict(true, cs.Pose((0.0, 0.0, 0.0), down), cs.Pose((0.75, 0.0, 0.05), down), points=201)
camera = np.array(((900.0, 60.0, 300.0), (90.0, -880.0, 250.0), (0.25, 0.1, 1.0)))
random = np.random.default_rng(0)


def pixels(x: float, z: float) -> np.ndarray:
    """Where a place in the cable's plane is seen; a click is off by a pixel or so."""
    seen = camera @ (x, z, 1.0)
    return seen[:2] / seen[2] + random.normal(size=2)


# What is clicked: the grips, a second point in the cable's direction at each, the cable, and the corners of a board.
rows = ["what,u,v,x,y"]
for what, places in {
    "start": [(0.0, 0.0)],
    "start_along": [(0.06, 0.0)],
    "end": [(0.75, 0.05)],
    "end_along": [(0.81, 0.05)],
    "point": shape.positions[10:-10:9][:, [0, 2]],
    "known": [(-0.2, 0.2), (1.0, 0.2), (1.0, -0.7), (-0.2, -0.7)],
}.items():
    for x, y in places:
        u, v = pixels(x, y)
        rows.append(f"{what},{u:.1f},{v:.1f}," + (f"{x},{y}" if what == "known" else ","))
Path("clicks.csv").write_text("\n".join(rows) + "\n")

# From here on it is as with a photograph of your own: the length and the weight are measured, the stiffness is a guess.
guess = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.02)
photo = cs.calibrate_photo("clicks.csv", guess)
found = photo.found["bending_stiffness"]
print(f"EI = {found.value:.5f} N m^2, 95 % from {found.low:.5f} to {found.high:.5f}; true 0.004")
