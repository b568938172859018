"""XML that is not trusted: no DOCTYPE, no entities but the five, bounded size and depth. :func:`read_xml`"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.parsers import expat

from cable_shape.errors import FileError
from cable_shape.files.files import path_of, read_bounded

#: Larger files are refused.
MOST_BYTES = 128 * 1024 * 1024
#: Elements within each other.
MOST_DEPTH = 64
_REMEDY = "Save it again as XML in UTF-8, as its first line says"


class _Begun(Exception):  # noqa: N818, no error
    """The top element has begun: nothing can be declared any more."""


def read_xml(path: str | Path, what: str = "file") -> ElementTree.Element:
    """The top element of an XML file.

    Raises
    ------
    FileError
        Naming the file, line and remedy: not well formed, of another encoding than it says, with a DOCTYPE (entities,
        which may stand for more than memory holds, or for other files), too large or too deep.
    """
    data = read_bounded(path, MOST_BYTES, what)
    file = path_of(path)
    _check_prolog(data, file, what)
    parser: Any = ElementTree.XMLPullParser(("end",))
    try:
        parser.feed(data)
        parser.close()
        root: ElementTree.Element | None = None
        for _, root in parser.read_events():  # noqa: B007, the last one to end is the top
            pass
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise _malformed(file, error) from None
    assert root is not None
    if _too_deep(root):
        raise FileError(f"{file}: elements are nested more than {MOST_DEPTH} deep. Is it the right {what}?")
    return root


def _check_prolog(data: bytes, file: Path, what: str) -> None:
    """Refuses what declares anything before its top element, whatever encoding it is in."""

    def refuse(*_: object) -> None:
        remedy = "Remove it, and what it declares; nothing of it is read."
        raise FileError(f"{file}, line {parser.CurrentLineNumber}: a DOCTYPE, which no {what} needs. {remedy}")

    def begin(*_: object) -> None:
        raise _Begun

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = begin
    try:
        parser.Parse(data, True)
    except _Begun:
        return
    except FileError:
        raise
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise _malformed(file, error) from None


def _malformed(file: Path, error: Exception) -> FileError:
    place = getattr(error, "position", None) or (getattr(error, "lineno", None), None)
    line = f", line {place[0]}" if place[0] else ""
    code = getattr(error, "code", None)
    reason = expat.ErrorString(code) if isinstance(code, int) else "its encoding is not known"
    return FileError(f"{file}{line}: not well-formed XML: {reason}. {_REMEDY}.")


def _too_deep(root: ElementTree.Element) -> bool:
    level = [root]
    for _ in range(MOST_DEPTH):
        level = [child for element in level for child in element]
        if not level:
            return False
    return True


def tag(element: ElementTree.Element) -> str:
    """The name of an element without its namespace."""
    return element.tag.rpartition("}")[2]


def children(element: ElementTree.Element, name: str) -> Iterator[ElementTree.Element]:
    """Its children of this name, in whatever namespace."""
    return (child for child in element if tag(child) == name)


def text(element: ElementTree.Element | None, name: str) -> str:
    """The text of the first child of this name; empty where there is none, or where it stands for no value."""
    for child in () if element is None else children(element, name):
        found = (child.text or "").strip()
        return "" if found == "/NULL" else found
    return ""
