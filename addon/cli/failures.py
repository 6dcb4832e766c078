# SPDX-License-Identifier: GPL-3.0-or-later
"""What stopped a command, or one take of several, as one sentence, which the contract promises, never a traceback."""

import errno
import os
import traceback
from pathlib import Path

from ..core.data.errors import InputError, JobError, UserError

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
        said = str(error)
        if isinstance(error, MemoryError) or any(words in said for words in OUT_OF_MEMORY):
            return True
        error = error.__cause__ or error.__context__
    return False


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:300]
