"""The lifecycle node `cable_shape_node`: a thin shell around :meth:`cable_shape.Cycle.step`.

Everything is loaded and compiled in configure; activation opens the input; a cycle runs in the callback of the message
that completes its input, or at a set rate. docs/node.md lists topics and parameters.
"""

from __future__ import annotations

import gc
import os
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from typing import Any, NoReturn, final

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import NotInitializedException
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, LifecycleState
from rclpy.lifecycle import TransitionCallbackReturn as Return
from rclpy.parameter import Parameter
from rclpy.utilities import ok

from cable_shape.cycle.parts import in_parts, parts_of
from cable_shape.errors import ArgumentError, CableShapeError, shown
from cable_shape.ros import conversions
from cable_shape.ros.assembly import Assembly
from cable_shape.ros.complaint_log import ComplaintLog
from cable_shape.ros.diagnostics import Health
from cable_shape.ros.edits import Edits
from cable_shape.ros.executor import InputFirstExecutor
from cable_shape.ros.interrupt import Interrupts, shut_down, told_to_end
from cable_shape.ros.log_folder import find_log_folder
from cable_shape.ros.outputs import Outputs
from cable_shape.ros.parameters import BY_NAME, SPECS, Settings, unknown_overrides, widened
from cable_shape.ros.planning_scene import PlanningScene
from cable_shape.ros.pose_source import PoseSource
from cable_shape.ros.seeing import Seeing
from cable_shape.ros.sources import JointSource, Ready, Sink, Source
from cable_shape.ros.surroundings import Surroundings
from cable_shape.ros.transitions import guard_transitions
from cable_shape.ros.workers import start_workers

WATCH_PERIOD = 0.1  # s, between looks at the health


@final
class CableShapeNode(LifecycleNode):
    """See the module; `rclpy` calls everything here from one thread."""

    def __init__(self) -> None:
        super().__init__("cable_shape_node")
        self._locked = False
        self._wrong_overrides = self._declare()
        self._settings = self._current()
        self.add_pre_set_parameters_callback(widened)
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._apply)
        self._health = Health(self._settings.stale_after)
        self._assembly: Assembly | None = None
        self._outputs: Outputs | None = None
        self._scene: PlanningScene | None = None
        self._edits: Edits | None = None
        self._seeing: Seeing | None = None
        self._source: Source | None = None
        self._rate_timer: Any = None
        self._waiting: Ready | None = None  # the newest input, when cycles run at a set rate
        self._superseded = 0
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._around = Surroundings(self)
        self._last_diagnosis: tuple[Any, float] = ((), -1e9)
        self._log = ComplaintLog(self.get_logger())
        # not on the node's clock: a silent /clock must not silence the diagnostics
        self.create_timer(WATCH_PERIOD, self._watch, clock=Clock(clock_type=ClockType.STEADY_TIME))
        guard_transitions(self, lambda: self._health.state, self._locked_against)

    @property
    def autostart(self) -> bool:
        """Whether to configure and activate at start."""
        return self._settings.autostart

    @property
    def inputs(self) -> Sequence[Any]:
        """The subscriptions that bring input; none before configure."""
        return () if self._source is None else self._source.subscriptions

    # Parameters

    def _declare(self) -> dict[str, str]:
        """Declares all parameters with the overrides that are allowed; returns a text for each that is not."""
        overrides: dict[str, Parameter] = self._parameter_overrides
        values = {spec.name: spec.default for spec in SPECS}
        wrong = {}
        for parameter in widened([p for name, p in overrides.items() if name in BY_NAME]):
            name = parameter.name
            try:
                Settings.of({**values, name: parameter.value})
            except ArgumentError as error:
                wrong[name] = str(error)
            else:
                values[name] = parameter.value
        for spec in SPECS:
            self.declare_parameter(spec.name, values[spec.name], spec.descriptor(), ignore_override=True)
        wrong.update({text: text for text in unknown_overrides(overrides, self._parameters)})
        return wrong

    def _current(self, changes: Sequence[Parameter] = ()) -> Settings:
        """The settings with some of them changed."""
        values = {spec.name: self.get_parameter(spec.name).value for spec in SPECS}
        values.update({p.name: p.value for p in changes if p.name in BY_NAME})
        return Settings.of(values)

    def _validate(self, changes: list[Parameter]) -> SetParametersResult:
        """All of `changes`, or none."""
        names = ", ".join(p.name for p in changes)
        if self._locked_against(f"a change of {shown(names)}"):
            return SetParametersResult(successful=False, reason=self._health.turned_away["lock"][0])
        if self._health.state != "unconfigured":
            fixed = [p.name for p in changes if p.name in BY_NAME and not BY_NAME[p.name].live]
            if fixed:
                reason = f"{', '.join(fixed)}: fixed while the node is configured (it is {self._health.state}). "
                reason += "Deactivate and clean it up first, then set, configure and activate."
                return SetParametersResult(successful=False, reason=reason)
        try:
            self._current(changes)
        except ArgumentError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _locked_against(self, what: str) -> bool:
        """Whether the node is locked; if it is, it says that `what` was asked for and is refused."""
        if self._locked:
            text = f"{what} was asked for by a peer and is refused: the node is locked (parameter lock) since it was "
            text += "active. Shut it down and start it anew, with lock: false to change things while it runs."
            self._health.turn_away("lock", text, self._now())
        return self._locked

    def _apply(self, changes: list[Parameter]) -> None:
        """`changes` were set."""
        self._settings = self._current()
        self._health.stale_after = self._settings.stale_after
        for parameter in changes:
            self._wrong_overrides.pop(parameter.name, None)
        if self._source is not None:
            self._source.apply(self._settings)

    # Lifecycle

    def on_configure(self, state: LifecycleState) -> Return:
        """Loads everything, compiles the kernels and creates the topics."""
        return self._attempt("configure", "inactive", self._configure, state)

    def on_activate(self, state: LifecycleState) -> Return:
        """Opens the input; the garbage collector no longer looks at what is loaded."""
        return self._attempt("activate", "active", self._activate, state)

    def on_deactivate(self, state: LifecycleState) -> Return:
        """Closes the input."""
        self._waiting = None
        if self._edits is not None:
            self._edits.refuse_waiting("the node was deactivated before. Activate it, and ask again.")
        if self._scene is not None:
            self._scene.remove()
        self._health.state = "inactive"
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> Return:
        """Takes everything down again."""
        self.close()
        self._health.state = "unconfigured"
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> Return:
        """Takes everything down for good."""
        self.close()
        self._health.state = "finalized"
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> Return:
        """After a defect in a transition: back to unconfigured."""
        self.close()
        self._health.state = "unconfigured"
        return super().on_error(state)

    def _attempt(
        self,
        name: str,
        reached: str,
        action: Callable[[LifecycleState], Return],
        state: LifecycleState,
    ) -> Return:
        """Runs a transition; what fails is logged and goes to the diagnostics, and the node stays where it was."""
        try:
            result = action(state)
        except CableShapeError as error:
            self._health.failure = f"{name} failed: {error}"
            self.get_logger().error(self._health.failure)
            if self._health.state == "unconfigured":
                self.close()
            return Return.FAILURE
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # rclpy would swallow it without a word
            self._health.failure = f"{name} failed: {type(error).__name__}: {error}"
            self.get_logger().fatal(f"{name} failed unexpectedly:\n{traceback.format_exc()}")
            raise
        self._health.failure = ""
        self._health.state = reached
        return result

    def _configure(self, state: LifecycleState) -> Return:
        if self._wrong_overrides:
            raise ArgumentError(" ".join(self._wrong_overrides.values()))
        settings = self._settings
        settings.complete()
        self.get_logger().info("configuring; where kernels are not compiled yet, this takes some minutes")
        began = time.perf_counter()
        assembly = self._assembly = Assembly(settings)
        sink = Sink(self._health, self._now, self._deliver, self._set_back)
        self._outputs = Outputs(self, assembly.cycle.parts)
        if settings.input == "joints":
            assert assembly.robot is not None
            self._source = JointSource(self, settings, sink, assembly.robot, assembly.holdings[0])
        elif settings.input == "tf":
            from cable_shape.ros.transform_source import TransformSource  # not everybody has tf2_msgs

            self._source = TransformSource(self, settings, sink, assembly.robot, assembly.holdings)
        else:
            self._source = PoseSource(self, settings, sink, assembly.robot, assembly.holdings)
        self._health.robot_expected = assembly.robot is not None
        if settings.moveit_rate > 0.0:
            self._scene = PlanningScene(self, settings, assembly.cycle.parts)
        self._edits = Edits(self, settings, assembly.cycle, self._health, self._now, self._edited)
        if settings.points_seen:
            self._seeing = Seeing(self, settings, assembly, self._health, self._now)
        start_workers(self, settings, assembly)
        if settings.rate > 0.0:
            self._rate_timer = self.create_timer(1.0 / settings.rate, self._tick)
        self.get_logger().info(f"parameters: {settings.echo()}")
        for remark in assembly.remarks(settings):
            self.get_logger().warning(remark)
        self.get_logger().info(f"{assembly.describe()}; configured in {time.perf_counter() - began:.1f} s")
        return super().on_configure(state)

    def _activate(self, state: LifecycleState) -> Return:
        assert self._source is not None
        self._source.clear()
        self._restart()
        gc.collect()
        gc.freeze()
        self._health.activate(self._source.topics, self._now())
        self._locked = self._settings.lock
        return super().on_activate(state)

    def close(self, leave: bool = False) -> None:
        """Ends viewer and workers (see `Assembly.close`) and takes down what configure made, at any time."""
        if self._rate_timer is not None:
            self.destroy_timer(self._rate_timer)
            self._rate_timer = None
        if self._source is not None:
            self._source.destroy()
            self._source = None
        if self._outputs is not None:
            self._outputs.destroy()
            self._outputs = None
        if self._edits is not None:
            self._edits.destroy()
            self._edits = None
        if self._seeing is not None:
            self._seeing.destroy()
            self._seeing = None
        if self._scene is not None:
            self._scene.destroy()
            self._scene = None
        if self._assembly is not None:
            self._assembly.close(leave)
            self._assembly = None
        gc.unfreeze()

    # Cycles

    def _now(self) -> int:
        """[ns], on the node's clock."""
        now: int = self.get_clock().now().nanoseconds
        return now

    def _deliver(self, ready: Ready) -> None:
        """Input for a cycle came."""
        if self._rate_timer is None:
            self._run(ready)
            return
        self._superseded += self._waiting is not None
        self._waiting = ready

    def _set_back(self) -> None:
        """The input's clock was set back."""
        if self._edits is not None:
            self._edits.restart()
        self._restart()

    def _restart(self) -> None:
        """The input's clock starts anew: nothing from before may be used."""
        self._waiting = None
        if self._assembly is not None:
            self._assembly.cycle.reset()
        if self._seeing is not None:
            self._seeing.restart()

    def _tick(self) -> None:
        """Time for a cycle; without new input there is none."""
        ready, self._waiting = self._waiting, None
        if ready is not None:
            self._run(ready)

    def _run(self, ready: Ready) -> None:
        """One cycle: grips, shapes, which are sent at once, then the rest."""
        assembly, outputs, edits = self._assembly, self._outputs, self._edits
        if assembly is None or outputs is None or edits is None:
            return
        edits.make_due(ready.stamp, ready.frame_id)
        began = time.perf_counter()
        try:
            grips, links = ready.ends()
            seeing = self._seeing
            report = assembly.cycle.step(
                grips,
                ready.stamp,
                links,
                lambda shapes: outputs.publish_shapes(parts_of(shapes), ready.stamp, ready.frame_id),
                seen=None if seeing is None else lambda _: seeing.seen(grips, ready.stamp, ready.frame_id, links),
            )
        except CableShapeError as error:
            self._health.refuse("cycle", str(error), self._now())
            return
        except Exception as error:
            if told_to_end():  # a signal, while shapes were sent
                raise
            self.get_logger().error(
                f"a cycle failed unexpectedly:\n{traceback.format_exc()}", throttle_duration_sec=10.0
            )
            assembly.cycle.reset()
            text = f"a defect ended this cycle ({type(error).__name__}: {error}): its warnings are not published, and "
            text += "the next cycle starts afresh. Report it with the traceback in the log."
            self._health.refuse("cycle defect", text, self._now())
            return
        parts = in_parts(report)
        outputs.publish(parts, ready.frame_id, self._settings.stale_after)
        if self._scene is not None:
            self._scene.publish(parts, ready.frame_id)
        if assembly.viewer is not None:
            assembly.viewer.offer(parts)
        self._health.cycled(report, time.perf_counter() - began, self._now())

    def _edited(self) -> None:
        """The cables are others."""
        if self._seeing is not None:
            self._seeing.take()
        assembly = self._assembly
        if assembly is None:
            return
        for output in (self._outputs, self._scene):
            if output is not None:
                output.take(assembly.cycle.parts)
        assembly.tell_edited()

    # Health

    def _watch(self) -> None:
        """Publishes the diagnostics when they hold news or are due, and logs what is new."""
        if self._source is not None:
            self._health.hint = self._source.hint()
            self._health.counts = {**self._source.counts(), "superseded": self._superseded}
            if self._seeing is not None:
                self._health.counts |= self._seeing.counts
        viewer = None if self._assembly is None else self._assembly.viewer
        if viewer is not None:
            viewer.flush()
            self._health.counts["reports that the viewer did not take"] = viewer.dropped
        now, steady = self._now(), time.monotonic()
        if self._edits is not None:
            self._edits.tend(steady)
        if self._around.tend(self._assembly, steady):
            self._health.troubles = self._around.troubles
            if self._source is not None:
                self._health.publishers = tuple(self._source.publishers())
        verdicts = self._health.verdicts(now)
        complaints = [complaint for verdict in verdicts for complaint in verdict.complaints]
        news = (self._health.state, tuple((c.code, c.level) for c in complaints))
        last, when = self._last_diagnosis
        if news != last or steady - when >= self._settings.diagnostics_period:
            self._diagnostics.publish(
                conversions.diagnostics_message(verdicts, self.get_fully_qualified_name().lstrip("/"), now)
            )
            self._last_diagnosis = (news, steady)
        self._log.tell(complaints, steady)


def main(args: list[str] | None = None) -> int:
    """Runs the node until SIGINT or SIGTERM; the exit code is 0 then."""
    Interrupts.begin()
    find_log_folder()
    rclpy.init(args=args)
    node: CableShapeNode | None = None
    try:
        node = CableShapeNode()
        executor = InputFirstExecutor(node, lambda: node.inputs)
        if node.autostart and node.trigger_configure() == Return.SUCCESS and ok():
            node.trigger_activate()
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException, NotInitializedException, RuntimeError) as error:
        Interrupts.ending = True
        if not isinstance(error, KeyboardInterrupt) and not told_to_end():  # else it is rclpy's own
            raise
    finally:
        Interrupts.ending = True
        if node is not None:
            node.close(leave=True)
            node.destroy_node()
        shut_down()
    return 0


def run() -> NoReturn:
    """The executable: once `main` has taken everything down, Python's own end would take seconds more.

    What the nodes hold in cycles of references is freed before: only then does the middleware tell the others that they
    are gone, who would else see them for 20 s more.
    """
    code = main()
    gc.collect()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    run()
