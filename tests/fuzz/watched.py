# SPDX-License-Identifier: GPL-3.0-or-later
"""Limits around what reads broken files: memory, open files and time."""

import os
import resource
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

# That one file may take. The slowest takes 2 s of a quiet machine; what reads in vain takes minutes on any.
MEMORY_MB, SECONDS = 1024, 20
PATIENCE = 2  # times as long, on the wall's clock
FILES_OPEN = 64  # at a time; one that stays open with every file is noticed soon


class TooSlowError(BaseException):
    """It takes too long; no OSError, as TimeoutError is: readers make a sentence of those."""


def limit(memory_mb: int = MEMORY_MB):
    """This process from now on: so much memory, so many open files, no core."""
    for late in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(late, _too_slow)
    resource.setrlimit(resource.RLIMIT_AS, (memory_mb << 20, memory_mb << 20))
    resource.setrlimit(resource.RLIMIT_NOFILE, (FILES_OPEN, FILES_OPEN))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


@contextmanager
def in_time() -> Iterator[None]:
    """Raises TooSlowError in the block after SECONDS."""
    # Of the processor's time, because others may work on this machine; what waits for ever uses none.
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE * SECONDS)
    try:
        yield
    finally:
        for timer in (signal.ITIMER_PROF, signal.ITIMER_REAL):
            signal.setitimer(timer, 0)


def quick_folder() -> str:
    """Where temporary files cost the least: in memory, where the system has such a folder."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else tempfile.gettempdir()


def _too_slow(*_):
    raise TooSlowError(f"takes over {SECONDS} s")
