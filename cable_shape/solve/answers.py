"""How the last solution answers what holds its cable, and what it is made of: :func:`sensitivity`, :func:`answers`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import changed
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.network import respond
from cable_shape.pose import FreeEnd, Grip
from cable_shape.scene.scene_parts import clip_names
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

ENDS = ("start", "end")
#: Numbers of a cable that a shape's derivative may be by.
NUMBERS = ("length", "linear_density", "bending_stiffness", "twisting_stiffness")
#: Cables beside one are this far from it, as a fraction of the number: nothing is solved for there.
_NEAR = 1e-6
#: kg/m, of a cable without weight.
_LIGHT = 1e-6


class Solved(Protocol):
    """What has solved for a cable: the memory of the rod, in contact or not."""

    problem: Problem
    history: int
    rings: Any  # its eyelets
    rows: slice  # of the cable among those points that the solver samples

    @property
    def sampled(self) -> int:
        """How many points the solver samples."""

    @property
    def ints(self) -> Any:
        """The network's plan; `floats`, `sols` and `work` are its other arrays."""

    @property
    def floats(self) -> Array:
        """See `kernels.network.tables`."""

    @property
    def sols(self) -> Array:
        """The same."""

    @property
    def work(self) -> Array:
        """The same."""

    @property
    def network_nodes(self) -> int:
        """How many nodes the network has, those of its knots in each of their spans."""

    def refresh(self) -> None:
        """Factors the matrix of the last solution."""

    def models_beside(self, cables: Sequence[Cable], kept: dict[bytes, Array] | None = None) -> Array:
        """(c, size): models of other cables held in the same way, on the mesh as it is."""

    def knots_of(self, supports: Sequence[int]) -> Array:
        """Which knots these supports are: the start, the clips, the end."""

    def pulls(self, points: int = 0) -> tuple[Array, Array, Array]:
        """Of the eyelets, see `Network.pulls`. Needs `refresh`."""

    def body_columns(self, name: str) -> tuple[Array, Array]:
        """(points, 3, 6), (e, 6): how positions and the eyelets' pulls change as a body moves."""


@final
class Changes:
    """Directions in which a cable may change, each told by two cables, `steps` (k,) of it above and below.

    Number and places of the kinks of the rest curvature are those of the cable itself, in shares of the length.
    """

    __slots__ = ("cables", "kept", "lengths", "steps")

    def __init__(self, pairs: Sequence[tuple[Cable, Cable]], steps: Array) -> None:
        self.cables = [cable for pair in pairs for cable in pair]
        self.steps = np.array(steps, dtype=np.float64)
        self.lengths = np.array([cable.length for cable in self.cables])  # (2 k,) m
        self.kept: dict[bytes, Array] = {}  # what they are made of, see `Network.beside`

    @property
    def longer(self) -> Array:
        """(k,) [m]: how much longer the cable is a unit of each direction."""
        return np.asarray(0.5 * (self.lengths[0::2] - self.lengths[1::2]) / self.steps)


def answers(state: Solved, changes: Changes) -> Array:
    """(n, 3, k): change of the last solution's positions, a unit of each direction, all that holds it standing still.

    Points keep their share of the length; clips and masses their arc length, and the cable runs on through eyelets.
    """
    points, count = state.problem.points, len(changes.steps)
    out, df = np.empty((state.sampled, 3, count)), np.empty((len(state.rings), count))
    slides = refreshed(state)
    models = state.models_beside(changes.cables, changes.kept)
    respond.answers(state.ints, state.floats, models, changes.steps, state.sols, state.work, points, out, df)
    return run_on(out, df, slides)[state.rows]


def pushed(state: Network, rows: int) -> Array:
    """(n, 3, 3 rows): change of the last solution's positions, by accelerations about x, y, z at each of `rows` places.

    These are evenly along the cable, accelerations linear between them; where the cable accelerates, or has kinks, it
    does so at these places alone. Point masses at other places bear theirs as they are.
    """
    points, count = state.problem.points, 3 * rows
    out, df = np.empty((state.sampled, 3, count)), np.empty((len(state.rings), count))
    slides = refreshed(state)
    models = np.repeat(state.models_loaded(rows), 2, axis=0)
    models[1::2] = state.floats[: models.shape[1]]
    respond.answers(state.ints, state.floats, models, np.full(count, 0.5), state.sols, state.work, points, out, df)
    return run_on(out, df, slides)[state.rows]


def sensitivity(state: Solved, by: Sequence[str] = ENDS, *, at: str = "cable") -> Array:
    """(n, 3, m): change of the last solution's positions, by the poses of what holds the cable, and by its numbers.

    `by` names the columns in their order: "start", "end" and "clip:NAME" have six, velocity [m/s] and angular velocity
    [rad/s], world axes, about that cable end (with ``at="gripper"`` about the gripper's own origin) or the origin of
    the clip's pose; "body:NAME" too, zeros where it touches nothing; "length", "linear_density",
    "bending_stiffness" (the mean of EI1 and EI2, which keep their ratio) and "twisting_stiffness" one. Points stay at
    their arc length, by "length" at their share of it. Columns of a free end, and of what a grip or a clip leaves free,
    are zero; the cable runs on through its eyelets.

    Raises
    ------
    ArgumentError
        If there is no solution yet, or for a name that means nothing here.
    """
    if state.history == 0:
        raise ArgumentError("sensitivity() is not allowed yet: there is no solution. Call predict first.")
    if at not in ("cable", "gripper"):
        raise ArgumentError.of("at", at, "it must be 'cable' or 'gripper'", "Choose one of these.")
    problem = state.problem
    places = {"start": 0, "end": 1 + len(problem.clips)}
    places.update((f"clip:{name}", knot) for knot, name in enumerate(clip_names(problem.clips), 1))
    check_names(problem, by, (*places, *NUMBERS))
    held = [name for name in by if name in places]
    moved = _moved(state, [places[name] for name in held])
    blocks = {name: moved[:, :, 6 * i : 6 * i + 6] for i, name in enumerate(held)}
    for name, end in zip(ENDS, (problem.start, problem.end), strict=True):
        if name in blocks and isinstance(end, FreeEnd):
            blocks[name][:] = 0.0
        elif name in blocks and at == "gripper":
            assert isinstance(end, Grip)
            about_gripper(end, blocks[name])
    if len(held) == len(by):
        return moved
    numbers = [name for name in by if name in NUMBERS]
    if numbers:
        pairs, steps = zip(*[pair_of(problem.cable, name) for name in numbers], strict=True)
        columns = answers(state, Changes(pairs, np.array(steps)))
        blocks.update((name, columns[:, :, i : i + 1]) for i, name in enumerate(numbers))
    for name in by:
        if name.startswith("body:"):
            blocks[name] = run_on(*state.body_columns(name.removeprefix("body:")), refreshed(state))
    return np.concatenate([blocks[name] for name in by], axis=2)


def check_names(problem: Problem, by: Sequence[str], known: Sequence[str]) -> None:
    """Refuses names that are not `known`, nor those of bodies around the cable."""
    if not by:
        raise ArgumentError.of("by", by, "it must name something", f"Known: {', '.join(known)}.")
    for name in by:
        if name not in known:
            scene = () if problem.scene is None else problem.scene.obstacles
            bodies = dict.fromkeys(f"body:{body.name}" for body in (*scene, *problem.bodies))
            if name not in bodies:
                remedy = f"Known: {', '.join((*known, *bodies))}."
                raise ArgumentError.of("by", name, "the shape knows no derivative by it", remedy)
        if by.count(name) > 1:
            raise ArgumentError.of("by", name, "it must be named once", "Leave it out where it comes again.")


def about_gripper(end: Grip, block: Array) -> None:
    """Changes columns (n, 3, 6) about the cable's end into those about the gripper's origin."""
    # v_cable = v_gripper + w x arm
    x, y, z = end.cable_frame.position - end.pose.position
    block[:, :, 3:] += block[:, :, :3] @ np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))


def _moved(state: Solved, knots: list[int]) -> Array:
    """(n, 3, 6 g): change of the positions with the poses of knots."""
    points, columns = state.problem.points, 6 * len(knots)
    out, df = np.empty((state.sampled, 3, columns)), np.empty((len(state.rings), columns))
    if knots:
        slides = refreshed(state)
        which = state.knots_of(knots)
        respond.sensitivities(state.ints, state.floats, state.sols, state.work, points, which, out, df)
        run_on(out, df, slides)
    return out[state.rows]


def refreshed(state: Solved) -> tuple[Array, Array] | None:
    """Factors the matrix; of a cable in eyelets also what moves their arc lengths, see `Network.pulls`."""
    state.refresh()
    if len(state.rings) == 0:
        return None
    _, J, slid = state.pulls(state.problem.points)
    return J, slid


def run_on(out: Array, df: Array, slides: tuple[Array, Array] | None) -> Array:
    """Adds to columns (n, 3, m) what the cable runs through its eyelets, whose pull they change by df (e, m)."""
    if slides is not None:
        J, slid = slides
        out -= np.einsum("pik,kc->pic", slid, np.linalg.solve(J, df))
    return out


def pair_of(cable: Cable, name: str) -> tuple[tuple[Cable, Cable], float]:
    """Two cables that differ in one of NUMBERS, and half by how much."""
    if name == "bending_stiffness":
        mean = cable.mean_bending_stiffness
        pair = [[(1.0 + sign * _NEAR) * x for x in cable.bending_stiffness] for sign in (1.0, -1.0)]
        return (cable.replace(bending_stiffness=pair[0]), cable.replace(bending_stiffness=pair[1])), _NEAR * mean
    value = getattr(cable, name)
    if name == "length" and cable.sections:
        step = _NEAR * value
        return (changed(cable, length=value + step), changed(cable, length=value - step)), step
    step = _LIGHT if value == 0.0 else _NEAR * value
    low = max(value - step, 0.0)
    high = value + step
    return (cable.replace(**{name: high}), cable.replace(**{name: low})), 0.5 * (high - low)
