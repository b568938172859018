"""The bound on length that knows friction: circles on a ball, and a motion in which friction holds a cable."""

import math

import contact_routing
import numpy as np
import pytest
from scene_held import Held, Stop, growth, turns
from scipy.spatial.transform import Rotation

import cable_shape as cs

BALL = 0.1


def circle(polar, friction, corners=2001):
    """A third of a circle of latitude on a ball, from one of the band's ends to the other."""
    around = np.linspace(0.0, math.tau / 3.0, corners)
    out = np.stack(
        (math.sin(polar) * np.cos(around), math.sin(polar) * np.sin(around), np.full(corners, math.cos(polar))), axis=1
    )
    return [Stop(BALL * n, n, friction) for n in out], BALL * math.sin(polar) * math.tau / 3.0


@pytest.mark.parametrize("polar", [0.5 * math.pi, 1.3, 1.8])
def test_what_slips_on_a_ball_grows_by_the_integral(polar):
    """There kappa_n = 1 / R and kappa_g = cot(polar) / R."""
    way, length = circle(polar, 0.4)
    into, along = turns(way)
    np.testing.assert_allclose(into.sum(), length / BALL, rtol=1e-3)
    np.testing.assert_allclose(along.sum(), length / BALL * abs(1.0 / math.tan(polar)), rtol=1e-3, atol=1e-9)
    cotangent = 1.0 / math.tan(polar)
    exact = math.exp(length / BALL * cotangent**2 / math.sqrt(0.4**2 - cotangent**2))
    np.testing.assert_allclose(growth(way), exact, rtol=1e-3)


@pytest.mark.parametrize("polar", [1.1, 2.0])
def test_friction_does_not_hold_steeper_circles(polar):
    assert abs(1.0 / math.tan(polar)) > 0.4
    assert growth(circle(polar, 0.4)[0]) == math.inf
    assert growth(circle(polar, 1.0)[0]) < math.inf


def test_no_shape_contradicts_it_and_what_has_been_slack_may_lie_elsewhere():
    given = contact_routing.motion("clips", 13)
    (cable,) = given.cables.values()
    clips = given.clips["cable"]
    cycle = cs.Cycle(given.cables, scene=given.scene, clips=given.clips, model="cosserat", points=301)
    hold, ways = Held(cable, given.scene, clips), [step["cable"] for step in given.steps]
    found, last = [], None
    for k, ends in enumerate(ways[:66]):
        shape = cycle.step({"cable": ends}, stamp=10_000_000 * k).shapes["cable"]
        if hold.too_short(*ends):
            assert not (shape.usable and hold.contradicts(shape, *ends)), k
            found.append(k)
        if shape.usable:
            last = shape
            hold.lie(shape)
    assert len(found) > 3
    far = found[-1]
    hold.lie(last)
    assert hold.too_short(*ways[far])
    assert not hold.too_short(*ways[found[0] - 10])  # its ends come nearer
    assert not hold.too_short(*ways[far])
    hold.lie(last)
    assert hold.too_short(*ways[far])

    lacking, rough = hold.lacking, last.again()
    rough.error_estimate += 1e-4
    hold.lie(rough)
    assert hold.too_short(*ways[far])
    assert 1e-5 < lacking - hold.lacking < 1e-4
    rough.frictionless = False
    for error, contradicts in ((0.9 * hold.lacking, True), (1.1 * hold.lacking, False)):
        rough.error_estimate = error
        assert hold.contradicts(rough, *ways[far]) == contradicts
    rough.error_estimate, rough.frictionless = 0.0, True
    assert not hold.contradicts(rough, *ways[far])

    outward, past = (last.positions[-1] + at for at in way_on(last))
    assert not hold.eases(ways[0][0], cs.Pose(outward))
    assert hold.eases(ways[0][0], cs.Pose(past))


def way_on(shape):
    """(3,), (3,): straight on from where it touches last, and so far round that place that the way cuts the corner."""
    free = shape.positions[-1] - max(shape.contacts, key=lambda contact: contact.arc_length).point
    round_it = Rotation.from_euler("z", 120.0, degrees=True).apply(free)
    return 0.05 * free, 1.05 * round_it - free
