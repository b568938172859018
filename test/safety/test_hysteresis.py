"""Warnings begin at a limit and end below it: no chatter on a noisy signal, nothing kept over a reset."""

import math

import numpy as np
import pytest
from rods import ALONG_X, CABLE, START

import cable_shape as cs
from cable_shape.safety.report import Margin, Severity
from cable_shape.safety.report import WarningKind as Kind
from cable_shape.safety.warnings import Standing

SCENE = cs.Scene(warn_distance=0.03, error_distance=0.01)
LOADS = (Kind.TENSION, Kind.BEND_RADIUS, Kind.TWIST_RATE, Kind.STRESS, Kind.STABILITY)


def severities(kind: Kind, signal, scene: cs.Scene = SCENE) -> list:
    """What stands at each value of `used`."""
    standing = Standing(scene)
    out = []
    for used in signal:
        found = standing.judge((Margin(kind, used, 1.0, used, 0.0),))
        out.append(found[0][1] if found else None)
    return out


W, E = Severity.WARN, Severity.ERROR


@pytest.mark.parametrize("kind", LOADS)
def test_a_load_warns_at_nine_tenths_and_ends_five_percent_below(kind):
    signal = [0.5, 0.899, 0.9, 0.88, 0.856, 0.854, 0.88, 0.95, 0.999, 1.0, 0.99, 0.951, 0.949, 0.87, 0.85]
    expected = [None, None, W, W, W, None, None, W, W, E, E, E, W, W, None]
    assert severities(kind, signal) == expected


def test_stretch_warns_only_when_nearly_taut():
    assert severities(Kind.OVERSTRETCHED, [0.98, 0.99, 0.95, 0.94, 1.0, 0.96, 0.945, 0.94]) == [
        None, W, W, None, E, E, W, None,
    ]  # fmt: skip


def test_clearance_warns_below_its_distances_and_ends_above_them():
    def used(distance: float) -> float:
        return 2.0 - distance / 0.03

    distances = [0.0301, 0.03, 0.0299, 0.0314, 0.0316, 0.0314, 0.0101, 0.01, 0.0099, 0.0124, 0.0126, 0.0316]
    expected = [None, None, W, W, None, None, W, W, E, E, W, None]
    assert severities(Kind.CLEARANCE, map(used, distances)) == expected


@pytest.mark.parametrize(("kind", "at"), [(Kind.TENSION, 0.9), (Kind.TENSION, 1.0), (Kind.CLEARANCE, 1.0)])
def test_no_chatter_on_a_noisy_signal_around_a_limit(kind, at):
    """A slow rise and fall through the limit with 1 % of noise: each level begins once and ends once."""
    rng = np.random.default_rng(8)
    ramp = np.concatenate((np.linspace(0.8, 1.15, 2000), np.linspace(1.15, 0.8, 2000)))
    noisy = ramp + 0.01 * rng.uniform(-1.0, 1.0, ramp.size)
    crossings = int((np.diff(noisy >= at) != 0).sum())
    assert crossings > 50, "without hysteresis it would chatter"
    found = severities(kind, noisy)
    changes = [b for a, b in zip([None, *found], found, strict=False) if b is not a]
    if kind is Kind.CLEARANCE:
        assert changes == [W, None]
    else:
        assert changes == [W, E, W, None]


def test_each_body_and_each_kind_has_its_own():
    standing = Standing(SCENE)

    def judge(**used: float) -> set:
        margins = [Margin(Kind.CLEARANCE, x, 0.03, 0.0, 0.0, name) for name, x in used.items() if name != "tension"]
        margins.append(Margin(Kind.TENSION, used.get("tension", 0.0), 1.0, 0.0, 0.0))
        return {m.other or m.kind for m, _ in standing.judge(tuple(margins))}

    assert judge(post=1.01, box=0.97) == {"post"}
    assert judge(post=0.97, box=0.97) == {"post"}, "the other body does not inherit it"
    assert judge(tension=0.89) == set(), "nor does another kind; a body out of reach is forgotten"
    assert judge(post=0.97) == set()


def test_reset_forgets():
    standing = Standing(SCENE)
    near = (Margin(Kind.TENSION, 0.91, 1.0, 0.91, 0.0),)
    kept = (Margin(Kind.TENSION, 0.88, 1.0, 0.88, 0.0),)
    assert standing.judge(near)
    assert standing.judge(kept)
    standing.reset()
    assert not standing.judge(kept)


def test_what_is_not_known_is_not_warned_of():
    assert severities(Kind.STABILITY, [math.nan, 0.95, math.nan]) == [None, W, None]


def test_a_cycle_keeps_what_stands_and_its_reset_forgets_it():
    """The chord decides: the limit of tension is what the cable has at 1.1 m."""

    def ends(chord: float):
        return {"cable": (START, cs.Pose((chord, 0.0, 0.0), ALONG_X))}

    tension = cs.predict(CABLE, *ends(1.1)["cable"], model="cosserat").tension.max()
    cycle = cs.Cycle(CABLE.replace(max_tension=tension / 0.9), model="cosserat")
    kinds = [[w.kind for w in cycle.step(ends(c), k).warnings] for k, c in enumerate((1.098, 1.1001, 1.098))]
    assert kinds == [[], [Kind.TENSION], [Kind.TENSION]]
    cycle.reset()
    assert cycle.step(ends(1.098), 0).warnings == ()


@pytest.mark.parametrize(
    ("kind", "value", "limit", "says"),
    [
        (Kind.STRESS, 9.5e6, 1e7, "stress 9.5 MPa of at most 10 MPa, safety factor 1.05. Unload the cable there."),
        (Kind.STABILITY, 0.05, 0.0, "about to snap to another shape"),
        (Kind.OVERSTRETCHED, 1.195, 1.2, "the grips are 1.195 m apart, and at most 1.200 m is allowed."),
    ],
)
def test_words(kind, value, limit, says):
    from cable_shape.safety.warnings import warnings_of

    shape = cs.predict(CABLE, START, cs.Pose((0.8, 0, 0), ALONG_X), model="gradient4")
    margin = Margin(kind, 0.995, limit, value, 0.6, "", 0.25)
    (warning,) = warnings_of("left", CABLE, SCENE, shape, cs.Clearance(), margins=(margin,))
    assert warning.text.startswith("left: ")
    assert says in warning.text
    assert warning.text.endswith("At this speed the limit is reached in 0.25 s.")
    assert warning.time_to_limit == 0.25
    assert warning.margin == 0.995
    np.testing.assert_array_equal(warning.point_on_cable, shape.positions[round(0.5 * (shape.points - 1))])
