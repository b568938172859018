"""Writes the reference shapes of this folder: `python test/references/make.py [name ...]`, all of them by default.

Each case of reference_cases.py is solved by collocation (test/helpers/collocation.py): Kirchhoff's equations with
stretch and shear, all stretches between clips and masses side by side. Of the package nothing is used but the reader of
cases and a shape that the collocation starts from, which says which of several equilibria is meant. What comes out is
integrated again by DOP853, and refused if it differs.

The files have the fields that cable_shape/command/reference_case.py reads, and in `solution` more than it: forces,
moments, `energy`, `events` (loads before and after clips and masses), and `min_eig`, the smallest eigenvalue of the
second variation (second_variation.py) in units of the largest stiffness / length^2, null with eyelets and end moments.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp, solve_ivp
from scipy.spatial.transform import Rotation

HERE = Path(__file__).parent
sys.path += [str(HERE), str(HERE.parent / "helpers"), str(HERE.parents[1])]

import collocation  # noqa: E402
import reference_cases  # noqa: E402
import second_variation  # noqa: E402
from collocation import STATES, Rod, Stop  # noqa: E402

import cable_shape as cs  # noqa: E402
from cable_shape.command.reference_case import reference_case  # noqa: E402

TOLERANCE = 1e-10  # of solve_bvp, in units of length L, force F and moment F L
DIFFERENCE = 1e-10  # in the same units: of one point and DOP853 from the point before
POINTS = 21
ELEMENTS = 300  # of the second variation
Values = dict[str, Any]
Array = np.ndarray


class Chain:
    """A case in units of its length L and of the force F, the larger of weight and EI / L^2."""

    def __init__(self, values: Values) -> None:
        self.values, fields = values, values["cable"]
        length, K = fields["length"], np.array((fields["EI1"], fields["EI2"], fields["GJ"]))
        gravity = -values["gravity"][2]
        weight = gravity * fields["linear_density"]
        self.length = length
        self.force = max(weight * length, K.max() / length**2)
        units = self.units = np.concatenate((np.full(3, length), np.ones(4), np.full(3, self.force * length),
                                             np.full(3, self.force)))[:, None]  # fmt: skip
        force, moment = units[12, 0], units[9, 0]
        stops = [(0.0, Stop(values["start"]["position"], values["start"]["quaternion_xyzw"]))]
        stops += [
            (
                clip["s"] / length,
                Stop(
                    np.array(clip["position"]) / length,
                    clip["quaternion_xyzw"],
                    slides=clip["type"] == "slide",
                    draw=clip.get("retraction", 0.0) / force,
                ),
            )
            for clip in values["clips"]
        ]
        stops += [
            (mass["s"] / length, Stop(force=(0.0, 0.0, -gravity * mass["mass"] / force)))
            for mass in values["point_masses"]
        ]
        end = values["end"]
        if end:
            last = Stop(np.array(end["position"]) / length, end["quaternion_xyzw"])
        else:
            pull = np.array(values["end_force"]) - (0.0, 0.0, gravity * values["end_mass"])
            last = Stop(force=pull / force, moment=np.array(values["end_moment"]) / moment)
        stops = [*sorted(stops, key=lambda stop: stop[0]), (1.0, last)]
        self.at, self.stops = np.array([s for s, _ in stops]), [stop for _, stop in stops]
        self.stops[0].place = np.array(self.stops[0].place) / length
        stiffness = collocation.constant(K / (moment * length))
        rest = collocation.constant(np.array(fields["rest_curvature"]) * length)
        give = [force / fields[name] if fields[name] else 0.0 for name in ("GA", "GA", "EA")]
        self.rods = [Rod(d, stiffness, rest, weight * length / force, give=give) for d in np.diff(self.at)]

    def guess(self, shape: cs.CableShape, x: Array) -> Array:
        """A shape of the package as states (13 a stretch, k), each stretch from the points inside it."""
        M = Rotation.from_quat(shape.quaternions).inv().apply(shape.moment)
        q = (
            shape.quaternions
            * np.cumprod(np.sign([1.0, *(shape.quaternions[1:] * shape.quaternions[:-1]).sum(axis=1)]))[:, None]
        )
        q *= np.sign(q[0] @ self.stops[0].rotation)
        Y = np.hstack((shape.positions, q, M, shape.force)) / self.units.T
        s, parts = shape.arc_length / self.length, []
        for a, b in pairwise(self.at):
            inside = (s > a + 1e-9) & (s < b - 1e-9)
            parts += [np.interp(a + (b - a) * x, s[inside], y) for y in Y[inside].T]
        return np.array(parts)

    def slide(self, arcs: Array) -> None:
        """Eyelets to these fractions of the length."""
        self.at[[stop.slides for stop in self.stops]] = arcs
        for rod, length in zip(self.rods, np.diff(self.at), strict=True):
            rod.length = length

    def solve(self, x: Array, Y: Array, tol: float = TOLERANCE) -> Any:
        found = collocation.chain(self.rods, self.stops, x, Y, tol)
        if found.p is not None:
            self.slide(found.p)
        return found

    def states(self, found: Any, s: Array) -> Array:
        """(13, k) at fractions s of the length, at a stop those after it."""
        out = np.empty((STATES, s.size))
        of = np.clip(np.searchsorted(self.at, s + 1e-12, side="right") - 1, 0, len(self.rods) - 1)
        for i, (a, b) in enumerate(pairwise(self.at)):
            out[:, of == i] = found.sol((s[of == i] - a) / (b - a))[STATES * i : STATES * (i + 1)]
        out[3:7] /= np.linalg.norm(out[3:7], axis=0)
        return out

    def check(self, found: Any, s: Array) -> float:
        """Largest difference of a point from DOP853 that comes from the point before, in every stretch."""
        worst = 0.0
        for i, (a, b) in enumerate(pairwise(self.at)):
            rod, points = self.rods[i], np.unique([a, *s[(s > a) & (s < b)], b])
            Y = found.sol((points - a) / (b - a))[STATES * i : STATES * (i + 1)]
            for k, (here, there) in enumerate(pairwise(points)):
                span = here - a, there - a
                worst = max(worst, again(lambda s, y, rod=rod: collocation.slopes(rod, s, y), span, Y[:, k : k + 2]))
        return worst

    def integrals(self, found: Any) -> tuple[float, float]:
        """Energy [J] with the weight's, zero at z = 0, and the integral of the twist u3."""
        energy = twist = 0.0
        nodes, weights = np.polynomial.legendre.leggauss(6)
        edges = np.linspace(0.0, 1.0, 201)
        x = (edges[:-1, None] + 0.5 * (nodes + 1.0) * np.diff(edges)[:, None]).ravel()
        weights = np.tile(0.5 * weights / 200, 200)
        for i, rod in enumerate(self.rods):
            Y = found.sol(x)[STATES * i : STATES * (i + 1)]
            u, _, N = collocation.strains(rod, rod.length * x, Y)
            bent = 0.5 * (Y[7:10] * (u - rod.rest(x))).sum(axis=0) + 0.5 * (np.array(rod.give) @ N**2)
            energy += rod.length * weights @ (bent + rod.weight * Y[2])
            twist += rod.length * weights @ u[2]
        ends = [found.y[STATES * i : STATES * (i + 1), -1] for i in range(len(self.rods))]
        for stop, Y in zip(self.stops[1:-1], ends[:-1], strict=True):
            energy -= stop.force[2] * Y[2]
        weight = -self.values["gravity"][2] * self.values["end_mass"] / self.force
        return (energy + weight * ends[-1][2]) * self.force * self.length, twist

    def stability(self, found: Any) -> float:
        """Smallest eigenvalue of the second variation, in units of the largest stiffness / L^2."""
        states = []
        for i, rod in enumerate(self.rods):
            n = round(ELEMENTS * rod.length) + 8
            states.append(found.sol((np.arange(n) + 0.5) / n)[STATES * i : STATES * (i + 1)])
        held = ["" if s.place is None else "frame" if s.rotation is not None else "place" for s in self.stops]
        return second_variation.smallest(self.rods, states, held) / self.rods[0].stiffness(np.zeros(1)).max()

    def events(self, found: Any) -> list[Values]:
        """Force and moment around clips and masses, in the world."""
        out = []
        for i, s in enumerate(self.at[1:-1]):
            event: Values = {"s": round(s * self.length, 12)}
            for side, Y in (("before", found.y[STATES * i : STATES * (i + 1), -1]),
                            ("after", found.y[STATES * (i + 1) : STATES * (i + 2), 0])):  # fmt: skip
                event[f"force_{side}"] = digits(Y[10:13] * self.force)
                event[f"moment_{side}"] = digits(collocation.turned(Y[3:7], Y[7:10]) * self.force * self.length)
            out.append(event)
        return out


def again(slopes: Callable[[Array, Array], Array], span: tuple[float, float], ends: Array) -> float:
    """How far DOP853 from the first column of `ends` comes from the second."""
    reached = solve_ivp(
        lambda s, y: slopes(np.array((s,)), y[:, None])[:, 0],
        span, ends[:, 0], method="DOP853", rtol=1e-12, atol=1e-14,
    )  # fmt: skip
    return float(np.abs(reached.y[:, -1] - ends[:, 1]).max())


def digits(values: Array) -> Any:
    """Rounded to 13 digits of the largest, in lists."""
    values = np.asarray(values)
    size = np.abs(values).max()
    return (np.round(values, 13 - int(np.ceil(np.log10(size)))) + 0.0).tolist() if size > 0.0 else values.tolist()


def solved(values: Values) -> tuple[Chain, Any]:
    """The case by collocation: from the package's shape, or without an approach from a load grown from none."""
    x = np.linspace(0.0, 1.0, 101)
    if values["approach"] is None:
        return grown(values, x)
    chain, case = Chain(values), reference_case(values)
    shape = cs.predict(case.cable, case.start, case.end, scene=case.scene, gravity=values["gravity"], points=401)
    assert shape.status is cs.Status.OK, shape
    loads = zip(values["clips"], shape.clips, strict=True)
    chain.slide([load.arc_length / chain.length for clip, load in loads if clip["type"] == "slide"])
    rough = chain.solve(x, chain.guess(shape, x), 1e-4)
    return chain, chain.solve(rough.x, rough.y)


def grown(values: Values, x: Array) -> tuple[Chain, Any]:
    """From the circle in which the cable lies without load, the point mass grown in steps."""
    mass = values["point_masses"][0]["mass"]
    curvature = values["cable"]["rest_curvature"][1]
    found = None
    for part in np.linspace(0.0, 1.0, 41):
        values["point_masses"][0]["mass"] = part * mass
        chain = Chain(values)
        if found is None:
            s = np.concatenate([a + (b - a) * x for a, b in pairwise(chain.at * chain.length)])
            turn = Rotation.from_quat(values["start"]["quaternion_xyzw"]) * Rotation.from_rotvec(
                np.outer(curvature * s, (0, 1, 0))
            )
            radius = turn.apply((-1.0, 0.0, 0.0)) / curvature
            Y = np.zeros((s.size, STATES))
            Y[:, 0:3] = (np.array(values["start"]["position"]) + radius - radius[0]) / chain.length
            Y[:, 3:7] = turn.as_quat() * np.sign(turn.as_quat()[0] @ chain.stops[0].rotation)
            Y[:, 3:7] *= np.sign(Y[:, 3:7] @ Y[0, 3:7])[:, None]
            mesh, guess = x, np.concatenate(np.split(Y.T, len(chain.rods), axis=1))
        else:
            mesh, guess = found.x, found.y
        found = chain.solve(mesh, guess, TOLERANCE if part == 1.0 else 1e-4)
    return chain, found


def hanging(values: Values) -> Values:
    """The solution of a catenary, r' = (1 / |n| + 1 / EA) n, by collocation too."""
    fields, end = values["cable"], np.array(values["end"]["position"])
    length, weight = fields["length"], 9.81 * fields["linear_density"]
    give = 1.0 / fields["EA"] if fields["EA"] else 0.0

    def slopes(s: Array, y: Array) -> Array:
        load = np.zeros((3, s.size))
        load[2] = weight
        return np.concatenate(((1.0 / np.linalg.norm(y[3:], axis=0) + give) * y[3:], load))

    s = np.linspace(0.0, length, 200)
    guess = np.vstack((np.outer(end, s / length), np.tile(weight * length * end[:, None], s.size)))
    guess[5] = weight * (s - 0.5 * length)
    found = solve_bvp(
        slopes, lambda a, b: np.concatenate((a[:3], b[:3] - end)), s, guess, tol=TOLERANCE, max_nodes=60_000
    )
    assert found.success, found.message
    s = np.linspace(0.0, length, POINTS)
    y = found.sol(s)
    worst = again(slopes, (0.0, length), y[:, [0, -1]])
    assert worst < DIFFERENCE, worst
    return {"s": digits(s), "r": digits(y[:3].T), "n": digits(y[3:].T), "force_start": digits(y[3:, 0])}


def completed(values: Values) -> Values:
    """The case with its solution."""
    if values["kind"] == "catenary":
        return {**values, "solution": hanging(values)}
    chain, found = solved(values)
    at = np.linspace(0.0, 1.0, POINTS)
    worst = chain.check(found, at)
    assert worst < DIFFERENCE, worst
    Y = chain.states(found, at) * chain.units
    energy, twist = chain.integrals(found)
    m = collocation.turned(Y[3:7], Y[7:10])
    sliding = any(stop.slides for stop in chain.stops)
    solution = {
        "s": digits(at * chain.length), "r": digits(Y[0:3].T), "q_xyzw": digits(Y[3:7].T), "n": digits(Y[10:13].T),
        "m": digits(m.T), "force_start": digits(Y[10:13, 0]), "energy": float(digits(energy)),
        "min_eig": None if any(values["end_moment"]) or sliding else round(chain.stability(found), 6),
        "events": chain.events(found),
    }  # fmt: skip
    print(
        f"{values['name']}: {found.x.size} nodes, DOP853 differs by {worst:.1e}, min_eig {solution['min_eig']}",
        flush=True,
    )
    approach = values.get("approach") or {}
    return {**values, "twist": {"integral_u3": twist, "end_twist": approach.get("end_twist")}, "solution": solution}


def text(values: Values) -> str:
    """JSON with a row of an array in a line."""
    inner = {key: value for key, value in values.items() if key != "solution"}
    lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in inner.items()]
    rows = []
    for key, value in values["solution"].items():
        many = isinstance(value, list) and value and isinstance(value[0], list)
        shown = "[\n   " + ",\n   ".join(json.dumps(row) for row in value) + "]" if many else json.dumps(value)
        rows.append(f"  {json.dumps(key)}: {shown}")
    return "{\n" + ",\n".join([*lines, ' "solution": {\n' + ",\n".join(rows) + "\n }"]) + "\n}\n"


if __name__ == "__main__":
    chosen = sys.argv[1:]
    for case in reference_cases.all_cases():
        if not chosen or case["name"] in chosen:
            (HERE / f"{case['name']}.json").write_text(text(completed(case)))
