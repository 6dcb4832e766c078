# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints tables 2 to 5 of the partial-solvers paper measured on the recorded people, its method and ours side by side.

python -m tests.accuracy.partial --results DIR                       everything that DIR does not have yet; hours
python -m tests.accuracy.partial --results DIR --quick               one group left out, two targets; minutes
python -m tests.accuracy.partial --results DIR --only ours --again   our method anew
python -m tests.accuracy.partial --results DIR --only grid cover     two studies, all methods
python -m tests.accuracy.partial --results DIR --as-is --show table4 | python scripts/results.py --take partial_table_4

Each part is kept in DIR as soon as it is measured, so a run can be stopped and gone on with, and parts may be run at
different times; the tables are put together from all that is there. "faithful" is the paper's method with its four
functions, and "+ turn" with the one function more that a mirror changes; "same people" are both learned from and
tested, as in the paper, and people left out are in no training.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from addon.core.papers.partial_solvers.training import Training

from .. import people
from .methods import FAITHFUL, METHODS
from .report import BLOCKS
from .results import Results
from .running import OTHERS, Plan, run
from .studies import STUDIES, TARGETS

FRAMES = 16_384  # the paper's table 2
GROUPS = {"paper": 5, "turn": 5, "ours": 10}  # an ensemble takes minutes to train, so two people are left out together
QUICK = {"targets": (0.999, 0.9999), "most": 1, "frames": 2048}
QUICK_TRAINING = Training(survey_frames=32, check_frames=600)
PARTS = ("faithful", "ours", *STUDIES, *OTHERS)


def plan_of(given: argparse.Namespace) -> Plan:
    """What the arguments ask to measure."""
    only = given.only or PARTS
    methods = tuple(method for method in METHODS if ("faithful" if method in FAITHFUL else "ours") in only)
    studies = tuple(study for study in (*STUDIES, *OTHERS) if study in only)
    if only == ["faithful"]:
        studies = (*STUDIES, "solvers", "optimal")
    plan = Plan(
        given.results,
        methods or METHODS,
        studies or (*STUDIES, *OTHERS),
        TARGETS,
        GROUPS,
        given.groups,
        FRAMES,
        Training(),
        given.again,
    )
    return replace(plan, **QUICK, options=QUICK_TRAINING) if given.quick else plan


def main() -> int:
    """Measures and prints what was asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.accuracy.partial", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--results", type=Path, required=True, metavar="DIR", help="where results are kept")
    parser.add_argument("--only", nargs="*", choices=PARTS, metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--quick", action="store_true", help="one group of people left out, two targets, few frames")
    parser.add_argument("--groups", type=int, default=10, help="test at most so many groups of left-out people")
    parser.add_argument("--again", action="store_true", help="measure also what is there already")
    parser.add_argument("--as-is", action="store_true", help="measure nothing; put together what is there")
    parser.add_argument("--show", nargs="*", choices=list(BLOCKS), metavar="BLOCK", help=f"of {', '.join(BLOCKS)}")
    given = parser.parse_args()
    if not people.available():
        print("the recorded people are not here; expected them in ../shared/data/people", file=sys.stderr)
        return 1
    if not given.as_is:
        with threadpool_limits(1, user_api="blas"):
            run(plan_of(given))
    results = Results(given.results)
    for name in given.show or BLOCKS:
        print(f"\n## {name}\n\n{BLOCKS[name](results)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
