#!/usr/bin/env python
"""Figures for planners: grasps a second, trajectories checked, targets of the steering task, and the node's service.

scripts/bench planner [--quick] [--save FILE] [--compare FILE] [--service] [--trajectory [N]]
"""

from __future__ import annotations

import planner_batch
import planner_service
import planner_steer
import planner_trajectory
from figures import Figures, bench_options, bench_parser, finish


def main() -> int:
    """All tables."""
    parser = bench_parser(__doc__, "fewer rows and paths")
    parser.add_argument("--service", action="store_true", help="only the service over DDS")
    parser.add_argument(
        "--trajectory",
        type=int,
        nargs="?",
        const=100,
        metavar="N",
        help="only trajectories, N (100) against finer checks",
    )
    options = bench_options(parser)
    quick, figures = options.quick, Figures()
    if options.trajectory:
        planner_trajectory.print_time(figures)
        planner_trajectory.print_agreement(figures, options.trajectory)
        return finish(figures, options)
    planner_service.print_service(figures, 7 if quick else 15)
    planner_service.print_cycles(figures, 2 if quick else 6)
    if not options.service:
        planner_batch.print_rates(figures, 10_000, 3 if quick else 7)
        planner_trajectory.print_time(figures)
        planner_trajectory.print_agreement(figures, 20 if quick else 200)
        planner_steer.print_steering(figures, 20 if quick else 200)
    return finish(figures, options)


if __name__ == "__main__":
    raise SystemExit(main())
