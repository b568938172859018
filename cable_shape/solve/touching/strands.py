"""What may touch each other, as one list of strands: several cables (:class:`Cables`), or the segments of a harness.

A strand is a cable with a name; its ends are held by grips, free, or in junctions. What solves for strands as if they
did not touch are solos: one a cable, one for all of a harness (:class:`.harness_strands.HarnessStrands`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import energy_of_sections
from cable_shape.checks import Array
from cable_shape.kernels.contact import drive
from cable_shape.kernels.network.tables import NOW
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.scene.body_tables import carried_by, clip_frames, link_rows
from cable_shape.shape import NUMBERS_PER_POINT, CableShape
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import MODEL
from cable_shape.solve.touching.harness_state import HarnessTouchState
from cable_shape.solve.touching.spot import Pair
from cable_shape.solve.touching.told import Told

_SAME = 1e-3  #: of the length: a shape found alone is the one that has come free, if it is no further away


class Strands(Protocol):
    """Strands, and what solves for them alone.

    Frames (n, 7) are those of the ends of all strands in turn, and of the links that carry bodies or clips, where they
    are known; of an end that no grip holds anything.
    """

    names: tuple[str, ...]
    cables: list[Cable]  #: what each is

    @property
    def gravity(self) -> Array:
        """(3,) [m/s^2]."""

    def free(self, strand: int) -> tuple[bool, bool]:
        """Whether nothing is at its start, at its end."""

    def gripped(self, strand: int) -> tuple[bool, bool]:
        """Whether a grip holds its start, its end."""

    def held_at(self, strand: int) -> list[float]:
        """[m], arc lengths of its clips, ascending."""

    def joined(self, pair: Pair) -> Array:
        """(2, 2) [m]: so much cable from an end of the first to one of the second tells nothing of contact; 0: any."""

    def hung_together(self, strands: Iterable[int]) -> list[int]:
        """Those of which the network is that has these, ascending."""

    def kinds(self) -> list[tuple[str, str]]:
        """How their ends are held."""

    def frames(self) -> Array:
        """Those of now."""

    def hold(self, frames: Array) -> None:
        """Moves ends and links there."""

    def given(self) -> Any:
        """What `give_back` takes to have ends and links where they are now."""

    def give_back(self, given: Any) -> None:
        """See `given`."""

    def renewed(self) -> bool:
        """Whether their problems are others than when this was asked last: they are under other loads."""

    def network(self, strands: Sequence[int]) -> HarnessProblem:
        """What is solved for these; each is the segment `key`."""

    def key(self, strand: int) -> str:
        """Its name in networks."""

    def follow(self, network: HarnessProblem, strands: Sequence[int]) -> None:
        """Puts the network's ends and links where they are now."""

    def poses(self, state: HarnessTouchState, strands: Sequence[int], frames: Array) -> Array:
        """(k, 7), of the knots of the network of these strands, with ends and links in `frames`."""

    def start(self, strands: Sequence[int], shapes: Sequence[CableShape] | Mapping[int, CableShape]) -> Any:
        """The shapes of these, by their numbers, as that of their network, see `HarnessTouchState.start_from`."""

    def shapes(self, told: Told) -> list[CableShape]:
        """Those of the strands of an equilibrium."""

    def alone(self, held: Collection[int]) -> list[CableShape | None]:
        """The shapes that they have whatever they touch; None of those that are held."""

    def accept(self, shapes: Sequence[CableShape]) -> None:
        """Tells that these shapes are the last equilibrium."""

    def go_on_from(self, strands: Collection[int], shapes: Sequence[CableShape], frames: Array) -> None:
        """Makes these shapes, between ends in `frames`, the last ones of what solves for these alone."""

    def comes_free(self, strands: Collection[int], shapes: Sequence[CableShape], frames: Array) -> bool:
        """Whether these have their shapes alone, too."""


class Solo(Protocol):
    """What solves for one cable as if there were no other."""

    problem: Problem  #: moved to the ends before every solve; may be another one, of the same cable under other loads

    def alone(self) -> CableShape:
        """The shape between the problem's ends."""

    def go_on_from(self, shape: CableShape, frames: Array, links: Array) -> None:
        """Makes a shape between the ends `frames` (2, 7) the last solution, if there are bodies it may lie on.

        links (m, 7): where the links were then that carry bodies; m = 0: not known, or there are none.
        """

    def twin(self) -> Solo:
        """Once more: it goes on from the last shape, and this one stays as it is."""


@final
class Shapes:
    """Shapes of several cables as what a harness's shape holds of its segments."""

    def __init__(self, shapes: Sequence[CableShape]) -> None:
        self.points = shapes[0].points
        self.buffer: Array = np.concatenate([shape.buffer for shape in shapes])
        self.bodies = tuple(dict.fromkeys(name for shape in shapes for name in shape.bodies))
        self.touches = [shape.touches.copy() for shape in shapes]
        for shape, rows in zip(shapes, self.touches, strict=True):
            rows[:, 1] = [self.bodies.index(shape.bodies[int(body)]) for body in rows[:, 1]]
        self.turns = np.array([shape.turns for shape in shapes])


@final
class Cables:
    """Cables that no junction joins; `names` and `solos` are theirs."""

    def __init__(self, names: Sequence[str], solos: Sequence[Solo]) -> None:
        self.names, self.solos = tuple(names), list(solos)
        self.problems = [solo.problem for solo in solos]
        self.cables = [problem.cable for problem in self.problems]

    @property
    def gravity(self) -> Array:
        """See `Strands`."""
        return self.problems[0].gravity

    def free(self, strand: int) -> tuple[bool, bool]:
        """See `Strands`."""
        return False, isinstance(self.problems[strand].end, FreeEnd)

    def gripped(self, strand: int) -> tuple[bool, bool]:
        """See `Strands`."""
        return True, isinstance(self.problems[strand].end, Grip)

    def held_at(self, strand: int) -> list[float]:
        """See `Strands`."""
        return [clip.arc_length for clip in self.problems[strand].clips]

    def joined(self, pair: Pair) -> Array:
        """See `Strands`."""
        return np.zeros((2, 2))

    def hung_together(self, strands: Iterable[int]) -> list[int]:
        """See `Strands`."""
        return sorted(set(strands))

    def kinds(self) -> list[tuple[str, str]]:
        """See `Strands`."""
        return [(problem.start.kind, getattr(problem.end, "kind", "free")) for problem in self.problems]

    def frames(self) -> Array:
        """See `Strands`."""
        problems = self.problems
        links, carried = problems[0].links, self._carried if problems[0].links is not None else {}
        frames = np.empty((2 * len(problems) + len(carried), 7))
        for i, problem in enumerate(problems):
            start, end = problem.start.cable_frame.array, problem.end
            frames[2 * i] = start
            frames[2 * i + 1] = start if isinstance(end, FreeEnd) else end.cable_frame.array
        if links is not None and carried:
            frames[2 * len(problems) :] = link_rows(links, carried)
        return frames

    def hold(self, frames: Array) -> None:
        """See `Strands`."""
        links = dict(zip(self._carried, map(Pose.trusted, frames[2 * len(self.problems) :]), strict=False))
        for i, problem in enumerate(self.problems):
            start, end = (at_frame(grip, frames[2 * i + j]) for j, grip in enumerate((problem.start, problem.end)))
            assert isinstance(start, Grip)
            problem.move(start, end, None if problem.links is None else {**problem.links, **links})

    def given(self) -> Any:
        """See `Strands`."""
        return [(problem.start, problem.end, problem.links) for problem in self.problems]

    def give_back(self, given: Any) -> None:
        """See `Strands`."""
        for problem, ends in zip(self.problems, given, strict=True):
            problem.move(*ends)

    def renewed(self) -> bool:
        """See `Strands`."""
        now = [solo.problem for solo in self.solos]
        changed = any(one is not problem for one, problem in zip(now, self.problems, strict=True))
        self.problems[:] = now
        return changed

    def network(self, strands: Sequence[int]) -> HarnessProblem:
        """See `Strands`."""
        return HarnessProblem.of_cables(self._of(strands))

    def key(self, strand: int) -> str:
        """See `Strands`."""
        return f"c{strand}"

    def follow(self, network: HarnessProblem, strands: Sequence[int]) -> None:
        """See `Strands`."""
        network.follow(self._of(strands))

    def poses(self, state: HarnessTouchState, strands: Sequence[int], frames: Array) -> Array:
        """See `Strands`."""
        out, knots = state.aimed(), state.cable.layout.knots
        if state.problem.clips_move:
            links, carried = frames[2 * len(self.problems) :], self._carried
            placed = [clip_frames(self.problems[i].clips, links, carried) for i in strands]
            out[state.cable.clip_rows] = np.concatenate(placed)
        for strand in strands:
            for side, end in enumerate(("start", "end")):
                if type(getattr(self.problems[strand], end)) is Grip:
                    out[knots["end", f"{self.key(strand)}.{end}"]] = frames[2 * strand + side]
        return out

    def start(self, strands: Sequence[int], shapes: Sequence[CableShape] | Mapping[int, CableShape]) -> Any:
        """See `Strands`."""
        return Shapes([shapes[i] for i in strands])

    def shapes(self, told: Told) -> list[CableShape]:
        """See `Strands`."""
        state = told.state
        turned, count = state.info[drive.INFO :], len(state.gaps)
        bodies, touches = told.touches(self.names, self.cables)
        out = []
        for row, cable in enumerate(told.cables):
            problem = self.problems[cable]
            n = problem.points
            size = NUMBERS_PER_POINT * n
            buffer = told.buffer[row * size : (row + 1) * size].copy()
            for side, at in ((problem.start, n), (problem.end, 4 * n - 3)):
                if type(side) is Grip and at > n:
                    buffer[at : at + 3] = side.cable_frame.position
            shape = CableShape(
                buffer,
                n,
                length=problem.cable.length,
                model=MODEL,
                status=told.status,
                detail=told.detail,
                energy=float(turned[2 * count + row]) + _energy_of_masses(problem, buffer),
                error_estimate=told.error_estimate,
                residual=float(state.info[drive.I_RESIDUAL]),
                iterations=told.iterations,
                turns=int(state.turns[NOW, row]),
                twist=float(turned[2 * row]),
                solve_time=told.solve_time,
                supports=told.loads[state.problem.clips[self.key(cable)]],
                touches=touches[row],
                bodies=bodies,
                frictionless=state.has_friction,
            )
            shape.energy += energy_of_sections(problem.cable, shape, problem.gravity)
            out.append(shape)
        return out

    def alone(self, held: Collection[int]) -> list[CableShape | None]:
        """See `Strands`."""
        return [solo.alone() if i not in held else None for i, solo in enumerate(self.solos)]

    def accept(self, shapes: Sequence[CableShape]) -> None:
        """See `Strands`: that needs nothing."""

    def go_on_from(self, strands: Collection[int], shapes: Sequence[CableShape], frames: Array) -> None:
        """See `Strands`."""
        links = frames[2 * len(self.problems) :]
        order = list(self._carried) if len(links) else []
        for i in strands:
            own = links[[order.index(name) for name in self.problems[i].carried]] if order else links
            self.solos[i].go_on_from(shapes[i], frames[2 * i : 2 * i + 2], own)

    def comes_free(self, strands: Collection[int], shapes: Sequence[CableShape], frames: Array) -> bool:
        """See `Strands`."""
        for i in strands:
            self.go_on_from((i,), shapes, frames)
            if not same_shape(self.solos[i].alone(), shapes[i]):
                return False
        return True

    def twin(self) -> Cables:
        """Once more: they go on from the last shapes, and these stay as they are."""
        return Cables(self.names, [solo.twin() for solo in self.solos])

    def higher(self, given: Cables, level: dict[int, int], way: Array) -> None:
        """Holds them so many times a way (3,) [m] off where `given` are."""
        for i, (problem, one) in enumerate(zip(self.problems, given.problems, strict=True)):
            by = level.get(i, 0) * way
            start, end = (_lifted(grip, by) if isinstance(grip, Grip) else grip for grip in (one.start, one.end))
            assert isinstance(start, Grip)
            problem.move(start, end, one.links)

    def _of(self, strands: Sequence[int]) -> dict[str, Problem]:
        """The problems of these, by their names in networks."""
        return {self.key(i): self.problems[i] for i in strands}

    @property
    def _carried(self) -> dict[str, str]:
        """The links that carry bodies, and those that carry clips of any of these cables."""
        if len(self.problems) == 1:
            return self.problems[0].carried
        clips = [replace(clip, name=None) for one in self.problems for clip in one.clips]
        return carried_by(self.problems[0].bodies, clips)


def _energy_of_masses(problem: Problem, buffer: Array) -> float:
    """[J], potential energy of a cable's point masses and plug."""
    n = problem.points
    arcs, places = buffer[:n], buffer[n : 4 * n].reshape(n, 3)
    masses = [(mass.mass, mass.arc_length) for mass in problem.masses]
    if isinstance(problem.end, FreeEnd):
        masses.append((problem.end.mass, problem.cable.length))
    out = 0.0
    for mass, arc in masses:
        at = np.array([np.interp(arc, arcs, x) for x in places.T])
        out -= mass * float(problem.gravity @ at)
    return out


def same_shape(alone: CableShape, shape: CableShape) -> bool:
    """Whether a shape found alone is this one."""
    if not alone.status:
        return False
    return bool(np.abs(alone.positions - shape.positions).max() <= _SAME * shape.length)


def _lifted(grip: Grip, way: Array) -> Grip:
    """The grip, moved by `way` (3,) [m]."""
    pose = grip.pose
    return grip.at(Pose(pose.position + way, pose.quaternion))


def at_frame(grip: Grip | FreeEnd, frame: Array) -> Grip | FreeEnd:
    """The grip where it holds its cable by this frame (7,)."""
    if not isinstance(grip, Grip):
        return grip
    return grip.at(Pose.trusted(frame, grip.pose.turns) * grip.offset.inverse())
