"""The mailbox between a cycle and its viewer: letters, of which the newest wins."""

from __future__ import annotations

import contextlib
import math
import subprocess
import sys
import time

import numpy as np
from reports import (
    MARGIN,
    PLUG,
    ROOT,
    arc,
    report,
)

from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.safety.report import CycleReport, Margin, WarningKind
from cable_shape.shape import CableShape, Status
from cable_shape.viewer.letters import decode, encode
from cable_shape.viewer.mailbox import SLOT_BYTES, SLOTS, Mailbox


def test_letters_come_out_as_they_went_in() -> None:
    k = np.int64(4)
    sent = report(int(k))
    sent = CycleReport(
        stamp=sent.stamp,
        grips={
            "cable": (Grip(Pose((1, 2, 3)), "pinned", Pose((0, 0, 0.1), (1, 0, 0, 0)), (1, 2, 3)), None),
            "other": (Pose((1, 2, 3), turns=2), Pose()),
        },
        links=None,
        shapes=sent.shapes,
        clearance=sent.clearance,
        warnings=sent.warnings,
        times={"total": float(np.float64(1e-3))},
        skipped={"reused": k},
        margins={"cable": (MARGIN, Margin(WarningKind.STABILITY, np.float64(0.1), 0.0, 9.0, 0.3))},
        tails={("cable", "end"): arc(0.2)},
        after_snap={"cable": arc(0.3, Status.SNAPPED)},
        plugs={"cable": PLUG},
    )
    got = decode(encode(sent))
    assert (got.stamp, got.links, got.times, got.skipped) == (sent.stamp, None, {"total": 1e-3}, {"reused": 4})
    start, end = got.grips["cable"]
    assert end is None
    assert (start.pose, start.kind, start.offset) == (Pose((1, 2, 3)), "pinned", Pose((0, 0, 0.1), (1, 0, 0, 0)))
    np.testing.assert_array_equal(start.curvature, (1, 2, 3))
    np.testing.assert_allclose(start.cable_frame.position, (1, 2, 3.1))
    assert got.grips["other"] == (Pose((1, 2, 3), turns=2), Pose())
    for name in CableShape.__slots__:
        np.testing.assert_array_equal(getattr(got.shapes["cable"], name), getattr(sent.shapes["cable"], name), name)
    body, expected = got.clearance["cable"].closest, sent.clearance["cable"].closest
    assert (body.body, body.distance, body.arc_length) == (expected.body, expected.distance, expected.arc_length)
    np.testing.assert_array_equal(body.point_on_body, expected.point_on_body)
    assert got.clearance["cable"].robot_checked is True
    assert (got.warnings[0].text, got.warnings[0].kind) == (sent.warnings[0].text, WarningKind.CLEARANCE)
    assert got.warnings[0].margin == sent.warnings[0].margin
    assert math.isnan(got.warnings[0].time_to_limit)
    assert got.margins["cable"][0] == MARGIN
    assert math.isnan(got.margins["cable"][1].time_to_limit)
    np.testing.assert_array_equal(got.tails["cable", "end"].buffer, arc(0.2).buffer)
    assert got.after_snap["cable"].status is Status.SNAPPED
    assert got.plugs == {"cable": PLUG}


def test_a_free_end_comes_out_as_one() -> None:
    sent = CycleReport(0, {"cable": (Pose(), FreeEnd(mass=0.1))}, None, {"cable": arc()}, {}, ())
    start, end = decode(encode(sent)).grips["cable"]
    assert start == Pose()
    assert isinstance(end, FreeEnd)
    assert end.mass == 0.1
    branch = CycleReport(0, {"h/a": (None, Pose()), "h/b": (None, None)}, None, {"h/a": arc(), "h/b": arc()}, {}, ())
    assert decode(encode(branch)).grips == {"h/a": (None, Pose())}


@contextlib.contextmanager
def a_mailbox():
    mailbox = Mailbox(Mailbox.memory())
    try:
        yield mailbox
    finally:
        mailbox.close()


def test_mailbox_keeps_the_newest_letter() -> None:
    with a_mailbox() as mailbox:
        assert mailbox.take(0) is None
        for k in range(1, 3 * SLOTS):
            assert mailbox.put(b"letter %d" % k)
        assert mailbox.take(0) == (3 * SLOTS - 1, b"letter %d" % (3 * SLOTS - 1))
        assert mailbox.take(3 * SLOTS - 1) is None
        assert mailbox.taken == 1
        assert not mailbox.put(bytes(SLOT_BYTES + 1))
        assert mailbox.newest == 3 * SLOTS - 1


def test_reader_and_writer_at_once_tear_no_letter() -> None:
    """Another process writes as fast as it can; every letter taken is of one piece and they only go forward."""
    code = (
        "import sys, time; from cable_shape.viewer.mailbox import Mailbox\n"
        "box = Mailbox(int(sys.argv[1]))\n"
        "for k in range(20000):\n"
        "    taken = box.taken\n"
        "    box.put(bytes([k % 251]) * (1000 + k % 7000))\n"
        "    while k % 5000 == 0 and box.taken == taken: time.sleep(1e-3)\n"  # so that some are taken on any machine
        "    if k % 200 == 0: time.sleep(1e-3)\n"
    )
    with a_mailbox() as mailbox:
        writer = subprocess.Popen([sys.executable, "-c", code, str(mailbox.file)], pass_fds=[mailbox.file], cwd=ROOT)
        try:
            number, taken = 0, 0
            until = time.monotonic() + 120.0
            while number < 20000 and time.monotonic() < until:
                letter = mailbox.take(number)
                if letter is not None:
                    assert letter[0] > number
                    number, text = letter
                    taken += 1
                    k = number - 1
                    assert text == bytes([k % 251]) * (1000 + k % 7000)
            assert writer.wait(120.0) == 0
        finally:
            writer.kill()
    assert number == 20000
    assert taken > 2
