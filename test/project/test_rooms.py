"""Who imports whom in the package: the table of rooms in CONTRIBUTING.md, held against the code.

Every import counts, wherever it stands: those inside functions and those for the type checker, too.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import cable_shape as cs

PACKAGE = Path(cs.__file__).parent
TABLE = (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8").split("## Rooms", 1)[1].split("\n## ", 1)[0]
ROWS = re.findall(r"^\| `([\w.]+)` (\*?) *\|[^|]*\|([^|]*)\|$", TABLE, flags=re.MULTILINE)
ORDER = [room for room, _, _ in ROWS]
ANYBODY = [room for room, star, _ in ROWS if star]
MAY = {room: {*ANYBODY, *re.findall(r"`([\w.]+)`", named)} for room, _, named in ROWS}


@cache
def modules() -> dict[str, Path]:
    """Dotted names below the package, "" for itself, and their files."""
    names = {".".join(file.relative_to(PACKAGE).with_suffix("").parts): file for file in PACKAGE.rglob("*.py")}
    return {re.sub(r"(^|\.)__init__$", "", name): file for name, file in names.items()}


def room_of(module: str) -> str:
    """The folder that a module lies in, or itself if it lies in none."""
    if not module:
        return "__init__"
    return module if modules()[module].stem == "__init__" else module.rpartition(".")[0] or module


@cache
def imported_by(module: str) -> set[str]:
    """Modules of the package that one imports."""
    found = set()
    for node in ast.walk(ast.parse(modules()[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} imports relatively"
            source = node.module or ""
            whole = {f"{source}.{alias.name}" for alias in node.names}
            inside = {name for name in whole if name.removeprefix("cable_shape.") in modules()}
            found |= inside | ({source} if inside < whole else set())
    ours = {"" if name == "cable_shape" else name.removeprefix("cable_shape.") for name in found if is_ours(name)}
    assert ours <= set(modules()), f"{module} imports what is not there"
    return ours - {module}


def is_ours(name: str) -> bool:
    return name == "cable_shape" or name.startswith("cable_shape.")


@cache
def arrows() -> dict[str, dict[str, list[str]]]:
    """Room -> rooms that it imports -> by which imports."""
    found: dict[str, dict[str, list[str]]] = {}
    for module in modules():
        room = room_of(module)
        for other in imported_by(module):
            if room_of(other) != room:
                found.setdefault(room, {}).setdefault(room_of(other), []).append(f"{module} -> {other}")
    return found


def test_the_table_has_every_room_and_no_other():
    assert len(ORDER) == len(set(ORDER))
    # a folder whose __init__.py alone lies in it is no room
    rooms = {room_of(module) for module, file in modules().items() if file.stem != "__init__"} | {"__init__"}
    assert set(ORDER) == rooms
    assert len(rooms) <= 30


def test_no_module_imports_itself_through_others():
    TopologicalSorter({module: imported_by(module) for module in modules()}).prepare()


def test_rooms_make_no_circle_and_no_long_chain():
    graph = {room: set(to) for room, to in arrows().items()}
    height: dict[str, int] = {}
    for room in TopologicalSorter(graph).static_order():  # a circle ends it
        height[room] = 1 + max((height[other] for other in graph.get(room, ())), default=0)
    assert max(height.values()) <= 18, height


def test_imports_follow_the_road():
    against = [
        by
        for room, to in arrows().items()
        for other, found in to.items()
        if ORDER.index(other) >= ORDER.index(room)
        for by in found
    ]
    assert against == []


def test_rooms_import_what_the_table_says():
    beyond = [
        by for room, to in arrows().items() for other, found in to.items() if other not in MAY[room] for by in found
    ]
    assert beyond == []
    named = {(room, other) for room, others in MAY.items() for other in others - {*ANYBODY}}
    assert named == {(room, other) for room, to in arrows().items() for other in to if other not in ANYBODY}


def test_what_solves_knows_nothing_of_what_checks_it():
    for room in ("solve", "solve.touching", "prediction"):
        assert not {"safety", "uncertainty", "cycle"} & set(arrows()[room])


def test_only_the_node_knows_ros():
    for module, file in modules().items():
        if room_of(module) != "ros":
            text = file.read_text(encoding="utf-8")
            assert not re.search(r"^\s*(?:from|import) (?:rclpy|\w+_(?:msgs|interfaces))\b", text, re.MULTILINE), module
