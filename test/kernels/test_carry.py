"""A solution in contact on another mesh: rotations in between, contacts where their nodes stay, balance where not."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cable_shape.kernels.contact.carry import carry
from cable_shape.kernels.contact.near import BARE, HELD, NEAR, NORMAL, ON, PRESS, RUB
from cable_shape.solve.mesh import interpolated

APART = 1e-9
FORCES = [PRESS, *range(RUB, RUB + 3), *range(HELD, HELD + 3)]


def meshes(seed: int, kept: list[bool], added: int) -> tuple[np.ndarray, np.ndarray]:
    """The old nodes, and new ones: some of the old and so many others; both ends stay."""
    rng = np.random.default_rng(seed)
    old = np.concatenate(([0.0], np.sort(rng.uniform(0.01, 0.99, len(kept))), [1.0]))
    stay = np.array([True, *kept, True])
    return old, np.sort(np.concatenate((old[stay], rng.uniform(0.0, 1.0, added))))


def carried(seed: int, old: np.ndarray, nodes: np.ndarray):
    """What was there, and what is carried over: quaternions, `near` and `on`."""
    rng = np.random.default_rng(seed + 1)
    q = np.array((0.0, 0.0, 0.0, 1.0)) + np.cumsum(0.2 * rng.normal(size=(old.size, 4)), axis=0)
    q *= rng.choice((-1.0, 1.0), old.size)[:, None] / np.linalg.norm(q, axis=1, keepdims=True)
    near = rng.normal(size=(old.size, NEAR))
    on = np.full((old.size, ON), BARE)
    on[:, 0] = rng.choice((BARE, 0, 1), old.size, p=(0.3, 0.5, 0.2))
    out = np.zeros((nodes.size, 4)), np.zeros((nodes.size, NEAR)), np.full((nodes.size, ON), BARE)
    new = np.empty(nodes.size, dtype=np.bool_)
    carry(old, q, near, on, nodes, *out, APART, new)
    return (q, near, on), out, new


@given(st.integers(0, 2**31), st.lists(st.booleans(), max_size=30), st.integers(0, 20))
def test_rotations_are_those_of_the_line_through_the_old_ones(seed, kept, added):
    old, nodes = meshes(seed, kept, added)
    (q, _, _), (found, _, _), _ = carried(seed, old, nodes)
    np.testing.assert_allclose(found, interpolated(nodes, old, q), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)
    stay = np.isin(old, nodes)
    turn = Rotation.from_quat(found[np.isin(nodes, old)]).inv() * Rotation.from_quat(q[stay])
    assert turn.magnitude().max() < 1e-7


@given(st.integers(0, 2**31), st.lists(st.booleans(), max_size=30), st.integers(0, 20))
def test_contacts_stay_and_what_was_pressed_elsewhere_is_shared_out(seed, kept, added):
    old, nodes = meshes(seed, kept, added)
    (_, near, on), (_, found, where), new = carried(seed, old, nodes)
    stay = np.isin(old, nodes)
    np.testing.assert_array_equal(new, ~np.isin(nodes, old))
    np.testing.assert_array_equal(where[~new], on[stay])
    assert (where[new] == BARE).all()
    np.testing.assert_array_equal(found[~new][:, NORMAL], near[stay][:, NORMAL])
    given = np.zeros((nodes.size, len(FORCES)))
    given[~new] = near[stay][:, FORCES]
    for k in np.flatnonzero(~stay & (on[:, 0] != BARE)):
        j = int(np.searchsorted(nodes, old[k]))
        part = (old[k] - nodes[j - 1]) / (nodes[j] - nodes[j - 1])
        for i, share in ((j - 1, 1.0 - part), (j, part)):
            if where[i, 0] == on[k, 0]:
                given[i] += share * near[k, FORCES]
    np.testing.assert_allclose(found[:, FORCES], given, atol=1e-12)
