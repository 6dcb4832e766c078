# SPDX-License-Identifier: GPL-3.0-or-later
"""A function of the tests in a process of its own, which ends where it takes too much memory or time."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MEMORY, SECONDS = 1 << 30, 5  # what reading a file may take at most

_SCRIPT = """
import resource, sys
import numpy, addon.io.cameras, addon.io.labels, addon.io.models, addon.io.points
from addon.core.data.errors import InputError
from tests.fuzz import READERS
used = int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]))
resource.setrlimit(resource.RLIMIT_AS, ({memory}, {memory}))
resource.setrlimit(resource.RLIMIT_CPU, (used + {seconds} + 1, used + {seconds} + 2))
from pathlib import Path
try:
    READERS[{kind!r}](Path(sys.argv[1]))
except InputError as error:
    print(error)
else:
    print("read")
"""


def read_within(kind: str, path: Path, memory: int = MEMORY, seconds: int = SECONDS) -> str:
    """What the reader `kind` of `tests.fuzz` says of a file, "read" or its error, within memory and time."""
    pytest.importorskip("resource", reason="this system has no limits for a process")
    script = _SCRIPT.format(kind=kind, memory=memory, seconds=seconds)
    lean = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # threads take room by the gigabyte and never use it
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)],
        cwd=ROOT,
        env={**os.environ, **lean},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"ended with {done.returncode}: {done.stderr[-1000:]}"
    return done.stdout.strip()
