"""The straight road: gripper poses -> ends -> predictor -> shape -> clearance -> report.

One :class:`Cycle` is called by the node, the bag replayer and the tests alike. It knows no ROS, no file and no viewer.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any, final

from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.cycle.cable_cycle import CableCycle, CableCycles, refuse_acceleration
from cable_shape.cycle.dynamic import DYNAMIC, MOTIONS, QUASISTATIC
from cable_shape.cycle.editing import Editing, Part
from cable_shape.cycle.given import BY_NAME, loads_of, look_of, named_ones, opened_end, opened_ends, uncertainties_of
from cable_shape.cycle.harness_cycle import HarnessCycle, HarnessCycles, beside_each_other
from cable_shape.cycle.looking_ahead import Together
from cable_shape.cycle.seen import AsSeen
from cable_shape.cycle.swinging import Swinging, step_on
from cable_shape.cycle.told import beside
from cable_shape.errors import ArgumentError
from cable_shape.pose import Ends, Pose
from cable_shape.prediction.cables_predictor import accelerate, check_ends, check_models
from cable_shape.prediction.edits import EDITS, Edit, EditResult
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.layout import Layout
from cable_shape.prediction.together import joined, told_of
from cable_shape.safety.near import CableNear
from cable_shape.safety.report import CycleReport
from cable_shape.scene.plug import Plug
from cable_shape.scene.scene import Clip, Obstacle, Scene
from cable_shape.shape import CableShape
from cable_shape.solve.problem import GRAVITY
from cable_shape.solve.quasistatic import LIMIT
from cable_shape.solve.touching.crossing import Crossing
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty


@final
class Cycle:
    """One control cycle for one or more cables.

    Parameters
    ----------
    cables : Cable, or mapping of name to Cable or Harness
        A single cable is named "cable". Segments of a harness "h" are "h/a" in clearance, margins, warnings, tubes
        and contacts; it has no plug.
    scene : Scene, optional
    robot_links : sequence of Obstacle
        Collision geometry of the robot, each with its `link` set (see ``Robot.link_geometry``).
    gripping_links : sequence of str
        Links that hold the cable; contact with them near the grips is neither solved for nor reported.
    model, gravity, points, tolerance
        As for :func:`cable_shape.predict`.
    tails : mapping of cable name to mapping of "start" and "end" to a length [m], optional
        What hangs beyond the grips, in place of the cable's own `tails`.
    plugs : mapping of cable name to Plug, optional
        In place of the scene's `plug`.
    clips : mapping of cable name to sequence of Clip, optional
        What holds that cable, in place of the scene's `clips`, which hold every cable.
    distributed_load : (2, 3) array_like or mapping of cable name to (2, 3) array_like, optional
        [N/m], world, at s = 0 and s = length, linear between, added to the weight; one for all cables, or each its own.
    time_budget : float, optional
        [s], of one prediction, see :class:`cable_shape.Predictor`.
    snap_horizon : float
        [s], where stability may be lost within this time at the present gripper speed, the snap is predicted; 0: never.
    quasistatic_limit : float
        Of the ratio of the cable's inertial load, as the grips move, to its weight, beyond which it is warned that the
        prediction leaves the inertia out; 0: never.
    uncertainty : Uncertainty or mapping of cable name to Uncertainty, optional
        Makes a tube about every shape (`report.tubes`, `report.tail_tubes`); clearance is that of the tube then, and
        margins and warnings of it, too.
    motion : str
        "quasistatic": at rest in every instant; "dynamic": as it swings (:class:`cable_shape.Motion`), in steps of the
        stamps, with the swing in shapes, clearance, loads and warnings; a late input is bridged along the straight way,
        with a warning, and after a second without one the cable begins anew, at rest. With ``contact="solve"`` bodies
        keep cables and harnesses out, and, without eyelets, those of one `grips` each other; then none has an
        `uncertainty`. Stability and snaps are not told.
    look_ahead : float
        [s], with motion="dynamic": how far to look where each cable swings if its grips stop now (`report.ahead`, and
        a warning where that is too near to something); 0: not at all.
    """

    def __init__(
        self,
        cables: Cable | Mapping[str, Cable | Harness],
        *,
        scene: Scene | None = None,
        robot_links: Sequence[Obstacle] = (),
        gripping_links: Sequence[str] = (),
        model: str = "auto",
        gravity: ArrayLike = GRAVITY,
        points: int = 150,
        tolerance: float | None = None,
        tails: Mapping[str, Mapping[str, float]] | None = None,
        plugs: Mapping[str, Plug] | None = None,
        clips: Mapping[str, Sequence[Clip]] | None = None,
        snap_horizon: float = 1.0,
        distributed_load: ArrayLike | Mapping[str, ArrayLike] | None = None,
        time_budget: float | None = None,
        quasistatic_limit: float = LIMIT,
        uncertainty: Uncertainty | Mapping[str, Uncertainty] | None = None,
        motion: str = QUASISTATIC,
        look_ahead: float = 0.0,
    ) -> None:
        named, harnesses = named_ones(cables)
        if scene is not None:
            checks.instance("scene", scene, (Scene,), "Write Scene(obstacles=[...]), or Scene.from_yaml(path).")
        robot_links = checks.entries("robot_links", robot_links, Obstacle)
        gripping_links = checks.entries("gripping_links", gripping_links, str, "Give a list of link names.")
        for name, lengths in checks.mapping("tails", tails, named, BY_NAME).items():
            named[name] = named[name].replace(tails=lengths)
        own_plugs = checks.mapping("plugs", plugs, named, BY_NAME)
        every = (*named, *harnesses)
        own_clips = checks.mapping("clips", clips, every, BY_NAME)
        loads = loads_of(distributed_load, named, every)
        horizon = checks.number("snap_horizon", snap_horizon, at_least=0.0, unit="s")
        ratio = checks.number("quasistatic_limit", quasistatic_limit, at_least=0.0)
        checks.one_of("motion", motion, MOTIONS)
        look, known = look_of(look_ahead, motion), uncertainties_of(uncertainty, every)
        self._named = named
        self._scene = scene or Scene()
        options: dict[str, Any] = {
            "gravity": gravity,
            "points": points,
            "time_budget": time_budget,
            "robot_links": robot_links,
            "gripping_links": gripping_links,
        }
        self._bodies = {"robot_links": robot_links, "gripping_links": gripping_links}
        limit = ratio if ratio > 0.0 else None
        self._maker = CableCycles(
            model, tolerance, options, loads, own_plugs, known, horizon, limit, len(named), motion, look
        )
        self._cables = {}
        for name, cable in named.items():
            own = dataclasses.replace(self.scene, clips=own_clips[name]) if name in own_clips else self.scene
            self._cables[name] = self._maker.make(name, cable, own, loads.get(name))
        self._layout: Layout | None = None  # from the first edit on
        keywords = {"model": model, "gravity": gravity, "points": points, "tolerance": tolerance}
        self._harness_maker = HarnessCycles(
            robot_links, gripping_links, {**keywords, "time_budget": time_budget}, loads, horizon, limit, known,
            motion, look,
        )  # fmt: skip
        self._harnesses: dict[str, HarnessCycle] = {}
        self._joined: set[frozenset[str]] = set()
        for name, harness in harnesses.items():
            own = dataclasses.replace(self.scene, clips=own_clips[name]) if name in own_clips else self.scene
            self._harnesses[name] = self._harness_maker.make(name, harness, own, loads.get(name))
            self._joined |= beside_each_other(name, harness)
        self._crossing: tuple[tuple[str, ...], Crossing] | None = None
        self._ahead: Together | None = None  # of that
        self._swinging: Swinging | None = None  # those that touch each other as they swing
        self._look_about()
        if self._solves_crossing:
            together: dict[str, Part] = {**self._cables, **self._harnesses}
            check_models({name: together[name].predictor.solo for name in self._beside}, self.scene)
        self.last_stamp: int | None = None

    @property
    def cables(self) -> dict[str, Cable]:
        """By name, as they are between the grips; `edit` changes them."""
        return self._named

    @property
    def parts(self) -> dict[str, Cable]:
        """The cables, and the segments of harnesses, by what clearance, margins and warnings call them."""
        return self._parts

    @property
    def scene(self) -> Scene:
        """As it is now: its bodies, and the clips and masses that every cable has; `edit` changes it."""
        return self._scene

    @scene.setter
    def scene(self, scene: Scene) -> None:
        raise ArgumentError(
            "scene of a Cycle cannot be exchanged: what is known of it is worked out once. Change it by "
            "edit(Add(...), ...), or make another one, Cycle(cables, scene=scene); its first step starts afresh."
        )

    @property
    def scenes(self) -> dict[str, Scene]:
        """What holds and surrounds each cable now, by name."""
        return {name: cable.scene for name, cable in self._cables.items()}

    def edit(self, *edits: Edit, cable: str | None = None, stamp: int | None = None) -> EditResult:
        """Changes cables, clips and bodies, all of these edits in their order or none; each cable goes on from there.

        A cable keeps its place between bodies, clips and other cables: what is moved takes it along on the straight
        way, what lets go of it lets it slide to where it comes to rest. The next `step` tells its shape. What swings
        goes on from where it is, with its velocity.

        Parameters
        ----------
        *edits : Add, Remove, Move, Insert, Release, Regrip, Open, SetCable
        cable : str, optional
            Whose clips, grips and numbers are meant. Of several cables it must be named, but for bodies, and for
            `Move`, `Release` and `Remove` of a clip, which then is that of every cable in it. Of a harness clips and
            masses name their `segment`, `Regrip` and `Open` the end, "a.start"; or it is one segment of it, "h/a", as
            it must be for `SetCable`.
        stamp : int, optional
            [ns], when it happens; older inputs are refused from then on. Default: at the last step.

        Returns
        -------
        EditResult
            Not `done`, with the `reason`, where an edit cannot be or the cable cannot follow it. Nothing has changed
            then, to the bit.

        Raises
        ------
        StaleInputError
            If `stamp` is older than that of the last step.
        ArgumentError
            For what is no edit, and where motion="dynamic" comes with an uncertainty.
        """
        for i, edit in enumerate(edits):
            checks.instance(f"edits[{i}]", edit, EDITS, "Write Add(Obstacle(...)), Release(name), ...")
        if stamp is not None:
            stamp = checks.stamp(stamp, self.last_stamp)
        if self._maker.motion == DYNAMIC and any(self._maker.uncertainty.values()):
            bound = "how well a shape is known depends on all of its motion, which an edit would change"
            raise ArgumentError.of("edits", f"{len(edits)} edits", bound, "Leave the uncertainty out.")
        parts: dict[str, Part] = {**self._cables, **self._harnesses}
        editing = Editing(self.layout, parts, self._maker, self._harness_maker, self._crossing)
        try:
            if cable is not None:
                checks.one_of("cable", cable, (*parts, *editing.layout.cables))
            for edit in edits:
                editing.take(edit, cable)
            common = editing.layout.common
            near = self._made_near(editing.cables, common)
        except ArgumentError as error:
            return EditResult(False, str(error))
        for name, one in self._cables.items():
            if editing.cycles[name] is not one:
                one.predictor.end()
        self._layout, self._scene = editing.layout, common
        self._cables, self._harnesses, self._crossing = editing.singles, editing.harnesses, editing.crossing
        self._named = {name: laid.cable for name, laid in editing.layout.single.items()}
        self._look_about(near)
        if stamp is not None:
            self.last_stamp = stamp
        return EditResult(True)

    @property
    def layout(self) -> Layout:
        """How the cables, and the segments of harnesses, are held now, among which bodies."""
        return self._layout or self._laid()

    def _laid(self) -> Layout:
        """The cables before any edit."""
        harnesses = {name: one.predictor.harness for name, one in self._harnesses.items()}
        parts: dict[str, Part] = {**self._cables, **self._harnesses}
        own_clips = {name: one.scene.clips for name, one in parts.items()}
        return Layout.of(self.scene, self._named, own_clips, harnesses)

    def _made_near(self, cables: Mapping[str, Cable], scene: Scene) -> CableNear:
        """What checks these cables, and segments, against each other."""
        return CableNear(cables, scene, self._maker.options["robot_links"], joined=self._joined)

    def _look_about(self, near: CableNear | None = None) -> None:
        """What depends on all cables and bodies."""
        self._parts = dict(self._named)
        for harness in self._harnesses.values():
            self._parts.update(harness.cables)
        self._near = near or self._made_near(self._parts, self.scene)
        parts: list[Part] = [*self._cables.values(), *self._harnesses.values()]
        self._pushed = any(part.predictor.problem.carried for part in parts)
        solved = {name: one.predictor.problem.solves_crossing for name, one in self._harnesses.items()}
        if all(cable.predictor.problem.solves_crossing for cable in self._cables.values()):
            solved = {**dict.fromkeys(self._cables, True), **solved}
        #: The parts that are kept out of each other.
        self._beside = [name for name, found in solved.items() if found]
        known = [name for name in self._beside if self._maker.uncertainty.get(name) is not None]
        if self._maker.motion == DYNAMIC and known and len(self._beside) > 1:
            bound = "what swings with a tube would pass through other cables, which contact='solve' keeps out"
            remedy = "Leave the uncertainty out, write motion='quasistatic', or give each cable a Cycle of its own."
            raise ArgumentError.of("uncertainty", known, bound, remedy)

    def step(
        self,
        grips: Mapping[str, Ends],
        stamp: int,
        links: Mapping[str, Pose] | Callable[[], Mapping[str, Pose] | None] | None = None,
        early: Callable[[Mapping[str, CableShape]], None] | None = None,
        *,
        acceleration: Mapping[str, ArrayLike] | None = None,
        seen: Callable[[Mapping[str, Any]], Mapping[str, AsSeen]] | None = None,
    ) -> CycleReport:
        """Predicts every cable in `grips` and checks it against the scene.

        Parameters
        ----------
        grips : mapping of cable name to (start, end)
            Poses or Grips in the world; end None or a FreeEnd: nothing holds it. Of a harness the mapping of ends, see
            :meth:`cable_shape.prediction.harness_predictor.HarnessPredictor.predict`; its shape is a
            :class:`HarnessShape`.
        stamp : int
            [ns], must not be older than the stamp of the last step.
        links : mapping of robot link to its Pose in the world, optional
            Without it, clearance to the robot is reported as not checked, and its links keep no cable out. A function
            is asked for them after `early`, or before the prediction where links keep the cable out or carry a clip.
        early : callable, optional
            Is given the shapes as soon as they are known, before clearance, margins and warnings.
        acceleration : mapping of cable name to (3,), (m, 3) or (m, 6) array_like, optional
            [m/s^2], world, of cables in `grips` in this step, uniform in arc length, see
            :meth:`cable_shape.Predictor.predict`; the others are at rest, and so are tails. Of a cable whose
            acceleration is given no QUASISTATIC margin is told: its inertia is part of the load.
        seen : callable, optional
            Is given the predicted shapes, and gives those that were seen instead, by name of the cable: clearance,
            margins, warnings and all else are of these then, and of stability, too, where they come with their rod. A
            snap is looked for ahead from the predicted shape.

        Raises
        ------
        StaleInputError
            If `stamp` goes backwards. `reset` forgets the last stamp (a bag that loops).
        ArgumentError
            For a cable that does not exist, or an acceleration that is none, or that the model does not know, and
            where it is not known where the link of a clip is.
        """
        stamp = checks.stamp(stamp, self.last_stamp)
        if type(grips) is not dict and not isinstance(grips, Mapping):
            raise ArgumentError.of("grips", grips, "it must be a mapping", "Write {name of the cable: (start, end)}.")
        if early is not None and not callable(early):
            raise ArgumentError.of("early", early, "it must be a function", "Leave it out, or give one.")
        if seen is not None and not callable(seen):
            raise ArgumentError.of("seen", seen, "it must be a function", "Leave it out, or give one.")
        began = perf_counter()
        grips, cables, held = self._taken(grips)
        moving = checks.mapping("acceleration", acceleration, grips, "Write {name of the cable: (ax, ay, az)}.")
        placed = (links() if self._pushed else None) if callable(links) else links
        shapes, together = self._predicted(grips, cables, held, stamp, placed, moving)
        if seen is not None:
            for name, look in seen(shapes).items():
                shapes[name] = look.shape
                part: Part = held[name] if name in held else cables[name]
                part.take_seen(look, grips[name], placed)  # type: ignore[arg-type]
        single: dict[str, CableShape] = {name: shapes[name] for name in cables}
        parts = {name: harness.parts(shapes[name]) for name, harness in held.items()}
        for own in parts.values():
            single.update(own)
        predicted = perf_counter()
        if early is not None:
            early(shapes)
        if callable(links) and not self._pushed:
            placed = links()
        resumed = perf_counter()
        tubes = self._tubes(grips, cables, held, shapes, stamp, placed)
        clearance = {name: cable.check(shapes[name], placed) for name, cable in cables.items()}
        for name, harness in held.items():
            clearance.update(harness.check(parts[name], placed))
        if self.scene.contact != "off":
            swell = {name: float(tube.radius.max()) for name, tube in tubes.items()}
            clearance = self._near.added(single, clearance, swell)
        for name, tube in tubes.items():
            clearance[name] = dataclasses.replace(clearance[name], confidence=tube.confidence, holds=tube.holds)
        checked = perf_counter()
        find = self._ahead.find(stamp) if together and self._ahead is not None else {}
        margins = {
            name: cable.margins(shapes[name], clearance[name], grips[name], stamp, find.get(name))
            for name, cable in cables.items()
        }
        for name, harness in held.items():
            margins.update(harness.margins(shapes[name], clearance, stamp, find.get(name)))
        measured = perf_counter()
        warnings = [
            warning for name, cable in cables.items() for warning in cable.warnings(shapes[name], margins[name])
        ]
        for name, harness in held.items():
            warnings += harness.warnings(parts[name], margins)
        plugs = {name: cable.plug_error(shapes[name]) for name, cable in cables.items()}
        ended = perf_counter()
        self.last_stamp = stamp
        return CycleReport(
            stamp=stamp,
            grips={name: ends if name in held else tuple(ends) for name, ends in grips.items()},  # type: ignore[misc]
            links=placed,
            shapes=shapes,
            clearance=clearance,
            warnings=tuple(warnings),
            times={
                "predict": predicted - began,
                "clearance": checked - resumed,
                "margins": measured - checked,
                "warnings": ended - measured,
                "total": predicted - began + ended - resumed,
            },
            skipped={
                "reused": sum(s.reused for s in shapes.values()),
                "pairs_culled": sum(c.pairs_culled for c in clearance.values()),
                "snap_checks": sum(cable.snap_skipped for cable in cables.values())
                + sum(harness.stability.snaps.skipped for harness in held.values()),
                "crossings": self._crossings_skipped(cables),
            },
            margins=margins,
            plugs={name: error for name, error in plugs.items() if error is not None},
            tubes=tubes,
            **beside(cables, held),
        )

    def _taken(
        self, grips: Mapping[str, Ends]
    ) -> tuple[Mapping[str, Ends], dict[str, CableCycle], dict[str, HarnessCycle]]:
        """What is given of each cable, without what edits have opened, and the cables and harnesses that are."""
        cables = {}
        held = {name: self._harnesses[name] for name in grips if name in self._harnesses}
        if held and self._layout is not None:
            grips = {**grips, **{name: opened_ends(self.layout.segments(name), grips[name]) for name in held}}
        for name in grips:
            if name in held:
                continue
            cable = self._cables.get(name)
            if cable is None:
                known_ones = ", ".join((*self._cables, *self._harnesses))
                raise ArgumentError.of("cable", name, "no such cable", f"Known: {known_ones}.")
            opened = "" if self._layout is None else self._layout.cables[name].opened
            check_ends(name, grips[name], opened)
            if opened:
                grips = {**grips, name: opened_end(grips[name], opened)}
            cables[name] = cable
        parts: list[Part] = [*cables.values(), *held.values()]
        for part in parts:
            part.look_again()
        return grips, cables, held

    def _predicted(
        self, grips: Mapping[str, Ends], cables: Mapping[str, CableCycle], held: Mapping[str, HarnessCycle], stamp: int,
        placed: Mapping[str, Pose] | None, moving: Mapping[str, Any],
    ) -> tuple[dict[str, Any], bool]:  # fmt: skip
        """All shapes, by name, and whether some were found together, at rest."""
        dynamic = self._maker.motion == DYNAMIC
        if moving or (self._solves_crossing and not dynamic):
            for name, cable in cables.items():
                accelerate(name, cable.predictor, moving.get(name))
        if dynamic:
            for name, given in moving.items():
                if given is not None:
                    refuse_acceleration(name)
            swings: dict[str, Any] = {**cables, **held}
            self._swinging = step_on(self._swinging, swings, self._beside, grips, stamp, placed, self._bodies)
        together = self._together(grips, placed, moving) if self._solves_crossing and not dynamic else {}
        shapes: dict[str, Any] = {
            name: cable.predict(grips[name], placed, together.get(name), moving.get(name), stamp)
            for name, cable in cables.items()
        }
        for name, harness in held.items():
            ends: Any = grips[name]
            shapes[name] = harness.predict(ends, placed, moving.get(name), stamp, together.get(name))
        return shapes, bool(together)

    def _tubes(
        self, grips: Mapping[str, Ends], cables: Mapping[str, CableCycle], held: Mapping[str, HarnessCycle],
        shapes: Mapping[str, Any], stamp: int, placed: Mapping[str, Pose] | None,
    ) -> dict[str, Tube]:  # fmt: skip
        """About the shapes of cables and segments of which it is known how well they are known."""
        found = {name: cable.spread(shapes[name], grips[name], placed, stamp) for name, cable in cables.items()}
        known = {name: tube for name, tube in found.items() if tube is not None}
        for name, harness in held.items():
            known.update(harness.spread(shapes[name], grips[name], placed, stamp))  # type: ignore[arg-type]
        return known

    @property
    def _solves_crossing(self) -> bool:
        """Whether some are kept out of each other; one by itself sees to it that it stays out of itself."""
        return len(self._beside) > 1

    def _together(
        self, grips: Mapping[str, Ends], links: Mapping[str, Pose] | None, moving: Mapping[str, Any]
    ) -> dict[str, Any]:
        """The shapes of all the cables and harnesses in `grips` that are kept out of each other."""
        names = tuple(name for name in grips if name in self._beside)
        parts: dict[str, Part] = {**self._cables, **self._harnesses}
        predictors = {name: parts[name].predictor for name in names}
        if not names:
            return {}
        if self._crossing is None or self._crossing[0] != names:
            self._crossing = names, joined({name: one.solo for name, one in predictors.items()})
        for name, predictor in predictors.items():
            ends: Any = grips[name]
            if isinstance(predictor, HarnessPredictor):
                predictor.move(ends, links, moving.get(name))
            else:
                start, end = ends
                predictor.move(start, end, links)
        shapes = told_of(predictors, self._crossing[1].solve())
        if self._ahead is None or self._ahead.crossing is not self._crossing[1]:
            self._ahead = Together(self._crossing[1], predictors, self._maker.snap_horizon)
        return shapes

    def _crossings_skipped(self, cables: Mapping[str, CableCycle]) -> int:
        """Pairs of cables, each with itself included, that bounds told not to have touched."""
        if self._crossing is not None:
            return self._crossing[1].culled
        return sum(cable.predictor.pairs_apart for cable in cables.values())

    def reset(self) -> None:
        """Forgets the last stamp, the warm start, speeds and standing warnings: the next step starts afresh."""
        self.last_stamp = None
        if self._crossing is not None:
            self._crossing[1].reset()
            self._ahead = None
        for cable in self._cables.values():
            cable.reset()
        for harness in self._harnesses.values():
            harness.reset()
