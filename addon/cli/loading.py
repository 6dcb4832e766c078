# SPDX-License-Identifier: GPL-3.0-or-later
"""Modules loaded in one go: they stay, and to look for garbage in the midst of them takes a tenth of the time."""

import gc
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

from ..core.data.errors import JobError

if sys.platform != "win32":
    import resource

# 16 MB are what this program has taken before it loads them, generously; measured.
# 5 s of a core are 25 times what NumPy takes to load, measured: what it is built on may ask for memory for ever.
LIBRARIES = """
import mmap, resource
most = min((one for one in (5, resource.getrlimit(resource.RLIMIT_CPU)[1]) if one >= 0))
resource.setrlimit(resource.RLIMIT_CPU, (most, most))
taken = mmap.mmap(-1, 1 << 24)
try:
    import numpy
except ModuleNotFoundError:
    pass
"""


def try_libraries():
    """JobError where the memory that this process may have is too little for NumPy to be loaded at all.

    What it is built on ends the process then, without a word of ours, so another one tries it. Where memory is not
    limited nothing is tried.
    """
    if sys.platform == "win32" or "numpy" in sys.modules:
        return
    limits = {resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)}
    if limits == {resource.RLIM_INFINITY}:
        return
    command = [sys.executable, "-c", LIBRARIES]
    if subprocess.run(command, capture_output=True, check=False).returncode:  # noqa: S603 it is ourselves
        limit = min(limits - {resource.RLIM_INFINITY}) >> 20
        raise JobError(f"there are {limit} MB of memory, with which it cannot begin; expected more, see ulimit")


@contextmanager
def uncollected() -> Iterator[None]:
    """Nothing is looked through for garbage in this block."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def load_labelling():
    """Loads what labels takes, before the first of them is there."""
    with uncollected():
        for module in (".label", "..jobs.points"):
            import_module(module, __package__)
