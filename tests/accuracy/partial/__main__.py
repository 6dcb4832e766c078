# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints tables 2 to 5 of the partial-solvers paper measured on the recorded people, its method and ours side by side.

python -m tests.accuracy.partial --results DIR                       everything that DIR does not have yet; hours
python -m tests.accuracy.partial --results DIR --only ours           our method alone
python -m tests.accuracy.partial --results DIR --show table4 | python scripts/results.py --take partial_table_4

Each part is kept in DIR as soon as it is measured, so a run can be stopped and gone on with; --show measures nothing,
and puts the tables together from all that is there. "faithful" is the paper's method with its four functions, and
"+ turn" with the one function more that a mirror changes; "same people" are both learned from and tested, as in the
paper, and people left out are in no training.
"""

import argparse
import sys
from pathlib import Path

from threadpoolctl import threadpool_limits

from .. import people
from .measuring import METHODS, run
from .report import BLOCKS, Results


def main() -> int:
    """Measures and prints what was asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.accuracy.partial", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--results", type=Path, required=True, metavar="DIR", help="where results are kept")
    parser.add_argument("--only", nargs="*", choices=METHODS, default=METHODS, help="these methods")
    parser.add_argument("--show", nargs="*", choices=list(BLOCKS), metavar="BLOCK", help=f"of {', '.join(BLOCKS)}")
    given = parser.parse_args()
    people.need_people()
    if given.show is None:
        with threadpool_limits(1, user_api="blas"):
            run(given.results, tuple(given.only))
    results = Results(given.results)
    for name in given.show or BLOCKS:
        print(f"\n## {name}\n\n{BLOCKS[name](results)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
