"""The service `edit` of the node, and the topics that tell what was edited: :class:`Edits`."""

from __future__ import annotations

import contextlib
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from cable_shape.cycle.cycle import Cycle
from cable_shape.errors import ArgumentError, CableShapeError, shown
from cable_shape.messages.edits import edits_of
from cable_shape.messages.pairing import SECOND
from cable_shape.prediction.edits import Edit
from cable_shape.ros import conversions, messages
from cable_shape.ros.diagnostics import Health
from cable_shape.ros.outputs import LATCHED
from cable_shape.ros.parameters import Settings

SERVICE, DONE, SCENE = "~/edit", "cable/edits", "cable/scene"

#: Requests that wait for their stamp, at most.
MOST_WAITING = 100
#: [s], by which an edit may be ahead of the input, and for which it is waited for input of its stamp.
MOST_AHEAD, LONGEST_WAIT = 10.0, 20.0
#: A recorder that comes late gets so many of the requests done before.
KEPT = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass(eq=False, slots=True)
class _Waiting:
    """A request whose stamp the input has not reached."""

    stamp: int  # ns
    request: Any
    response: Any
    edits: list[Edit]
    since: float  # s, on a steady clock
    header: Any = None  # whom to answer; None: rclpy has not told it yet


@final
class Edits:
    """Takes requests, has each done between two cycles, in the order of the input's stamps, and tells of it.

    What is done is published as it was asked for, with the stamp of the cycle that it came after: with the input all
    that a replay needs. What the cables are held and surrounded by then follows within a tenth of a second. `edited` is
    called each time.
    """

    def __init__(
        self,
        node: LifecycleNode,
        settings: Settings,
        cycle: Cycle,
        health: Health,
        now: Callable[[], int],
        edited: Callable[[], None],
    ) -> None:
        self._node, self._cycle, self._health, self._now, self._edited = node, cycle, health, now, edited
        self._locked = settings.lock and not settings.allow_edits
        self._frame = settings.frame_id
        self._after = 0  # ns, stamp of the last cycle
        self._number = 0  # requests done
        self._waiting: list[_Waiting] = []
        self._told = -1  # number of the scene that was published last
        self._done = node.create_publisher(messages.CableEdits, DONE, KEPT)
        self._scene = node.create_publisher(messages.CableScene, SCENE, LATCHED)
        self._service: Any = node.create_service(messages.EditCable, SERVICE, self._take)
        self._answer = self._service.send_response
        self._service.send_response = self._send  # type: ignore[method-assign]
        self.tend(time.monotonic())

    def make_due(self, stamp: int, frame_id: str) -> None:
        """Before a cycle: does what was asked for up to its `stamp` [ns]; its input is in `frame_id`."""
        due = [one for one in self._waiting if one.stamp <= stamp]
        for one in sorted(due, key=lambda one: one.stamp):
            self._waiting.remove(one)
            self._make(one.request, one.edits, one.response)
            self._late(one)
        self._after, self._frame = stamp, frame_id

    def tend(self, steady: float) -> None:
        """To be called some times a second, at the time `steady` [s]."""
        if self._told != self._number:
            self._told = self._number
            message = conversions.scene_message(self._cycle.layout, self._after, self._frame, self._number)
            self._scene.publish(message)
        late = [one for one in self._waiting if steady - one.since > LONGEST_WAIT]
        text = f"no input of this stamp or a younger one came within {LONGEST_WAIT:g} s. Leave the stamp 0, or look at "
        self._refuse(late, text + "the publishers of the poses.")

    def refuse_waiting(self, why: str) -> None:
        """Nothing that waits is done."""
        self._refuse(list(self._waiting), why)

    def restart(self) -> None:
        """The input's clock was set back: stamps begin anew."""
        self.refuse_waiting("the input's clock was set back before. Ask again, by the new clock.")
        self._after = 0

    def destroy(self) -> None:
        """Takes service and topics away."""
        self.refuse_waiting("the node was cleaned up before. Configure and activate it, and ask again.")
        self._node.destroy_service(self._service)
        for publisher in (self._done, self._scene):
            self._node.destroy_publisher(publisher)

    def _take(self, request: Any, response: Any) -> Any:
        """EditCable."""
        stamp = conversions.nanoseconds(request.header.stamp)
        try:
            self._check(stamp, request.header.frame_id)
            edits = edits_of(request.edits)
        except ArgumentError as error:
            return self._refused(response, str(error))
        if stamp == 0:
            return self._make(request, edits, response)
        self._waiting.append(_Waiting(stamp, request, response, edits, time.monotonic()))
        return response

    def _send(self, response: Any, header: Any) -> None:
        """In the place of the service's own: what waits is answered later."""
        one = next((one for one in self._waiting if one.response is response), None)
        if one is None:
            self._answer(response, header)
        else:
            one.header = header

    def _late(self, one: _Waiting) -> None:
        """Answers what has waited; its client may have ended."""
        with contextlib.suppress(Exception):
            self._answer(one.response, one.header)

    def _check(self, stamp: int, frame_id: str) -> None:
        """Whether edits with such a header may be asked for now."""
        if self._locked:
            text = (
                "an edit was asked for by a peer and is refused: the node is locked (parameter lock). Shut it down and "
            )
            text += "start it anew, with allow_edits: true."
            self._health.turn_away("edit", text, self._now())
            raise ArgumentError(text)
        if self._health.state != "active":
            remedy = "Activate it first."
            raise ArgumentError.of("state", self._health.state, "only an active node takes edits", remedy)
        if frame_id and frame_id != self._frame:
            bound = (
                f"it must be {self._frame!r}, that of the input" if self._frame else "no input has told its frame yet"
            )
            remedy = "Nothing is transformed here: give poses in the frame of the input, and it, or no name."
            raise ArgumentError.of("header.frame_id", shown(frame_id), bound, remedy)
        if stamp == 0:
            return
        remedy = "Leave it 0 for now."
        if stamp <= self._after or stamp < 0:
            bound = f"it must be above that of the last cycle, {self._after} ns"
            raise ArgumentError.of("header.stamp", f"{stamp} ns", bound, remedy)
        if self._after and stamp - self._after > MOST_AHEAD * SECOND:
            bound = f"it may be at most {MOST_AHEAD:g} s ahead of the last cycle, {self._after} ns"
            raise ArgumentError.of("header.stamp", f"{stamp} ns", bound, remedy)
        if len(self._waiting) >= MOST_WAITING:
            bound = f"at most {MOST_WAITING} requests wait for their stamps"
            raise ArgumentError.of("requests", len(self._waiting), bound, remedy)

    def _make(self, request: Any, edits: list[Edit], response: Any) -> Any:
        """Does the edits of a request, after the last cycle."""
        try:
            result = self._cycle.edit(*edits, cable=request.cable_id or None)
        except CableShapeError as error:
            return self._refused(response, str(error))
        except Exception as error:  # noqa: BLE001 a defect is answered, too
            self._node.get_logger().error(f"an edit failed unexpectedly:\n{traceback.format_exc()}")
            text = (
                f"a defect ended this edit ({type(error).__name__}: {error}): nothing has changed. Report it with the "
            )
            return self._refused(response, text + "traceback in the log.")
        if not result:
            return self._refused(response, result.reason)
        self._edited()
        self._number += 1
        self._health.edits_done += 1
        self._done.publish(conversions.edits_message(request, self._after, self._frame, self._number))
        response.done, response.number = True, self._number
        response.stamp = conversions.time_of(self._after)
        return response

    def _refused(self, response: Any, reason: str) -> Any:
        self._health.refuse_edit(reason, self._now())
        response.done, response.reason, response.number = False, reason, self._number
        response.stamp = conversions.time_of(self._after)
        return response

    def _refuse(self, waiting: list[_Waiting], why: str) -> None:
        for one in waiting:
            self._waiting.remove(one)
            self._refused(one.response, why)
            self._late(one)
