"""Every reader of files, given what is no file of its kind: an error of the package at once, and nothing told of it."""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pytest
from recordings import motion, write_bag

import cable_shape as cs
from cable_shape.calibration.picture import _image
from cable_shape.calibration.tables import ARRAYS_BYTES
from cable_shape.command.load_case import load_case
from cable_shape.errors import BagError, RobotError
from cable_shape.replay import bounds
from cable_shape.replay.bags import Bag
from cable_shape.replay.observations import load_observations, load_points
from cable_shape.robots.robot import Gripper, Robot
from cable_shape.scene.mesh_files import read_triangles

GRIPPERS = {"left": Gripper("a"), "right": Gripper("b")}
READERS: dict[str, tuple[Callable[[Path], object], str]] = {
    "cable": (cs.Cable.from_yaml, "x.yaml"),
    "scene": (cs.Scene.from_yaml, "x.yaml"),
    "uncertainty": (cs.Uncertainty.from_yaml, "x.yaml"),
    "robot": (Robot.from_yaml, "x.yaml"),
    "urdf": (lambda path: Robot(path, GRIPPERS), "x.urdf"),
    "case": (load_case, "x.yaml"),
    "case in json": (load_case, "x.json"),
    "stl": (read_triangles, "x.stl"),
    "obj": (cs.Mesh.from_file, "x.obj"),
    "clicks": (lambda path: cs.calibrate_photo(path, cs.Cable(1.0, 0.1, 0.01)), "x.csv"),
    "points": (load_points, "x.csv"),
    "observations": (load_observations, "x.csv"),
    "arrays": (load_observations, "x.npz"),
    "recording in mcap": (Bag, "x.mcap"),
    "recording in sqlite3": (Bag, "x.db3"),
    "recorded observations": (load_observations, "x.mcap"),
    "picture": (_image, "x.png"),
}
each_reader = pytest.mark.parametrize(("read", "name"), READERS.values(), ids=READERS)


def refused_at_once(read: Callable[[Any], object], path: Any) -> str:
    began = process_time()
    with pytest.raises(cs.CableShapeError) as caught:
        read(path)
    assert process_time() - began < 10.0
    return str(caught.value)


@each_reader
def test_fifo_folder_dangling_link_device_and_nul(read: Callable[[Any], object], name: str, tmp_path: Path) -> None:
    kinds = ("fifo", "folder", "link", "device", "kernel", "nothing")
    for kind in kinds:
        (tmp_path / kind).mkdir()
    os.mkfifo(tmp_path / "fifo" / name)
    (tmp_path / "folder" / name).mkdir()
    (tmp_path / "link" / name).symlink_to(tmp_path / "gone")
    (tmp_path / "device" / name).symlink_to("/dev/zero")
    (tmp_path / "kernel" / name).symlink_to("/proc/kmsg")  # a regular file, and reading it waits
    for kind in kinds:
        assert str(tmp_path / kind / name) in refused_at_once(read, tmp_path / kind / name)
    refused_at_once(read, f"a\0b{name}" if name[2:] not in ("png",) else Path(f"a\0b{name}"))


@each_reader
def test_noise_and_other_files_are_refused_unquoted(read: Callable[[Any], object], name: str, tmp_path: Path) -> None:
    file = tmp_path / name
    for content in (
        b"",
        b"hunter2",
        b"hunter2:x:0:0:hunter2:/root:/bin/bash\n" * 3,
        b"hunter2: [hunter2",
        b"'hunter2\n\t- hunter2: {",
        b"<hunter2><hunter2>&hunter2;</hunter3>",
        b"solid hunter2\nvertex hunter2 hunter2 hunter2\nendsolid",
        b"v 0 0 hunter2\nf 1 2 hunter2\nf hunter2\n",
        b"\x89MCAP0\r\nhunter2",
        b"SQLite format 3\0hunter2",
        b"\x89PNG\r\n\x1a\nhunter2",
        bytes(range(256)) * 100,
        b"\x00" * 100_000,
    ):
        file.write_bytes(content)
        assert "hunter2" not in refused_at_once(read, file)


@each_reader
def test_files_beyond_the_bounds_are_not_read(read: Callable[[Any], object], name: str, tmp_path: Path) -> None:
    with (tmp_path / name).open("wb") as file:
        file.truncate(1 << 40)  # sparse
    refused_at_once(read, tmp_path / name)


def test_an_xml_that_is_larger_than_it_looks(tmp_path: Path) -> None:
    entities = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
    laughs = f'<!DOCTYPE robot [<!ENTITY e0 "ha">{entities}]><robot name="&e9;"/>'
    assert "no URDF has these" in refused_at_once(lambda text: Robot(text, GRIPPERS), laughs)
    deep = "<robot>" + "<link>" * 100_000
    assert "nested more than 64 deep" in refused_at_once(lambda text: Robot(text, GRIPPERS), deep)
    with pytest.raises(RobotError, match="not well-formed XML: mismatched tag, line 2"):
        Robot("<robot>\n<secret></robot>", GRIPPERS)


def test_a_mesh_that_a_urdf_names_is_judged_before_the_parser_opens_it(tmp_path: Path) -> None:
    geometry = "<collision><geometry><mesh filename='{}'/></geometry></collision>"
    text = f"<robot name='r'><link name='a'>{geometry}</link></robot>"
    with (tmp_path / "big.stl").open("wb") as file:
        file.truncate(1 << 40)
    os.mkfifo(tmp_path / "fifo.stl")
    for name, told in (("big.stl", "bytes are read"), ("fifo.stl", "is not found"), ("a\x01.stl", "not well-formed")):
        file_of_robot = tmp_path / "r.urdf"
        file_of_robot.write_text(text.format(name))
        assert told in refused_at_once(lambda path: Robot(path, GRIPPERS), file_of_robot)


def archive(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name, content in members.items():
            out.writestr(name, content)
    return path


def array(value: Any, allow_pickle: bool = False) -> bytes:
    out = io.BytesIO()
    np.save(out, np.asarray(value), allow_pickle=allow_pickle)
    return out.getvalue()


SOUND = {"start": np.tile(np.eye(7)[6], (2, 1)), "end": np.tile(np.eye(7)[6], (2, 1)), "points": np.ones((2, 3, 3))}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"points": np.ones((2, 3))}, r"points = 'shape \(2, 3\)' is not allowed: it must be \(n, m, 3\)"),
        ({"points": np.array(1.0)}, r"points = 'shape \(\)'"),
        ({"points": np.ones((2, 3, 2))}, r"it must be \(2, 3, 3\)"),
        ({"start": np.ones((1, 7))}, r"start = 'shape \(1, 7\)'"),
        ({"arc_length": np.ones(4)}, r"arc_length = 'shape \(4,\)'"),
        ({"acceleration": np.ones((1, 2, 3))}, r"acceleration = 'shape \(1, 2, 3\)'"),
        ({"acceleration": np.ones(2)}, r"acceleration = 'shape \(2,\)'"),
        ({"group": np.array([0.0, np.nan])}, "group .* whole numbers"),
        ({"group": np.ones(3)}, "group = 'shape"),
        ({"points": np.array(["secret"])}, "not a sound file of arrays of numbers"),
        ({"points": np.array([{}], dtype=object)}, "not a sound file of arrays of numbers"),
        ({"other": np.ones(1)}, "unknown key 'other'"),
    ],
)
def test_arrays_of_another_shape_or_kind(changes: dict[str, Any], told: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "seen.npz", **SOUND)
    assert len(load_observations(tmp_path / "seen.npz")) == 2
    np.savez(tmp_path / "seen.npz", **{**SOUND, **changes})
    with pytest.raises(cs.ArgumentError, match=told):
        load_observations(tmp_path / "seen.npz")


def test_an_archive_that_is_larger_than_it_looks(tmp_path: Path) -> None:
    zeros = bytes(ARRAYS_BYTES // 3)
    archive(tmp_path / "x.npz", {f"{i}.npy": zeros for i in range(4)})
    assert (tmp_path / "x.npz").stat().st_size < 1_000_000
    assert "when unpacked, at most" in refused_at_once(load_observations, tmp_path / "x.npz")
    head = array(np.ones(1)).replace(b"(1,)", b"(9" + b"9" * 12 + b",)")[:128]
    archive(tmp_path / "x.npz", {"points.npy": head})
    assert "not a sound file" in refused_at_once(load_observations, tmp_path / "x.npz")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x,y,z\n1,2\n", "line 2: z = '' is not allowed"),
        ("x,y,z\n1,2,secret\n", "line 2: z = 'secret' is not allowed: it must be a number"),
        ("x,y,x,z\n1,2,3,4\n", "line 1: a column is named twice"),
        ('x,y,z\n1,2,"' + "3" * 200_000 + '"\n', "line 2: it is no row of a table"),
        ("a,b\n", "its first line must name the columns x, y, z"),
    ],
)
def test_tables_that_are_wrong(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text(text)
    with pytest.raises(cs.FileError, match=told):
        load_points(tmp_path / "x.csv")


def metadata(bag: Path, **changes: Any) -> None:
    import yaml

    file = bag / "metadata.yaml"
    information = yaml.safe_load(file.read_text())["rosbag2_bagfile_information"] | changes
    file.write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))


MERGES = "a: &a {x: 1}\n" + "".join(
    f"b{i}: &b{i} {{<<: [{','.join(['*' + ('a' if i == 0 else f'b{i - 1}')] * 9)}]}}\n" for i in range(12)
)


def test_a_recording_that_is_larger_than_it_looks_is_read_file_by_file(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", motion(5))
    with Bag(bag) as sound:
        topics = tuple(sound.types)
        count = len(list(sound.messages(topics)))
        assert sound.notes == []
    (bag / "metadata.yaml").write_text(MERGES)
    began = process_time()
    with Bag(bag) as opened:
        assert len(list(opened.messages(topics))) == count
        assert "its aliases" in opened.notes[0]
    assert process_time() - began < 10.0


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")], ids=["fifo", "device"])
def test_a_recording_that_names_what_is_no_file(make: Callable[[Path], object], tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", motion(5))
    make(bag / "more.mcap")
    metadata(bag, relative_file_paths=["bag.mcap", "more.mcap"])
    with Bag(bag) as opened:
        assert len(list(opened.messages(tuple(opened.types)))) > 0
        assert "not a regular file" in opened.notes[0]
    (bag / "bag.mcap").unlink()
    with pytest.raises(BagError, match="nothing in this recording can be read"):
        Bag(bag)


def test_noughts_in_place_of_records_are_passed_over(tmp_path: Path) -> None:
    """So many, read one by one, would take half a minute."""
    from backports import zstd

    size = 200_000_000
    packed = zstd.compress(bytes(size))
    sizes = [number.to_bytes(8, "little") for number in (size, len(packed))]
    body = bytes(16) + sizes[0] + bytes(4) + b"\4\0\0\0zstd" + sizes[1] + packed
    (tmp_path / "x.mcap").write_bytes(b"\x89MCAP0\r\n\6" + len(body).to_bytes(8, "little") + body)
    refused_at_once(Bag, tmp_path / "x.mcap")


def test_yaml_inside_a_recording_is_read_strictly(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", motion(2))
    with Bag(bag) as opened:
        assert opened.types
    from rosbags.rosbag2.metadata import parse_qos

    began = process_time()
    with pytest.raises(cs.FileError, match="its aliases"):
        parse_qos(MERGES)
    assert process_time() - began < 10.0
    none = "{sec: 9223372036, nsec: 854775807}"
    (qos,) = parse_qos(
        f"- {{history: 1, depth: 5, reliability: 1, durability: 2, deadline: {none}, lifespan: {none}, liveliness: 1, "
        f"liveliness_lease_duration: {none}, avoid_ros_namespace_conventions: false}}\n"
    )
    assert qos.depth == 5


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_pieces_of_a_recording_are_unpacked_within_bounds(
    compression: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if compression == "zstd":
        from backports import zstd

        packed = zstd.compress(bytes(3_000_000))
    else:
        import lz4.frame

        packed = lz4.frame.compress(bytes(3_000_000))
    assert bounds.unpacked(packed, compression) == bytes(3_000_000)
    monkeypatch.setattr(bounds, "UNPACKED_BYTES", 1_000_000)
    from rosbags.rosbag2 import ReaderError

    with pytest.raises(ReaderError, match="larger than 1000000 bytes"):
        bounds.unpacked(packed, compression)


def test_the_command_says_it_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from cable_shape.command.cli import main

    os.mkfifo(tmp_path / "x.yaml")
    (tmp_path / "case.json").write_text(json.dumps({"cable": "x.yaml", "start": {"position": [0, 0, 0]}}))
    assert main(["predict", str(tmp_path / "case.json")]) == 2
    assert main(["calibrate", str(tmp_path / "x.yaml"), "--length", "1", "--mass", "0.1"]) == 2
    assert main(["calibrate", "--sag", "0.1", "--cable", "/dev/zero"]) == 2
    assert main(["replay", "/dev/zero", "-o", str(tmp_path / "out"), "--cable", "/dev/zero"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 4
    assert said.count("not a regular file") >= 3
