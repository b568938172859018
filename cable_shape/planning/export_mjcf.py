"""A cable in its present shape as a MuJoCo model: :func:`mjcf`.

Bodies of equal length h follow each other, each turned against the one before by three hinges with springs, of the
bending stiffnesses and the twisting stiffness over h, whose rest is the cable's rest curvature. The middles of the
first and the last body are the ends of the cable; the first is fixed, the last one welded, and clips hold the point of
the cable that is in them. The model is loaded as the cable is; stretch and shear are left out.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.shape import CableShape

#: Joints that are made, if no number is asked for.
JOINTS = 60
#: Of a hinge, by its stiffness: damping [s] and armature [s^2], which lets it take steps of milliseconds.
_DAMPING, _ARMATURE = 0.02, 4e-5
#: Of what holds ends and clips: as hard as steps of 2 ms allow.
_STIFF = 'solref="0.004 1" solimp="0.9999 0.9999 0.001"'


def mjcf(shape: CableShape, cable: Cable, joints: int = JOINTS, held: bool = True) -> bytes:
    """The XML; held: the end is held where it is, else it is free.

    Raises
    ------
    ArgumentError
        Of a cable that has sections, or a rest curvature that varies.
    """
    rest = np.asarray(cable.rest_curvature)
    if cable.sections or rest.ndim > 1 or cable.mean_bending_stiffness == 0.0:
        bound = "the same stiffness and rest curvature everywhere are told in MJCF"
        raise ArgumentError.of("cable", cable, bound, "Export its shape as STL or USD.")
    h, s = shape.length / joints, np.linspace(0.0, shape.length, joints + 1)
    frames = Slerp(shape.arc_length, Rotation.from_quat(shape.quaternions))(s)
    turns = frames[:-1].inv() * frames[1:]
    free = (turns.inv() * Rotation.from_rotvec(h * rest)).as_euler("XYZ")
    place = shape.positions[0] - 0.5 * h * frames[0].as_matrix()[:, 2]
    lines = [_body(0, place, frames[0], "")]
    stiffness = np.array((*cable.bending_stiffness, cable.twisting_stiffness)) / h
    lines += [_body(k + 1, (0.0, 0.0, h), turns[k], _hinges(stiffness, free[k])) for k in range(joints)]
    lines.append("</body>" * (joints + 1))
    lever, mass = 0.25 * shape.length, cable.linear_density * h
    last = shape.positions[-1] - 0.5 * h * frames[-1].as_matrix()[:, 2]
    pose = f'pos="{_text(last)}" quat="{_text(np.roll(frames[-1].as_quat(), 1))}"'
    lines.append(f'<body name="grip" {pose}/>')
    weld = f'<weld body1="grip" body2="B{joints}" relpose="0 0 0 1 0 0 0" {_STIFF} torquescale="{lever:.6g}"/>'
    hold = [weld] if held else []
    hold += [_clip(float(row[0]), h, joints) for row in shape.supports]
    inner = "\n".join(lines)
    return f"""<mujoco model="cable">
  <compiler angle="radian" boundmass="0" boundinertia="0"/>
  <option timestep="0.002" integrator="implicitfast"><flag contact="disable"/></option>
  <size memory="100M"/>
  <default><default class="cable">
    <geom type="capsule" fromto="0 0 0 0 0 {h:.9g}" size="{0.5 * cable.diameter:.9g}" mass="{mass:.9g}"/>
  </default></default>
  <worldbody>
{inner}
  </worldbody>
  <equality>{"".join(hold)}</equality>
</mujoco>
""".encode()


def _body(k: int, place: object, turn: Rotation, hinges: str) -> str:
    """The beginning of a body, in the frame of the one before."""
    quaternion = np.roll(turn.as_quat(), 1)
    return f'<body name="B{k}" pos="{_text(place)}" quat="{_text(quaternion)}">{hinges}<geom class="cable"/>'


def _hinges(stiffness: Array, free: Array) -> str:
    """Three of them, with the angles at which they are free of moment."""
    axes = ("1 0 0", "0 1 0", "0 0 1")
    told = zip(axes, stiffness.tolist(), free.tolist(), strict=True)
    return "".join(
        f'<joint type="hinge" axis="{axis}" stiffness="{k:.9g}" springref="{angle:.12g}" '
        f'damping="{_DAMPING * k:.6g}" armature="{_ARMATURE * k:.6g}"/>'
        for axis, k, angle in told
    )


def _clip(arc: float, h: float, joints: int) -> str:
    """What holds the point at an arc length."""
    k = min(max(round(arc / h), 0), joints)
    return f'<connect body1="B{k}" anchor="0 0 {arc - k * h + 0.5 * h:.9g}" {_STIFF}/>'


def _text(values: object) -> str:
    return " ".join(f"{x:.12g}" for x in np.asarray(values, dtype=float))
