"""Flat arrays of a cable in clips, and their parts.

The cable is cut into spans by its supports: support 0 is the start, the last one the end, those between are clips and
other points whose place is an unknown of its own. With N elements, N + 1 nodes and m spans:

    mesh  (18 N + 1)   s N+1 | h N | load 9N | rest 6N | error indicator N
    sol   3 slots      q 4 nodes | force of each span 3m | frames of the supports 7 (m + 1) | their arc lengths m + 1 |
                       turns
    work               see `matrices`, `vectors`, `joints_of`

A frame is position and quaternion; its position is that of the support now, unknown or not.
"""

from __future__ import annotations

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel

NOW, BEFORE, TRIAL = 0, 1, 2
JOINT = 60  # numbers kept for each span by the factorisation


@kernel
def mesh_size(elements: int) -> int:
    """Numbers in `mesh`."""
    return 18 * elements + 1


@kernel(forceinline=True)
def mesh_parts(mesh: Array, elements: int) -> tuple[Array, Array, Array, Array, Array]:
    """s, h, load, rest, errors."""
    n = elements
    return (
        mesh[: n + 1],
        mesh[n + 1 : 2 * n + 1],
        mesh[2 * n + 1 : 11 * n + 1].reshape(n, 9),
        mesh[11 * n + 1 : 17 * n + 1].reshape(n, 6),
        mesh[17 * n + 1 : 18 * n + 1],
    )


@kernel
def slot_size(elements: int, spans: int) -> int:
    """Numbers in one of the three slots of `sol`."""
    return 4 * (elements + 1) + 3 * spans + 8 * (spans + 1) + 1


@kernel(forceinline=True)
def slot(sol: Array, elements: int, spans: int, which: int) -> tuple[Array, Array, Array, Array, Array]:
    """q (N+1, 4), forces (m, 3), frames (m+1, 7), arc lengths (m+1,) and turns (1,) of one slot of `sol`."""
    nodes = elements + 1
    a = which * (4 * nodes + 11 * spans + 9)
    b = a + 4 * nodes
    c = b + 3 * spans
    d = c + 7 * (spans + 1)
    e = d + spans + 1
    return (
        sol[a:b].reshape(nodes, 4),
        sol[b:c].reshape(spans, 3),
        sol[c:d].reshape(spans + 1, 7),
        sol[d:e],
        sol[e : e + 1],
    )


@kernel
def work_size(elements: int, spans: int) -> int:
    """Numbers in `work`."""
    return 75 * elements + 40 * (elements + 1) + (JOINT + 21) * spans + 6 * (spans + 1)


@kernel(forceinline=True)
def matrices(work: Array, elements: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """D (N+1, 9), U (N, 9), parts (N, 36), P (N+1, 9), Y (N, 9), W (N+1, 12), see `span_system` and `span_factor`."""
    nodes = elements + 1
    a = 9 * nodes
    b = a + 9 * elements
    c = b + 36 * elements
    d = c + 9 * nodes
    e = d + 9 * elements
    f = e + 12 * nodes
    return (
        work[:a].reshape(nodes, 9),
        work[a:b].reshape(elements, 9),
        work[b:c].reshape(elements, 36),
        work[c:d].reshape(nodes, 9),
        work[d:e].reshape(elements, 9),
        work[e:f].reshape(nodes, 12),
    )


@kernel(forceinline=True)
def vectors(work: Array, elements: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """first (N, 9), full (N, 9), slack (N, 3), G (N+1, 3), d (N+1, 3), start (N+1, 4)."""
    nodes = elements + 1
    a = 54 * elements + 30 * nodes
    b = a + 9 * elements
    c = b + 9 * elements
    d = c + 3 * elements
    e = d + 3 * nodes
    f = e + 3 * nodes
    g = f + 4 * nodes
    return (
        work[a:b].reshape(elements, 9),
        work[b:c].reshape(elements, 9),
        work[c:d].reshape(elements, 3),
        work[d:e].reshape(nodes, 3),
        work[e:f].reshape(nodes, 3),
        work[f:g].reshape(nodes, 4),
    )


@kernel(forceinline=True)
def joints_of(work: Array, elements: int, spans: int) -> tuple[Array, Array, Array, Array]:
    """joints (m, JOINT), sums (m, 21), pull (m+1, 3), given (m+1, 3)."""
    a = 75 * elements + 40 * (elements + 1)
    b = a + JOINT * spans
    c = b + 21 * spans
    d = c + 3 * (spans + 1)
    e = d + 3 * (spans + 1)
    return (
        work[a:b].reshape(spans, JOINT),
        work[b:c].reshape(spans, 21),
        work[c:d].reshape(spans + 1, 3),
        work[d:e].reshape(spans + 1, 3),
    )
