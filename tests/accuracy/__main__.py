# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints the project's figures on recorded people whom the tested models have never seen, as Markdown tables.

python -m tests.accuracy --quick     some minutes: two groups of people
python -m tests.accuracy --full      all people, and the curves
python -m tests.accuracy --only standing --sets body26 --groups 1 --count 20 --show 20
python -m tests.accuracy --full --only walking           every walk and turn of everybody, take by take

Nothing here is part of the test suite: it needs the recorded people beside the project, and time.
"""

import argparse
import sys
from pathlib import Path

from threadpoolctl import threadpool_limits

from . import people, runs, starts, tracking
from .door import run_door, run_door_standing, run_walking
from .rebuilding import run_rebuilding

RUNS = {
    "standing": runs.run_standing,
    "starts": starts.run_starts,
    "iterations": starts.run_iterations,
    "tracking": tracking.run_tracking,
    "speed": runs.run_speed,
    "walking": run_walking,
    "occlusion": runs.run_occlusion,
    "sweeps": runs.run_sweeps,
    "rebuilding": run_rebuilding,
    "door": run_door,
    "door-standing": run_door_standing,
}
QUICK = ("standing", "starts", "speed", "walking")


def main() -> int:
    """Runs what was asked for."""
    parser = argparse.ArgumentParser(prog="python -m tests.accuracy", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two groups of people, no curves (the default)")
    parser.add_argument("--full", action="store_true", help="everybody, and the curves")
    parser.add_argument("--only", nargs="*", choices=list(RUNS), help="these measurements alone")
    parser.add_argument("--sets", nargs="*", default=["gait15", "body26"], help="marker sets")
    parser.add_argument("--groups", type=int, help="how many of the five groups of left-out people")
    parser.add_argument("--count", type=int, help="standing captures a group; of walking people every take is labelled")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--as-recorded", action="store_true", help="keep the names that a recording has exchanged")
    parser.add_argument("--show", type=int, default=0, help="list up to this many flawed takes of each measurement")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="draw pictures into this folder, too")
    given = parser.parse_args()
    if not people.available():
        print("the recorded people are not here; expected them in ../shared/data/people", file=sys.stderr)
        return 1
    if given.as_recorded:
        people.EXCHANGED.clear()
    groups = given.groups or (5 if given.full else 2)
    plan = runs.Plan(
        tuple(given.sets),
        tuple(people.folds()[:groups]),
        given.count or (100 if given.full else 40),
        given.seed,
        given.show,
        given.plots,
    )
    with threadpool_limits(1, user_api="blas"):
        for name in given.only or (RUNS if given.full else QUICK):
            RUNS[name](plan)
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
