# SPDX-License-Identifier: GPL-3.0-or-later
"""One run at a time gives files their names in a folder, so that those of two never mix.

A lock on a file there says whose turn it is; whoever has it takes the file away again. Where one was killed the next
run does, and where a folder or its file system knows no such file, runs go on without.
"""

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

from .scratch import lock_now
from .source import open_at_once

TURN = ".mocap-autolabel.turn"
LONG_S = 60.0  # s; giving names takes milliseconds, so who has the turn for so long is stopped or cut off
LOOK_S = 0.01  # s between two looks


@contextmanager
def turns(folders: Iterable[Path]) -> Iterator[None]:
    """It is this run's turn in all these folders while the block runs."""
    with ExitStack() as stack:
        # In one order for all, or two could wait for each other.
        for folder in sorted(set(folders)):
            stack.enter_context(_turn(folder))
        yield


@contextmanager
def _turn(folder: Path) -> Iterator[None]:
    path = folder / TURN
    file = _taken(path)
    try:
        yield
    finally:
        if file is not None:
            if os.name == "nt":  # which gives up no file that is open
                file.close()
            with suppress(OSError):
                path.unlink()
            file.close()


def _taken(path: Path) -> IO | None:
    """The file of a turn, open and locked; None where there can be none."""
    end = time.monotonic() + LONG_S
    while time.monotonic() < end:
        try:
            file = open(path, "ab", opener=open_at_once)  # noqa: SIM115 a path has no opener
        except OSError:
            return None
        try:
            lock_now(file)
            if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                return file
        except (BlockingIOError, PermissionError):  # another's turn
            time.sleep(LOOK_S)
        except FileNotFoundError:  # whoever had it took it away
            pass
        except OSError:  # no locks here
            file.close()  # Windows takes no file away that is open
            with suppress(OSError):
                path.unlink()
            return None
        file.close()
    return None
