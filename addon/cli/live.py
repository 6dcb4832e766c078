# SPDX-License-Identifier: GPL-3.0-or-later
"""`live SOURCE`: names from a stream, a JSON line for each frame."""

import json
import signal
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from ..core.data.errors import JobError, UserError
from ..core.points.whole_take.live import Window, WindowNames, WindowSolver
from ..io.models import open_model
from ..io.scratch import naming_scratch, scratch_folder
from ..io.source import read_bytes
from ..jobs.live import LiveJob, name_stream
from .arguments import add_options, job_of, number
from .console import ProgressLine, print_results
from .serving import WINDOWS
from .workers import Worker

DESCRIPTION = """Names the points of a stream frame by frame: a line of JSON for each on standard output, until the
sender ends or Ctrl-C. Settled names only: what is not sure yet is unnamed."""
ASKED_WINDOW, WINDOW_NAMES = "window", "names"  # files in which windows go to the process beside, and names come back


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("live", help="names from a stream", description=DESCRIPTION)
    what = "qtm://HOST (Qualisys), natnet://HOST (OptiTrack) or vicon://HOST; :PORT where it is not the usual one"
    parser.add_argument("source", metavar="SOURCE", help=what)
    add_options(parser, "--model", required=True)
    parser.add_argument("--out", type=Path, metavar="FILE.c3d", help="also keep all frames in this .c3d")
    wait = number(0.1, 3600, "number of seconds")
    parser.add_argument("--wait", type=wait, default=5.0, metavar="S", help="end after S seconds without a frame (5)")
    parser.add_argument("--anywhere", action="store_true", help="also a sender outside of this machine's own network")
    add_options(parser, "--up", "--rate", "--overwrite")
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Names a stream."""
    refuse_offline()
    job, shown = job_of(LiveJob, arguments), ProgressLine(arguments.progress)
    stops: list[int] = []

    def stop(kind: int, _frame):
        if stops:  # for the second time: at once
            raise KeyboardInterrupt
        stops.append(kind)

    def tell(line: dict):
        print_results([json.dumps(line, separators=(",", ":"), ensure_ascii=False)], line, as_json=False)
        count = len(line["markers"])
        state = f"frame {line['frame']}: {count} named, {len(line['unnamed'])} not, {line['late']} late"
        shown.tell(f"{state}, {line['ms']} ms")

    with ExitStack() as stack:
        solver = stack.enter_context(SolverProcess(stack.enter_context(scratch_folder()), job.model))
        for kind in (signal.SIGINT, signal.SIGTERM):
            stack.callback(signal.signal, kind, signal.signal(kind, stop))
        try:
            result = name_stream(job, solver, tell, lambda: bool(stops))
        finally:
            shown.clear()
    shown.tell(f"{result['frames']} frames, {result['late']} late", at_once=True)
    return 0


def refuse_offline():
    """JobError where Blender's user does not allow it to go online."""
    blender = sys.modules.get("bpy")
    if blender is not None and blender.app.binary_path and not blender.app.online_access:
        raise JobError("Allow Online Access is off in Blender's preferences; expected it on, or blender --online-mode")


class SolverProcess:
    """A process beside this one that solves windows; use it as a context manager."""

    def __init__(self, scratch: Path, model: str):
        """Starts it."""
        self.scratch, self.model, self.free = scratch, model, True
        self.worker = Worker(scratch, [WINDOWS, model, str(scratch)])

    def __enter__(self):
        return self

    def __exit__(self, *_: object):
        self.worker.process.kill()
        self.worker.process.wait()
        self.worker.close()

    def send(self, window: Window):
        """Gives it a window."""
        facts = {"row": window.row, "rate": window.rate, "number": window.number.tolist()}
        _put(self.scratch / ASKED_WINDOW, facts, window.xyz.astype(np.float32))
        self.free = False
        self.worker.say(b"\n")

    def answer(self) -> WindowNames | None:
        """What came of it; None while it is at work. JobError where it has ended."""
        path = self.scratch / WINDOW_NAMES
        if not path.exists():
            if self.worker.process.poll() is not None:
                ended = self.worker.ended(self.model, path)
                raise ended if isinstance(ended, UserError) else JobError("its process has ended; expected it to go on")
            return None
        facts, pairs = _got(path, float)
        path.unlink()
        self.free = True
        names = (np.array(facts[name], int) for name in ("number", "marker"))
        return WindowNames(*names, pairs.reshape(3, *facts["shape"]) if pairs.size else pairs, facts["refused"])


def _put(path: Path, facts: dict, array: np.ndarray):
    """Writes facts and the numbers of an array to a scratch file, which appears whole."""
    part = path.with_suffix(".part")
    with naming_scratch(path.parent):
        part.write_bytes(json.dumps(facts).encode() + b"\n" + array.tobytes())
        part.replace(path)


def _got(path: Path, kind: type) -> tuple[dict, np.ndarray]:
    head, _, rest = read_bytes(path).partition(b"\n")
    return json.loads(head), np.frombuffer(rest, kind)


def solve_windows(model: str, folder: str) -> int:
    """What the process beside does: a window for each line on standard input, until there are no more."""
    solver, place = WindowSolver(open_model(model)), Path(folder)
    with threadpool_limits(1, user_api="blas"):
        while sys.stdin.buffer.readline():
            facts, flat = _got(place / ASKED_WINDOW, np.float32)
            xyz = flat.reshape(-1, len(facts["number"]), 3).astype(float)
            names = solver.solve(Window(facts["row"], facts["rate"], np.array(facts["number"], int), xyz))
            said = {"number": names.number.tolist(), "marker": names.marker.tolist(), "refused": names.refused}
            _put(place / WINDOW_NAMES, said | {"shape": names.pairs.shape[1:]}, names.pairs)
    return 0
