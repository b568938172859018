"""The tube that holds a cable, as rerun draws it: :func:`capsules`. Imports rerun: see recording."""

from __future__ import annotations

import math

import numpy as np
import rerun as rr

from cable_shape.checks import Array
from cable_shape.uncertainty.uncertainty import Tube
from cable_shape.viewer import colour as colours

PIECES = 40


def capsules(tube: Tube, diameter: float) -> rr.Capsules3D:
    """Wire frames about the cable, one a piece, as wide as cable and tube together where these are widest."""
    shape = tube.shape
    shown = np.unique(np.linspace(0, shape.points - 1, min(shape.points, PIECES + 1)).round().astype(int))
    ends = shape.positions[shown]
    along = np.diff(ends, axis=0)
    lengths = np.linalg.norm(along, axis=1)
    return rr.Capsules3D(
        lengths=lengths,
        radii=np.maximum(np.maximum.reduceat(tube.radius, shown[:-1]), tube.radius[shown[1:]]) + 0.5 * diameter,
        translations=ends[:-1],
        quaternions=[_upright_to(way) for way in along / np.maximum(lengths, 1e-12)[:, None]],
        colors=colours.TUBE,
        fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
    )


def _upright_to(way: Array) -> rr.Quaternion:
    """A turn of z onto a unit vector (3,)."""
    x, y, z = way.tolist()
    if z < -1.0 + 1e-9:
        return rr.Quaternion(xyzw=(1.0, 0.0, 0.0, 0.0))
    w = math.sqrt(0.5 * (1.0 + z))
    return rr.Quaternion(xyzw=(-0.5 * y / w, 0.5 * x / w, 0.0, w))
