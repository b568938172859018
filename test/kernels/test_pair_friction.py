"""Friction of a pair of cables: what one surface has gone over the other, and its derivative, by differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_link import REACH, pair

from cable_shape.kernels.contact import pair_friction
from cable_shape.kernels.contact.near import ACTIVE, APART, BARE, LINK, LINKED, PUSH, TOWARD
from cable_shape.kernels.contact.pair_friction import HELD, LIMIT, RUBS
from cable_shape.kernels.network.tables import TRIAL

ROUGH, PUSHED, LENGTH, THICK = 0.3, 2.0, 1.0, (1.0, 2.0)  # N, m, radii to each other


def remembered(seed):
    """A pair in general position that has just come to rest, and its arrays, see `test_link.pair`."""
    lying, q, near, _, _, n = pair(seed)
    lying = lying._replace(
        rough=np.full(6, ROUGH), rubs=np.zeros((3, 1, RUBS)), thick=np.repeat(THICK, 3), s=np.zeros(6)
    )
    on = lying.on[0]
    on[:, [0, 1, LINK, 4]] = BARE
    for side, k in enumerate((1, 4)):
        on[k, LINK], on[k, LINKED], near[k, PUSH] = side, ACTIVE, PUSHED
    pair_friction.remember_pairs(lying, 0, 0.0, LENGTH)
    lying.rubs[TRIAL] = lying.rubs[0]
    lying.rubs[TRIAL, 0, LIMIT] = ROUGH * PUSHED
    return lying, q, near, n


def pulled(seed, z, held=(0.0, 0.0)):
    """t and K after turns and ways z (12,) of both knots, in their own frames and in the world; held: t' [N]."""
    lying, q, near, n = remembered(seed)
    lying.rubs[TRIAL, 0, HELD : HELD + 2] = held
    for side in range(2):
        turn = Rotation.from_rotvec(z[6 * side : 6 * side + 3])
        for k in range(3 * side, 3 * side + 3):  # the cable beside it goes along as one body
            own = Rotation.from_quat(q[3 * side + 1])
            q[k] = (own * turn * own.inv() * Rotation.from_quat(q[k])).as_quat() if k != 3 * side + 1 else q[k]
        q[3 * side + 1] = (Rotation.from_quat(q[3 * side + 1]) * turn).as_quat()
    way = REACH * n + z[3:6] - z[9:12]
    for k, sign in ((1, 1.0), (4, -1.0)):
        near[k, TOWARD : TOWARD + 3], near[k, APART] = sign * way / np.linalg.norm(way), np.linalg.norm(way)
    t, K, slips = pair_friction.law(lying, q, near, 0, 1.0, 0.0, LENGTH)
    return np.array(t), np.array(K).reshape(3, 3), slips


def gone(seed, z):
    """d, of z to first order: by the velocities of both cables where they touch."""
    _, q, _, n = remembered(seed)
    thick = REACH * np.array(THICK) / sum(THICK)
    turns = [Rotation.from_quat(q[1 + 3 * side]).apply(z[6 * side : 6 * side + 3]) for side in range(2)]
    of_a = z[3:6] + np.cross(turns[0], -thick[0] * n)
    of_b = z[9:12] + np.cross(turns[1], thick[1] * n)
    return (np.eye(3) - np.outer(n, n)) @ (of_a - of_b)


@pytest.mark.parametrize("seed", range(6))
def test_what_sticks_is_pulled_back_by_what_the_surfaces_have_gone(seed):
    z = np.random.default_rng(seed).normal(size=12) * np.tile((1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-5), 2) * 1e-2
    t, K, slips = pulled(seed, z)
    firm = ROUGH * PUSHED / (1e-4 * LENGTH)
    assert not slips
    assert pytest.approx(firm * (np.eye(3) - np.outer(remembered(seed)[3], remembered(seed)[3])), abs=1e-2 * firm) == K
    assert t == pytest.approx(-firm * gone(seed, z), abs=2e-3 * firm * np.linalg.norm(gone(seed, z)))


@pytest.mark.parametrize("seed", range(6))
def test_what_slips_is_pulled_by_its_limit_and_turns_as_its_derivative_says(seed):
    random = np.random.default_rng(seed)
    held = ROUGH * PUSHED * np.array((0.6, -0.5))
    far, step = random.normal(size=12) * np.tile((0.0, 0.0, 0.0, 1e-4, 1e-4, 1e-4), 2), np.zeros(12)
    step[[3, 4, 5, 9, 10, 11]] = random.normal(size=6) * 1e-7
    if pulled(seed, np.zeros(12), held)[0] @ gone(seed, far) > 0.0:
        far *= -1.0  # on in the way that it is pulled against
    (t, K, slips), (other, _, _) = pulled(seed, far, held), pulled(seed, far + step, held)
    n = remembered(seed)[3]
    assert slips
    assert np.linalg.norm(t) == pytest.approx(ROUGH * PUSHED, rel=1e-9)
    assert np.abs(K @ t).max() < 1e-6 * np.abs(K).max()
    change = other - t
    change -= (change @ n) * n  # as the normal turns so does what it carries
    assert change == pytest.approx(-K @ gone(seed, step), abs=0.03 * np.linalg.norm(K @ gone(seed, step)))


def test_two_cables_that_turn_as_one_body_have_gone_nowhere():
    lying, q, near, n = remembered(3)
    turn = Rotation.from_rotvec((0.4, -0.7, 0.2))
    lying.rubs[TRIAL, 0, HELD : HELD + 2] = held = np.array((0.2, 0.1))
    e, f = (np.array(v) for v in pair_friction.plane_of(lying, q, 0, tuple(n)))
    q[:] = (turn * Rotation.from_quat(q)).as_quat()
    for k, sign in ((1, 1.0), (4, -1.0)):
        near[k, TOWARD : TOWARD + 3] = sign * turn.apply(n)
    t, _, slips = pair_friction.law(lying, q, near, 0, 1.0, 0.0, LENGTH)
    assert not slips
    assert t == pytest.approx(turn.apply(held[0] * e + held[1] * f), abs=1e-9)
