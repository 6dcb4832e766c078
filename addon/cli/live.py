# SPDX-License-Identifier: GPL-3.0-or-later
"""`live SOURCE`: names from a stream, a JSON line for each frame."""

import json
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from threadpoolctl import threadpool_limits

from ..core.data.errors import JobError
from ..core.data.wording import count_of
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
        beside = stack.enter_context(solver())
        for kind in (signal.SIGINT, signal.SIGTERM):
            stack.callback(signal.signal, kind, signal.signal(kind, stop))
        try:
            result = name_stream(job, beside, tell, lambda: bool(stops))
        finally:
            shown.clear()
    unsent = f", {served.unsent} not sent" if served is not None else ""
    shown.tell(f"{count_of(result['frames'], 'frame')}, {result['late']} late{unsent}", at_once=True)
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
        beside = stack.enter_context(solver())

        def tell(line: dict):
            nonlocal changed
            changed += len(line["renamed"])
            latest.seek(0)
            latest.write(json.dumps(line | {"at": time.time(), "changed": changed}).encode() + b"\n")

        stopped, recording = (lambda: (folder / STOP).exists() or left()), (folder / RECORD).exists
        return name_stream(job, beside, tell, stopped, recording, posed=True)


def refuse_offline():
    """JobError where Blender's user does not allow it to go online."""
    bpy = sys.modules.get("bpy")
    if bpy is not None and bpy.app.binary_path and not bpy.app.online_access:
        raise JobError("Allow Online Access is off in Blender's preferences; expected it on, or blender --online-mode")


@contextmanager
def solver() -> Iterator[Worker]:
    """A process beside this one, which ends at once with the block."""
    with scratch_folder() as scratch:
        worker = Worker(scratch)
        try:
            yield worker
        finally:
            worker.process.kill()
            worker.process.wait()
            worker.close()
