# SPDX-License-Identifier: GPL-3.0-or-later
"""Limits around what reads broken files: memory, time, and what it may do to the system while it is watched."""

import os
import resource
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MEMORY_MB, SECONDS = 1024, 5  # that one file may take
PATIENCE = 6  # times as long, on the wall's clock
FILES_OPEN = 64  # at a time; one that stays open with every file is noticed soon

# Of these the folder that a name is in comes last, as the number of an open one or −1.
_CHANGES = ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.chmod", "os.chown",
            "os.utime", "os.mknod")  # fmt: skip
_NEVER = ("socket.", "subprocess.", "os.system", "os.exec", "os.fork", "os.posix_spawn", "os.spawn", "pty.", "urllib.",
          "http.", "ftplib.", "smtplib.", "webbrowser.", "pickle.")  # fmt: skip
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


class TooSlowError(BaseException):
    """It takes too long; no OSError, as TimeoutError is: readers make a sentence of those."""


class Watch:
    """What is done to files, processes and the network while `looking`; `seen` says what is not allowed, once each.

    Files may be written within `writable` and read there, in `readable` and where Python's own modules are.
    """

    def __init__(self, writable: list[Path], readable: list[Path]):
        self.writable = tuple(f"{Path(one).resolve()}{os.sep}" for one in writable)
        own = [*sys.path, sys.prefix, sys.base_prefix, "/proc", "/sys", *readable]
        self.readable = (*self.writable, *(str(Path(one).resolve()) for one in own if one), os.devnull)
        self.looking, self.seen = False, []
        sys.addaudithook(self._told)
        sys.unraisablehook = self._unraisable

    @contextmanager
    def around(self) -> Iterator[list[str]]:
        """Watches the block."""
        self.seen, self.looking = [], True
        try:
            yield self.seen
        finally:
            self.looking = False

    def _told(self, event: str, arguments: tuple):
        if not self.looking:
            return
        self.looking = False  # whatever is done to find out is our own
        try:
            what = self._wrong(event, arguments)
        finally:
            self.looking = True
        if what is not None:
            if what not in self.seen:
                self.seen.append(what)
            raise PermissionError(what)

    def _wrong(self, event: str, arguments: tuple) -> str | None:
        if event.startswith(_NEVER):
            return f"{event} {arguments!r}"[:300]
        if event == "open" and not isinstance(arguments[0], int):
            path, mode, flags = arguments
            return self._outside(
                path, bool(flags & _WRITING) if isinstance(flags, int) else bool(set(mode) & set("wax+"))
            )
        if event in _CHANGES:
            paths = arguments[: 2 if event in ("os.rename", "os.link", "os.symlink") else 1]
            wrong = [self._outside(path, True, arguments[-1]) for path in paths if not isinstance(path, int)]
            return next((f"{event}: {one}" for one in wrong if one is not None), None)
        return None

    def _outside(self, path: str | bytes | os.PathLike, writing: bool, within: int = -1) -> str | None:
        """What is wrong with a path, of a folder that is open as `within` where that is above -1."""
        place = Path(os.fsdecode(path))
        if within >= 0:
            place = Path(f"/proc/self/fd/{within}").readlink() / place
        try:
            name = str(place.parent.resolve() / place.name)
        except ValueError:
            return None  # no path at all: nothing is opened
        if f"{name}{os.sep}".startswith(self.writable if writing else self.readable):
            return None
        return f"{'writes' if writing else 'reads'} {name[:200]}"

    def _unraisable(self, told):
        if self.looking:
            self.seen.append(f"cannot be raised: {type(told.exc_value).__name__}: {told.exc_value}"[:300])


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
