"""Frames along a curve: parallel transport of a start frame, and the roll that is left at the other end.

Quaternions are x, y, z, w and turn the cable frame into the world; d3 is the tangent. Curves are given as rows: an
array (3, n) holds x, y and z of n points.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.kernels._jit import kernel

#: Below this 1 + cos(angle) two directions count as opposite, and the half turn goes about d1.
_OPPOSITE = 1e-14

#: The correction for the turning of the curve between two points needs points close enough: 1 + cos(angle) above this.
_CLOSE = 1.9


@kernel
def director(q, axis):
    """The director d1, d2 or d3 (`axis` 0, 1, 2) of the frame `q` as three numbers."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    if axis == 0:
        return 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    if axis == 1:
        return 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


@kernel
def align(q, tx, ty, tz):
    """Turns the frame `q` (4,), in place, by the smallest rotation that brings d3 onto the unit vector (tx, ty, tz)."""
    ax, ay, az = director(q, 2)
    rx, ry, rz, rw = ay * tz - az * ty, az * tx - ax * tz, ax * ty - ay * tx, 1.0 + ax * tx + ay * ty + az * tz
    if rw < _OPPOSITE:
        rx, ry, rz = director(q, 0)
        rw = 0.0
    scale = 1.0 / math.sqrt(rx * rx + ry * ry + rz * rz + rw * rw)
    rx, ry, rz, rw = rx * scale, ry * scale, rz * scale, rw * scale
    x, y, z, w = q[0], q[1], q[2], q[3]
    q[0] = rw * x + rx * w + ry * z - rz * y
    q[1] = rw * y - rx * z + ry * w + rz * x
    q[2] = rw * z + rx * y - ry * x + rz * w
    q[3] = rw * w - rx * x - ry * y - rz * z


@kernel(fastmath={"contract"})
def transport(tangents, turning, step, frames):
    """Carries the frame in ``frames[0:4]`` along the curve without twist (parallel transport).

    The smallest rotation from each tangent to the next, corrected by the area between the curve of tangents and the
    great circle on the unit sphere, step^3 / 12 t . (t' x t''): of 4th order in `step` where points are close.

    Parameters
    ----------
    tangents : (3, n)
        Unit tangents; the first one is d3 of the first frame.
    turning : (n,)
        [1/m^3], t . (t' x t''), derivatives along the arc length; zeros for a plane curve.
    step : float
        [m], arc length between neighbouring points.
    frames : (4 n,)
        First frame in, all frames out.
    """
    n = tangents.shape[1]
    turns = np.empty((4, n))
    tx, ty, tz = tangents[0], tangents[1], tangents[2]
    px, py, pz, pw = turns[0], turns[1], turns[2], turns[3]
    quarter = 0.25 * step * step * step / 12.0
    for k in range(n - 1):
        ax, ay, az, bx, by, bz = tx[k], ty[k], tz[k], tx[k + 1], ty[k + 1], tz[k + 1]
        rx, ry, rz, rw = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx, 1.0 + ax * bx + ay * by + az * bz
        # half the area, as a twist about the tangent behind: (half b, 1) (r, rw)
        half = quarter * (turning[k] + turning[k + 1])
        half = half if rw > _CLOSE and abs(half) < 0.1 else 0.0
        cx, cy, cz = by * rz - bz * ry, bz * rx - bx * rz, bx * ry - by * rx
        along = bx * rx + by * ry + bz * rz
        scale = 1.0 / math.sqrt(max(2.0 * rw * (1.0 + half * half), _OPPOSITE)) if rw > _OPPOSITE else 0.0
        px[k] = (rx + half * (bx * rw + cx)) * scale
        py[k] = (ry + half * (by * rw + cy)) * scale
        pz[k] = (rz + half * (bz * rw + cz)) * scale
        pw[k] = (rw - half * along) * scale
    x, y, z, w = frames[0], frames[1], frames[2], frames[3]
    for k in range(n - 1):
        rx, ry, rz, rw = px[k], py[k], pz[k], pw[k]
        if rw == 0.0:  # opposite tangents: half a turn about d1
            rx, ry, rz = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
            rw = 0.0
        x, y, z, w = (  # in pairs: the next step waits for these
            (rw * x + rx * w) + (ry * z - rz * y),
            (rw * y - rx * z) + (ry * w + rz * x),
            (rw * z + rx * y) - (ry * x - rz * w),
            (rw * w - rx * x) - (ry * y + rz * z),
        )
        frames[4 * k + 4], frames[4 * k + 5], frames[4 * k + 6], frames[4 * k + 7] = x, y, z, w


@kernel(fastmath={"contract"})
def darboux(bend, frames, curvature):
    """Curvature of a twist-free frame: u1, u2, u3 = (-t' . d2, t' . d1, 0) [1/m].

    bend : (3, n)
        Curvature vectors t' [1/m], world.
    frames : (4 n,)
    curvature : (3 n,)
        Out.
    """
    for k in range(bend.shape[1]):
        x, y, z, w = frames[4 * k], frames[4 * k + 1], frames[4 * k + 2], frames[4 * k + 3]
        bx, by, bz = bend[0, k], bend[1, k], bend[2, k]
        curvature[3 * k] = -2.0 * bx * (x * y - w * z) - by * (1.0 - 2.0 * (x * x + z * z)) - 2.0 * bz * (y * z + w * x)
        curvature[3 * k + 1] = (
            bx * (1.0 - 2.0 * (y * y + z * z)) + 2.0 * by * (x * y + w * z) + 2.0 * bz * (x * z - w * y)
        )
        curvature[3 * k + 2] = 0.0


@kernel
def roll(p, q):
    """[rad] in (-pi, pi]: how far the frame `q` is turned about d3 with respect to `p`, after their d3 are aligned."""
    z = p[3] * q[2] - p[0] * q[1] + p[1] * q[0] - p[2] * q[3]
    w = p[3] * q[3] + p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
    if z == 0.0 and w == 0.0:
        return 0.0
    angle = 2.0 * math.atan2(z, w)
    if angle > math.pi:
        angle -= 2.0 * math.pi
    elif angle <= -math.pi:
        angle += 2.0 * math.pi
    return angle


@kernel
def straight(start, end, length, points, buffer):
    """Fills a shape's buffer with the straight line between two points, without load: the answer when none was found.

    start, end : (7,) position [m] and quaternion. Frames are the start frame turned onto the line.
    """
    n = points
    q = start[3:7].copy()
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    chord = math.sqrt(dx * dx + dy * dy + dz * dz)
    if chord > 0.0:
        align(q, dx / chord, dy / chord, dz / chord)
    for k in range(n):
        t = k / (n - 1.0)
        buffer[k] = length * t
        for j in range(3):
            buffer[n + 3 * k + j] = start[j] + t * (end[j] - start[j])
        for j in range(4):
            buffer[4 * n + 4 * k + j] = q[j]
    for j in range(3):
        buffer[4 * n - 3 + j] = end[j]
    buffer[8 * n :] = 0.0
    return roll(q, end[3:7])
