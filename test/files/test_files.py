"""Files that a user or a peer names: only regular ones are read, within bounds, and nothing in them is told."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path
from time import process_time

import pytest

import cable_shape as cs
from cable_shape.files.files import TEXT_BYTES, YAML_BYTES, path_of, read_bounded, read_text, regular, safe_output
from cable_shape.files.yaml_files import load_yaml

AT_ONCE = 10.0  # s of this process, whatever else keeps the processor busy


def fifo(folder: Path) -> Path:
    os.mkfifo(folder / "fifo.yaml")
    return folder / "fifo.yaml"


def dangling(folder: Path) -> Path:
    (folder / "link.yaml").symlink_to(folder / "nothing")
    return folder / "link.yaml"


def listening(folder: Path) -> Path:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(folder / "s.yaml"))
    return folder / "s.yaml"


def in_a_circle(folder: Path) -> Path:
    (folder / "a").symlink_to(folder / "b")
    (folder / "b").symlink_to(folder / "a")
    return folder / "a"


NOT_FILES: list[tuple[Callable[[Path], Path], str]] = [
    (fifo, "it is a FIFO, not a regular file"),
    (dangling, "no such file"),
    (listening, "it is a socket, not a regular file"),
    (in_a_circle, "cannot be opened: Too many levels of symbolic links"),
    (lambda folder: folder, "it is a folder, not a regular file"),
    (lambda folder: folder / "nothing" / "deeper", "no such file"),
    (lambda _: Path("/dev/zero"), "it is a device, not a regular file"),
    (lambda _: Path("a\0b"), "has NUL in it"),
    (lambda _: Path("~nobody_of_this_name/x"), "no such user's home"),
    (lambda _: Path("x" * 5000), "File name too long"),
]


@pytest.mark.parametrize(("make", "text"), NOT_FILES)
@pytest.mark.parametrize("read", [cs.Cable.from_yaml, cs.Scene.from_yaml, cs.Uncertainty.from_yaml, read_text, regular])
def test_what_is_no_regular_file_is_refused_at_once(
    make: Callable[[Path], Path], text: str, read: Callable[[Path], object], tmp_path: Path
) -> None:
    began = process_time()
    with pytest.raises(cs.InputError, match=text) as caught:
        read(make(tmp_path))
    assert isinstance(caught.value, cs.ArgumentError)
    assert process_time() - began < AT_ONCE


@pytest.mark.parametrize("path", [3, None, b"cable.yaml", 1.5, ["cable.yaml"]])
def test_what_is_no_path_is_refused(path: object) -> None:
    with pytest.raises(cs.ArgumentError, match="it must be a path"):
        path_of(path)  # type: ignore[arg-type]


def test_no_more_is_read_than_allowed_whatever_the_file_says_of_its_size(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"x" * 1001)
    with pytest.raises(cs.FileError, match="at most 1000 bytes are read"):
        read_bounded(file, 1000)
    assert read_bounded(file, 1001) == b"x" * 1001
    maps = Path("/proc/self/maps")  # regular, and its size is said to be 0
    assert maps.stat().st_size == 0
    assert len(read_bounded(maps, TEXT_BYTES)) > 1000
    with pytest.raises(cs.FileError, match="at most 1000 bytes are read"):
        read_bounded(maps, 1000)


def test_a_large_file_is_not_even_begun(tmp_path: Path) -> None:
    file = tmp_path / "cable.yaml"
    with file.open("wb") as opened:
        opened.truncate(1 << 40)
    began = process_time()
    for read in (load_yaml, lambda path: regular(path, YAML_BYTES)):
        with pytest.raises(cs.FileError, match=f"{YAML_BYTES}"):
            read(file)
    assert process_time() - began < AT_ONCE


def test_text_that_is_not_utf8_is_refused_by_its_line_without_quoting_it(tmp_path: Path) -> None:
    file = tmp_path / "cable.yaml"
    file.write_bytes(b"length: 1\n# secret \xff\n")
    with pytest.raises(cs.FileError, match=r"cable.yaml, line 2: it is not text in UTF-8") as caught:
        load_yaml(file)
    assert "secret" not in str(caught.value)
    assert "ff" not in str(caught.value).split("line 2")[1]


def test_a_file_that_may_not_be_read_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "cable.yaml"
    file.write_text("length: 1\n")
    file.chmod(0)
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)  # root reads everything
    try:
        with pytest.raises(cs.FileError, match="Permission denied"):
            load_yaml(file)
    finally:
        os.seteuid(user)


def test_output_goes_below_its_folder_and_over_its_own_kind_only(tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "deep").mkdir(parents=True)
    assert safe_output(out, "a.rrd", [".rrd"]) == out / "a.rrd"
    assert safe_output(out, out / "deep" / "a.yaml") == out / "deep" / "a.yaml"
    (out / "old.rrd").write_bytes(b"RRF2\0")
    (out / "empty.rrd").touch()
    (out / "cable.yaml").write_text("# Calibrated; standard errors\nlength: 1\n")
    for name in ("old.rrd", "empty.rrd", "cable.yaml"):
        assert safe_output(out, name) == out / name
    link = tmp_path / "to_out"
    link.symlink_to(out)
    assert safe_output(link, link / "a.rrd") == out / "a.rrd"


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("/etc/passwd", "it must end in .rrd"),
        ("/etc/a.rrd", "files are written only below"),
        ("../a.rrd", "files are written only below"),
        ("deep/../../a.rrd", "files are written only below"),
        ("away/a.rrd", "files are written only below"),
        ("nowhere/a.rrd", "its folder must exist"),
        (".rrd", "it must end in .rrd"),
        ("a.yaml", "it must end in .rrd"),
        ("other.rrd", "something is there that is no rrd file"),
        ("link.rrd", "something is there that is no rrd file"),
        ("hard.rrd", "something is there that is no rrd file"),
        ("fifo.rrd", "something is there that is no rrd file"),
        ("folder.rrd", "something is there that is no rrd file"),
        ("a\0.rrd", "NUL"),
        (3, "it must be a path"),
    ],
)
def test_output_elsewhere_is_refused(path: str, text: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "deep").mkdir(parents=True)
    (out / "folder.rrd").mkdir()
    (out / "away").symlink_to("/etc")
    (out / "other.rrd").write_text("what somebody wrote")
    (tmp_path / "mine.rrd").write_bytes(b"RRF2")
    (out / "link.rrd").symlink_to(tmp_path / "mine.rrd")
    os.link(tmp_path / "mine.rrd", out / "hard.rrd")
    os.mkfifo(out / "fifo.rrd")
    with pytest.raises(cs.ArgumentError, match=text):
        safe_output(out, path, [".rrd"])


def test_without_an_output_folder_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(cs.ArgumentError, match="no output folder is set"):
        safe_output("", tmp_path / "a.rrd")
    with pytest.raises(cs.ArgumentError, match="its folder must exist"):
        safe_output(tmp_path / "gone", "a.rrd")
