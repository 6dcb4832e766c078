# SPDX-License-Identifier: GPL-3.0-or-later
"""What a command says: results on standard output, progress and the reason of a failure on standard error."""

import errno
import json
import os
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from ..core.data.errors import ForceableError, InputError, JobError, UserError, spelt_out
from ..core.data.progress import Progress, finished
from ..core.data.wording import count_of

# What systems and Python say where there is no memory, other than by MemoryError.
OUT_OF_MEMORY = (
    os.strerror(errno.ENOMEM),
    "failed to map segment from shared object",
    "can't start new thread",
    "paging file is too small",
)


def as_trouble(error: Exception, trace: bool = False) -> UserError:
    """Whatever was raised as trouble with an exit status; `trace` shows where faults of our own are."""
    if isinstance(error, UserError):
        return error
    if isinstance(error, BrokenPipeError):
        return JobError("the program that reads the results went away; expected it to read them all")
    if _lacks_memory(error):
        return JobError("the memory is full; expected fewer frames at once, see --frames, or fewer --jobs")
    if isinstance(error, OSError):
        kind = InputError if error.filename else JobError
        place = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else error.filename or ""
        return kind(f"the system says: {error.strerror or _line(error)}; expected a path that can be used", place)
    if trace:
        traceback.print_exception(error)
    fault = f"{type(error).__name__}: {_line(error)}"
    return JobError(f"a fault of Mocap Autolabel itself ({fault}); expected none, please report it")


def of_take(error: Exception, take: Path, trace: bool = False) -> UserError:
    """The same of one take of several, which it names unless it names another file."""
    trouble = as_trouble(error, trace)
    return trouble if trouble.file else type(trouble)(trouble.message, take)


def _lacks_memory(error: BaseException | None) -> bool:
    """Whether something failed, or what it failed of, for want of memory: what loads libraries has words of its own."""
    while error is not None:
        message = str(error)
        if isinstance(error, MemoryError) or any(words in message for words in OUT_OF_MEMORY):
            return True
        error = error.__cause__ or error.__context__
    return False


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:300]


Result = TypeVar("Result")
PROGRAM = "mocap-autolabel"
# A terminal hears often, a log file now and then, s.
TERMINAL_PAUSE, LOG_PAUSE = 0.1, 2.0
AGAIN = 0.02  # s after which a request to stop that Python could not raise is made again


def not_in_c3d(report: dict) -> list[str]:
    """What of a take no C3D file can say as it is, in sentences."""
    frames = "no .c3d can say these frame numbers: its frames are numbered from 0"
    names = f"no .c3d can hold {count_of(len(report.get('c3d_names', {})), 'name')}: c3d_names of the report has others"
    return [words for key, words in (("c3d_first_frame", frames), ("c3d_names", names)) if key in report]


def open_streams():
    """Leads closed standard streams nowhere; otherwise the next file opened would get what Blender prints."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, this one
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115


def complain(trouble: UserError | str):
    """One line on standard error: `mocap-autolabel: FILE:LINE: what is wrong; what was expected`."""
    message = spelt_out(" ".join(str(trouble).split()))
    more = "; --force goes on regardless" if isinstance(trouble, ForceableError) else ""
    for stream, text in ((sys.stdout, ""), (sys.stderr, f"{PROGRAM}: {message}{more}\n")):
        with suppress(OSError):  # where nobody can hear, the exit status tells
            stream.write(text)
            stream.flush()


@contextmanager
def telling(kind: type[Warning]) -> Iterator[None]:
    """Warnings of this kind are lines as of `complain`, each once."""
    shown, told = warnings.showwarning, set()

    def say(message, category, *where, **more):
        if not issubclass(category, kind):
            shown(message, category, *where, **more)
        elif str(message) not in told:  # Python forgets what it has shown once any filter is changed
            told.add(str(message))
            complain(str(message))

    warnings.showwarning = say
    try:
        yield
    finally:
        warnings.showwarning = shown


def print_results(lines: list[str], result: dict, as_json: bool):
    """The results as lines for people, or as one JSON object."""
    text = (
        json.dumps(result, indent=1, default=_plain, allow_nan=False) if as_json else "\n".join(map(spelt_out, lines))
    )
    # A file's name may have letters that the terminal's alphabet lacks.
    alphabet = sys.stdout.encoding or "utf-8"
    try:
        sys.stdout.write(text.encode(alphabet, "backslashreplace").decode(alphabet) + "\n")
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise JobError(f"the results cannot be printed ({error.strerror}); expected room where they go") from None


def report_work(arguments, work: Generator[Progress, None, dict], name: str, lines: Callable) -> int:
    """Does the work of a command and prints what it returns, a dict of which `lines` makes some for people."""
    result = ProgressLine(arguments.progress).drain(work, name)
    print_results(lines(result), result, arguments.json)
    return 0


class ProgressLine:
    """Progress on standard error, only where it is a terminal or the user asked for it."""

    def __init__(self, wanted: bool):
        self.terminal = sys.stderr.isatty()
        self.shown = wanted or self.terminal
        self.width, self.last = 0, -LOG_PAUSE

    def drain(self, work: Generator[Progress, None, Result], name: str) -> Result:
        """Runs a generator of `Progress` to its end and gives what it returns."""
        try:
            return finished(work, lambda step: self.tell(f"{name}: {step.fraction:4.0%} {step.note}"))
        finally:
            self.clear()

    def tell(self, words: str, at_once: bool = False):
        """Shows a state, unless the last one was shown a moment ago."""
        pause = TERMINAL_PAUSE if self.terminal else LOG_PAUSE
        if not self.shown or (not at_once and time.monotonic() - self.last < pause):
            return
        self.last, words = time.monotonic(), spelt_out(words)
        if self.terminal:
            self._write("\r" + words.ljust(self.width))
            self.width = len(words)
        else:
            self._write(words + "\n")

    def clear(self):
        """Takes the line off a terminal, so that what follows stands alone."""
        if self.width:
            self._write("\r" + " " * self.width + "\r")
            self.width = 0

    def _write(self, text: str):
        """Nobody loses a take because its progress cannot be shown."""
        try:
            sys.stderr.write(text)
            sys.stderr.flush()
        except OSError:
            self.shown = False


@contextmanager
def stoppable() -> Iterator[None]:
    """Ctrl-C, a request to end and a terminal that is closed raise KeyboardInterrupt: temporary files are taken away.

    Blender keeps Ctrl-C for itself otherwise.
    """
    kinds = [signal.SIGINT, signal.SIGTERM]
    # Windows has no SIGHUP, and under nohup it stays ignored.
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        kinds.append(signal.SIGHUP)
    before = {kind: signal.signal(kind, signal.default_int_handler) for kind in kinds}
    hook, sys.unraisablehook = sys.unraisablehook, _say_again(sys.unraisablehook)
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for kind, handler in before.items():
            signal.signal(kind, signal.SIG_DFL if handler is None else handler)


def _say_again(hook: Callable) -> Callable:
    """A hook for what Python cannot raise: a request to stop that fell into such a moment is made again behind it.

    Windows has no timer for that: there it has to be asked for again.
    """

    def handler(lost):
        if lost.exc_type is KeyboardInterrupt and sys.platform != "win32":
            signal.signal(signal.SIGALRM, signal.default_int_handler)
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
        else:
            hook(lost)

    return handler


def _plain(value):
    """NumPy's numbers and arrays as JSON has them."""
    return value.tolist() if hasattr(value, "tolist") else str(value)
