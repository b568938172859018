"""The factors of a cable in contact, for answers to motions under which the same points stay in contact."""

from __future__ import annotations

from cable_shape.kernels import contact_drive, contact_near, span_work
from cable_shape.kernels.contact_near import NORMAL, ROUND
from cable_shape.kernels.span_work import NOW
from cable_shape.models.touch_state import TouchState


def factored(state: TouchState) -> tuple[int, int]:
    """Factors the matrix of the last solution with its contacts; returns its spans, and how many forces are unknown.

    The state's where, mask, place, base and lam are then those of the spans.
    """
    n = state.elements
    h = span_work.mesh_parts(state.mesh, n)[1]
    near, on = state.near[NOW], state.on[NOW]
    spans = contact_near.supports(
        state.q[NOW], h, near, on, state.held, state.held_mask, state.where, state.mask, state.place, state.base,
        ROUND, 2.0 / float(state.par[0] + state.par[1]), True,
    )  # fmt: skip
    contact_near.forces_of(near, NORMAL, state.ends[NOW], state.where, state.base, spans, state.lam)
    unknown = spans + state.forces + 1 - state.held.size
    cut = slice(spans + 1)
    contact_drive.refresh(
        state.par, state.mesh, n, state.q[NOW], state.lam[:spans], state.where[cut], state.mask[cut], state.place[cut],
        state.base[cut], unknown, state.work,
    )  # fmt: skip
    state.unfactored()
    return spans, unknown
