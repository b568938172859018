"""Recordings of fast motion: frames that are lost are found in how the grips move."""

from __future__ import annotations

import numpy as np
import pytest
from motion_real import RATE, times_of

NOISE = 3e-5  # m, of markers


def swung(lost: set[int]) -> tuple[np.ndarray, np.ndarray]:
    """Markers (T, 4, 3) [m] of two grips that swing, without these frames of 400, and times (T,) [s]."""
    times = np.array([k for k in range(400) if k not in lost]) / RATE
    x = np.stack((0.2 * np.sin(4.0 * times), 0.1 * np.cos(3.0 * times), 0.05 * np.sin(7.0 * times)), axis=1)
    offsets = np.array(((0.0, 0.0, 0.0), (0.05, 0.0, 0.0), (0.6, 0.1, 0.0), (0.65, 0.1, 0.0)))
    noise = NOISE * np.random.default_rng(1).standard_normal((len(times), 4, 3))
    return x[:, None] + offsets + noise, times


@pytest.mark.parametrize("lost", [set(), {50}, set(range(120, 129)), {33, 34, *range(250, 256)}], ids=len)
def test_frames_that_are_lost_are_found(lost: set[int]):
    markers, times = swung(lost)
    assert times_of(markers) == pytest.approx(times, abs=1e-9)


def test_a_grip_that_starts_or_stops_at_once_has_lost_none():
    t = np.arange(100) / RATE
    x = np.clip(t - 0.3, 0.0, 0.4) * 0.8
    markers = np.stack((x, 0.0 * x, 0.0 * x), axis=1)[:, None] + np.zeros((1, 4, 1))
    markers = markers + NOISE * np.random.default_rng(2).standard_normal(markers.shape)
    assert times_of(markers) == pytest.approx(t, abs=1e-9)


def test_grips_at_rest_have_lost_none():
    markers = np.zeros((100, 4, 3)) + NOISE * np.random.default_rng(3).standard_normal((100, 4, 3))
    assert times_of(markers) == pytest.approx(np.arange(100) / RATE, abs=1e-9)
