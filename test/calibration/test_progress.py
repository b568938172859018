"""How far a fit is: shown on a terminal where it takes long, told to `proceed`, and nothing elsewhere."""

from __future__ import annotations

import io
import sys

import pytest

from cable_shape.calibration import progress
from cable_shape.calibration.progress import Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def shown(monkeypatch: pytest.MonkeyPatch, where: io.StringIO, on: bool = True) -> str:
    """What two iterations write there, whatever their time."""
    monkeypatch.setattr(progress, "_QUICK", 0.0)
    monkeypatch.setattr(sys, "stderr", where)
    with Progress(on) as told:
        told.what = "3 supports: "
        assert told.step(1, 2.5e-3)
        assert told._bar is not None or not on
        if told._bar is not None:
            told._bar.refresh()
    return where.getvalue()


def test_a_terminal_shows_iterations_and_misses(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, Terminal())
    assert "calibrate: 1 iterations" in text
    assert "3 supports: misses 2.5 mm" in text


def test_nothing_is_shown_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    assert shown(monkeypatch, io.StringIO()) == ""
    assert shown(monkeypatch, Terminal(), on=False) == ""


def test_proceed_is_asked_with_number_and_misses() -> None:
    asked = []

    def proceed(iteration: int, scale: float) -> bool:
        asked.append((iteration, scale))
        return iteration < 2

    with Progress(False, proceed) as told:
        assert [told.step(k, 1e-3 / k) for k in (1, 2)] == [True, False]
    assert asked == [(1, 1e-3), (2, 5e-4)]
