"""What a cycle skips: the same answers without each shortcut, and each of them fires."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from demo_cell import cable_ends, minimum_jerk
from problems import ALONG_X, CABLE, START, motion, planar_motion

import cable_shape as cs
from cable_shape.solve.problem import NAMED_TOLERANCE

CONFIG = Path(__file__).resolve().parents[2] / "config"
NAME = "cable"
HORIZON = 1.0  # s, of the look ahead: the cycle's own default


class Job(NamedTuple):
    """A motion in a scene; period [ns] from pose to pose."""

    cable: cs.Cable
    scene: cs.Scene | None
    grips: list[tuple[cs.Pose, cs.Pose]]
    period: int = 100_000_000


class Shortcut(NamedTuple):
    """How it is off before and after each step, what it may change in tolerances (0: not a bit), and its count."""

    before: Callable[[cs.Cycle], bool]
    after: Callable[[cs.Cycle], bool]
    bound: float
    count: str


def all_pairs(cycle: cs.Cycle) -> bool:
    """Every pair of segment and body is looked at."""
    cycle._cables[NAME]._checker.cull = False
    return True


def anew(cycle: cs.Cycle) -> bool:
    """Solves although nothing moved."""
    cycle._cables[NAME].predictor._last = None
    return True


def look_ahead(cycle: cs.Cycle) -> bool:
    """Follows the rod's copy to the horizon although stability does not run out; False: a snap was not told."""
    cable = cycle._cables[NAME]
    if cable._watch.twists is None or cable.predictor.rod_state is None:
        return True
    return cable._snap_within(HORIZON) is None or cable.after_snap is not None


def nothing(cycle: cs.Cycle) -> bool:
    return True


SHORTCUTS = {
    "culling of bodies": Shortcut(all_pairs, nothing, 0.0, "pairs_culled"),
    "reuse of the last shape": Shortcut(anew, nothing, 1.0, "reused"),
    "snap look-ahead on demand": Shortcut(nothing, look_ahead, 0.0, "snap_checks"),
}


def to_and_fro(poses: list[cs.Pose]) -> list[tuple[cs.Pose, cs.Pose]]:
    """A motion of the end there and back."""
    return [(START, pose) for pose in (*poses, *poses[-2:0:-1])]


def jobs() -> dict[str, Job]:
    """A scene that is shipped, and motions without one in which other shortcuts matter."""
    demo = cs.Cable.from_yaml(CONFIG / "cables" / "demo.yaml")
    bodies = cs.Scene.from_yaml(CONFIG / "scenes" / "bench_cell.yaml")
    grips = [cable_ends(minimum_jerk(t)) for t in np.linspace(0.0, 20.0, 40)]
    taut = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=1e-6)
    spans = [cs.Pose((1.194 - 0.004 * x, 0.0, 0.05 * x), ALONG_X) for x in np.linspace(0.0, 1.0, 40)[::5]]
    return {
        "among bodies": Job(demo, bodies, grips, 500_000_000),
        "motion M": Job(CABLE, None, to_and_fro(motion()[::5])),
        "planar motion": Job(CABLE, None, to_and_fro(planar_motion()[::5])),
        "taut thin span": Job(taut, None, to_and_fro(spans)),
    }


JOBS = jobs()
CASES = [(job, name) for job in JOBS for name in SHORTCUTS if JOBS[job].scene or not name.startswith("culling")]


@pytest.mark.parametrize(("which", "name"), CASES)
def test_a_shortcut_changes_nothing_and_fires(which: str, name: str) -> None:
    job, shortcut = JOBS[which], SHORTCUTS[name]
    with_it, without = (cs.Cycle(job.cable, scene=job.scene) for _ in range(2))
    apart, fired, same = 0.0, 0, True
    for k, grips in enumerate(job.grips):
        stamp = job.period * (k + 1)
        on = with_it.step({NAME: grips}, stamp=stamp)
        same &= shortcut.before(without)
        off = without.step({NAME: grips}, stamp=stamp)
        same &= shortcut.after(without)
        a, b = on.shapes[NAME], off.shapes[NAME]
        near = [{body.body: body.distance for body in one.clearance[NAME].bodies} for one in (on, off)]
        same &= bool((a.buffer == b.buffer).all()) and near[0] == near[1] and a.status is b.status
        apart = max(apart, float(np.linalg.norm(a.positions - b.positions, axis=1).max()))
        fired += on.skipped[shortcut.count] > 0
    assert same if shortcut.bound == 0.0 else apart <= shortcut.bound * NAMED_TOLERANCE * job.cable.length
    assert fired or name.startswith("reuse")  # where grips rest


def test_the_last_shape_is_given_again_where_grips_rest() -> None:
    cycle = cs.Cycle(CABLE)
    pose = motion()[0]
    reports = [cycle.step({NAME: (START, pose)}, stamp=k * 10_000_000) for k in range(3)]
    assert [report.skipped["reused"] for report in reports] == [0, 1, 1]
