"""What scripts/soak --files reads: all kinds of files with readers, sound ones, bombs, and what is no file at all."""

from __future__ import annotations

import collections
import contextlib
import importlib
import io
import operator
import os
import socket
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

CONFIG = Path(__file__).resolve().parents[1] / "config"
MERGES = "a: &a {length: 1}\n" + "".join(
    f"b{i}: &b{i} {{<<: [{','.join(['*' + ('a' if i == 0 else f'b{i - 1}')] * 9)}]}}\n" for i in range(12)
)
ALIASES = "length: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12)
)
CHAIN = "length: &c0 []\n" + "".join(f"a{k}: &c{k} [*c{k - 1}]\n" for k in range(1, 2000))
ENTITIES = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
LAUGHS = f'<!DOCTYPE robot [<!ENTITY e0 "ha">{ENTITIES}]><robot name="&e9;"/>'
SOLID = (
    "solid a\n" + "facet normal 0 0 1\nouter loop\n" + "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
)


#: Readers of each kind of file, by module and name.
READERS: dict[str, tuple[str, ...]] = {
    "yaml": (
        "cable.cable:Cable.from_yaml", "scene.scene:Scene.from_yaml", "ros.assembly:load_cables",
        "robots.robot:Robot.from_yaml", "uncertainty.uncertainty:Uncertainty.from_yaml",
        "command.load_case:load_case",
    ),
    "json": ("command.load_case:load_case",),
    "urdf": ("robots.robot:Robot",),
    "stl": ("scene.solids:Mesh.from_file",),
    "obj": ("scene.solids:Mesh.from_file",),
    "csv": (
        "replay.observations:load_observations", "replay.observations:load_points", "calibration.photo:is_photo",
        "calibration.photo:load_clicks",
    ),
    "npz": ("replay.observations:load_observations",),
    "mcap": ("replay.bags:Bag",),
    "db3": ("replay.bags:Bag",),
}  # fmt: skip


def read(kind: str, file: Path) -> None:
    """By every reader of the kind: it reads, or refuses with a CableShapeError."""
    from cable_shape.errors import CableShapeError

    for name in READERS[kind]:
        module, _, path = name.partition(":")
        reader = operator.attrgetter(path)(importlib.import_module(f"cable_shape.{module}"))
        with contextlib.suppress(CableShapeError):
            if kind == "urdf":
                reader(file, _grippers()).link_poses()
            elif kind in ("mcap", "db3"):
                with reader(file) as bag:
                    collections.deque(bag.messages(tuple(bag.types)), maxlen=0)
            else:
                reader(file)


def _grippers() -> dict[str, Any]:
    from cable_shape.pose import Pose
    from cable_shape.robots.robot import Gripper

    return {side: Gripper(f"{side}_tool", Pose((0.0, 0.0, 0.0))) for side in ("left", "right")}


def sound(kind: str, folder: Path) -> list[bytes]:
    """Sound files of this kind."""
    if kind in ("yaml", "urdf"):
        return [file.read_bytes() for file in sorted(CONFIG.rglob(f"*.{kind}"))]
    if kind in ("mcap", "db3"):
        from cell_replay import write_recording

        write_recording(folder / kind, kind, 6)
        return [(folder / kind / f"{kind}.{kind}").read_bytes()]
    return {
        "json": [
            b'{"cable": {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.01}, "start": {"position": '
            b'[0, 0, 0]}, "end": {"position": [0.8, 0, 0], "quaternion": [0, 0, 0, 1]}, "model": "auto"}'
        ],
        "stl": [
            (SOLID + "endsolid a\n").encode(),
            bytes(80) + b"\x02\0\0\0" + np.arange(24, dtype="<f4").tobytes()[:100],
        ],
        "obj": [b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf -1//2 -2//3 -3//1 1/1/1\n"],
        "csv": [
            b"observation,what,x,y,z,qx,qy,qz,qw,arc_length\n0,start,0,0,0,0,0,0,1,\n0,end,1,0,0,0,0,0,1,\n"
            b"0,point,.5,0,-.1,,,,,.6\n",
            b"what,u,v,x,y\nknown,0,0,0,0\nknown,9,0,1,0\nstart,0,0,,\nend,9,0,,\npoint,4,3,,\npoint,5,3,,\npoint,6,3,,\n",
        ],
        "npz": [_arrays(start=np.eye(7)[[6, 6]], end=np.eye(7)[[6, 6]], points=np.ones((2, 3, 3)), group=[0, 1])],
    }[kind]


def bombs(kind: str) -> list[bytes]:
    """Small files that stand for huge ones, or nest deeply, or lie about their size."""
    deep = "[" * 100_000
    many = {
        "yaml": [
            MERGES,
            ALIASES,
            CHAIN,
            f"length: {deep}",
            "length: 1" + "0" * 5000,
            "length: &a [*a]",
            "length: 1:30\n",
        ],
        "json": [f'{{"cable": {deep}', '{"cable": 1' + "0" * 5000 + "}", '{"cable": 1, "cable": 2}'],
        "urdf": [LAUGHS, "<robot>" + "<link>" * 100_000],
        "stl": ["solid " + "vertex 1e999 " * 1000 + "endsolid"],
        "obj": ["f " + "1 " * 300_000, "v 0 0 0\nf " + "9" * 5000 + " 1 1\n"],
        "csv": ['x,y,z\n"' + "1" * 200_000],
    }.get(kind, [])
    out = [text.encode() for text in many]
    if kind == "npz":
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in ("start", "end", "points"):
                archive.writestr(f"{name}.npy", bytes(150_000_000))
        head = io.BytesIO()
        np.save(head, np.ones(1))
        lying = head.getvalue().replace(b"(1,)", b"(9" + b"9" * 12 + b",)")
        out += [packed.getvalue(), _zip({"points.npy": lying})]
    if kind == "mcap":
        from backports import zstd

        chunk = zstd.compress(bytes(400_000_000))
        body = (
            b"\0" * 16
            + (400_000_000).to_bytes(8, "little")
            + bytes(4)
            + b"\4\0\0\0zstd"
            + len(chunk).to_bytes(8, "little")
        )
        record = b"\6" + (len(body) + len(chunk)).to_bytes(8, "little") + body + chunk
        out.append(b"\x89MCAP0\r\n" + record)
    return out


def _arrays(**arrays: object) -> bytes:
    out = io.BytesIO()
    np.savez(out, **arrays)  # type: ignore[arg-type]
    return out.getvalue()


def _zip(members: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


def _socket(file: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(file))


def _sparse(file: Path) -> None:
    with file.open("wb") as out:
        out.truncate(1 << 40)


#: Puts at a path what no reader may open, wait for, or read to its end.
NO_FILES: dict[str, Callable[[Path], object]] = {
    "FIFO": os.mkfifo,
    "device without end": lambda file: file.symlink_to("/dev/zero"),
    "device without content": lambda file: file.symlink_to("/dev/null"),
    "terminal": lambda file: file.symlink_to("/dev/tty"),
    "file of the kernel": lambda file: file.symlink_to("/proc/kmsg"),
    "memory": lambda file: file.symlink_to("/proc/self/mem"),
    "socket": _socket,
    "folder": Path.mkdir,
    "dangling link": lambda file: file.symlink_to(file.with_name("nothing")),
    "link to itself": lambda file: file.symlink_to(file),
    "huge and empty": _sparse,
}


def removed(file: Path) -> None:
    """Makes room at a path."""
    if file.is_dir() and not file.is_symlink():
        file.rmdir()
    else:
        file.unlink(missing_ok=True)
