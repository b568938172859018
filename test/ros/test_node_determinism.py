"""The live node in simulated time gives the bits that the same pairs give without middleware."""

import array

import numpy as np
from builtin_interfaces.msg import Time
from conftest import CABLE_YAML
from harness import ALONG_X
from rosgraph_msgs.msg import Clock

from cable_shape.cable import Cable
from cable_shape.cycle import Cycle
from cable_shape.pose import Grip, Pose
from cable_shape.ros.fields import shape_fields

FIELDS = ("arc_length", "positions", "quaternions", "curvature", "force", "moment")


def test_the_same_pairs_give_the_same_bits(start, tmp_path):
    node = start(use_sim_time="true")
    clock = node.node.create_publisher(Clock, "/clock", 1)
    file = tmp_path / "cable.yaml"
    file.write_text(CABLE_YAML)
    cycle = Cycle(Cable.from_yaml(file))

    def play(k):
        stamp = 50_000_000_000 + 20_000_000 * k
        clock.publish(Clock(clock=Time(sec=stamp // 10**9, nanosec=stamp % 10**9)))
        ends = (0.0, 0.01 * np.sin(0.3 * k), 0.5), (0.8 + 0.1 * np.sin(0.2 * k), 0.0, 0.5)
        for side, place in enumerate(ends):
            node.pose(side, stamp, place)
        return stamp, [Grip(Pose(place, ALONG_X)) for place in ends]

    stamp, grips = play(0)  # until all topics have met; a repeated stamp is refused
    while node.shape_of(stamp) is None:
        node.spin(0.1)
        if node.shape_of(stamp) is None:
            node.pose(0, stamp, (0.0, 0.0, 0.5))
            node.pose(1, stamp, (0.8, 0.0, 0.5))
    cycle.step({"cable": grips}, stamp)
    for k in range(1, 40):
        stamp, grips = play(k)
        message = node.until(lambda stamp=stamp: node.shape_of(stamp), "shape of this pair")
        expected = shape_fields("cable", cycle.step({"cable": grips}, stamp).shapes["cable"])
        for name in FIELDS:
            assert getattr(message, name) == array.array("d", expected[name].tobytes()), (k, name)
        assert (message.model, message.energy) == (expected["model"], expected["energy"])
    assert node.process.stop() == 0
