# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints how long the labelling takes on this machine, as a Markdown table: virtual people, one core.

python -m tests.benchmarks
python -m tests.benchmarks --repeats 50 --only table1 follow

Nothing here asserts anything: times depend on the machine, and on what else it does. The least of many repeats says
what the code needs, the median what one gets.
"""

import argparse
import os
import platform
import sys
from collections.abc import Callable, Iterator
from time import perf_counter, process_time

import numpy as np
from threadpoolctl import threadpool_limits

from . import cases

COLUMNS = ("what", "median", "least", "of the processor", "floor", "aim", "the paper")
RUNS: dict[str, Callable[[int], Iterator[cases.Row]]] = {
    "table1": cases.table_1,
    "frame": cases.standing_frame,
    "follow": cases.following,
    "occlusion": cases.occlusion,
    "refine": cases.refining,
}


def timed(job: cases.Job, repeats: int) -> np.ndarray:
    """(repeats, 2) seconds of the job, by the clock and of the processor, after one run that nobody counts."""
    job()
    seconds = np.empty((repeats, 2))
    for index in range(repeats):
        begin = perf_counter(), process_time()
        job()
        seconds[index] = perf_counter() - begin[0], process_time() - begin[1]
    return seconds


def line(cells) -> str:
    """One row of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def main() -> int:
    """Times what was asked for."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=list(RUNS), help="these measurements alone")
    parser.add_argument("--repeats", type=int, default=30, help="how often each is repeated")
    given = parser.parse_args()
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, {os.cpu_count()} cores{load}, ", end="")
    print(f"one thread, {given.repeats} repeats\n")
    print(line(COLUMNS))
    print(line(["---", *["---:"] * (len(COLUMNS) - 1)]))
    with threadpool_limits(1, user_api="blas"):
        for name in given.only or RUNS:
            for row in RUNS[name](given.repeats):
                clock, core = (timed(row.job, row.repeats) / row.per).T
                figures = [row.show(np.median(clock)), row.show(clock.min()), row.show(np.median(core))]
                print(line([row.title, *figures, *row.promises]), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
