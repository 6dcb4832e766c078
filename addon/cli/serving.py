# SPDX-License-Identifier: GPL-3.0-or-later
"""A process that works for another: work comes to it one after the other, so that it starts up once.

Each comes as a command line, a line of JSON on standard input, and has one as its answer on standard output, where
Blender may write too. The command `work` does what another process hands over in a file, and tells how far it is.
"""

import gc
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from importlib import import_module
from io import StringIO
from pathlib import Path

from ..core.data.errors import JobError, UserError
from ..core.data.progress import Progress, finished

if sys.platform == "win32":
    import ctypes
    import msvcrt
else:
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
    # Each of its threads takes memory of its own, and where there is none it may wait for it for ever.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
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
        for module in (".label", "..jobs.labelling"):
            import_module(module, __package__)


SERVE = "serve"  # the word that makes a process one
HANDED = "work"  # the word of a command that only such a process gets: work RESULT PARCEL
ANSWER = "mocap-autolabel answers: "  # which an answer begins with
SHARE = "mocap-autolabel has done: "  # which the share that is done begins with
PATIENCE = 10.0  # s, in which what is stopped may clean up
POLL = 0.5  # s between two looks at whether whoever sent a command is there
WORD_EVERY = 0.1  # s between two words on how far the work is


def serve(run: Callable[[list[str]], int]) -> int:
    """Runs command lines until there are no more; ends as by Ctrl-C when whoever sends them is gone in the middle.

    Where no timer can interrupt the work, as on Windows, it ends at its next word on how far it is, or behind it.
    """
    load_labelling()  # while whoever sends the first line is still at its files
    out = sys.stdout
    for line in _lines():
        if left():  # what was sent before that is not wanted any more
            break
        errors = StringIO()
        with _looking_out(), redirect_stdout(StringIO()), redirect_stderr(errors):
            status = run(json.loads(line))
        out.write(f"\n{ANSWER}{json.dumps({'status': status, 'errors': errors.getvalue()})}\n")
        out.flush()
    return 0


def _lines() -> Iterator[bytes]:
    """What comes, until whoever sends it is gone."""
    rest = b""
    with suppress(OSError):
        while got := os.read(0, 65536):
            *whole, rest = (rest + got).split(b"\n")
            yield from whole


def left() -> bool:
    """Whether whoever sent the command lines is gone: the pipe is closed then, however the other process ended."""
    if sys.platform == "win32":
        pipe = ctypes.c_void_p(msvcrt.get_osfhandle(0))
        return not ctypes.windll.kernel32.PeekNamedPipe(pipe, None, 0, None, None, None)
    pipe = select.poll()
    pipe.register(0, 0)  # that it was closed is told unasked
    return bool(pipe.poll(0))


@contextmanager
def _looking_out() -> Iterator[None]:
    """Ends the block as by Ctrl-C when whoever sent its work is gone, and the process once it had time to clean up."""

    def look(*_):
        if left():
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_REAL, PATIENCE)
            signal.raise_signal(signal.SIGINT)

    if sys.platform == "win32":
        yield
        return
    signal.signal(signal.SIGALRM, look)
    signal.siginterrupt(signal.SIGALRM, False)
    signal.setitimer(signal.ITIMER_REAL, POLL, POLL)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def run_work(result: Path, parcel: Path) -> int:
    """Does the work of a parcel, a function with what it is given; what it returns, or its trouble, goes into another.

    Where that is a generator it is stepped to its end, and the share that it yields is told on standard output. An exit
    status that it returns is that of this command.
    """
    from .parcels import read_parcel, write_parcel

    told = 0.0

    def tell(step: Progress | float):
        nonlocal told
        if time.monotonic() < told + WORD_EVERY:
            return
        told = time.monotonic()
        share = step.fraction if isinstance(step, Progress) else step
        sys.__stdout__.write(f"\n{SHARE}{share:.4f}\n")
        sys.__stdout__.flush()
        if left():
            raise KeyboardInterrupt

    try:
        work = read_parcel(parcel)
        parcel.unlink()  # those of a whole session are many
        outcome = work()
        if isinstance(outcome, Generator):
            outcome = finished(outcome, tell)
    except UserError as error:
        outcome = error
    write_parcel(result, outcome)
    return outcome if isinstance(outcome, int) else 0
