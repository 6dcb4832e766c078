# SPDX-License-Identifier: GPL-3.0-or-later
"""A process that works for another: command lines come to it one after the other, so that it starts up once.

Each comes as a line of JSON on standard input, and has one as its answer on standard output, where Blender may write
too.
"""

import _thread
import gc
import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from importlib import import_module
from io import StringIO

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
TRY = "try"  # the word of a command that only such a process gets: try --result FILE TRIAL
WINDOWS = "windows"  # of a process that solves what `live` sends it: windows MODEL FOLDER
ANSWER = "mocap-autolabel answers: "  # which an answer begins with
PATIENCE = 10.0  # s, in which what is stopped may clean up
POLL = 0.5  # s; Windows hears no interruption while it waits without end


def serve(run: Callable[[list[str]], int]) -> int:
    """Runs command lines until there are no more; ends as by Ctrl-C when whoever sends them is gone in the middle."""
    lines: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    busy, left = threading.Event(), threading.Event()
    threading.Thread(target=_listen, args=(lines, busy, left), daemon=True).start()
    load_labelling()  # while whoever sends the first line is still at its files
    out = sys.stdout
    while (line := waited_for(lines)) is not None:
        busy.set()
        if left.is_set():  # what was sent before that is not wanted any more
            break
        errors = StringIO()
        with redirect_stdout(StringIO()), redirect_stderr(errors):
            status = run(json.loads(line))
        busy.clear()
        out.write(f"\n{ANSWER}{json.dumps({'status': status, 'errors': errors.getvalue()})}\n")
        out.flush()
    return 0


def waited_for(what: queue.SimpleQueue):
    """The next thing in a queue, however long it takes; an interruption is heard meanwhile."""
    while True:
        with suppress(queue.Empty):
            return what.get(timeout=POLL)


def _listen(lines: queue.SimpleQueue, busy: threading.Event, left: threading.Event):
    """Hands on what comes, and ends the process when whoever sent it has `left`: the pipe closes then.

    That holds on every system, however the other process ended.
    """
    rest = b""
    with suppress(OSError):
        while got := os.read(0, 65536):
            *whole, rest = (rest + got).split(b"\n")
            for line in whole:
                lines.put(line)
    left.set()
    lines.put(None)
    if busy.is_set():
        _thread.interrupt_main()
        time.sleep(PATIENCE)
        os._exit(JobError.exit_status)
