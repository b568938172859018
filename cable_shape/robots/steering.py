"""A task and limits for mink that steer the cable, beside mink's own: they import mink and MuJoCo.

    held = HeldCable(Predictor(cable), robot)
    configuration = held.configuration()
    middle = CablePointTask(held, 0.5 * cable.length)
    middle.set_target((0.5, 0.0, 0.2))
    limits = [mink.ConfigurationLimit(held.model), CableChordLimit(held), CableClearanceLimit(held, scene)]
    velocity = mink.solve_ik(configuration, [middle, posture], dt, solver="daqp", limits=limits)

Each is linear in the joints' velocities at the present configuration, as everything in differential inverse kinematics:
keep the steps short, with ``mink.VelocityLimit`` or a small dt.
"""

from __future__ import annotations

from typing import NamedTuple, final

import mink
import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.harness import split_end
from cable_shape.cable.pieces import widest
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.predictor import Predictor
from cable_shape.robots.held_cable import Held, HeldCable
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.safety.report import BodyDistance, WarningKind
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape

__all__ = ["CableChordLimit", "CableClearanceLimit", "CableLoadLimit", "CablePointTask", "Held", "HeldCable"]

#: The part of what is left to a bound that one step may use up.
_GAIN = 0.85
#: The chord stays below this part of the cable's length.
_MOST_CHORD = 0.98
#: A load counts from this part of its limit on.
_NEAR = 0.9
#: rad or m, of predictions beside another: far above what they are solved to.
_BESIDE = 1e-3
_PIECES = 10  # of the cable, each of whose worst places counts


@final
class CablePointTask(mink.Task):
    """Brings one point of the centreline to a place.

    Parameters
    ----------
    held : HeldCable
    arc_length : float
        [m], of the point, from 0 to the length of the cable, or of the segment.
    segment : str
        Of a harness: on which the point is.
    cost : float or (3,) array_like
        1/m, of the error along the world's axes; 0 leaves an axis free.
    gain : float
        The part of the error that one step should take away, above 0 and at most 1.
    lm_damping : float
        As for mink's tasks.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    def __init__(
        self,
        held: HeldCable,
        arc_length: float,
        *,
        segment: str = "",
        cost: ArrayLike = 1.0,
        gain: float = 1.0,
        lm_damping: float = 0.0,
    ) -> None:
        weights = checks.vector("cost", np.broadcast_to(np.asarray(cost, dtype=np.float64), (3,)), 3, "1/m")
        if (weights < 0.0).any():
            raise ArgumentError.of("cost", weights.tolist(), "it must be at least 0 1/m", "Give weights of 0 or more.")
        damping = checks.number("lm_damping", lm_damping, at_least=0.0)
        super().__init__(weights, _part("gain", gain), damping)
        if segment not in held.parts:
            known = ", ".join(held.parts)
            bound = f"the harness has the segments {known}" if known else "a cable has none"
            raise ArgumentError.of("segment", segment, bound, "Name one of a harness, none of a cable.")
        length = held.parts[segment].length
        self.held, self.arc_length = held, checks.number("arc_length", arc_length, at_least=0.0, unit="m")
        self.segment = segment
        if self.arc_length > length:
            raise ArgumentError.of(
                "arc_length", self.arc_length, f"it must be at most the cable's length, {length:g} m", "Choose a point."
            )
        self.target: Array | None = None

    def set_target(self, place: ArrayLike) -> None:
        """Where the point should be, (3,) [m], world."""
        self.target = checks.vector("place", place, 3, "m")

    def set_target_from_configuration(self, configuration: mink.Configuration) -> None:
        """The point should stay where it is."""
        self.target = self._point(configuration)[0]

    def compute_error(self, configuration: mink.Configuration) -> Array:
        """(3,) [m], from the target to the point, world."""
        if self.target is None:
            raise ArgumentError(
                "target = None is not allowed: it says where the point should be. Call set_target first."
            )
        error: Array = self._point(configuration)[0] - self.target
        return error

    def _point(self, configuration: mink.Configuration) -> tuple[Array, Array]:
        return self.held.point(self.held.at(configuration), self.arc_length, self.segment)

    def compute_jacobian(self, configuration: mink.Configuration) -> Array:
        """(3, nv), of the error."""
        return self._point(configuration)[1]


@final
class CableClearanceLimit(mink.Limit):
    """Keeps the cable's surface further than a bound from every obstacle and link of the robot.

    A step uses up at most a part of what is left to the bound, to first order; where the cable is nearer, as after a
    step that was too long, the limit asks for its return, and ``mink.solve_ik`` raises NoSolutionFound if other limits
    do not allow it. A link that grips the cable counts beyond 0.05 m of its ends only.

    Parameters
    ----------
    held : HeldCable
    scene : Scene
        Its obstacles; those with a `link` move with the robot, as the robot's own links do.
    minimum : float, optional
        [m], the bound. Default: the scene's `warn_distance`.
    gain : float
        The part of what is left that one step may use up, above 0 and at most 1.
    horizon : float, optional
        [m], bodies further away set no limit. Default: three times the bound, at least 0.1 m.
    """

    def __init__(
        self,
        held: HeldCable,
        scene: Scene,
        *,
        minimum: float | None = None,
        gain: float = _GAIN,
        horizon: float | None = None,
    ) -> None:
        self.held = held
        self.minimum = checks.number("minimum", scene.warn_distance if minimum is None else minimum, unit="m")
        self.gain = _part("gain", gain)
        robot = held.robot
        held_parts = {split_end(end)[0] for end in held.grips} or {""}
        self._checkers = {
            name: ClearanceChecker(
                Scene(obstacles=scene.obstacles, warn_distance=max(self.minimum, 0.0), error_distance=0.0),
                radius=0.5 * widest(cable),
                robot_links=robot.link_geometry,
                gripping_links=robot.gripping_links if name in held_parts else (),
                horizon=horizon,
            )
            for name, cable in held.parts.items()
        }
        self._links = {body.name: body.link for body in (*scene.obstacles, *robot.link_geometry)}

    def distances(self, configuration: mink.Configuration) -> tuple[tuple[BodyDistance, ...], Array]:
        """The bodies within the horizon, for each segment of a harness, and the Jacobian (k, nv) of their distances."""
        held = self.held.at(configuration)
        near = {name: one.check(held.part(name)[0], held.links).bodies for name, one in self._checkers.items()}
        rows = [self._slope(held, body, name) for name, bodies in near.items() for body in bodies]
        every = tuple(body for bodies in near.values() for body in bodies)
        return every, np.array(rows).reshape(-1, self.held.model.nv)

    def _slope(self, held: Held, body: BodyDistance, part: str) -> Array:
        """(nv,): at the closest points, along the line between them; that these slide is of second order."""
        shape, jacobian = held.part(part)
        places = shape.arc_length
        i = min(int(body.arc_length / places[1]), len(places) - 2)
        x = body.arc_length / places[1] - i
        centre = (1.0 - x) * shape.positions[i] + x * shape.positions[i + 1]
        moves: Array = (1.0 - x) * jacobian[i] + x * jacobian[i + 1]
        link = self._links[body.body]
        if link is not None:
            moves = moves - self.held.point_on(link, body.point_on_body)
        apart = centre - body.point_on_body
        inside = body.distance + self._checkers[part].radius < 0.0
        normal: Array = apart / ((-1.0 if inside else 1.0) * max(float(np.linalg.norm(apart)), 1e-12))
        return normal @ moves

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> mink.Constraint:
        """-d distance <= gain (distance - minimum), a row a body."""
        bodies, jacobian = self.distances(configuration)
        if not bodies:
            return mink.Constraint()
        left = np.array([body.distance for body in bodies]) - self.minimum
        return mink.Constraint(G=-jacobian, h=self.gain * left)


@final
class CableChordLimit(mink.Limit):
    """Keeps the chord between the cable's ends below a part of its length, so that no step pulls it taut; of a harness
    that between the gripped ends below a part of the shortest way along segments.

    Parameters
    ----------
    held : HeldCable
    most : float
        Chord over length, above 0 and at most 1.
    gain : float
        The part of what is left that one step may use up, above 0 and at most 1.
    """

    def __init__(self, held: HeldCable, *, most: float = _MOST_CHORD, gain: float = _GAIN) -> None:
        self.held, self.most, self.gain = held, _part("most", most), _part("gain", gain)
        predictor = held.predictor
        if isinstance(predictor, HarnessPredictor):
            self._length = predictor.harness.way(*held.grips)
            self._ends = [(name, 0 if side == "start" else -1) for name, side in map(split_end, held.grips)]
        else:
            self._length, self._ends = predictor.cable.length, [("", 0), ("", -1)]

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> mink.Constraint:
        """d chord <= gain (most length - chord)."""
        held = self.held.at(configuration)
        (near, at), (far, to) = ((held.part(name), row) for name, row in self._ends)
        across = far[0].positions[to] - near[0].positions[at]
        chord = float(np.linalg.norm(across))
        if chord == 0.0 or self._length == np.inf:
            return mink.Constraint()
        row = across / chord @ (far[1][to] - near[1][at])
        left = self.most * self._length - chord
        return mink.Constraint(G=row[None], h=np.array([self.gain * left]))


class Load(NamedTuple):
    """How much a shape uses of a limit at each of its points."""

    kind: WarningKind
    limit: float
    used: Array  # (points,), 1 at the limit


@final
class CableLoadLimit(mink.Limit):
    """Keeps a cable's tension, bend radius and twist rate within its limits; one with sections has no rows here.

    Of what is used by more than a part, at the worst place of each piece of the cable, a step uses up at most a part of
    what is left, to first order: how it answers the joints is found from predictions beside the last, one for each
    joint. Loads are those of the prediction, whatever was seen.

    Parameters
    ----------
    held : HeldCable
        Of a cable.
    near : float
        The part of a limit from which on it counts, above 0 and at most 1.
    gain : float
        The part of what is left that one step may use up, above 0 and at most 1.
    """

    def __init__(self, held: HeldCable, *, near: float = _NEAR, gain: float = _GAIN) -> None:
        if not isinstance(held.predictor, Predictor):
            raise ArgumentError("held of a harness is not allowed: loads are those of one cable. Hold a cable.")
        self.held, self.near, self.gain = held, _part("near", near), _part("gain", gain)
        self._predictor = held.predictor

    def loads(self, shape: CableShape) -> list[Load]:
        """Of each limit that the cable has."""
        cable, found = self._predictor.cable, []
        if cable.sections:
            return []
        if cable.max_tension is not None:
            found.append(Load(WarningKind.TENSION, cable.max_tension, shape.tension / cable.max_tension))
        if cable.min_bend_radius is not None:
            used = cable.min_bend_radius * np.hypot(shape.curvature[:, 0], shape.curvature[:, 1])
            found.append(Load(WarningKind.BEND_RADIUS, cable.min_bend_radius, used))
        if cable.max_twist_rate is not None:
            used = np.abs(shape.curvature[:, 2]) / cable.max_twist_rate
            found.append(Load(WarningKind.TWIST_RATE, cable.max_twist_rate, used))
        return found

    def near_limit(self, configuration: mink.Configuration) -> list[tuple[int, int, str]]:
        """Those that count now: which of the loads, at which point, and in words."""
        shape = self.held.predicted(configuration).part()[0]
        pieces = np.array_split(np.arange(shape.points), min(_PIECES, shape.points))
        out = []
        for which, load in enumerate(self.loads(shape)):
            for piece in pieces:
                row = int(piece[np.argmax(load.used[piece])])
                if load.used[row] > self.near:
                    where = f"{load.kind.name} at {shape.arc_length[row]:.3g} m"
                    out.append((which, row, f"{where} would be beyond its limit, {load.limit:.3g}"))
        return out

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> mink.Constraint:
        """d used <= gain (1 - used), a row each."""
        near = self.near_limit(configuration)
        if not near:
            return mink.Constraint()
        held, robot = self.held.predicted(configuration), self.held.robot
        used = self._used(held.part()[0], near)
        rows = np.zeros((len(near), self.held.model.nv))
        for joint in np.flatnonzero(robot.carrying):
            q = held.q.copy()
            q[joint] += _BESIDE
            beside = self._used(self._predictor.ahead()(*robot.grips(q)), near)
            rows[:, self.held.velocities[joint]] = (beside - used) / _BESIDE
        robot.update(held.q)
        return mink.Constraint(G=rows, h=self.gain * (1.0 - used))

    def _used(self, shape: CableShape, near: list[tuple[int, int, str]]) -> Array:
        loads = self.loads(shape)
        return np.array([loads[which].used[row] for which, row, _ in near])


def _part(name: str, value: float) -> float:
    part = checks.number(name, value, above=0.0)
    if part > 1.0:
        raise ArgumentError.of(name, part, "it must be at most 1", "Give a part, above 0 and at most 1.")
    return part
