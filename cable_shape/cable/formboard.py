"""A harness laid flat at its true lengths, as SVG and DXF: :func:`laid_flat`, :func:`svg`, :func:`dxf`.

Every segment is a straight line as long as it is. From the middle of the harness branches fan out: a branch gets the
share of its parent's angle that its open ends are of all open ends (the radial drawing of trees of P. Eades, Drawing
free trees, 1992), so that none crosses another. In a loop one segment is drawn to where it ends, its length beside it.
"""

from __future__ import annotations

import math
from collections import defaultdict
from typing import NamedTuple
from xml.sax.saxutils import escape

from cable_shape.cable.harness import Harness, split_end

_MARGIN, _TEXT = 0.06, 0.006  # m
_FULL = 2.0 * math.pi


class Line(NamedTuple):
    """A segment on the board."""

    name: str
    length: float  # [m], of the segment
    start: tuple[float, float]  # [m]
    end: tuple[float, float]
    closes: bool  # a loop: the line is not as long as the segment


class Board(NamedTuple):
    """A formboard: lines, and names at points, 1:1 in metres."""

    title: str
    lines: tuple[Line, ...]
    names: tuple[tuple[str, tuple[float, float]], ...]
    size: tuple[float, float, float, float]  # least and largest x, least and largest y


def laid_flat(harness: Harness) -> Board:
    """Places of all segments: the parts of the harness beside each other."""
    node_of = {end: f"end {end}" for end in harness.ends}
    node_of |= {end: junction.name for junction in harness.junctions for end in junction.ends}
    at: dict[str, list[str]] = defaultdict(list)
    for end in harness.ends:
        at[node_of[end]].append(end)
    lines: list[Line] = []
    places: dict[str, tuple[float, float]] = {}
    right = 0.0
    for part in harness.parts():
        nodes = list(dict.fromkeys(node_of[f"{name}.{side}"] for name in sorted(part) for side in ("start", "end")))
        tree = _Tree(harness, node_of, at, max(nodes, key=lambda node: len(at[node])))
        found = tree.places()
        shift = right - min(x for x, _ in found.values())
        found = {node: (x + shift, y) for node, (x, y) in found.items()}
        right = max(x for x, _ in found.values()) + _MARGIN
        places |= found
        for name in sorted(part, key=list(harness.segments).index):
            a, b = found[node_of[f"{name}.start"]], found[node_of[f"{name}.end"]]
            lines.append(Line(name, harness.segments[name].length, a, b, name not in tree.used))
    labels = {} if harness.imported is None else harness.imported.labels
    names = []
    for node, place in places.items():
        label = labels.get(node.removeprefix("end "), "")
        if label or not node.startswith("end "):
            names.append((label or node, place))
    x, y = [p[0] for p in places.values()], [p[1] for p in places.values()]
    title = "harness" if harness.imported is None else harness.imported.source
    return Board(title, tuple(lines), tuple(names), (min(x), max(x), min(y), max(y)))


class _Tree:
    """A part of a harness, spread from its middle; `used`: segments that are as long as they are."""

    def __init__(self, harness: Harness, node_of: dict[str, str], at: dict[str, list[str]], root: str) -> None:
        self.lengths = {name: cable.length for name, cable in harness.segments.items()}
        self.node_of, self.at, self.root = node_of, at, root
        self.used: set[str] = set()
        self.below: dict[str, list[tuple[str, str]]] = defaultdict(list)  # segment and node beyond it
        order, seen = [root], {root}
        for node in order:
            for end in at[node]:
                name, side = split_end(end)
                other = node_of[f"{name}.{'end' if side == 'start' else 'start'}"]
                if other not in seen:
                    seen.add(other)
                    self.used.add(name)
                    self.below[node].append((name, other))
                    order.append(other)
        self.tips = dict.fromkeys(order, 1)
        for node in reversed(order):
            self.tips[node] = sum(self.tips[other] for _, other in self.below[node]) or 1

    def places(self) -> dict[str, tuple[float, float]]:
        """(x, y) of every node."""
        out = {self.root: (0.0, 0.0)}
        todo = [(self.root, 0.0, _FULL)]
        while todo:
            node, begin, width = todo.pop()
            x, y = out[node]
            for name, other in self.below[node]:
                share = min(width * self.tips[other] / self.tips[node], math.pi)
                angle, length = begin + 0.5 * share, self.lengths[name]
                out[other] = (x + length * math.cos(angle), y + length * math.sin(angle))
                todo.append((other, begin, share))
                begin += width * self.tips[other] / self.tips[node]
        return out


def svg(board: Board) -> str:
    """An SVG, 1:1 in millimetres."""
    low_x, high_x, low_y, high_y = board.size
    wide, high = 1e3 * (high_x - low_x + 2.0 * _MARGIN), 1e3 * (high_y - low_y + 2.0 * _MARGIN)

    def at(place: tuple[float, float]) -> tuple[float, float]:
        return 1e3 * (place[0] - low_x + _MARGIN), 1e3 * (high_y - place[1] + _MARGIN)

    size = 1e3 * _TEXT
    out = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide:.2f}mm" height="{high:.2f}mm" '
        f'viewBox="0 0 {wide:.2f} {high:.2f}" font-family="sans-serif" font-size="{size:.2f}">',
        f"<title>{escape(board.title)}</title>",
    ]
    for line in board.lines:
        (a, b), (c, d) = at(line.start), at(line.end)
        dashed = ' stroke-dasharray="4 3"' if line.closes else ""
        out.append(
            f'<line x1="{a:.3f}" y1="{b:.3f}" x2="{c:.3f}" y2="{d:.3f}" stroke="#2563a8" stroke-width="1.5"{dashed}/>'
        )
        label = escape(f"{line.name}  {1e3 * line.length:.1f}")
        turn = math.degrees(math.atan2(d - b, c - a))
        turn += 180.0 if abs(turn) > 90.0 else 0.0
        x, y = 0.5 * (a + c), 0.5 * (b + d)
        out.append(
            f'<text x="{x:.2f}" y="{y - 2.0:.2f}" transform="rotate({turn:.2f} {x:.2f} {y:.2f})" '
            f'text-anchor="middle" font-size="{0.6 * size:.2f}">{label}</text>'
        )
    for name, place in board.names:
        x, y = at(place)
        out.append(f'<circle cx="{x:.3f}" cy="{y:.3f}" r="2" fill="#d98e04"/>')
        out.append(f'<text x="{x + 3.0:.2f}" y="{y - 3.0:.2f}">{escape(name)}</text>')
    return "\n".join((*out, "</svg>")) + "\n"


def dxf(board: Board) -> str:
    """A DXF (AutoCAD R12, ASCII), 1:1 in millimetres: layers SEGMENTS, LENGTHS, NAMES."""
    out = ["0", "SECTION", "2", "ENTITIES"]
    for line in board.lines:
        (a, b), (c, d) = line.start, line.end
        out += ["0", "LINE", "8", "SEGMENTS", "10", _mm(a), "20", _mm(b), "11", _mm(c), "21", _mm(d)]
        turn = math.degrees(math.atan2(d - b, c - a))
        turn += 180.0 if abs(turn) > 90.0 else 0.0
        told = f"{line.name}  {1e3 * line.length:.1f}"
        out += _words("LENGTHS", 0.5 * (a + c), 0.5 * (b + d), 0.6 * _TEXT, told, turn)
    for name, (x, y) in board.names:
        out += _words("NAMES", x, y, _TEXT, name, 0.0)
    return "\n".join((*out, "0", "ENDSEC", "0", "EOF")) + "\n"


def _words(layer: str, x: float, y: float, height: float, text: str, turn: float) -> list[str]:
    """A TEXT; what is not ASCII is written as DXF writes it."""
    told = "".join(c if 32 <= ord(c) < 127 else f"\\U+{min(ord(c), 0xFFFF):04X}" for c in text)
    return ["0", "TEXT", "8", layer, "10", _mm(x), "20", _mm(y), "40", _mm(height), "1", told, "50", f"{turn:.3f}"]


def _mm(x: float) -> str:
    return f"{1e3 * x:.6f}"
