"""The cable as it swings: :class:`Motion`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from time import perf_counter
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.motion import meeting
from cable_shape.motion.among import Among, Lying, without_eyelets
from cable_shape.motion.common import MODEL, Traced, check_moves, enough, failed, steps_ahead, work_of
from cable_shape.motion.finer import FINEST, MANY, MOST, WIDE, drawn_coarsely, going_on, sampled
from cable_shape.motion.run import Run
from cable_shape.motion.swing import Swing, load_of, spread_evenly
from cable_shape.motion.tangents import NUMBERS, RATE, Number, Pair, Tangents, Ways, check_begun, number_of, traced
from cable_shape.pose import NOT_GIVEN, FreeEnd, Grip, Pose, both_given
from cable_shape.scene.mesh_parts import divided
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.scene.scene_parts import clip_names
from cable_shape.shape import CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.answers import ENDS, check_names
from cable_shape.solve.network import Network
from cable_shape.solve.outcome import no_room
from cable_shape.solve.problem import GRAVITY, Problem
from cable_shape.solve.seen import seen_of
from cable_shape.solve.touching import touching


@final
class Motion(Traced):
    """A cable that swings: its shape from step to step, inertia included.

    The rod of :mod:`cable_shape.solve.cosserat` with mass, retardation and drag (docs/motion.md): implicit steps of
    any size, of second order in time and of fourth in the length of the elements.

    Parameters
    ----------
    cable : Cable or Harness
        Its linear density is above 0; `retardation_time` and `drag` damp it. A harness makes a
        :class:`cable_shape.motion.harness_motion.HarnessMotion`.
    scene : Scene, optional
        Clips hold the cable, in eyelets it runs; masses load it and have inertia. With ``contact="solve"`` obstacles
        keep it out and hold it by their friction.
    gravity : (3,) array_like
        [m/s^2], world.
    points : int
        Number of points of the shapes, uniform in arc length.
    robot_links, gripping_links
        As of :class:`cable_shape.Predictor`: bodies on links, which keep the cable out as obstacles do, and links that
        hold it, which do not.
    distributed_load : (2, 3) array_like, optional
        [N/m], as of :class:`cable_shape.Predictor`: dead, beside the weight. Of a harness by segment.
    elements : int, optional
        Of the whole cable, of equal length; at least four between two supports. Default: 20, or as many more as the
        boundary layers sqrt(EI / |n|) of a limp cable, or its twist, ask for when it begins, up to 400; twice and four
        times as many, up to 200, from where the first ones beside a grip or a clip turn too far in a step.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    def __new__(cls, cable: Any, *arguments: Any, **keywords: Any) -> Any:
        """A :class:`HarnessMotion` for a harness."""
        if not isinstance(cable, Harness):
            return super().__new__(cls)
        from cable_shape.motion.harness_motion import HarnessMotion

        return HarnessMotion(cable, *arguments, **keywords)

    def __init__(
        self,
        cable: Cable | Harness,
        scene: Scene | None = None,
        gravity: ArrayLike = GRAVITY,
        points: int = 150,
        elements: int | None = None,
        *,
        robot_links: Iterable[Obstacle] = (),
        gripping_links: Iterable[str] = (),
        distributed_load: ArrayLike | None = None,
    ) -> None:
        if not isinstance(cable, Cable):
            raise ArgumentError.of("cable", cable, "it must be a Cable or a Harness", "Write Cable(length=..., ...).")
        options: dict[str, Any] = {"gravity": gravity, "points": points, "distributed_load": distributed_load}
        options |= {"robot_links": tuple(robot_links), "gripping_links": tuple(gripping_links)}
        self._still = Problem(cable, scene=scene, friction=False, **options)
        self.problem = Problem(cable, scene=without_eyelets(scene), **options)
        self.elements = None if elements is None else checks.integer("elements", elements, at_least=4, at_most=2000)
        check_moves(cable)
        divided(self._still.bodies)
        self._state: Network | None = None
        self._swing: Swing | None = None
        self._last: CableShape | None = None
        self._links: Mapping[str, Pose] | None = None
        self._error, self._usual = 0.0, 0  # elements where it began
        self._tangents: Tangents | None = None

    @property
    def cable(self) -> Cable:
        """The cable, as given."""
        return self.problem.cable

    @property
    def held(self) -> dict[str, Grip | FreeEnd]:
        """The ends, as they are now."""
        return {"start": self.problem.start, "end": self.problem.end}

    @property
    def knots(self) -> tuple[dict[str, int], int]:
        """What holds the cable, by name, and which knot it is; and how many there are."""
        names = ["start", *(f"clip:{name}" for name in clip_names(self.problem.clips)), "end"]
        return {name: knot for knot, name in enumerate(names)}, len(names)

    @property
    def unrest(self) -> float:
        """[N], what inertia and drag of all of the cable take after the last step; 0 before it has begun."""
        return 0.0 if self._swing is None else self._swing.unrest

    @property
    def last(self) -> CableShape:
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
        start: Pose | Grip,
        end: Pose | Grip | FreeEnd | None = NOT_GIVEN,
        arc_length: ArrayLike | None = None,
        points: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        links: Mapping[str, Pose] | None = None,
        *,
        by: Sequence[str] = (),
        at: str = "cable",
    ) -> CableShape:
        """Starts at rest between these ends, or as the cable is seen; returns that shape.

        Where its status says no, there is nothing to step.

        Parameters
        ----------
        start, end : Pose or Grip
            `end` may be a FreeEnd; None is a free end without load.
        arc_length : (k,) array_like, optional
            [m], where on the cable the points are, ascending; without it their distances share the length.
        points : (k, 3) array_like, optional
            [m], world, on the cable, at the instant at which the ends are here.
        velocity : (k, 3) array_like, optional
            [m/s], world, of the points.
        links : mapping, optional
            Poses in the world of the links that carry clips, and bodies which are solved for; None: those are left out.
        by : names, each once
            What `sensitivity` is to tell from now on, carried along with every step. "start", "end" and "clip:NAME":
            six columns, by so much the pose is another in all steps, position [m] and rotation [rad], world axes, about
            that cable end (with ``at="gripper"`` about the gripper's own origin) or the origin of the clip's pose;
            "velocity:start", "velocity:end": six, what its velocity and angular velocity are more, from now on.
            "length", "linear_density", "bending_stiffness" (the mean of both, which keep their ratio),
            "twisting_stiffness", "retardation_time" and "drag": one each, per unit.

        Raises
        ------
        ArgumentError
            For wrong arguments; for `by` beside `points`.
        """
        both_given("begin(start, end)", end)
        checks.one_of("at", at, ("cable", "gripper"))
        by = checks.entries("by", (by,) if isinstance(by, str) else by, str, "Write ('start', 'drag'), for example.")
        began = perf_counter()
        self._swing = self._last = self._tangents = None
        problem = self.problem.move(start, end, links)
        if by:
            check_names(problem, by, self._known())
        seen = None
        if points is not None:
            seen = seen_of(problem.start, problem.end, self.cable.length, arc_length, points, velocity)
        elif arc_length is not None or velocity is not None:
            raise ArgumentError("arc_length and velocity are those of points, and there are none. Give points (k, 3).")
        state = Network(problem)
        shape = cosserat.solve(problem, state)
        if not shape.status:
            return shape
        lying = None
        if self._touches:
            shape = lying = meeting.lying(self._still.move(start, end, links))
            if not lying.status:
                return lying
        self._usual = self.elements or enough(shape, self.cable)
        spread_evenly(state, self._usual)
        among = self._among(shape, start, end, links)
        swing = Swing(load_of(problem), state, among, None if lying is None else Lying.of(lying))
        if not swing.alive:
            return failed(shape, Status.NOT_CONVERGED, "The cable does not come to rest on the mesh of its motion. ")
        if by:
            check_begun(seen is not None)
        self._state, self._swing, self._links = state, swing, links
        out, rates = self._buffers()
        swing.tell(out, rates)
        self._error = float(np.abs(out[problem.points : 4 * problem.points].reshape(-1, 3) - shape.positions).max())
        if seen is not None:
            if not swing.draw_to(seen):
                drawn = drawn_coarsely(problem, swing, shape, seen, self._among)
                if drawn is None:
                    self._swing = self._state = None
                    return failed(shape, Status.NOT_CONVERGED, "The cable could not be drawn to the points. ")
                self._state, self._swing = drawn
            self._swing.tell(out, rates)
        status = Status.OK if seen is not None else shape.status
        self._last = self._shape(out, rates, began, status, "" if seen is not None else shape.detail)
        if by:
            ways = Ways(by, *self.knots, lambda: self.held, about_gripper=at == "gripper")
            pairs = {ways.at[name]: number_of(self.cable, name) for name in by if name in NUMBERS}
            self.trace(pairs, ways)
        return self._last

    def take_up(
        self,
        shape: CableShape,
        start: Pose | Grip,
        end: Pose | Grip | FreeEnd | None = NOT_GIVEN,
        links: Mapping[str, Pose] | None = None,
        *,
        left_by: Motion | None = None,
    ) -> CableShape:
        """Goes on from a shape of this cable, with its velocity, that another motion has left; returns that.

        What holds and touches the cable now may be elsewhere than what did: it gets there in the next step. How fast
        bends change, which retardation feels, and what accelerates it are not told by a shape: that is 0 at first.

        Parameters
        ----------
        shape : CableShape
            Of another :class:`Motion`; one at rest has no velocity.
        start, end, links
            As of `begin`; they are to be near to the ends of the shape.
        left_by : Motion, optional
            Which the shape is the last one of: where cable and mesh are the same nothing is lost.

        Raises
        ------
        ArgumentError
            For wrong arguments, and a shape of another length, or of fewer than 8 points.
        """
        both_given("take_up(shape, start, end)", end)
        checks.instance("shape", shape, (CableShape,), "Give that of another Motion.")
        self._swing = self._last = self._tangents = None
        self._usual = self.elements or enough(shape, self.cable)
        found = going_on(self.problem.move(start, end, links), shape, self._usual, self._among)
        if found is None:
            bound = f"it must be usable, of {self.cable.length:g} m, and have some points"
            raise ArgumentError.of("shape", shape, bound, "Give the last one of a motion of this cable.")
        state, swing = found
        if left_by is not None and left_by._swing is not None and left_by.cable == self.cable:
            swing.go_on_as(left_by._swing)
        self._state, self._swing, self._links = state, swing, links
        self._last, self._error = shape, max(0.0, shape.error_estimate)  # 0 if it is not known
        return shape

    def step(
        self,
        start: Pose | Grip,
        end: Pose | Grip | FreeEnd | None,
        dt: float,
        links: Mapping[str, Pose] | None = None,
    ) -> CableShape:
        """The cable dt [s] later, when its ends have come here; never raises for a physical reason: look at `status`.

        Between the last ends and these they move in a straight line, and so do links; without `links` those
        stay. OVERSTRETCHED, and NOT_CONVERGED where not even shorter steps do, or a grip or clip would be inside a
        body: the state is kept as it was, and the shape is the last one.

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
        held = self.problem.start, self.problem.end
        kinds, links = self._kinds(), self._links if links is None else dict(links)
        problem = self.problem.move(start, end, links)
        if self._kinds() != kinds:
            ends = f"{kinds[0]} and {kinds[1]}"
            raise ArgumentError.of("ends", self._kinds(), f"they were {ends} at begin", "Hold them so, or begin again.")
        poses = state.aim(problem.start, problem.end)
        taut = no_room(problem, state, poses)
        if taut is not None:
            return failed(last, Status.OVERSTRETCHED, taut[2].split(". ")[0] + ". The state is kept. ", taut[3])
        if isinstance(problem.end, FreeEnd):
            swing.load_end(problem.end, problem.end_fall)
        if swing.among is not None:
            if self._still.clips_move:
                self._still.move(start, end, links)
            swing.among.move(links, self._still.clip_frames)
            buried = swing.among.buried(poses)
            if buried is not None:
                knot, gap, body = buried
                words = touching.inside(*self._support(knot), gap, body)
                return failed(last, Status.NOT_CONVERGED, words + "The state is kept. ")
        place, frame = last.positions[-1], last.quaternions[-1]
        out, velocity = self._buffers()
        if not swing.step(poses, dt, out, velocity):
            finer = self._refined(*held)
            if finer:
                self._state, self._swing = finer
                shape = self.step(start, end, dt, links)
                if shape.status:
                    return shape
                self._state, self._swing = state, swing
            self.problem.move(start, end, links)
            return failed(last, Status.NOT_CONVERGED, "A step could not be taken. The state is kept. ")
        if self._tangents is not None:
            self._tangents.follow(poses, dt)
        shape = self._shape(out, velocity, began, Status.OK, "")
        shape.work += work_of(held[1], problem.end, shape, place, frame)
        lost = shape.work - shape.dissipated
        lost -= shape.energy + shape.kinetic_energy - last.energy - last.kinetic_energy
        shape.lost = lost
        self._last, self._links = shape, links
        if swing.among is None and shape.iterations > MANY and swing.widest_turn > WIDE:
            self._state, self._swing = self._refined(problem.start, problem.end) or (state, swing)
        return shape

    def _refined(self, start: Grip, end: Grip | FreeEnd) -> tuple[Network, Swing] | None:
        """The state between these ends, where it is, on elements half as long; None: there are enough, or as many as
        were asked for, or derivatives are carried along."""
        swing, last = self._swing, self._last
        assert swing is not None
        assert last is not None
        count, problem = 2 * swing.model.h.size, self.problem.move(start, end, self._links)
        if self.elements is not None or count > min(FINEST * self._usual, MOST) or self._tangents is not None:
            return None
        found = going_on(problem, sampled(swing, last, count), count, self._among)
        if found is not None:
            found[1].accelerate_as(swing)
        return found

    def trace(self, pairs: Mapping[int, Pair], moves: Callable[[float], Array]) -> None:
        """Has `sensitivity` tell p columns from now on, the motion having just begun at rest.

        pairs: of columns along which the cable changes, two cables above and below, half their distance and a scale.
        moves: (p, k, 6) of the time [s] since, how the start, the clips and the end move, world, about the cable.

        Raises
        ------
        ArgumentError
            As `begin` for its `by`.
        """
        swing, state = self._swing, self._state
        if swing is None or state is None:
            raise ArgumentError("trace() needs a motion at rest, and there is none. Call begin first.")
        numbers = {}
        for column, (cables, step, scale) in pairs.items():
            above, below = (load_of(self.problem.beside(cable)) for cable in cables)
            numbers[column] = Number(state.models_beside(cables), (above, below), step, scale)
        self._tangents = Tangents(swing, numbers, moves)

    def sensitivity(self, of: str = "positions") -> Array:
        """(points, 3, m): how the last shape would be another, d positions / d (by), columns in the order of `begin`'s.

        Exact but for rounding, between nodes of the cubic through them. Points keep their share of the length. Columns
        of a free end, and of rotations that a grip or clip leaves free, are zero. In contact what touches, sticks and
        slips is held as it is, see `breaks`.

        Parameters
        ----------
        of : "positions" or "velocity"
            Of which it is.

        Raises
        ------
        ArgumentError
            Where `begin` was given no names.
        """
        checks.one_of("of", of, ("positions", "velocity"))
        return traced(self._tangents).columns(of == "velocity")

    def run(self, starts: ArrayLike, ends: ArrayLike | None, steps: ArrayLike, twists: ArrayLike | None = None) -> Run:
        """Many steps at once, for what needs the centreline alone: the last of them leaves no shape to step from.

        Where `begin` was given names, or twists are, the run has their derivative.

        Parameters
        ----------
        starts, ends : (T, 7) array_like
            Position [m] and quaternion x, y, z, w of the cable frames after each step, grasp offsets included; ends of
            a free end: None.
        steps : (T,) array_like
            [s].
        twists : (T, 2, 6, m) array_like, optional
            In m directions: by so much start and end are elsewhere after each step, position [m] and rotation [rad],
            world axes, about the cable's end.

        Raises
        ------
        ArgumentError
            Before `begin`, and for wrong arguments.
        """
        swing, state = self._swing, self._state
        if swing is None or state is None:
            raise ArgumentError("run() needs a state to step from, and there is none. Call begin first.")
        dt = checks.numbers("steps", steps, "Give them in s.").ravel()
        if not (np.isfinite(dt).all() and (dt > 0.0).all()):
            raise ArgumentError.of("steps", dt.tolist(), "each must be above 0 s", "Leave out frames of one time.")
        goals = np.repeat(state.aim(self.problem.start, self.problem.end)[None], len(dt), axis=0)
        goals[:, 0] = checks.numbers("starts", starts, "Give (T, 7).").reshape(len(dt), 7)
        last = starts if ends is None else ends
        goals[:, -1] = checks.numbers("ends", last, "Give (T, 7).").reshape(len(dt), 7)
        self._last = None
        if twists is None and self._tangents is None:
            return Run(swing.model.s.copy(), *swing.run(goals, dt))
        moves = np.zeros((len(dt), goals.shape[1], 6, 0))
        if twists is not None:
            ways = checks.numbers("twists", twists, "Give (T, 2, 6, m).").reshape(len(dt), 2, 6, -1)
            moves = np.zeros((len(dt), goals.shape[1], 6, ways.shape[3]))
            moves[:, 0], moves[:, -1] = ways[:, 0], 0.0 if isinstance(self.problem.end, FreeEnd) else ways[:, 1]
        if self._tangents is None:
            self._tangents = Tangents(swing, {}, Ways((), *self.knots, lambda: self.held, about_gripper=False))
        return self._tangents.run(goals, dt, moves)

    def ahead(self, count: int, dt: float) -> list[CableShape]:
        """So many steps dt [s] on, with the ends held where they are now; the state stays as it is.

        Fewer where a step cannot be taken.

        Raises
        ------
        ArgumentError
            Before `begin`.
        """
        last, (start, end) = self._last, (self.problem.start, self.problem.end)
        state, swing, tangents, self._tangents = self._state, self._swing, self._tangents, None
        found = steps_ahead(swing, count, lambda: self.step(start, end, dt))
        self._last, self._state, self._swing, self._tangents = last, state, swing, tangents
        return found

    def _known(self) -> tuple[str, ...]:
        """Names of derivatives."""
        return (*self.knots[0], *(RATE + side for side in ENDS), *NUMBERS)

    @property
    def _touches(self) -> bool:
        """Whether there are bodies that are solved for, or eyelets, or the cable touches itself."""
        eyelets = len(self._still.clips) > len(self.problem.clips)
        return bool(self.problem.bodies) or eyelets or self._still.solves_crossing

    def _among(
        self, shape: CableShape, start: Pose | Grip, end: Pose | Grip | FreeEnd | None, links: Mapping[str, Pose] | None
    ) -> partial[Among] | None:
        """What makes them known to a network whose shape this is."""
        if not self._touches:
            return None
        still = self._still.move(start, end, links)
        eyelets = [(i, 0) for i, clip in enumerate(still.clips) if clip.kind == "slide"]
        return partial(Among, still, [self.cable], eyelets, shape.supports)

    def _buffers(self) -> tuple[Array, Array]:
        """For a shape, and its velocity."""
        n = self.problem.points
        return CableShape.new_buffer(n), np.empty((n, 3))

    def _supports(self, swing: Swing) -> Array:
        """(k, 7), of each clip: arc length [m], force [N] and moment [N m] on it."""
        clips = self._still.clips
        out, knots = np.zeros((len(clips), 7)), iter(swing.memory.reaction[1:])
        for row, clip in zip(out, clips, strict=True):
            if clip.kind != "slide":
                row[0], row[1:] = clip.arc_length, -next(knots)
        if swing.among is not None:
            swing.among.tell_eyelets(out)
        return out

    def _support(self, knot: int) -> tuple[str, str]:
        """What a knot is, and its name."""
        held = [i for i, clip in enumerate(self._still.clips) if clip.kind != "slide"]
        if 0 < knot <= len(held):
            return "clip", f"clips[{held[knot - 1]}]"
        return "grip", "start grip" if knot == 0 else "end grip"

    def _kinds(self) -> tuple[str, str, float]:
        """How the ends are held, and the mass of a plug."""
        end = self.problem.end
        if isinstance(end, FreeEnd):
            return self.problem.start.kind, "free", end.mass
        return self.problem.start.kind, end.kind, 0.0

    def _shape(self, out: Array, velocity: Array, began: float, status: Status, detail: str) -> CableShape:
        """The shape after the last step."""
        swing = self._swing
        assert swing is not None
        end = self.problem.end
        info, touches = swing.info, swing.touches()
        energy = swing.energy
        if isinstance(end, FreeEnd):
            n = self.problem.points
            energy += float(end.force @ out[4 * n - 3 : 4 * n])
        return CableShape(
            out,
            self.problem.points,
            length=self.cable.length,
            model=MODEL,
            status=status,
            detail=detail,
            energy=energy,
            error_estimate=self._error + float(swing.told[1]) + swing.depth + swing.deviation(touches),
            iterations=int(info[0]),
            solve_time=perf_counter() - began,
            turns=swing.turns,
            twist=float(swing.told[0]),
            velocity=velocity,
            kinetic_energy=swing.kinetic_energy,
            work=float(info[2]),
            dissipated=float(info[3]),
            supports=self._supports(swing),
            touches=touches,
            bodies=() if swing.among is None else swing.among.names,
        )


_MADE_FROM = inspect.signature(Motion.__init__)
_MADE_FROM = _MADE_FROM.replace(parameters=list(_MADE_FROM.parameters.values())[1:])
Motion.__signature__ = _MADE_FROM  # type: ignore[attr-defined]  # not that of __new__
