"""The bench of steps in contact: what it wraps to time them is called as the solver calls it."""

import contact_times
from figures import Figures


def test_steps_that_need_the_road_are_found_and_timed(capsys):
    contact_times.print_road(Figures())
    steps = int(capsys.readouterr().out.split("posts")[1].split()[0])
    assert steps >= 3
