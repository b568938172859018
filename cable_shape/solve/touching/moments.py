"""Where moments inside of elements are not those of the forces there: tension makes layers thinner than elements.

From point to point m' = n x t, whose derivative is n' x t + n x t': Hermite's rule, exact to the fourth order, tells
what moments miss where the shape's points are no further apart than a layer is thick, and the cable does not stretch.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.contact.near import BARE
from cable_shape.kernels.network.tables import NOW
from cable_shape.shape import CableShape, Status
from cable_shape.solve.touching.laid import MOST_ELEMENTS
from cable_shape.solve.touching.state import TouchState
from cable_shape.solve.touching.step import FAR, WARM_ITERATIONS, Steps

#: Of the largest moment: what is missed between two points of a shape of which more nodes are asked, and which is none.
MISSED, TOO_MUCH = 5e-4, 1e-3
#: Of the points' distance: where layers are thinner, the rule is off by as much itself.
_THIN = 1.5
#: Of its limit, and of the largest push: so much more than friction can a contact may rub.
RUBBED, EVEN = 0.01, 1e-3
OVER = (
    f"an equilibrium in contact, but where it slips friction is more than {RUBBED:.0%} beyond its limit once the "
    "discretisation error is taken off. "
)
_ROUNDS = 3  #: of adding nodes
_BESIDE = 1e-9  #: [m] of a point: there forces jump between it and both of its neighbours
UNEVEN = (
    f"an equilibrium in contact, but inside of its elements moments miss more than {TOO_MUCH:g} of the largest: the "
    "cable is taut. Bring the ends closer. "
)


def thin(state: TouchState) -> bool:
    """Whether layers of the last solution, of a cable that does not stretch, may be thinner than an element."""
    if state.stretches:
        return False
    pull = float(np.abs(state.ends[NOW]).max())  # within sqrt(3) of the largest force, but for what lies on bodies
    return 3.0 * pull * float(state.h.max()) ** 2 > state.bend


def refined(steps: Steps, told: Callable[[Status], CableShape], shape: CableShape) -> bool:
    """Whether the last solution, whose `shape` is `told`, now has more nodes where moments are inexact."""
    state, changed = steps.state, False
    frames, before = state.grips[NOW].copy(), shape.positions.copy()
    for _ in range(_ROUNDS):
        arcs = np.union1d(uneven(state, shape, steps.loads, MISSED), beyond_cone(state, shape))
        if not arcs.size or state.elements + arcs.size > MOST_ELEMENTS:
            break
        kept = steps.kept()
        if not state.insert(arcs):
            break
        state.target(frames)
        found = steps.again(WARM_ITERATIONS, far=FAR) and steps.settle(frames)
        if not found or steps.passes(before, steps.buffer):
            steps.take_back(kept)
            break
        shape, changed = told(shape.status), True
    return changed


def uneven(state: TouchState, shape: CableShape, loads: Array, part: float) -> Array:
    """`missed` by the last solution; loads (k, 7): of clips, by arc length."""
    jumps = np.concatenate((state.nodes[state.on[NOW, :, 0] != BARE], loads[:, 0]))
    return missed(shape, jumps, state.nodes, state.bend, part)


def beyond_cone(state: TouchState, shape: CableShape) -> Array:
    """Middles [m] of the elements beside contacts that rub by more than friction can.

    Which is so of pushes before the discretisation error is taken off them.
    """
    rows = shape.touches
    if not (len(rows) and state.rubs and state.has_friction):
        return np.empty(0)
    node = np.abs(state.nodes[:, None] - rows[:, 0]).argmin(axis=0)
    limit = np.maximum(state.rough[node], state.bodies.rough[rows[:, 1].astype(int)]) * rows[:, 8]
    beyond = np.linalg.norm(rows[:, 9:12], axis=1) - limit > RUBBED * limit + EVEN * rows[:, 8].max()
    node = node[beyond]
    return np.unique(
        0.5 * np.concatenate((state.nodes[node - 1] + state.nodes[node], state.nodes[node] + state.nodes[node + 1]))
    )


def missed(shape: CableShape, jumps: Array, nodes: Array, bend: float, part: float) -> Array:
    """Middles [m] of those elements between `nodes` (n,) in which moments miss more than a `part` of the largest.

    jumps (k,) [m]: where forces do; bend [N m^2]: bending stiffness.
    """
    n = shape.force
    pull = float(np.linalg.norm(n, axis=1).max())
    spacing = shape.length / (shape.points - 1)
    widest = float(np.diff(nodes).max())
    if not (_THIN * spacing) ** 2 * pull < bend < widest**2 * pull:
        return np.empty(0)
    s, m, t = shape.arc_length, shape.moment, shape.tangents
    h = np.diff(s)[:, None]
    bent = np.cross(_turned(shape.quaternions, shape.curvature), t)
    slope, second = np.cross(n, t), np.cross(n, bent)
    rule = 0.5 * h * (slope[:-1] + slope[1:]) + h**2 / 12.0 * (second[:-1] - second[1:])
    rule += h / 12.0 * np.cross(np.diff(n, axis=0), t[:-1] - t[1:])
    off = np.linalg.norm(np.diff(m, axis=0) - rule, axis=1)
    at = np.concatenate([np.searchsorted(s, jumps + by) for by in (-_BESIDE, _BESIDE)])
    off[np.clip(at - 1, 0, off.size - 1)] = 0.0
    middles = 0.5 * (s[1:] + s[:-1])[off > part * float(np.linalg.norm(m, axis=1).max())]
    elements = np.unique(np.searchsorted(nodes, middles))
    return np.asarray(0.5 * (nodes[elements] + nodes[elements - 1]))


def _turned(q: Array, v: Array) -> Array:
    """(n, 3) vectors of frames with quaternions (n, 4), in the world."""
    u, w = q[:, :3], q[:, 3:]
    return np.asarray(v + 2.0 * np.cross(u, np.cross(u, v) + w * v))
