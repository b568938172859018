"""The viewer on a screen, and pictures without one."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from reports import (
    CABLE,
    PERIOD,
    ROOT,
    SCENE,
    T0,
    report,
    wait_until,
    write,
)

from cable_shape.errors import ArgumentError
from cable_shape.scene.scene import Scene
from cable_shape.viewer.process import ViewerProcess


def test_window_needs_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(ArgumentError, match=r"neither DISPLAY nor WAYLAND_DISPLAY is set. Write a .rrd instead"):
        ViewerProcess("window", {}, Scene())


def vulkan() -> bool:
    return any(folder.is_dir() and any(folder.glob("*.json")) for folder in (Path("/usr/share/vulkan/icd.d"),))


def commands_of(pid: int) -> list[tuple[int, str]]:
    """(pid, command line) of the children of a process."""
    out = []
    for folder in Path("/proc").iterdir():
        with contextlib.suppress(OSError, ValueError):
            if folder.name.isdecimal() and int((folder / "stat").read_text().rsplit(")")[1].split()[1]) == pid:
                out.append((int(folder.name), (folder / "cmdline").read_text().replace("\0", " ")))
    return out


def shown_time(command: str) -> int | None:
    """The time [ns] that the window with this command line shows."""
    from rerun.experimental import ViewerClient

    port = command.split("--port ")[1].split()[0]
    recordings = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy").get_state().recordings
    return recordings[0].current_time if recordings else None


def listening(pid: int) -> list[tuple[str, int]]:
    """Addresses and ports on which a process takes connections."""
    sockets = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            sockets.add(os.readlink(entry).removeprefix("socket:[").rstrip("]"))
    found = []
    for table in ("tcp", "tcp6"):
        for line in Path("/proc/net", table).read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and words[9] in sockets:
                address, port = words[1].split(":")
                place = socket.inet_ntoa(bytes.fromhex(address)[::-1]) if table == "tcp" else address
                found.append((place, int(port, 16)))
    return found


@pytest.mark.parametrize(("options", "address"), [((), "127.0.0.1"), (("--bind", "127.0.0.2"), "127.0.0.2")])
def test_view_listens_where_it_is_told_and_else_on_this_machine_only(
    tmp_path: Path, options: tuple[str, ...], address: str
) -> None:
    write(tmp_path / "out.rrd", [report(k) for k in range(3)])
    command = [sys.executable, "-m", "cable_shape.command.cli", "view", "--web", *options, str(tmp_path / "out.rrd")]
    with (tmp_path / "log").open("w") as log:
        view = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, cwd=ROOT)
    viewers: list[tuple[int, str]] = []
    try:
        assert wait_until(lambda: bool(viewers.extend(commands_of(view.pid)) or viewers))
        pid = viewers[0][0]
        assert wait_until(lambda: len(listening(pid)) == 2), (tmp_path / "log").read_text()
        assert {place for place, _ in listening(pid)} == {address}
    finally:
        for pid, _ in viewers[:1]:
            os.kill(pid, signal.SIGTERM)
        view.send_signal(signal.SIGINT)
        view.wait(120.0)


@pytest.mark.skipif(
    not (shutil.which("Xvfb") and vulkan()),
    reason="needs Xvfb and Mesa: apt-get install xvfb mesa-vulkan-drivers libvulkan1 libxkbcommon-x11-0",
)
def test_window_opens_under_a_memory_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    screen = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), "-screen", "0", "800x600x24", "-nolisten", "tcp"],
        pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    window = None
    try:
        with open(reading) as numbers:
            monkeypatch.setenv("DISPLAY", f":{numbers.readline().strip()}")
        monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
        viewer = ViewerProcess("window", {"cable": CABLE}, SCENE, memory_limit="64MB")
        assert viewer.send(report(0))
        assert wait_until(lambda: viewer.shown == 1)
        ((window, command),) = commands_of(viewer.pid)
        assert "--memory-limit 64MB --server-memory-limit 64MB" in command
        assert "--bind 127.0.0.1" in command
        assert viewer.send(report(5))
        assert wait_until(lambda: shown_time(command) == T0 + 5 * PERIOD)
        os.kill(window, signal.SIGKILL)  # someone closes the window
        assert wait_until(lambda: not viewer.send(report(1)))
        viewer.close(timeout=20.0)
        window = None
    finally:
        if window is not None:
            os.kill(window, signal.SIGKILL)
        screen.terminate()
        screen.wait(120.0)


@pytest.mark.skipif(not vulkan(), reason="needs a Vulkan driver: apt-get install mesa-vulkan-drivers libvulkan1")
def test_screenshot_shows_the_cable(tmp_path: Path) -> None:
    from matplotlib.image import imread

    from cable_shape.viewer.screenshot import screenshot

    write(tmp_path / "out.rrd", [report(k) for k in range(3)])
    for settle in (2.0, 10.0, 60.0):  # s, as long as this machine needs
        (tmp_path / "out.png").write_bytes(screenshot(tmp_path / "out.rrd", 0.02, (800, 500), settle=settle))
        pixels = imread(tmp_path / "out.png")[..., :3] * 255.0
        assert pixels.shape == (500, 800, 3)
        scene = pixels[60:400, :500]
        yellow = np.abs(scene - (255.0, 213.0, 79.0)).max(axis=2) < 40.0  # the arc is at the middle of the scale
        if yellow.sum() > 300:
            break
    assert yellow.sum() > 300
    with pytest.raises(ArgumentError, match=r"at = 9.0 is not allowed: the recording is 0.040 s long"):
        screenshot(tmp_path / "out.rrd", 9.0)
