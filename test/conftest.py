"""What all tests share: the same examples in every run; ROS on this machine alone, where no other tests are."""

import os
import zlib

from hypothesis import settings


def domain() -> int:
    """1 to 101, for which Linux keeps ports free; the workers of one run have one after the other."""
    run = os.environ.get("PYTEST_XDIST_TESTRUNUID") or str(os.getpid())
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    return 1 + (zlib.crc32(run.encode()) + worker) % 101


# before rclpy is initialised, and for all processes that tests start
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(domain())

settings.register_profile("the same in every run", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("the same in every run")
