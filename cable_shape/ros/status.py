"""`cable-shape status`: what /diagnostics and the lifecycle of the nodes say, live. Needs no `ros2` command."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, final

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import GetState
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from cable_shape.errors import InputError
from cable_shape.ros.log_folder import find_log_folder
from cable_shape.ros.streams import middleware_to_stderr

#: of /diagnostics, in this order
LINES = ("lifecycle", "input", "prediction", "cable")
LEVELS = ("ok", "WARN", "ERROR", "STALE")

#: [s], that nodes are looked for before those found are taken for all
SETTLE = 1.0

#: [s], after which a state is asked for anew: an answer may be lost while topics and services meet
ASK_AGAIN = 1.0

STATE_SERVICE, STATE_TYPE = "/get_state", "lifecycle_msgs/srv/GetState"


@final
@dataclass(frozen=True, slots=True)
class Line:
    """One line of a node's diagnostics."""

    level: int  # 0 is well
    text: str
    values: dict[str, str]


@final
@dataclass(slots=True)
class Seen:
    """What is known of one node."""

    name: str  # with its namespace
    state: str = ""  # of its lifecycle; empty: it has not answered
    lines: dict[str, Line] = field(default_factory=dict)  # empty: it has not spoken

    @property
    def complete(self) -> bool:
        """Whether it has answered and spoken."""
        return bool(self.state and self.lines)

    @property
    def well(self) -> bool:
        """Whether it has, and nothing is wrong."""
        return self.complete and all(line.level == 0 for line in self.lines.values())

    def text(self, values: bool = False) -> str:
        """Some lines to read; with `values` all numbers, too."""
        if not self.complete:
            lacks = "answers nothing" if not self.state else "has sent no diagnostics"
            hint = "It may be configuring, which takes some minutes where kernels are compiled, be stopped, or have a "
            lacks += f" yet. {hint}diagnostics_period longer than --timeout."
            rows = [f"{self.name}: {self.state or 'state unknown'}", f"  {'WARN':<5} {'':<11}{lacks}"]
        else:
            rows = [f"{self.name}: {self.state}"]
        for name, line in self.lines.items():
            rows.append(f"  {LEVELS[line.level]:<5} {name:<11}{line.text}")
            rows += [f"        {'':<11}{key}: {value}" for key, value in line.values.items() if values]
        return "\n".join(rows)

    def mapping(self) -> dict[str, Any]:
        """The same for a program."""
        lines = {
            name: {"level": LEVELS[line.level], "message": line.text, "values": line.values}
            for name, line in self.lines.items()
        }
        return {"node": self.name, "state": self.state, "well": self.well, "lines": lines}


def lines_of(message: DiagnosticArray) -> Iterator[tuple[str, dict[str, Line]]]:
    """The nodes that a message of /diagnostics speaks for, each with its four lines; others' messages have none.

    Whatever a peer wrote, what is shown are printable characters.
    """
    found: dict[str, dict[str, Line]] = {}
    for status in message.status:
        name, _, line = status.name.rpartition(": ")
        if line in LINES and name == status.hardware_id:
            level = min(status.level[0], len(LEVELS) - 1)
            values = {printable(entry.key): printable(entry.value) for entry in status.values}
            found.setdefault(printable(f"/{name}"), {})[line] = Line(level, printable(status.message), values)
    for name, lines in found.items():
        if len(lines) == len(LINES):
            yield name, {line: lines[line] for line in LINES}


def printable(text: str) -> str:
    """`text` without what a terminal takes for commands."""
    return "".join(character if character.isprintable() else "?" for character in text)


@final
class Listener:
    """Hears all nodes of cable_shape on this ROS domain; a context manager.

    Parameters
    ----------
    only : str
        Full name of the one node that is asked for; empty: all of them.
    """

    def __init__(self, only: str = "") -> None:
        self.only = only and f"/{only.strip('/')}"
        self.seen: dict[str, Seen] = {}
        self._clients: dict[str, Any] = {}
        self._asked: dict[str, tuple[float, Any]] = {}  # when a state was asked for last, and its answer
        find_log_folder()
        self._context = Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(f"_cable_shape_status_{os.getpid()}", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._take, 100)

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def _take(self, message: DiagnosticArray) -> None:
        for name, lines in lines_of(message):
            if self.only in ("", name):
                self.seen.setdefault(name, Seen(name)).lines = lines

    def spin(self, seconds: float) -> None:
        """Listens for so long, and asks for states."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._look()
            self._executor.spin_once(timeout_sec=min(left, 0.1))

    def others(self) -> list[str]:
        """Full names of the nodes on this domain but for the one that listens."""
        pairs = self._node.get_node_names_and_namespaces()
        own = (self._node.get_name(), self._node.get_namespace())
        return sorted({printable(f"{space.rstrip('/')}/{name}") for name, space in pairs if (name, space) != own})

    def _look(self) -> None:
        """Finds nodes that have a lifecycle and publish diagnostics, asks them, and forgets those that are gone."""
        speak = {
            f"{end.node_namespace.rstrip('/')}/{end.node_name}"
            for end in self._node.get_publishers_info_by_topic("/diagnostics")
        }
        for service, kinds in self._node.get_service_names_and_types():
            name = service.removesuffix(STATE_SERVICE)
            named = self.only == name or (not self.only and name.endswith("/cable_shape_node"))
            if service.endswith(STATE_SERVICE) and STATE_TYPE in kinds and name in speak and named:
                self.seen.setdefault(name, Seen(name))
        now = time.monotonic()
        for name, seen in self.seen.items():
            if name not in self._clients:
                self._clients[name] = self._node.create_client(GetState, name + STATE_SERVICE)
            when, answer = self._asked.get(name, (-ASK_AGAIN, None))
            if answer is not None and answer.done() and answer.result() is not None:
                seen.state = printable(answer.result().current_state.label)
                self._asked[name] = (when, None)
            if now - when >= ASK_AGAIN and self._clients[name].service_is_ready():
                self._asked[name] = (now, self._clients[name].call_async(GetState.Request()))
        gone = set(self.seen) - {*self.others()} if self.seen else set()
        for name in gone:
            if not self._clients[name].service_is_ready():
                self._node.destroy_client(self._clients.pop(name))
                self._asked.pop(name, None)
                del self.seen[name]


def look(listener: Listener, timeout: float) -> list[Seen]:
    """The nodes as they are now, once all of them have answered and spoken, or after `timeout` [s].

    Raises
    ------
    InputError
        If there is none.
    """
    began = time.monotonic()
    settle = 0.0 if listener.only else min(SETTLE, timeout)
    while (passed := time.monotonic() - began) < timeout:
        listener.spin(0.05)
        if passed >= settle and listener.seen and all(seen.complete for seen in listener.seen.values()):
            break
    if not listener.seen:
        raise InputError(nobody(listener.only, listener.others(), timeout))
    return [listener.seen[name] for name in sorted(listener.seen)]


def nobody(only: str, others: list[str], timeout: float) -> str:
    """What to say when no node was heard."""
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"
    there = f"other nodes there: {', '.join(others)}" if others else "no other node is there, either"
    asked = f"no node {only}" if only else "no node of cable_shape"
    return (
        f"{asked} was heard within {timeout:g} s on ROS_DOMAIN_ID = {domain}, "
        f"ROS_AUTOMATIC_DISCOVERY_RANGE = {reach}; {there}. Start it (cable_shape_node --ros-args --params-file FILE), "
        "or set both variables as they are set for the node; a process that is stopped is not heard either."
    )


def follow(
    listener: Listener, timeout: float, tell: Callable[[str], None], values: bool, ends: Callable[[], bool]
) -> None:
    """Tells the state of each node, and again each time when something but a number has changed, until it `ends`."""
    told: dict[str, str] = {}
    silent_since: float | None = time.monotonic()
    while not ends():
        listener.spin(0.2)
        clock = time.strftime("%H:%M:%S")
        for name in sorted({*told} - {*listener.seen}):
            del told[name]
            tell(f"{clock} {name}: gone")
        for name, seen in sorted(listener.seen.items()):
            if seen.complete and told.get(name) != (news := re.sub(r"\d[\d.e+-]*", "#", seen.text())):
                told[name] = news
                tell(f"{clock} {seen.text(values)}")
        if told:
            silent_since = None
        elif silent_since is not None and time.monotonic() - silent_since > timeout:
            silent_since = None
            tell(f"{clock} {nobody(listener.only, listener.others(), timeout)} Waiting for it.")


def run(only: str, timeout: float, going_on: bool, values: bool, as_json: bool) -> bool:
    """The command: prints what nodes say; whether all of them are well."""
    with middleware_to_stderr():
        with Listener(only) as listener:
            if going_on:
                interrupts: list[int] = []  # raised where rclpy cleans up, a KeyboardInterrupt would be lost
                signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
                follow(listener, timeout, lambda text: print(text, flush=True), values, lambda: bool(interrupts))
                signal.signal(signal.SIGINT, signal.default_int_handler)
                raise KeyboardInterrupt
            nodes = look(listener, timeout)
        if as_json:
            print(json.dumps([seen.mapping() for seen in nodes], indent=2))
        else:
            print("\n".join(seen.text(values) for seen in nodes))
        return all(seen.well for seen in nodes)
