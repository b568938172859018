"""The live node in simulated time gives the bits that the same pairs give without middleware."""

import array

import numpy as np
from builtin_interfaces.msg import Time
from conftest import CABLE_YAML
from harness import ALONG_X, nanoseconds
from recordings import PERIOD, ends_at, motion, write_bag
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock

from cable_shape.cable.cable import Cable
from cable_shape.cycle.cycle import Cycle
from cable_shape.messages.fields import shape_fields
from cable_shape.pose import Grip, Pose
from cable_shape.replay.bag_writer import cable_shape_store
from cable_shape.replay.run import replay
from cable_shape.replay.settings import Settings

FIELDS = ("arc_length", "positions", "quaternions", "curvature", "force", "moment")
FOR_SURE = 20  # pairs at the beginning that are not dropped


def test_the_same_pairs_give_the_same_bits(start, tmp_path):
    node = start(use_sim_time="true")
    clock = node.node.create_publisher(Clock, "/clock", 1)
    file = tmp_path / "cable.yaml"
    file.write_text(CABLE_YAML)
    cycle = Cycle(Cable.from_yaml(file))

    for k in range(40):
        stamp = 50_000_000_000 + 20_000_000 * k
        clock.publish(Clock(clock=Time(sec=stamp // 10**9, nanosec=stamp % 10**9)))
        ends = (0.0, 0.01 * np.sin(0.3 * k), 0.5), (0.8 + 0.1 * np.sin(0.2 * k), 0.0, 0.5)
        message = node.shape_at(stamp, *ends)
        grips = [Grip(Pose(place, ALONG_X)) for place in ends]
        expected = shape_fields("cable", cycle.step({"cable": grips}, stamp).shapes["cable"])
        for name in FIELDS:
            assert getattr(message, name) == array.array("d", expected[name].tobytes()), (k, name)
        assert (message.model, message.energy) == (expected["model"], expected["energy"])
    assert node.process.stop() == 0


def test_a_recording_played_live_gives_the_bits_of_its_replay_until_a_pair_is_dropped(start, tmp_path, cable_file):
    """Played by the recording's clock, at ten times its speed; after a drop the same within the tolerance."""
    frames = motion(120, skew=0)
    cable = Cable.from_yaml(cable_file)
    replay(write_bag(tmp_path / "bag", frames), tmp_path / "out", Settings(cable=cable, rrd=False, picture=False))
    store = cable_shape_store()
    with Reader(tmp_path / "out" / "replay") as reader:
        wanted = [c for c in reader.connections if c.topic == "/cable/shape"]
        replayed = {time: store.deserialize_cdr(raw, c.msgtype) for c, time, raw in reader.messages(wanted)}
    assert len(replayed) == 120

    node = start(use_sim_time="true")
    clock = node.node.create_publisher(Clock, "/clock", 1)
    played = sorted(replayed)
    for k, stamp in enumerate(played):
        clock.publish(Clock(clock=Time(sec=stamp // 10**9, nanosec=stamp % 10**9)))
        if k < FOR_SURE or k == len(played) - 1:
            node.shape_at(stamp, *ends_at(k))
            continue
        for side, place in enumerate(ends_at(k)):
            node.pose(side, stamp, place)
        node.spin(1e-10 * PERIOD)
    live = {nanoseconds(message.header.stamp): message for message in node.shapes}
    whole = True
    for stamp in played:
        if stamp not in live:
            whole = False
            continue
        got, expected = live[stamp], replayed[stamp]
        if whole:
            assert got.model == expected.model
            for name in FIELDS:
                assert np.array_equal(getattr(got, name), getattr(expected, name)), name
        else:
            apart = np.subtract(got.positions, expected.positions)
            assert np.abs(apart).max() < 2e-5 * cable.length  # each within the tolerance
    assert all(stamp in live for stamp in played[:FOR_SURE])  # so that some were compared to the bit
    assert node.process.stop() == 0
