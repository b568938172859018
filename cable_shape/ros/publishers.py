"""Who publishes on an input topic: :class:`PublisherWatch` refuses what two send at once, and names a wrong type."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, final

from rclpy.node import Node

from cable_shape.messages.pairing import MIXED, SpeakerGuard
from cable_shape.ros.diagnostics import Complaint, Level

_LOOK_AGAIN = 0.5  # s, between looks at the names while messages mix


@final
class PublisherWatch:
    """The publishers of one topic that the node listens to.

    Parameters
    ----------
    node : Node
    topic : str
        As given to `create_subscription`.
    kind : type
        Of its messages.
    """

    def __init__(self, node: Node, topic: str, kind: type) -> None:
        self._node, self._topic, self._type = node, topic, _type_name(kind)
        self._guard = SpeakerGuard()
        self._text, self._looked = "", -_LOOK_AGAIN
        self._mixed = -_LOOK_AGAIN  # when a message was last refused

    def mixed(self, subscription: Any, info: Mapping[str, Any]) -> str:
        """Why the message that came with `info` must not be used; empty if it may be."""
        now = time.monotonic()
        if self._guard.check(subscription.handle.get_publisher_count(), info, now):
            return ""
        self._mixed = now
        if now - self._looked >= _LOOK_AGAIN:
            self._looked = now
            names = self._names(self._known())
            self._text = (
                f"{self._topic}: publishers {names} mix: none of their messages is used before one alone has sent for "
                f"{MIXED:g} s. End one, or remap its topic; one that was killed stays known for some 20 s."
            )
        return self._text

    def complaints(self, subscription: Any) -> list[Complaint]:
        """What is wrong with the publishers that are known now, whether or not they send."""
        matched = subscription.handle.get_publisher_count()
        if matched < 2 and self._node.count_publishers(self._topic) == matched:
            return []  # to ask who they are takes longer
        known = self._known()
        names = self._names(known)
        found = []
        if " and " in names and time.monotonic() - self._mixed >= MIXED:
            text = f"{self._topic} has several publishers, {names}: used as long as only one sends. End the others."
            found.append(Complaint(f"publishers {self._topic}", Level.WARN, text))
        return found + self.wrong_types(known)

    def wrong_types(self, known: list[tuple[str, str]] | None = None) -> list[Complaint]:
        """Publishers whose messages do not come since they are of another type."""
        known = self._known() if known is None else known
        found = []
        for name, kind in sorted({(name, kind) for name, kind in known if kind != self._type}):
            text = (
                f"{self._topic}: {name} publishes {kind} there, it must be {self._type}: its messages do not come. "
                "Change its type, or remap its topic."
            )
            found.append(Complaint(f"type {self._topic} {name}", Level.ERROR, text))
        return found

    def forget(self) -> None:
        """The next message has none before it."""
        self._guard.forget()

    def _known(self) -> list[tuple[str, str]]:
        """Full name of the node and type of each publisher."""
        found = []
        for publisher in self._node.get_publishers_info_by_topic(self._topic):
            name = f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
            found.append(("a node not yet known" if "UNKNOWN" in name else name, publisher.topic_type))
        return found

    def _names(self, known: list[tuple[str, str]]) -> str:
        """The nodes that publish the right type, in words."""
        return " and ".join(sorted(name for name, kind in known if kind == self._type))


def _type_name(kind: type) -> str:
    """As the graph writes it: geometry_msgs/msg/PoseStamped."""
    package = kind.__module__.split(".")[0]
    return f"{package}/msg/{kind.__name__}"
