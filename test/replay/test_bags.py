"""Reading sound and damaged recordings; writing recordings that are the same every time."""

from __future__ import annotations

import json
import shutil
import sqlite3
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from recordings import (
    BEGIN,
    LEFT,
    MCAP,
    PERIOD,
    POSE,
    RIGHT,
    SQLITE3,
    Entry,
    cut,
    motion,
    storage_file,
    write_bag,
)
from rosbags.rosbag2 import CompressionMode, Reader, StoragePlugin

import cable_shape as cs
from cable_shape.replay.bag_writer import (
    MARGINS_TYPE,
    POINTS_TYPE,
    SHAPE_TYPE,
    WARNINGS_TYPE,
    BagWriter,
    cable_shape_store,
    message_folder,
)
from cable_shape.replay.bags import Bag
from cable_shape.replay.mcap_salvage import salvage_mcap

BOTH = (LEFT, RIGHT)


def stamps(bag: Bag) -> list[tuple[str, int]]:
    """(topic, stamp) of all messages of both grippers."""
    found = []
    for topic, _, message in bag.messages(BOTH):
        stamp = message.header.stamp
        found.append((topic, stamp.sec * 1_000_000_000 + stamp.nanosec))
    return found


def expected(frames: int) -> list[tuple[str, int]]:
    return [(entry.topic, entry.log_time) for entry in motion(frames)]


@pytest.mark.parametrize("storage", [MCAP, SQLITE3])
@pytest.mark.parametrize("single_file", [False, True])
def test_a_sound_recording_is_read_in_full(tmp_path: Path, storage: StoragePlugin, single_file: bool) -> None:
    folder = write_bag(tmp_path / "bag", motion(20), storage)
    with Bag(storage_file(folder) if single_file else folder) as bag:
        assert bag.types == {LEFT: POSE, RIGHT: POSE}
        assert bag.counts == {LEFT: 20, RIGHT: 20}
        assert stamps(bag) == expected(20)
        assert bag.problems == []
        assert bag.notes == []


@pytest.mark.parametrize(
    ("storage", "compression"),
    [
        (MCAP, CompressionMode.STORAGE),
        (MCAP, CompressionMode.MESSAGE),
        (MCAP, CompressionMode.FILE),
        (SQLITE3, CompressionMode.MESSAGE),
        (SQLITE3, CompressionMode.FILE),
    ],
)
def test_a_compressed_recording_is_read(tmp_path: Path, storage: StoragePlugin, compression: CompressionMode) -> None:
    folder = write_bag(tmp_path / "bag", motion(5), storage, compression)
    with Bag(folder) as bag:
        assert stamps(bag) == expected(5)
        assert bag.problems == []


@pytest.mark.parametrize("storage", [MCAP, SQLITE3])
def test_a_recording_without_metadata_is_read_file_by_file(tmp_path: Path, storage: StoragePlugin) -> None:
    folder = write_bag(tmp_path / "bag", motion(5), storage)
    (folder / "metadata.yaml").unlink()
    with Bag(folder) as bag:
        assert stamps(bag) == expected(5)
        assert bag.problems == []
        assert bag.notes == ["bag was read file by file: metadata.yaml is missing"]


def test_the_path_of_metadata_yaml_means_its_folder(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "bag", motion(2))
    with Bag(folder / "metadata.yaml") as bag:
        assert len(stamps(bag)) == 4


@pytest.mark.parametrize(
    ("compression", "frames", "cuts"), [(CompressionMode.NONE, 60, 25), (CompressionMode.STORAGE, 1500, 6)]
)
def test_a_truncated_mcap_gives_every_whole_message_before_the_cut(
    tmp_path: Path, compression: CompressionMode, frames: int, cuts: int
) -> None:
    whole = write_bag(tmp_path / "whole", motion(frames), MCAP, compression)
    size = storage_file(whole).stat().st_size
    read = []
    for part, at in enumerate(np.linspace(0.2 * size, 0.8 * size, cuts).astype(int)):
        folder = tmp_path / f"cut{part}"
        shutil.copytree(whole, folder)
        cut(folder, int(at))
        with Bag(folder) as bag:
            found = stamps(bag)
            assert found == expected(frames)[: len(found)]
            assert any("ends at byte" in problem for problem in bag.problems) or len(found) == 2 * frames
            if len(found) < 2 * frames:
                count = bag.read[LEFT]
                assert f"{LEFT}: {count} of {frames} messages read, {frames - count} missing" in bag.problems
        read.append(len(found))
    assert read == sorted(read), "a longer piece never gives less"
    assert len({count for count in read if 0 < count < 2 * frames}) >= 2, "the cuts fell between messages"


@pytest.mark.parametrize("size", [9, 30, 100])
def test_an_mcap_cut_before_its_topics_says_that_nothing_can_be_read(tmp_path: Path, size: int) -> None:
    folder = cut(write_bag(tmp_path / "bag", motion(3)), size)
    with pytest.raises(cs.BagError, match=f"nothing in this recording can be read.*ends at byte {size}"):
        Bag(folder)


def test_a_cut_in_the_index_of_an_mcap_loses_nothing(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "bag", motion(10))
    cut(folder, storage_file(folder).stat().st_size - 4)
    with Bag(folder) as bag:
        assert stamps(bag) == expected(10)
        assert bag.problems == []
        assert any("index of bag.mcap is missing or damaged" in note for note in bag.notes)


@pytest.mark.parametrize("with_metadata", [True, False])
def test_a_truncated_sqlite_file_gives_the_rows_before_the_cut(tmp_path: Path, with_metadata: bool) -> None:
    folder = write_bag(tmp_path / "bag", motion(400), SQLITE3)
    if not with_metadata:
        (folder / "metadata.yaml").unlink()
    cut(folder, storage_file(folder).stat().st_size // 2)
    with Bag(folder) as bag:
        found = stamps(bag)
    assert 100 < len(found) < 800
    assert found == expected(400)[: len(found)]
    assert any("bag.db3" in problem and f"after {len(found)} messages" in problem for problem in bag.problems)
    assert with_metadata == any("of 400 messages read" in problem for problem in bag.problems)


def test_a_damaged_chunk_is_left_out_and_named(tmp_path: Path) -> None:
    file = storage_file(write_bag(tmp_path / "bag", motion(10), MCAP, CompressionMode.STORAGE))
    sound = salvage_mcap(file, BOTH)
    assert (len(sound.messages), sound.lost) == (20, [])
    content = bytearray(file.read_bytes())
    frame = content.index(b"\x28\xb5\x2f\xfd")  # the magic number of zstd
    content[frame : frame + 4] = bytes(4)
    file.write_bytes(content)
    damaged = salvage_mcap(file, BOTH)
    assert damaged.messages == []
    assert damaged.lost == ["the chunk at byte 43 of bag.mcap is damaged and was left out"]


def test_a_message_that_cannot_be_decoded_is_counted(tmp_path: Path) -> None:
    entries = motion(3)
    entries.insert(2, Entry(LEFT, POSE, BEGIN + PERIOD - 1, raw=b"\x00\x01\x00\x00\xff"))
    with Bag(write_bag(tmp_path / "bag", entries)) as bag:
        assert stamps(bag) == expected(3)
    assert f"1 messages of {LEFT} are damaged and were left out" in bag.problems


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.mcap", None, "no such file or folder"),
        ("notes.txt", b"hello", "not a recording"),
        ("old.bag", b"#ROSBAG V2.0\n", "a ROS 1 bag. Convert it: rosbags-convert"),
        ("empty.mcap", b"", "empty.mcap is empty"),
        ("wrong.mcap", b"this is not an mcap file at all", "does not begin like an MCAP file"),
        ("wrong.db3", b"this is not a database at all, but text", "nothing in this recording can be read"),
    ],
)
def test_what_is_not_a_recording_is_refused_with_the_remedy(
    tmp_path: Path, name: str, content: bytes | None, message: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(cs.BagError, match=message):
        Bag(path)


def test_a_folder_without_a_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(cs.BagError, match=r"neither metadata\.yaml nor a \.mcap or \.db3 file"):
        Bag(tmp_path)


def test_a_database_without_the_tables_of_rosbag2_is_refused(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "other.db3") as connection:
        connection.execute("CREATE TABLE other(id INTEGER)")
    connection.close()
    with pytest.raises(cs.BagError, match=r"nothing in this recording can be read.*other\.db3"):
        Bag(tmp_path / "other.db3")


def report(stamp: int) -> cs.CycleReport:
    """A report with a shape of known numbers and one warning."""
    n = 5
    shape = cs.CableShape(
        np.arange(17.0 * n),
        n,
        length=1.2,
        model="gradient4",
        status=cs.Status.OVERSTRETCHED,
        detail="too far",
        energy=-0.5,
        error_estimate=1e-6,
        solve_time=3e-5,
    )
    warning = cs.CableWarning(
        cable_id="cable",
        kind=cs.WarningKind.CLEARANCE,
        severity=cs.Severity.ERROR,
        text="post is near",
        value=0.004,
        limit=0.01,
        margin=2.5,
        arc_length=0.3,
        point_on_cable=np.array((1.0, 2.0, 3.0)),
        point_on_other=np.array((4.0, 5.0, 6.0)),
        other="post",
    )
    return cs.CycleReport(
        stamp=stamp,
        grips={},
        links=None,
        shapes={"cable": shape},
        clearance={"cable": cs.Clearance(robot_checked=True)},
        warnings=(warning,),
        margins={"cable": (cs.Margin(cs.WarningKind.CLEARANCE, 1.2, 0.03, 0.024, 0.3, "post", 0.5),)},
    )


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    stamp = BEGIN + 123_456_789
    with BagWriter(tmp_path / "replay") as writer:
        writer.write(report(stamp), "cell")
    store = cable_shape_store()
    with Reader(tmp_path / "replay") as reader:
        (first, first_time, raw), (second, second_time, raw2), (third, third_time, raw3), last = reader.messages()
        shape, warnings = store.deserialize_cdr(raw, SHAPE_TYPE), store.deserialize_cdr(raw2, WARNINGS_TYPE)
        margins = store.deserialize_cdr(raw3, MARGINS_TYPE)
        points = store.deserialize_cdr(last[2], POINTS_TYPE)
        for connection, _, written in reader.messages():
            message = store.deserialize_cdr(written, connection.msgtype)
            assert bytes(store.serialize_cdr(message, connection.msgtype)) == written
        durability = [c.ext.offered_qos_profiles[0].durability.name for c in reader.connections]
    assert (first.topic, first.msgtype, first_time) == ("/cable/shape", SHAPE_TYPE, stamp)
    assert (second.topic, second.msgtype, second_time) == ("/cable/warnings", WARNINGS_TYPE, stamp)
    assert (third.topic, third.msgtype, third_time) == ("/cable/margins", MARGINS_TYPE, stamp)
    assert durability == ["VOLATILE", "TRANSIENT_LOCAL", "VOLATILE", "VOLATILE"]
    n = 5
    assert (last[0].topic, last[0].msgtype, last[1]) == ("/cable/points", POINTS_TYPE, stamp)
    assert [(field.name, field.offset, field.datatype) for field in points.fields] == [
        (name, 4 * i, 7) for i, name in enumerate(("x", "y", "z", "arc_length", "tension"))
    ]
    rows = np.frombuffer(points.data.tobytes(), "<f4").reshape(n, 5)
    assert (points.width, points.point_step, points.row_step) == (n, 20, 20 * n)
    np.testing.assert_array_equal(rows[:, :3].ravel(), shape.positions.astype("<f4"))
    np.testing.assert_array_equal(rows[:, 3], shape.arc_length.astype("<f4"))
    for name, begin, width in (
        ("arc_length", 0, 1),
        ("positions", 1, 3),
        ("quaternions", 4, 4),
        ("curvature", 8, 3),
        ("force", 11, 3),
        ("moment", 14, 3),
    ):
        np.testing.assert_array_equal(getattr(shape, name), np.arange(begin * n, (begin + width) * n, dtype=float))
    assert (shape.header.stamp.sec, shape.header.stamp.nanosec) == divmod(stamp, 10**9)
    assert (shape.header.frame_id, shape.cable_id, shape.model) == ("cell", "cable", "gradient4")
    assert (shape.status, shape.usable, shape.detail) == (4, False, "too far")
    assert (shape.length, shape.energy, shape.error_estimate) == (1.2, -0.5, 1e-6)
    assert shape.solve_time == 0.0
    (warning,) = warnings.warnings
    assert warnings.robot_checked
    assert (warning.kind, warning.severity, warning.other, warning.text) == (0, 2, "post", "post is near")
    assert (warning.value, warning.limit, warning.margin, warning.arc_length) == (0.004, 0.01, 2.5, 0.3)
    assert (warning.point_on_cable.x, warning.point_on_other.z) == (1.0, 6.0)
    assert np.isnan(warning.time_to_limit)
    (margin,) = margins.margins
    assert (margin.cable_id, margin.kind, margin.other) == ("cable", 0, "post")
    assert (margin.used, margin.limit, margin.value, margin.arc_length) == (1.2, 0.03, 0.024, 0.3)
    assert margin.time_to_limit == 0.5


def test_the_same_reports_give_the_same_bytes(tmp_path: Path) -> None:
    content = []
    for run in ("a", "b"):
        with BagWriter(tmp_path / run / "replay") as writer:
            for k in range(3):
                writer.write(report(BEGIN + k), "world")
        content.append([(tmp_path / run / "replay" / name).read_bytes() for name in ("replay.mcap", "metadata.yaml")])
    assert content[0] == content[1]


def test_only_an_earlier_replay_is_replaced(tmp_path: Path) -> None:
    folder = tmp_path / "replay"
    for _ in range(2):
        with BagWriter(folder) as writer:
            writer.write(report(BEGIN), "world")
    (folder / "precious.txt").write_text("mine")
    with pytest.raises(cs.BagError, match=r"holds other files \(precious.txt\)"):
        BagWriter(folder)
    assert (folder / "replay.mcap").is_file()


def test_message_hashes_are_those_of_the_built_package() -> None:
    built = Path(sys.prefix) / "share" / "cable_shape_msgs" / "msg"
    if not (built / "CableShape.json").is_file():
        pytest.skip(f"cable_shape_msgs is not built into {sys.prefix}")
    store = cable_shape_store()
    for name in ("CableShape", "CableWarnings"):
        hashes = json.loads((built / f"{name}.json").read_text())["type_hashes"]
        kind = f"cable_shape_msgs/msg/{name}"
        (published,) = (entry["hash_string"] for entry in hashes if entry["type_name"] == kind)
        assert store.hash_rihs01(kind) == published


def test_message_definitions_are_found_in_a_prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = message_folder()
    installed = tmp_path / "share" / "cable_shape_msgs" / "msg"
    shutil.copytree(source, installed)
    monkeypatch.setattr("cable_shape.replay.bag_writer.__file__", str(tmp_path / "else" / "where" / "bag_writer.py"))
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    assert message_folder() == installed
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    monkeypatch.setattr(sys, "prefix", "/nowhere")
    with pytest.raises(cs.DependencyError, match="message definitions of cable_shape_msgs were not found"):
        message_folder()


def test_the_layout_that_salvage_reads_is_that_of_the_format(tmp_path: Path) -> None:
    """A hand-made file: header, schema, channel, message without chunk, then a cut."""

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    def record(opcode: int, content: bytes) -> bytes:
        return struct.pack("<BQ", opcode, len(content)) + content

    content = b"\x89MCAP0\r\n"
    content += record(1, text("ros2") + text("test"))
    content += record(3, struct.pack("<H", 7) + text("a/msg/B") + text("ros2msg") + text(""))
    content += record(4, struct.pack("<HH", 9, 7) + text("/b") + text("cdr") + text(""))
    content += record(5, struct.pack("<HIQQ", 9, 0, 20, 20) + b"second")
    content += record(5, struct.pack("<HIQQ", 9, 0, 10, 10) + b"first")
    content += record(5, struct.pack("<HIQQ", 9, 0, 30, 30) + b"third")[:-1]
    file = tmp_path / "hand.mcap"
    file.write_bytes(content)
    found = salvage_mcap(file, ["/b"])
    assert found.types == {"/b": "a/msg/B"}
    assert found.messages == [("/b", 10, b"first"), ("/b", 20, b"second")]
    assert found.lost == [f"hand.mcap ends at byte {len(content)} within its messages, the rest is missing"]
