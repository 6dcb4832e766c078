# SPDX-License-Identifier: GPL-3.0-or-later
"""`live SOURCE`: names from a stream, a JSON line for each frame."""

import json
import signal
import sys
import time
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path

from threadpoolctl import threadpool_limits

from ..core.data.errors import JobError, UserError
from ..core.points.several.live import solved_of_several
from ..core.points.whole_take.live import Window, WindowNames, solved_window, subject_in
from ..io.scratch import scratch_folder
from ..io.streams.natnet_server import NamesServer
from ..jobs.live import LiveJob, name_stream
from .arguments import add_options, job_of, number
from .console import ProgressLine, print_results
from .label.options import add_subjects, settle_subjects
from .serving import left
from .workers import Worker

DESCRIPTION = """Names the points of a stream frame by frame: a line of JSON for each on standard output, until the
sender ends or Ctrl-C. Settled names only: what is not sure yet is unnamed."""


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("live", help="names from a stream", description=DESCRIPTION)
    what = "qtm://HOST (Qualisys), natnet://HOST (OptiTrack) or vicon://HOST; :PORT where it is not the usual one"
    parser.add_argument("source", metavar="SOURCE", help=what)
    add_options(parser, "--model")
    add_subjects(parser, auto=False)
    parser.add_argument("--out", type=Path, metavar="FILE.c3d", help="also keep all frames in this .c3d")
    wait = number(0.1, 3600, "number of seconds")
    parser.add_argument("--wait", type=wait, default=5.0, metavar="S", help="end after S seconds without a frame (5)")
    parser.add_argument("--anywhere", action="store_true", help="also who is outside of this machine's own network")
    what = "also serve the names there, an address of this machine, as Motive would: to engines, as NatNet"
    parser.add_argument("--serve", metavar="natnet://HOST", help=what)
    add_options(parser, "--up", "--rate", "--overwrite")
    parser.set_defaults(run=run, own=None)


def run(arguments) -> int:
    """Names a stream."""
    refuse_offline()
    settle_subjects(arguments, "--model MODEL")
    job, shown = job_of(LiveJob, arguments, wearers=tuple(arguments.subject)), ProgressLine(arguments.progress)
    stops: list[int] = []
    served: NamesServer | None = None

    def stop(kind: int, _frame):
        if stops:  # for the second time: at once
            raise KeyboardInterrupt
        stops.append(kind)

    def tell(line: dict):
        if served is not None:
            served.tell(line)
        print_results([json.dumps(line, separators=(",", ":"), ensure_ascii=False)], line, as_json=False)
        count = len(line["markers"])
        state = f"frame {line['frame']}: {count} named, {len(line['unnamed'])} not, {line['late']} late"
        shown.tell(f"{state}, {line['ms']} ms")

    with ExitStack() as stack:
        if arguments.serve:
            served = stack.enter_context(NamesServer(arguments.serve, job.called, job.anywhere))
        solver = stack.enter_context(SolverProcess(stack.enter_context(scratch_folder()), job))
        for kind in (signal.SIGINT, signal.SIGTERM):
            stack.callback(signal.signal, kind, signal.signal(kind, stop))
        try:
            result = name_stream(job, solver, tell, lambda: bool(stops))
        finally:
            shown.clear()
    unsent = f", {served.unsent} not sent" if served is not None else ""
    shown.tell(f"{result['frames']} frames, {result['late']} late{unsent}", at_once=True)
    return 0


LATEST, RECORD, STOP = "frame", "record", "stop"  # files by which Blender and the process beside it speak


def name_beside(job: LiveJob, folder: Path) -> dict:
    """Names a stream for a window, with which it shares a `folder`. Gives what `name_stream` does.

    The line of the latest frame is in one file, over the one before, so that nothing grows or waits while the window is
    busy; `at` is when it was written, `changed` how many names were taken back. It records from when another file is
    there, and ends when a third is, or whoever sent it is gone: what was recorded is kept then, too. Lines have the
    body that the names make.
    """
    changed = 0
    with ExitStack() as stack:
        stack.callback(signal.signal, signal.SIGINT, signal.signal(signal.SIGINT, signal.SIG_IGN))
        stack.enter_context(threadpool_limits(1, user_api="blas"))
        latest = stack.enter_context((folder / LATEST).open("wb", buffering=0))
        solver = stack.enter_context(SolverProcess(stack.enter_context(scratch_folder()), job, posed=True))

        def tell(line: dict):
            nonlocal changed
            changed += len(line["renamed"])
            latest.seek(0)
            latest.write(json.dumps(line | {"at": time.time(), "changed": changed}).encode() + b"\n")

        return name_stream(job, solver, tell, lambda: (folder / STOP).exists() or left(), (folder / RECORD).exists)


def refuse_offline():
    """JobError where Blender's user does not allow it to go online."""
    bpy = sys.modules.get("bpy")
    if bpy is not None and bpy.app.binary_path and not bpy.app.online_access:
        raise JobError("Allow Online Access is off in Blender's preferences; expected it on, or blender --online-mode")


class SolverProcess:
    """A process beside this one that solves windows; use it as a context manager."""

    def __init__(self, scratch: Path, job: LiveJob, posed: bool = False):
        """Starts it; where bodies are `posed` it also says whose names they are."""
        self.worker, self.work = Worker(scratch), partial(solved, job, posed)

    def __enter__(self):
        return self

    def __exit__(self, *_: object):
        self.worker.process.kill()
        self.worker.process.wait()
        self.worker.close()

    @property
    def free(self) -> bool:
        """Whether it has nothing to do."""
        return not self.worker.busy

    def send(self, window: Window):
        """Gives it a window."""
        self.worker.hand(partial(self.work, window))

    def answer(self) -> WindowNames | None:
        """What came of it; None while it is at work. The JobError of how it ended where it has."""
        found = self.worker.look()
        if isinstance(found, UserError):
            raise found
        return found


def solved(job: LiveJob, posed: bool, window: Window) -> WindowNames:
    """What the process beside does with a window."""
    with threadpool_limits(1, user_api="blas"):
        worn = job.worn
        models = [one.model for one in worn.subjects]
        names = solved_of_several(worn.subjects, window) if job.several else solved_window(models[0], window)
        if not posed:
            return names
        own = zip(models, worn.firsts, strict=True)
        return replace(names, subjects=tuple(subject_in(model, window, names.marker - first) for model, first in own))
