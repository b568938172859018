#!/usr/bin/env python
"""Figures for planners: grasps a second, trajectories checked, targets of the steering task, and the node's service.

scripts/bench planner [--quick] [--service]
"""

from __future__ import annotations

import argparse

import planner_batch
import planner_service
import planner_steer
import planner_trajectory


def main() -> None:
    """All tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer rows and paths")
    parser.add_argument("--service", action="store_true", help="only the service over DDS")
    options = parser.parse_args()
    planner_service.print_service(repeats=7 if options.quick else 15)
    planner_service.print_cycles(phases=1 if options.quick else 3)
    if options.service:
        return
    planner_batch.print_rates(10_000, 3 if options.quick else 7)
    planner_batch.print_agreement(50 if options.quick else 500)
    planner_trajectory.print_time()
    planner_trajectory.print_agreement(20 if options.quick else 200)
    planner_steer.print_steering(20 if options.quick else 200)


if __name__ == "__main__":
    main()
