"""Where a search for a harness from nothing starts: what is laid out, and how often."""

from __future__ import annotations

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.solve import harness_search
from cable_shape.solve.harness_guess import laid
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import HarnessProblem

ALONG_X = (0.5, 0.5, 0.5, 0.5)
ARM = cs.Cable(length=0.4, linear_density=0.05, bending_stiffness=0.004)
FORK = cs.Junction("fork", ("a.end", "b.start", "c.start"))
HARNESS = cs.Harness({"a": ARM, "b": ARM, "c": ARM.replace(length=0.2)}, [FORK])
ENDS = {"a.start": cs.Pose((0.0, 0.0, 1.0), ALONG_X), "b.end": cs.Pose((0.7, 0.0, 1.0), ALONG_X)}


def test_spans_lead_on_from_their_frames_and_none_is_stretched() -> None:
    state = HarnessNetwork(HarnessProblem(HARNESS).move(ENDS))
    poses = laid(state, state.aim(), 1.0)
    layout = state.layout
    for span, (first, last) in zip(layout.structure.spans, layout.arcs, strict=True):
        way = poses[span.end, :3] - poses[span.start, :3]
        assert np.linalg.norm(way) < 1.01 * (last - first)
    fork, tip = (poses[layout.knots[name]] for name in (("junction", "fork"), ("end", "c.end")))
    assert fork[2] < 1.0  # it hangs
    assert tip[0] > fork[0] + 0.1  # c leads on from a
    assert abs(np.linalg.norm(fork[3:]) - 1.0) < 1e-12
    still = [layout.knots["end", end] for end in ENDS]
    np.testing.assert_array_equal(poses[still], state.aim()[still])


def test_each_way_to_lay_it_out_is_gone_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def counted(state: HarnessNetwork, poses: np.ndarray, load: float) -> np.ndarray:
        calls.append(load)
        return laid(state, poses, load)

    monkeypatch.setattr(harness_search, "laid", counted)
    monkeypatch.setattr(harness_search.HarnessSearch, "call", lambda *_, **__: False)
    monkeypatch.setattr(harness_search.HarnessSearch, "_settled", lambda _: False)
    assert cs.predict(HARNESS, ENDS).status is cs.Status.NOT_CONVERGED
    assert sorted(calls) == sorted(set(calls))
