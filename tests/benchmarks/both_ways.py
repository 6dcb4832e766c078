# SPDX-License-Identifier: GPL-3.0-or-later
"""A benchmark by NumPy and by the compiled library: each way in a process of its own, whose rows are lines of JSON."""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from time import process_time

import numpy as np

from addon.core.kernels.library import SWITCH

BY_NUMPY, COMPILED = "1", "0"  # of the switch


def processor_seconds(job: Callable[[], object]) -> float:
    """The processor time that a job takes, s."""
    begin = process_time()
    job()
    return process_time() - begin


def rows_of_ways(
    module: str,
    doc: str,
    names: Sequence[str],
    measured: Callable[[list[str], Path | None], None],
    ways: Sequence[str],
) -> list[list[list]]:
    """The rows of each of `ways`, as the benchmark `module` prints them when it is called with `--one-way`.

    Of its measurements' `names` the command line may choose some; `measured(names, models)` prints the rows of one
    way. Nothing is returned where that was asked for.
    """
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=doc.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=list(names), help="these measurements alone")
    parser.add_argument("--models", type=Path, help="folder that models are kept in")
    parser.add_argument("--one-way", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    chosen = given.only or list(names)
    if given.one_way:
        measured(chosen, given.models)
        return []
    with tempfile.TemporaryDirectory() as folder:
        again = [sys.executable, "-m", module, "--one-way", "--only", *chosen]
        again += ["--models", str(given.models or folder)]
        return [_rows(again, way) for way in ways]


def machine() -> str:
    """Where it was measured, as tables begin with."""
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return f"Python {platform.python_version()}, NumPy {np.__version__}, {os.cpu_count()} cores{load}"


def _rows(command: list[str], way: str) -> list[list]:
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=os.environ | {SWITCH: way})
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
