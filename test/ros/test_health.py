"""What the diagnostics say, without ROS."""

import numpy as np
import pytest

from cable_shape.messages.pairing import SECOND
from cable_shape.ros.cycle_times import MOST_CYCLES, CycleTimes
from cable_shape.ros.diagnostics import Health, Level
from cable_shape.safety.report import CableWarning, CycleReport, Severity, WarningKind
from cable_shape.shape import CableShape, Status

TOPICS = ("left_gripper/pose", "right_gripper/pose")
T0 = 1000 * SECOND


def report(stamp, status=Status.OK, warnings=(), detail="", skipped=None):
    shape = CableShape(np.zeros(17 * 2), 2, length=1.0, model="gradient4", status=status, detail=detail)
    return CycleReport(
        stamp=stamp, grips={}, links=None, shapes={"cable": shape}, clearance={}, warnings=tuple(warnings),
        skipped=skipped or {},
    )  # fmt: skip


def active(stale_after=0.5):
    health = Health(stale_after)
    health.activate(TOPICS, T0)
    return health


def seen(health, now):
    for topic in TOPICS:
        health.arrived(topic, now)


def values_of(health, name, now):
    return next(v.values for v in health.verdicts(now) if v.name == name)


def said(health, name, now):
    verdict = next(v for v in health.verdicts(now) if v.name == name)
    return verdict.level, verdict.message


def test_waiting_names_the_topics_that_are_missing_and_those_that_came():
    health = active()
    level, text = said(health, "input", T0)
    assert level == Level.WARN
    assert "no message on left_gripper/pose and right_gripper/pose yet: nothing is published" in text
    health.arrived(TOPICS[0], T0)
    level, text = said(health, "input", T0)
    assert level == Level.WARN
    assert "no message on right_gripper/pose yet (left_gripper/pose came)" in text


def test_good_input_is_ok_with_rate_and_cycle_times():
    health = active()
    for i in range(1, 201):
        now = T0 + i * SECOND // 100
        seen(health, now)
        health.cycled(report(now), seconds=i * 1e-5, now=now)
    assert said(health, "input", now) == (Level.OK, "100.0 cycles a second")
    assert said(health, "prediction", now) == (Level.OK, "cable: OK")
    values = next(v.values for v in health.verdicts(now) if v.name == "prediction")
    assert float(values["cycle time p50 [ms]"]) == pytest.approx(1.0, rel=0.02)
    assert float(values["cycle time max [ms]"]) == pytest.approx(2.0, rel=0.01)


def test_cycle_times_are_those_of_the_last_seconds():
    health = active()
    for k, milliseconds in ((1, 50.0), (2, 50.0), (8, 1.0), (9, 3.0)):
        health.cycled(report(T0 + k * SECOND), 1e-3 * milliseconds, T0 + k * SECOND)
    values = values_of(health, "prediction", T0 + 9 * SECOND)
    assert float(values["cycle time p50 [ms]"]) == pytest.approx(2.0)
    assert float(values["cycle time max [ms]"]) == pytest.approx(3.0)
    values = values_of(health, "prediction", T0 + 60 * SECOND)  # no cycle in these seconds
    assert not any(key.startswith("cycle time") for key in values)


def test_more_cycles_than_are_kept_leave_the_newest():
    times = CycleTimes()
    for k in range(MOST_CYCLES + 100):
        times.add(float(k), T0)
    assert sorted(times.within(5.0, T0)) == [float(k) for k in range(100, MOST_CYCLES + 100)]
    assert times.last_end == T0


def test_skipped_work_is_added_up():
    health = active()
    for k in range(1, 4):
        health.cycled(report(T0 + k, skipped={"reused": 1, "snap_checks": 0}), 1e-3, T0 + k)
    values = values_of(health, "prediction", T0 + 3)
    assert (values["skipped reused"], values["skipped snap_checks"]) == ("3", "0")


def test_silence_becomes_stale_after_the_limit_and_only_then():
    health = active(stale_after=0.5)
    seen(health, T0)
    health.cycled(report(T0), 1e-3, T0)
    assert said(health, "input", T0 + SECOND // 2)[0] == Level.OK
    level, text = said(health, "input", T0 + SECOND)
    assert level == Level.WARN
    assert "stale: no message on left_gripper/pose and right_gripper/pose for 1.00 s, more than stale_after" in text


def test_a_refusal_is_an_error_until_answered_then_a_warning_for_a_while():
    health = active()
    seen(health, T0)
    health.refuse("pose", "left_gripper/pose: position = nan", T0)
    assert said(health, "input", T0 + 100) == (Level.ERROR, "left_gripper/pose: position = nan")
    health.cycled(report(T0), 1e-3, T0 + 200)
    assert said(health, "input", T0 + 300)[0] == Level.WARN
    later = T0 + 3 * SECOND
    seen(health, later)
    health.cycled(report(later), 1e-3, later)
    assert said(health, "input", later)[0] == Level.OK
    values = next(v.values for v in health.verdicts(later) if v.name == "input")
    assert values["refused: pose"] == "1"


def test_unpaired_input_says_why():
    health = active()
    health.hint = "no pair: stamps are 3 s apart"
    seen(health, T0 + SECOND)
    assert said(health, "input", T0 + SECOND) == (Level.WARN, "no pair: stamps are 3 s apart")


def test_stamps_off_the_clock_and_a_clock_that_never_ran_are_told():
    health = active()
    seen(health, T0)
    health.cycled(report(T0 - 10 * SECOND), 1e-3, T0)
    level, text = said(health, "input", T0)
    assert level == Level.WARN
    assert "10.000 s behind the node's clock" in text
    assert "use_sim_time" in text
    never = Health(0.5)
    never.activate(TOPICS, 0)
    assert "nothing came on /clock" in said(never, "input", 0)[1]


def test_a_clock_set_back_does_not_freeze_the_ages():
    health = active()
    seen(health, T0)
    health.cycled(report(T0), 1e-3, T0)
    back = T0 - 100 * SECOND
    health.verdicts(back)
    level, text = said(health, "input", back + 2 * SECOND)
    assert level == Level.WARN
    assert "stale" in text


@pytest.mark.parametrize(
    ("status", "level"),
    [(Status.UNSTABLE, Level.WARN), (Status.OVERSTRETCHED, Level.ERROR), (Status.NOT_CONVERGED, Level.ERROR)],
)
def test_a_status_that_is_not_ok_is_told_with_its_remedy(status, level):
    health = active()
    health.cycled(report(T0, status), 1e-3, T0)
    assert said(health, "prediction", T0) == (level, f"cable: {status.name}. {status.remedy}")


def test_a_remark_is_a_warning_for_a_while_and_never_an_error():
    health = active()
    seen(health, T0)
    health.remark("swap", "left and right have changed places", T0)
    assert said(health, "input", T0 + 100) == (Level.WARN, "left and right have changed places")
    values = next(v.values for v in health.verdicts(T0) if v.name == "input")
    assert values["remarked: swap"] == "1"
    later = T0 + 3 * SECOND
    seen(health, later)
    assert said(health, "input", later)[0] == Level.OK


def test_a_robot_whose_links_are_not_known_is_told():
    health = active()
    health.robot_expected = True
    health.cycled(report(T0), 1e-3, T0)
    level, text = said(health, "cable", T0)
    assert level == Level.WARN
    assert "clearance to the robot is not checked: no usable joint_states" in text


def test_troubles_of_the_node_itself_are_warnings():
    health = active()
    health.troubles = {"viewer": "the viewer has ended"}
    assert said(health, "lifecycle", T0) == (Level.WARN, "the viewer has ended")


def test_warnings_set_the_level_of_the_cable():
    zero = np.zeros(3)
    warning = CableWarning(
        "cable", WarningKind.CLEARANCE, Severity.ERROR, "2 mm from box", 0.002, 0.01, 5.0, 0.3, zero, zero
    )
    health = active()
    health.cycled(report(T0, warnings=[warning]), 1e-3, T0)
    assert said(health, "cable", T0) == (Level.ERROR, "2 mm from box")
    health.cycled(report(T0 + 1), 1e-3, T0 + 1)
    assert said(health, "cable", T0) == (Level.OK, "no warnings")


def test_a_failed_transition_is_an_error_and_inactive_input_is_not_judged():
    health = Health(0.5)
    health.failure = "configure failed: cable_file"
    assert said(health, "lifecycle", T0) == (Level.ERROR, "configure failed: cable_file")
    assert said(health, "input", T0) == (Level.OK, "unconfigured: input is not used")
