"""One flat work array of a mesh, and its parts as arrays."""

from __future__ import annotations

from typing import Any

from cable_shape.kernels._jit import kernel

Array = Any


@kernel
def work_size(elements: int, width: int) -> int:
    """Numbers needed for `elements` elements and `width` border columns, the gradient's included."""
    nodes = elements + 1
    return nodes * (28 + 6 * width) + 63 * elements + width * width + 21 + width


@kernel(forceinline=True)
def matrices(work: Array, elements: int, width: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """D, U, X, P, Y, W."""
    nodes = elements + 1
    a = 0
    b = a + 9 * nodes
    D = work[a:b].reshape(nodes, 9)
    a = b
    b = a + 9 * elements
    U = work[a:b].reshape(elements, 9)
    a = b
    b = a + 3 * width * nodes
    X = work[a:b].reshape(nodes, 3 * width)
    a = b
    b = a + 9 * nodes
    P = work[a:b].reshape(nodes, 9)
    a = b
    b = a + 9 * elements
    Y = work[a:b].reshape(elements, 9)
    a = b
    b = a + 3 * width * nodes
    W = work[a:b].reshape(nodes, 3 * width)
    return D, U, X, P, Y, W


@kernel(forceinline=True)
def vectors(work: Array, elements: int, width: int) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """parts, first, G, d, gram, total, step."""
    nodes = elements + 1
    a = (18 + 6 * width) * nodes + 18 * elements
    b = a + 36 * elements
    parts = work[a:b].reshape(elements, 36)
    a = b
    b = a + 9 * elements
    first = work[a:b].reshape(elements, 9)
    a = b
    b = a + 3 * nodes
    G = work[a:b].reshape(nodes, 3)
    a = b
    b = a + 3 * nodes
    d = work[a:b].reshape(nodes, 3)
    a = b
    b = a + width * width
    gram = work[a:b].reshape(width, width)
    a = b
    b = a + 21
    total = work[a:b]
    a = b
    return parts, first, G, d, gram, total, work[a : a + width]
