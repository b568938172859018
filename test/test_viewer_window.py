"""The viewer on a screen, and pictures without one."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest
from reports import (
    CABLE,
    PERIOD,
    SCENE,
    T0,
    report,
    wait_until,
    write,
)

from cable_shape.errors import ArgumentError
from cable_shape.scene import Scene
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
        assert wait_until(lambda: viewer.shown == 1, within=60.0)
        ((window, command),) = commands_of(viewer.pid)
        assert "--memory-limit 64MB --server-memory-limit 64MB" in command
        assert "--bind 127.0.0.1" in command
        assert viewer.send(report(5))
        assert wait_until(lambda: shown_time(command) == T0 + 5 * PERIOD, within=60.0)
        os.kill(window, signal.SIGKILL)  # someone closes the window
        assert wait_until(lambda: not viewer.send(report(1)))
        viewer.close(timeout=20.0)
        window = None
    finally:
        if window is not None:
            os.kill(window, signal.SIGKILL)
        screen.terminate()
        screen.wait(10.0)


@pytest.mark.skipif(not vulkan(), reason="needs a Vulkan driver: apt-get install mesa-vulkan-drivers libvulkan1")
def test_screenshot_shows_the_cable(tmp_path: Path) -> None:
    from matplotlib.image import imread

    from cable_shape.viewer.screenshot import screenshot

    write(tmp_path / "out.rrd", [report(k) for k in range(3)])
    (tmp_path / "out.png").write_bytes(screenshot(tmp_path / "out.rrd", 0.02, (800, 500), settle=2.0))
    pixels = imread(tmp_path / "out.png")[..., :3] * 255.0
    assert pixels.shape == (500, 800, 3)
    scene = pixels[60:400, :500]
    yellow = np.abs(scene - (255.0, 213.0, 79.0)).max(axis=2) < 40.0  # the arc is at the middle of the scale
    assert yellow.sum() > 300
    with pytest.raises(ArgumentError, match=r"at = 9.0 is not allowed: the recording is 0.040 s long"):
        screenshot(tmp_path / "out.rrd", 9.0)
