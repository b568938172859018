"""Stability in contact against a rod of straight pieces: its energy's second differences where its contact holds it."""

from __future__ import annotations

import numpy as np
import pytest
from rods import arch_ends, arch_predictor
from scipy.linalg import eigh, null_space
from scipy.spatial.transform import Rotation

import cable_shape as cs

PIECES, STEP = 40, 1e-4
CABLE = arch_predictor()[0].cable.replace(diameter=0.006)
STIFFNESS = np.array((*CABLE.bending_stiffness, CABLE.twisting_stiffness))
ALONG_Y = cs.Pose((0.0, 0.0, 0.0), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))


def chain(frames, turns):
    """Energy [J] (k,) and node positions (k, n + 1, 3) of n pieces after turns (k, n - 1, 3) of the nodes inside."""
    k, pieces = len(turns), len(frames) - 1
    h, whole = CABLE.length / pieces, np.zeros((k, pieces + 1, 3))
    whole[:, 1:-1] = turns
    nodes = Rotation.from_quat(np.tile(frames, (k, 1))) * Rotation.from_rotvec(whole.reshape(-1, 3))
    quats = nodes.as_quat().reshape(k, pieces + 1, 4)
    left, right = (Rotation.from_quat(q.reshape(-1, 4)) for q in (quats[:, :-1], quats[:, 1:]))
    bend = (left.inv() * right).as_rotvec()
    energy = (0.5 / h * STIFFNESS * bend**2).sum(axis=1).reshape(k, -1).sum(axis=1)
    along = (left * Rotation.from_rotvec(0.5 * bend)).apply((0.0, 0.0, h)).reshape(k, pieces, 3)
    return energy, np.concatenate((np.zeros((k, 1, 3)), np.cumsum(along, axis=1)), axis=1)


def gap(positions, axis, near):
    """(k,) [m], least distance to a line along y through `axis` (2,), on the parabola by the nodes about `near`."""
    far = np.linalg.norm(positions[:, near - 1 : near + 2][:, :, [0, 2]] - axis, axis=2)
    slope, curved = 0.5 * (far[:, 2] - far[:, 0]), far[:, 2] - 2.0 * far[:, 1] + far[:, 0]
    return far[:, 1] - 0.5 * slope**2 / curved


def smallest(frames, axis):
    """Smallest eigenvalue in units of the smallest stiffness / length^2, and the contact's force [N]."""
    n = 3 * (len(frames) - 2)
    _, start = chain(frames, np.zeros((1, n // 3, 3)))
    near = int(np.linalg.norm(start[0][:, [0, 2]] - axis, axis=1).argmin())

    def parts(turns):
        energy, places = chain(frames, turns.reshape(len(turns), -1, 3))
        return np.column_stack((energy, places[:, -1], gap(places, axis, near)))

    unit = STEP * np.eye(n)
    slopes = (parts(unit) - parts(-unit)) / (2.0 * STEP)  # (n, 5)
    multipliers = np.linalg.lstsq(slopes[:, 1:], slopes[:, 0], rcond=None)[0]
    weights = np.array((1.0, *-multipliers))
    i, j = np.triu_indices(n)
    corners = [parts(a * unit[i] + b * unit[j]) @ weights * a * b for a in (1.0, -1.0) for b in (1.0, -1.0)]
    second = np.zeros((n, n))
    second[i, j] = second[j, i] = sum(corners) / (4.0 * STEP**2)
    free = null_space(slopes[:, 1:].T)
    mass = CABLE.length / (len(frames) - 1) * np.eye(free.shape[1])
    softest = eigh(free.T @ second @ free, mass, eigvals_only=True)[0]
    return softest * CABLE.length**2 / STIFFNESS.min(), multipliers[-1]


@pytest.mark.parametrize("tilt", [0.0, 0.4, 0.5])
def test_it_is_that_of_a_chain_of_pieces(tilt):
    """An arch under a bar that presses on a third of it; from 9.6 down, the softer the nearer it is to snapping."""
    free = arch_predictor()[0].predict(*arch_ends(0.0)).positions
    x, _, z = free[np.abs(free[:, 0] - 0.35).argmin()]
    bar = cs.Obstacle("bar", cs.Capsule(0.02, 0.4), ALONG_Y, link="bar")
    cycle = cs.Cycle(
        CABLE, scene=cs.Scene(obstacles=[bar], contact="solve"), model="cosserat", points=PIECES + 1, snap_horizon=0.0
    )
    ways = [(0.0, above) for above in np.linspace(0.053, 0.011, 20)] + [(t, 0.011) for t in np.arange(0.0, tilt, 0.01)]
    for k, (at, above) in enumerate([*ways, (tilt, 0.011)]):
        links = {"bar": cs.Pose((x, 0.0, z + above))}
        report = cycle.step({"cable": arch_ends(at)}, k * 10_000_000, links=links)
    shape = report.shapes["cable"]
    assert shape.status is cs.Status.OK
    (contact,) = shape.contacts
    (told,) = (m.value for m in report.margins["cable"] if m.kind is cs.WarningKind.STABILITY)
    expected, force = smallest(shape.quaternions, np.array((x, z + 0.011)))
    assert contact.force == pytest.approx(force, rel=0.03)
    assert told == pytest.approx(expected, rel=0.03)
