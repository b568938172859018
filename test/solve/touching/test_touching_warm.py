"""Steps from the last shape that take little: contacts that stand stand on, what friction carries goes on."""

import math
from unittest.mock import patch

import numpy as np
import pytest
from scene_certificate import judged

import cable_shape as cs
from cable_shape.solve.touching import step
from cable_shape.solve.touching.step import Steps

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(1.2, 0.1, 0.003, 0.003, diameter=0.004)


def on_table(friction):
    return cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace(), friction=friction)], contact="solve")


def ends(k):
    """Smooth steps of 0.1 mm; the cable lies on the table between the grips."""
    t = 5e-3 * k
    start = cs.Pose((0, 0.002 * math.sin(t), 0.03 + 0.02 * math.sin(t)), ALONG_X)
    return start, cs.Pose((1.13 + 0.01 * math.sin(1.4 * t), *start.position[1:]), ALONG_X)


def test_what_friction_carries_goes_on_from_step_to_step():
    """From what it carried last alone, steps took five iterations."""
    scene = on_table(0.4)
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat")
    took = []
    for k in range(100):
        shape = predictor.predict(*ends(k))
        assert shape.status is cs.Status.OK
        assert not judged(CABLE, scene, shape, shape.supports)
        took.append(shape.iterations)
    assert not shape.frictionless
    assert len(shape.contacts) > 15
    assert np.median(took[10:]) <= 3.0


def test_contacts_that_stand_stand_on_in_one_solve():
    predictor, other = (cs.Predictor(CABLE, scene=on_table(0.0), model="cosserat") for _ in range(2))
    ran: list[int] = []
    solve = step._SOLVE

    def told(*given):
        ran.append(given[16])
        return solve(*given)

    with patch.object(step, "_SOLVE", told):
        for k in range(20):
            predictor.predict(*ends(k))
        state = predictor._solver._touch
        assert not state.stood
        state.stood = True  # as after a road whose contacts stand
        ran.clear()
        for k in range(20, 40):
            shape = predictor.predict(*ends(k))
            assert shape.status is cs.Status.OK
            assert state.stood
        assert ran == [0] * 20
    for k in range(40):
        same = other.predict(*ends(k))
    assert shape.positions == pytest.approx(same.positions, abs=shape.error_estimate + same.error_estimate)


def test_a_body_that_moves_counts_from_where_it_was_when_contacts_do_not_stand_on(monkeypatch):
    """Else it would be past the cable unseen."""
    scene = cs.Scene(obstacles=[cs.Obstacle("tray", cs.HalfSpace(), link="arm")], contact="solve")
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat")

    def links(height):
        return {"arm": cs.Pose((0.0, 0.0, height))}

    for k in range(5):
        predictor.predict(*ends(k), links=links(0.0))
    state = predictor._solver._touch
    state.stood = True
    monkeypatch.setattr(Steps, "_square", property(lambda self: not self.still))
    asked = []
    go = Steps.go

    def told(self, *given, **named):
        asked.append((self.still, state.bodies.frames_then.copy()))
        return go(self, *given, **named)

    monkeypatch.setattr(Steps, "go", told)
    assert predictor.predict(*ends(5), links=links(1e-4)).status is cs.Status.OK
    (still, first), (runs, second) = asked
    assert still
    assert not runs
    assert second == pytest.approx(first, abs=0.0)


@pytest.mark.parametrize("why", ["it is none", "askew", "inexact"])
def test_where_contacts_that_stand_are_no_shape_they_run_again(why, monkeypatch):
    predictor, other = (cs.Predictor(CABLE, scene=on_table(0.0), model="cosserat") for _ in range(2))
    for one in (predictor, other):
        for k in range(20):
            one.predict(*ends(k))
    state = predictor._solver._touch
    state.stood = True
    if why == "it is none":
        go = Steps.go
        monkeypatch.setattr(Steps, "go", lambda self, *a, **b: not self.still and go(self, *a, **b))
    elif why == "askew":
        monkeypatch.setattr(Steps, "_square", property(lambda self: not self.still))
    else:
        monkeypatch.setattr(Steps, "_exact", lambda self: not self.still)
    shape, same = (one.predict(*ends(20)) for one in (predictor, other))
    assert not state.stood
    assert shape.status is cs.Status.OK
    assert shape.positions == pytest.approx(same.positions, abs=1e-6)
