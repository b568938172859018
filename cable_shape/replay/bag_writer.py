"""Writing a rosbag2 folder with the messages of the node: :class:`BagWriter`. The same input gives the same bytes."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, final

import numpy as np
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from cable_shape.errors import BagError, DependencyError
from cable_shape.messages.edits import scene_fields
from cable_shape.messages.fields import (
    ARRAYS,
    POINT_BYTES,
    POINT_FIELDS,
    margin_fields,
    point_rows,
    shape_fields,
    warning_fields,
)
from cable_shape.messages.pairing import SECOND
from cable_shape.prediction.layout import Layout
from cable_shape.replay.cdr import packed
from cable_shape.safety.report import CycleReport

PACKAGE = "cable_shape_msgs"
MESSAGES = (
    "CableEdit", "CableEdits", "CableMargin", "CableMargins", "CableScene", "CableShape", "CableWarning",
    "CableWarnings",
)  # fmt: skip
SHAPE_TYPE = f"{PACKAGE}/msg/CableShape"
WARNINGS_TYPE = f"{PACKAGE}/msg/CableWarnings"
MARGINS_TYPE = f"{PACKAGE}/msg/CableMargins"
EDITS_TYPE = f"{PACKAGE}/msg/CableEdits"
SCENE_TYPE = f"{PACKAGE}/msg/CableScene"
POINTS_TYPE = "sensor_msgs/msg/PointCloud2"

# The messages' fields in their order, as codes of cdr.
_HEAD = "iIs"
_SHAPE_FIELDS = (
    "cable_id", "model", "status", "usable", "detail", "length", *(name for name, _ in ARRAYS), "energy",
    "error_estimate", "reused", "solve_time",
)  # fmt: skip
_SHAPE = "ssB?sdDDDDDDdd?d"
_WARNING = "sBBsddddddddddds"
_MARGIN = "sBsddddd"
_FLOAT32 = 7
_POINT_FIELDS = [len(POINT_FIELDS), *(v for i, name in enumerate(POINT_FIELDS) for v in (name, 4 * i, _FLOAT32, 1))]
_POINTS = f"III{len(POINT_FIELDS) * 'sIBI'}?IIy?"


@final
class BagWriter:
    """A new rosbag2 folder (mcap) with /cable/shape, /cable/warnings, /cable/margins and, to be drawn by others,
    /cable/points, and where there are edits /cable/edits and /cable/scene; a context manager.

    An earlier folder made by this class is replaced, anything else is left alone.

    Raises
    ------
    BagError
        If `folder` exists and holds anything but an earlier recording of this class.
    DependencyError
        If the message definitions of cable_shape_msgs are not found.
    """

    def __init__(
        self,
        folder: Path,
        shape_topic: str = "/cable/shape",
        warnings_topic: str = "/cable/warnings",
        margins_topic: str = "/cable/margins",
        points_topic: str = "/cable/points",
    ) -> None:
        self.store = cable_shape_store()
        self._edits: tuple[Connection, Connection] | None = None
        self._broken = False  # a write failed, so that another one would come after half a record
        _make_room(folder)
        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        self._shape = self._connect(shape_topic, SHAPE_TYPE, QosDurability.VOLATILE)
        self._warnings = self._connect(warnings_topic, WARNINGS_TYPE, QosDurability.TRANSIENT_LOCAL)
        self._margins = self._connect(margins_topic, MARGINS_TYPE, QosDurability.VOLATILE)
        self._points = self._connect(points_topic, POINTS_TYPE, QosDurability.VOLATILE)

    def _connect(self, topic: str, kind: str, durability: QosDurability) -> Connection:
        """A topic with the quality of service that the node offers."""
        never = QosTime(0, 0)
        qos = Qos(
            QosHistory.KEEP_LAST,
            1,
            QosReliability.RELIABLE,
            durability,
            never,
            never,
            QosLiveliness.SYSTEM_DEFAULT,
            never,
            False,
        )
        return self._writer.add_connection(topic, kind, typestore=self.store, offered_qos_profiles=[qos])

    def write(self, report: CycleReport, frame_id: str) -> None:
        """The messages that the node would have sent for this report, at its stamp and with solve_time 0."""
        head = (*divmod(report.stamp, SECOND), frame_id)
        for cable_id, shape in report.shapes.items():
            fields = {**shape_fields(cable_id, shape), "solve_time": 0.0}
            values = [fields[name] for name in _SHAPE_FIELDS]
            self._put(self._shape, report.stamp, packed(_HEAD + _SHAPE, (*head, *values)))
        told = [value for warning in report.warnings for value in _flat(warning_fields(warning))]
        codes, values = f"{_HEAD}?I{len(report.warnings) * _WARNING}", [report.robot_checked, len(report.warnings)]
        self._put(self._warnings, report.stamp, packed(codes, (*head, *values, *told)))
        margins = [margin_fields(name, margin) for name, found in report.margins.items() for margin in found]
        told = [value for margin in margins for value in margin.values()]
        codes = f"{_HEAD}I{len(margins) * _MARGIN}"
        self._put(self._margins, report.stamp, packed(codes, (*head, len(margins), *told)))
        rows = point_rows(report.shapes)
        values = [1, len(rows), *_POINT_FIELDS, False, POINT_BYTES, rows.nbytes, rows, True]
        self._put(self._points, report.stamp, packed(_HEAD + _POINTS, (*head, *values)))

    def write_edits(self, message: Any, layout: Layout, stamp: int, frame_id: str) -> None:
        """A CableEdits that was repeated before the cycle of `stamp` [ns], and what it made."""
        if self._edits is None:
            topics = (("/cable/edits", EDITS_TYPE), ("/cable/scene", SCENE_TYPE))
            one, other = (self._connect(topic, kind, QosDurability.TRANSIENT_LOCAL) for topic, kind in topics)
            self._edits = one, other
        fields = {"number": message.number, "cable_id": message.cable_id, "edits": message.edits}
        self._write(self._edits[0], EDITS_TYPE, stamp, frame_id, fields)
        scene: dict[str, Any] = {"number": message.number, **scene_fields(layout)}
        for name, kind in (("starts", np.float64), ("ends", np.float64), ("opened", np.uint8)):
            scene[name] = np.array(scene[name], dtype=kind)
        self._write(self._edits[1], SCENE_TYPE, stamp, frame_id, scene)

    def _write(self, connection: Connection, kind: str, stamp: int, frame_id: str, fields: dict[str, Any]) -> None:
        types = self.store.types
        time = types["builtin_interfaces/msg/Time"](*divmod(stamp, SECOND))
        message = types[kind](header=types["std_msgs/msg/Header"](time, frame_id), **fields)
        self._put(connection, stamp, self.store.serialize_cdr(message, kind))

    def _put(self, connection: Connection, stamp: int, message: bytes | memoryview) -> None:
        try:
            self._writer.write(connection, stamp, message)
        except OSError:
            self._broken = True
            raise

    def close(self) -> None:
        """Finishes the files; after an OSError they stay as they are, to be read up to the last whole message."""
        try:
            if not self._broken:
                self._writer.close()
        except OSError:
            self._broken = True
            raise
        finally:
            if self._broken:
                with contextlib.suppress(OSError):
                    self._file().close()

    def _file(self) -> Any:
        """The .mcap that rosbags has open."""
        storage: Any = self._writer.storage
        return storage.bio

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _flat(fields: Mapping[str, Any]) -> Iterator[Any]:
    """Values, those of points one by one."""
    for value in fields.values():
        if isinstance(value, dict):
            yield from value.values()
        else:
            yield value


def cable_shape_store() -> Typestore:
    """The messages of ROS 2 Jazzy and of cable_shape_msgs."""
    folder = message_folder()
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name in MESSAGES:
        types.update(get_types_from_msg((folder / f"{name}.msg").read_text(encoding="utf-8"), f"{PACKAGE}/msg/{name}"))
    store.register(types)
    return store


def message_folder() -> Path:
    """Where the .msg files are: in the source tree, else in a prefix of AMENT_PREFIX_PATH or that of this Python.

    There they are those of the built messages, or the copies that the wheel of this package brings.
    """
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    prefixes.append(Path(sys.prefix))
    candidates = [
        Path(__file__).resolve().parents[2] / "msg_defs" / "msg",
        *(prefix / "share" / PACKAGE / "msg" for prefix in prefixes),
        *(prefix / "share" / "cable_shape" / "msg" for prefix in prefixes),
    ]
    for folder in candidates:
        if all((folder / f"{name}.msg").is_file() for name in MESSAGES):
            return folder
    raise DependencyError(
        f"The message definitions of {PACKAGE} were not found in {', '.join(str(c) for c in candidates)}. "
        "Run scripts/test or scripts/demo once, or source the workspace in which colcon built them."
    )


def _make_room(folder: Path) -> None:
    """Removes an earlier recording of this class at `folder`; refuses to touch anything else."""
    if folder.is_dir():
        ours = {"metadata.yaml", "metadata.yaml.tmp", f"{folder.name}.mcap"}
        others = sorted(file.name for file in folder.iterdir() if file.name not in ours)
        if others:
            raise BagError(f"{folder} holds other files ({', '.join(others[:3])}). Choose another output folder.")
        for name in ours:
            (folder / name).unlink(missing_ok=True)
        folder.rmdir()
    elif folder.exists():
        raise BagError(f"{folder} is a file. Choose another output folder.")
