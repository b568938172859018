"""Writing a rosbag2 folder with the messages of the node: :class:`BagWriter`. The same input gives the same bytes."""

from __future__ import annotations

import contextlib
import os
import sys
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
    POINT_BYTES,
    POINT_FIELDS,
    margin_fields,
    point_rows,
    shape_fields,
    warning_fields,
)
from cable_shape.messages.pairing import SECOND
from cable_shape.prediction.layout import Layout
from cable_shape.safety.report import CableWarning, CycleReport

PACKAGE = "cable_shape_msgs"
MESSAGES = (
    "CableEdit", "CableEdits", "CableMargin", "CableMargins", "CableScene", "CableShape", "CableWarning",
    "CableWarnings",
)  # fmt: skip
SHAPE_TYPE = f"{PACKAGE}/msg/CableShape"
WARNING_TYPE = f"{PACKAGE}/msg/CableWarning"
WARNINGS_TYPE = f"{PACKAGE}/msg/CableWarnings"
MARGIN_TYPE = f"{PACKAGE}/msg/CableMargin"
MARGINS_TYPE = f"{PACKAGE}/msg/CableMargins"
EDITS_TYPE = f"{PACKAGE}/msg/CableEdits"
SCENE_TYPE = f"{PACKAGE}/msg/CableScene"
POINTS_TYPE = "sensor_msgs/msg/PointCloud2"


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
        field: Any = self.store.types["sensor_msgs/msg/PointField"]
        self._point_fields = [field(n, 4 * i, field.FLOAT32, 1) for i, n in enumerate(POINT_FIELDS)]

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
        for cable_id, shape in report.shapes.items():
            fields = {**shape_fields(cable_id, shape), "solve_time": 0.0}
            self._write(self._shape, SHAPE_TYPE, report.stamp, frame_id, fields)
        fields = {"robot_checked": report.robot_checked, "warnings": [self._warning(w) for w in report.warnings]}
        self._write(self._warnings, WARNINGS_TYPE, report.stamp, frame_id, fields)
        kind = self.store.types[MARGIN_TYPE]
        margins = [kind(**margin_fields(name, m)) for name, found in report.margins.items() for m in found]
        self._write(self._margins, MARGINS_TYPE, report.stamp, frame_id, {"margins": margins})
        rows = point_rows(report.shapes)
        cloud = {"height": 1, "width": len(rows), "fields": self._point_fields, "is_bigendian": False, "is_dense": True}
        cloud |= {"point_step": POINT_BYTES, "row_step": rows.nbytes, "data": rows.view(np.uint8).ravel()}
        self._write(self._points, POINTS_TYPE, report.stamp, frame_id, cloud)

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
        try:
            self._writer.write(connection, stamp, self.store.serialize_cdr(message, kind))
        except OSError:
            self._broken = True
            raise

    def _warning(self, warning: CableWarning) -> Any:
        """A CableWarning message."""
        types, fields = self.store.types, warning_fields(warning)
        for name in ("point_on_cable", "point_on_other"):
            fields[name] = types["geometry_msgs/msg/Point"](**fields[name])
        return types[WARNING_TYPE](**fields)

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
