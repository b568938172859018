"""The harness as it swings: :class:`HarnessMotion`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from time import perf_counter
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.kernels.network import tables
from cable_shape.motion.among import Among, Lying, without_eyelets
from cable_shape.motion.common import MODEL, Traced, check_moves, enough, failed, steps_ahead, work_of
from cable_shape.motion.meeting import harness_lying
from cable_shape.motion.swing import FEWEST, Load, Swing
from cable_shape.motion.tangents import NUMBERS, RATE, Number, Tangents, Ways, number_of, traced
from cable_shape.pose import FreeEnd, Grip, Pose, one_mapping
from cable_shape.scene.mesh_parts import divided
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.shape import NUMBERS_PER_POINT, Status
from cable_shape.solve import harness_search
from cable_shape.solve.harness_answers import differences
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_outcome import out_of_reach
from cable_shape.solve.harness_problem import End, HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.problem import GRAVITY
from cable_shape.solve.touching import harness_solve, touching
from cable_shape.solve.touching.harness_state import HarnessTouchState, Laid


@final
class HarnessMotion(Traced):
    """A harness that swings; what ``Motion(harness)`` makes. Parameters are those of Motion but for these.

    harness : Harness
        Every segment has a linear density and a bending stiffness above 0.
    scene : Scene, optional
        Clips, eyelets among them, and masses name their `segment`.
    points, elements : int
        Of each segment.
    name : str, optional
        Of the harness: contacts of segments with each other then are with "name/segment".
    called : mapping of segment to str, optional
        What they are with instead, where there is no name.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    def __init__(
        self,
        harness: Harness,
        scene: Scene | None = None,
        gravity: ArrayLike = GRAVITY,
        points: int = 150,
        elements: int | None = None,
        *,
        robot_links: Iterable[Obstacle] = (),
        gripping_links: Iterable[str] = (),
        distributed_load: Mapping[str, ArrayLike] | None = None,
        name: str = "",
        called: Mapping[str, str] | None = None,
    ) -> None:
        segments = getattr(harness, "segments", ())
        self._called = [f"{name}/{segment}" if name else (called or {}).get(segment, segment) for segment in segments]
        options: dict[str, Any] = {"gravity": gravity, "points": points, "distributed_load": distributed_load}
        options |= {"robot_links": tuple(robot_links), "gripping_links": tuple(gripping_links)}
        self._still = HarnessProblem(harness, scene=scene, friction=False, **options)
        self.problem = HarnessProblem(harness, scene=without_eyelets(scene), **options)
        self.elements = None if elements is None else checks.integer("elements", elements, at_least=4, at_most=2000)
        for name, cable in harness.segments.items():
            try:
                check_moves(cable)
            except ArgumentError as error:
                raise ArgumentError(f"segment {name!r}: {error}") from None
        divided(self._still.bodies)
        order, clips = list(harness.segments), () if scene is None else scene.clips
        rows = ((i, clip.segment) for i, clip in enumerate(clips) if clip.kind == "slide")
        self._eyelets = [(i, order.index(name)) for i, name in rows if name is not None]
        self._state: HarnessNetwork | None = None
        self._swing: Swing | None = None
        self._last: HarnessShape | None = None
        self._links: Mapping[str, Pose] | None = None
        self._error = 0.0
        self._loose: list[int] = []  # knots that nothing holds
        self._tangents: Tangents | None = None

    @property
    def harness(self) -> Harness:
        """The harness, as given."""
        return self.problem.harness

    @property
    def held(self) -> dict[str, Grip | FreeEnd]:
        """The ends, as they are now."""
        return dict(self.problem.ends)

    @property
    def knots(self) -> tuple[dict[str, int], int]:
        """What holds the harness, by name, and which knot it is; and how many there are."""
        state = self._state
        assert state is not None
        knots = {name: state.layout.knots["end", name] for name in self.problem.ends}
        clips = zip(self.problem.clip_names, state.clip_rows, strict=True)
        return knots | {f"clip:{name}": row for name, row in clips}, int(state.ints[tables.N_KNOTS])

    @property
    def last(self) -> HarnessShape:
        """The last shape.

        Raises
        ------
        ArgumentError
            Before `begin`.
        """
        if self._last is None:
            raise ArgumentError("there is no last shape. Call begin first.")
        return self._last

    def begin(
        self,
        ends: Mapping[str, End],
        *more: object,
        links: Mapping[str, Pose] | None = None,
        by: Sequence[str] = (),
        at: str = "cable",
    ) -> HarnessShape:
        """Starts at rest between these ends; returns that shape. Where its status says no, there is nothing to step.

        Parameters
        ----------
        ends : mapping of open end to Pose, Grip or FreeEnd
            As of `HarnessPredictor.predict`.
        *more
            None: the ends of a harness are one mapping.
        links : mapping, optional
            As there.
        by : names, each once
            What `sensitivity` is to tell, see `Motion.begin`: open ends, "a.start", and "velocity:a.start",
            "clip:NAME"; "length:a" of segment a, and so the other numbers.
        at : "cable" or "gripper"
            As there.

        Raises
        ------
        ArgumentError
            As there.
        """
        one_mapping(ends, more)
        checks.one_of("at", at, ("cable", "gripper"))
        by = checks.entries("by", (by,) if isinstance(by, str) else by, str, "Write ('a.start', 'drag:a').")
        began = perf_counter()
        self._swing = self._last = self._tangents = None
        problem = self.problem.move(ends, links)
        if by:
            self._check_names(by)
        among = lying = None
        if self._touches:
            shape = harness_lying(self._still.move(ends, links))
        else:
            shape, state = harness_search.solve(problem)
        if not shape.status:
            return shape
        if self._touches:
            state, among, lying = self._lay(shape)
        self._spread_evenly(state, shape)
        swing = Swing(self._load(state), state, among, lying)
        if not swing.alive:
            detail = "The harness does not come to rest on the mesh of its motion. "
            return failed(shape, Status.NOT_CONVERGED, detail)
        self._take(state, swing, links)
        out, rates = self._buffers()
        swing.tell(out, rates)
        self._last = self._shape(out, rates, began, shape.status, shape.detail)
        pairs = zip(self._last.segments.values(), shape.segments.values(), strict=True)
        self._error = max(float(np.abs(a.positions - b.positions).max()) for a, b in pairs)
        self._last.error_estimate += self._error
        if by:
            ways = Ways(by, *self.knots, lambda: self.held, about_gripper=at == "gripper")
            self._tangents = Tangents(swing, self._numbers(state, ways.at), ways)
        return self._last

    def take_up(
        self,
        shape: HarnessShape,
        ends: Mapping[str, End],
        links: Mapping[str, Pose] | None = None,
        *,
        left_by: HarnessMotion | None = None,
    ) -> HarnessShape:
        """Goes on from a shape of this harness that another motion has left, see `Motion.take_up`; returns that.

        Raises
        ------
        ArgumentError
            For wrong arguments, and a shape of a harness with other segments.
        """
        checks.instance("shape", shape, (HarnessShape,), "Give that of another motion.")
        if not shape.status or {n: one.length for n, one in shape.segments.items()} != {
            n: one.length for n, one in self.harness.segments.items()
        }:
            bound = "it must be usable, and of this harness"
            raise ArgumentError.of("shape", shape, bound, "Give the last one of a motion of this harness.")
        self._swing = self._last = self._tangents = None
        self.problem.move(ends, links)
        self._still.move(ends, links)
        state, among, lying = self._lay(shape)
        self._spread_evenly(state, shape)
        swing = Swing(self._load(state), state, among if self._touches else None, lying, goes_on=True)
        if left_by is not None and left_by._swing is not None and left_by.harness == self.harness:
            swing.go_on_as(left_by._swing)
        self._take(state, swing, links)
        self._last, self._error = shape, max(0.0, shape.error_estimate)  # 0 if it is not known
        return shape

    @property
    def _touches(self) -> bool:
        """Whether there are bodies that are solved for, or eyelets, or segments touch each other."""
        return bool(self.problem.bodies or self._eyelets or self._still.solves_crossing)

    def _take(self, state: HarnessNetwork, swing: Swing, links: Mapping[str, Pose] | None) -> None:
        """Makes this what is stepped."""
        self._state, self._swing, self._links = state, swing, links
        held = {*(row for row, _ in state._held), *state.clip_rows}
        self._loose = [row for row in range(len(swing.solution.pose)) if row not in held]

    def _lay(self, lying: HarnessShape) -> tuple[HarnessNetwork, partial[Among], Lying]:
        """The network without eyelets as the harness lies, and what is known of bodies and eyelets."""
        touch = HarnessTouchState(self.problem)  # type: ignore[arg-type]
        knots, whole, state = touch.knots_at(lying, touch.aimed()), Laid(lying, touch.gaps), touch.cable
        state.resume_from(whole, touch.gaps, knots)
        cables = [*self.harness.segments.values(), *(None for _ in state.layout.levers)]
        among = partial(Among, self._still, cables, self._eyelets, lying.supports, names=self._called)
        return state, among, Lying.of(whole, touch.gaps, lying.velocity)

    def step(self, ends: Mapping[str, End], dt: float, links: Mapping[str, Pose] | None = None) -> HarnessShape:
        """The harness dt [s] later, when its ends have come here, see `Motion.step`.

        Raises
        ------
        ArgumentError
            For wrong arguments, before `begin`, and for ends that are held in another way than there.
        """
        began = perf_counter()
        dt = checks.number("dt", dt, above=0.0, unit="s")
        swing, state, last = self._swing, self._state, self._last
        if swing is None or state is None or last is None:
            raise ArgumentError("step() needs a state to step from, and there is none. Call begin first.")
        before, kinds, links = dict(self.problem.ends), self._kinds(), self._links if links is None else dict(links)
        problem = self.problem.move(ends, links)
        if self._kinds() != kinds:
            remedy = "Hold them so, or begin again."
            raise ArgumentError.of("ends", self._kinds(), f"they were {kinds} at begin", remedy)
        poses = self._aim(state, swing)
        taut = out_of_reach(problem, state, poses)
        if taut is not None:
            return failed(last, Status.OVERSTRETCHED, taut[2].split(". ")[0] + ". The state is kept. ", taut[3])
        for knot, end, fall in self._tips(state):
            swing.load_end(end, fall, knot)
        if swing.among is not None:
            if self._still.clips_move:
                self._still.move(ends, links)
            swing.among.move(links, self._still.clip_frames)
            buried = swing.among.buried(poses)
            if buried is not None:
                knot, gap, body = buried
                support = harness_solve.support_of(state.layout.knots, self._still.clip_names, knot)
                words = touching.inside(*support, gap, body)
                return failed(last, Status.NOT_CONVERGED, words + "The state is kept. ")
        out, velocity = self._buffers()
        if not swing.step(poses, dt, out, velocity):
            return failed(last, Status.NOT_CONVERGED, "A step could not be taken. The state is kept. ")
        if self._tangents is not None:
            self._tangents.follow(poses, dt)
        shape = self._shape(out, velocity, began, Status.OK, "")
        for name, now in problem.ends.items():
            if isinstance(now, FreeEnd):
                segment, _, side = name.rpartition(".")
                one, k = last.segments[segment], 0 if side == "start" else -1
                place, frame = one.positions[k], one.quaternions[k]
                shape.work += work_of(before[name], now, shape.segments[segment], place, frame, k)
        shape.lost = shape.work - shape.dissipated
        shape.lost -= shape.energy + shape.kinetic_energy - last.energy - last.kinetic_energy
        self._last, self._links = shape, links
        return shape

    def ahead(self, count: int, dt: float) -> list[HarnessShape]:
        """So many steps dt [s] on, with the ends held where they are now, see `Motion.ahead`.

        Raises
        ------
        ArgumentError
            Before `begin`.
        """
        last, ends = self._last, dict(self.problem.ends)
        tangents, self._tangents = self._tangents, None
        found = steps_ahead(self._swing, count, lambda: self.step(ends, dt))
        self._last, self._tangents = last, tangents
        return found

    def sensitivity(self, of: str = "positions") -> dict[str, Array]:
        """{segment: (points, 3, m)}: see `Motion.sensitivity`.

        Raises
        ------
        ArgumentError
            As there.
        """
        checks.one_of("of", of, ("positions", "velocity"))
        columns, n = traced(self._tangents).columns(of == "velocity"), self.problem.points
        return {name: columns[i * n : (i + 1) * n] for i, name in enumerate(self.harness.segments)}

    def trace(self, moves: Callable[[float], Array]) -> None:
        """Has `sensitivity` tell p columns from now on, see `Motion.trace`.

        Raises
        ------
        ArgumentError
            As there.
        """
        if self._swing is None:
            raise ArgumentError("trace() needs a motion at rest, and there is none. Call begin first.")
        self._tangents = Tangents(self._swing, {}, moves)

    def _check_names(self, names: Sequence[str]) -> None:
        """Refuses names that mean nothing here."""
        ends = list(self.problem.ends)
        known = [*ends, *(RATE + name for name in ends), *(f"clip:{name}" for name in self.problem.clip_names)]
        known += [f"{kind}:{segment}" for kind in NUMBERS for segment in self.harness.segments]
        for name in names:
            if name not in known:
                raise UnknownKeyError.among("by", name, known)
            if names.count(name) > 1:
                raise ArgumentError.of("by", name, "it must be named once", "Leave it out where it comes again.")

    def _numbers(self, state: HarnessNetwork, at: Mapping[str, int]) -> dict[int, Number]:
        """What names of numbers say, by their columns."""
        found = {}
        for name, column in at.items():
            kind, _, segment = name.partition(":")
            if kind not in NUMBERS:
                continue
            cables, step, scale = number_of(self.harness.segments[segment], kind)
            pair = self.problem.beside(segment, cables[0]), self.problem.beside(segment, cables[1])
            models = state.models_beside(*differences(self.problem, pair))
            loads = [self._load(state, problem) for problem in pair]
            found[column] = Number(models, (loads[0], loads[1]), step, scale)
        return found

    def _aim(self, state: HarnessNetwork, swing: Swing) -> Array:
        """Poses of the knots: those that are held where they are to be, the others as they are."""
        poses = state.aim()
        poses[self._loose] = swing.solution.pose[self._loose]
        return poses

    def _spread_evenly(self, state: HarnessNetwork, shape: HarnessShape) -> None:
        """Lays the solution out on elements of equal length in every segment; levers are one each."""
        arcs, counts = state.layout.arcs, []
        for name, spans in state.layout.spans.items():
            cable = self.harness.segments[name]
            wanted = self.elements or enough(shape.segments[name], cable)
            for j in spans:
                share = (arcs[j, 1] - arcs[j, 0]) / cable.length
                counts.append(max(FEWEST, round(wanted * share)))
        counts += [1] * len(state.layout.levers)
        state.lay_out([(np.array((a, b)), np.ones(2)) for a, b in arcs.tolist()], counts)

    def _load(self, state: HarnessNetwork, problem: HarnessProblem | None = None) -> Load:
        """What it has for mass; or what that of a problem beside has."""
        harness = self.harness if problem is None else problem.harness
        cables = [*harness.segments.values(), *(None for _ in state.layout.levers)]
        masses = [(knot, mass) for knot, mass, _ in state.layout.at_masses]
        return Load(self.problem.points, cables, [], masses, self._tips(state))

    def _tips(self, state: HarnessNetwork) -> list[tuple[int, FreeEnd, Array]]:
        """Knots of free ends, what loads them, and what weighs there."""
        found = []
        for knot, name in state._tips:
            end = self.problem.ends[name]
            assert isinstance(end, FreeEnd)
            found.append((knot, end, self.problem.fall(name)))
        return found

    def _buffers(self) -> tuple[Array, Array]:
        """For a shape, and its velocity; levers are the last cables."""
        assert self._state is not None
        points = self.problem.points * self._state.cables
        return np.empty(NUMBERS_PER_POINT * points), np.empty((points, 3))

    def _kinds(self) -> dict[str, str | float]:
        """How the ends are held, or the mass of a plug."""
        return {name: end.kind if isinstance(end, Grip) else end.mass for name, end in self.problem.ends.items()}

    def _shape(self, out: Array, velocity: Array, began: float, status: Status, detail: str) -> HarnessShape:
        """The shape after the last step."""
        swing, state, problem = self._swing, self._state, self.problem
        assert swing is not None
        assert state is not None
        info, n, c = swing.info, problem.points, len(self.harness.segments)
        touches = [swing.touches(i) for i in range(c)]
        off = max(map(swing.deviation, touches), default=0.0)
        shape = HarnessShape(
            self.harness, out[: NUMBERS_PER_POINT * n * c], n, model=MODEL, status=status, detail=detail,
            twists=swing.told[: 2 * c : 2],
            error_estimate=self._error + float(swing.told[1 : 2 * c : 2].max()) + swing.depth + off,
            iterations=int(info[0]), solve_time=perf_counter() - began,
            clips=self._supports(swing, state), clips_of=self._still.clips, velocity=velocity[: n * c],
            kinetic_energy=swing.kinetic_energy, work=float(info[2]), dissipated=float(info[3]),
            touches=touches,
            bodies=() if swing.among is None else swing.among.names,
        )  # fmt: skip
        shape.energy = swing.energy
        for name, end in problem.ends.items():
            if isinstance(end, FreeEnd):
                segment, _, side = name.rpartition(".")
                shape.energy += float(end.force @ shape.segments[segment].positions[0 if side == "start" else -1])
        return shape

    def _supports(self, swing: Swing, state: HarnessNetwork) -> Array:
        """(k, 7), of each of the scene's clips: arc length [m], force [N] and moment [N m] on it."""
        clips = () if self._still.scene is None else self._still.scene.clips
        out, rows = np.zeros((len(clips), 7)), iter(state.clip_rows)
        for row, clip in zip(out, clips, strict=True):
            if clip.kind != "slide":
                row[0], row[1:] = clip.arc_length, -swing.memory.reaction[next(rows)]
        if swing.among is not None:
            swing.among.tell_eyelets(out)
        return out
