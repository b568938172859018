"""Where frames are, from transforms between neighbours: :class:`TransformTree`. Knows no ROS; stamps are in ns."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import islice
from typing import final

from cable_shape.errors import InputError, StaleInputError, shown
from cable_shape.messages.pairing import SECOND, StampGuard
from cable_shape.pose import IDENTITY, Pose, between

#: Frames that are known at most; what a /tf of a whole factory has is below.
MAX_FRAMES = 2000

#: Transforms kept of one frame: those of the fastest sender while one waits for the slowest.
HISTORY = 512


@final
@dataclass(slots=True)
class _Edge:
    """A frame in its parent."""

    parent: str
    guard: StampGuard
    static: Pose | None = None
    samples: deque[tuple[int, Pose]] = field(default_factory=lambda: deque(maxlen=HISTORY))


@final
class TransformTree:
    """The newest transforms of a tree of frames, and the way from one frame to some others.

    A transform is looked at only if it lies on one of these ways; of the others only the parent is kept.

    Parameters
    ----------
    base : str
        The frame in which the others are wanted.
    frames : iterable of str
    """

    def __init__(self, base: str, frames: Iterable[str]) -> None:
        self.base, self.frames = base, tuple(frames)
        self.repeated = 0  # transforms with the stamp of the one before
        self._edges: dict[str, _Edge] = {}
        self._ways: dict[str, tuple[list[str], list[str]] | None] = {}
        self.needed: set[str] = set()  # children on the ways
        self._find_ways()

    def __len__(self) -> int:
        return len(self._edges)

    def changes_nothing(self, parent: str, child: str) -> bool:
        """Whether a transform on /tf would: it is known where it hangs, and it lies on no way."""
        edge = self._edges.get(child)
        return edge is not None and edge.parent == parent and child not in self.needed and edge.static is None

    def put_static(self, parent: str, child: str, pose: Callable[[], Pose]) -> None:
        """`child` is at `pose` in `parent` for good.

        Raises
        ------
        InputError
        """
        edge = self._edge(parent, child)
        edge.static = pose()
        edge.samples.clear()

    def put(self, parent: str, child: str, stamp: int, pose: Callable[[], Pose]) -> bool:
        """`child` is at `pose` in `parent` at `stamp`; True if the clock was set back by more than a second.

        Raises
        ------
        InputError, ArgumentError
            For a stamp that goes backwards, a frame with two parents at one time, a pose that is none.
        """
        edge = self._edges.get(child)
        if edge is not None and edge.parent != parent and edge.samples and abs(stamp - edge.samples[-1][0]) < SECOND:
            raise InputError(
                f"/tf: frame {shown(child)} has two parents, {shown(edge.parent)} and {shown(parent)}, within a "
                "second: the other one is not used. A frame has one parent: look for two nodes that send it."
            )
        edge = self._edge(parent, child)
        if child not in self.needed:
            edge.static = None
            return False
        if stamp == edge.guard.last:  # senders repeat what has not moved
            self.repeated += 1
            return False
        found = pose()
        restarted = edge.guard.check(stamp)
        if restarted:
            self.forget()
            edge.guard.check(stamp)
        edge.static = None
        edge.samples.append((stamp, found))
        return restarted

    def forget(self) -> None:
        """Any stamp may come next; what is static stays."""
        for edge in self._edges.values():
            edge.guard.forget()
            edge.samples.clear()

    def newest(self, frames: Iterable[str]) -> int | None:
        """The newest stamp at which all of `frames` are known; None if there is none, 0 if all of it is static."""
        stamps = []
        for frame in frames:
            way = self._ways[frame]
            if way is None:
                return None
            for edge in (self._edges[name] for part in way for name in part):
                if edge.static is None:
                    if not edge.samples:
                        return None
                    stamps.append(edge.samples[-1][0])
        return min(stamps, default=0)

    def at(self, frame: str, stamp: int, gap: int) -> Pose:
        """The pose of `frame` at `stamp`, between the two transforms around it; the nearer of them is within `gap`.

        Raises
        ------
        StaleInputError
            If none is.
        """
        way = self._ways[frame]
        if way is None:
            raise StaleInputError(self.missing(frame))
        up, down = (self._chain(part, stamp, gap) for part in way)
        return up if down is IDENTITY else down.inverse() * up

    def missing(self, frame: str) -> str:
        """Why there is no way to `frame`, in words; empty if there is one."""
        if self._ways[frame] is not None:
            return ""
        up, down = self._above(frame), self._above(self.base)
        if frame not in self._edges and not any(edge.parent == frame for edge in self._edges.values()):
            return (
                f"/tf: nobody sends frame {frame!r}; there are {self._listed()}. Start its sender, or correct the name."
            )
        if self.base not in self._edges and not any(edge.parent == self.base for edge in self._edges.values()):
            return (
                f"/tf: nobody sends frame {self.base!r}, in which {frame!r} is wanted; there are {self._listed()}. "
                "Start its sender, or set frame_id."
            )
        return (
            f"/tf: frame {frame!r} hangs on {shown(up[-1])} and the frame of the shapes {self.base!r} on "
            f"{shown(down[-1])}: nobody sends a transform between these. Start its sender, or set frame_id."
        )

    def prune(self, stamp: int) -> None:
        """Forgets what is older than the last transforms up to `stamp`."""
        for name in self.needed:
            samples = self._edges[name].samples
            while len(samples) > 1 and samples[1][0] <= stamp:
                samples.popleft()

    def _listed(self) -> str:
        """The known frames in words."""
        known = sorted({*self._edges, *(edge.parent for edge in self._edges.values())})
        more = f" and {len(known) - 10} more" if len(known) > 10 else ""
        return ", ".join(map(shown, known[:10])) + more if known else "none"

    def _edge(self, parent: str, child: str) -> _Edge:
        """The edge that ends at `child`, made or hung elsewhere if need be."""
        edge = self._edges.get(child)
        if edge is not None and edge.parent == parent:
            return edge
        if not parent or not child or parent == child:
            raise InputError(
                f"/tf: a transform from {shown(parent)} to {shown(child)} is not allowed: header.frame_id and "
                "child_frame_id must be two different names. Correct its sender."
            )
        if edge is None and len(self._edges) >= MAX_FRAMES:
            raise InputError(
                f"/tf: frame {shown(child)} is one more than the {MAX_FRAMES} frames that are kept: it is not used. "
                "Look for a sender that makes up names, or remap /tf to a topic with fewer."
            )
        edge = self._edges[child] = _Edge(parent, StampGuard(f"/tf: {child}"))
        self._find_ways()
        return edge

    def _above(self, frame: str) -> list[str]:
        """`frame` and all frames that it hangs on, to the root, or to where they go round in a circle."""
        found = [frame]
        while (edge := self._edges.get(found[-1])) is not None and edge.parent not in found:
            found.append(edge.parent)
        return found

    def _find_ways(self) -> None:
        """The edges from each frame and from the base up to where they meet."""
        base = self._above(self.base)
        self.needed = set()
        for frame in self.frames:
            up = self._above(frame)
            meet = next((name for name in up if name in base), None)
            self._ways[frame] = None if meet is None else (up[: up.index(meet)], base[: base.index(meet)])
            self.needed.update(name for name in (*up, *base) if name in self._edges)

    def _chain(self, names: list[str], stamp: int, gap: int) -> Pose:
        """The pose of the first of `names` in the parent of the last."""
        pose = IDENTITY
        for name in names:
            edge = self._edges[name]
            step = edge.static if edge.static is not None else self._between(name, edge, stamp, gap)
            pose = step if pose is IDENTITY else step * pose
        return pose

    def _between(self, name: str, edge: _Edge, stamp: int, gap: int) -> Pose:
        """One edge at `stamp`."""
        samples = edge.samples
        if samples and samples[-1][0] == stamp:
            return samples[-1][1]
        after = bisect_left(samples, stamp, key=lambda sample: sample[0])
        near = [*islice(samples, max(after - 1, 0), after + 1)]
        miss = min((abs(when - stamp) for when, _ in near), default=None)
        if miss is None or miss > gap:
            far = "no transform" if miss is None else f"none nearer than {miss / SECOND:.3f} s"
            raise StaleInputError(
                f"/tf: {name} at {stamp} ns is not known: {far}, max_skew = {gap / SECOND:g} s. Send all transforms "
                "between the grippers and frame_id at like times, or raise max_skew."
            )
        if len(near) == 1 or near[-1][0] == stamp:
            return near[-1][1]
        (before, first), (behind, second) = near
        return Pose.trusted(between(first.array, second.array, (stamp - before) / (behind - before)))
