# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders for what is not finished, and tables in them. Where their maker was killed the next run takes them away.

The maker holds a lock on a file in its folder; the system lets go of it when the process ends, however it ends. So a
folder whose lock can be had is nobody's any more, on whichever machine or in whichever container its maker ran.
"""

import atexit
import os
import re
import shutil
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

from ..core.data.errors import JobError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

SCRATCH = "mocap-autolabel-"
LOCK = ".mocap-autolabel.lock"
TOKEN = 12  # letters that tell one folder from another
NO_LOCKS = b"no locks here\n"  # in a lock where the file system has none
OWN: set[Path] = set()  # folders of this process that are there, or about to be
FORSAKEN_S = 86400.0  # s; nobody works so long at what it could not lock


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A folder among the system's temporary ones, gone at the end; JobError that names the place where there is none.

    What is written there goes through `naming_scratch`.
    """
    try:
        parent = Path(tempfile.gettempdir())
    except OSError as error:
        raise JobError(f"there is no folder for temporary files ({error}); expected one, see TMPDIR") from None
    take_away_forsaken(parent, SCRATCH)
    with own_folder(parent, SCRATCH, unwritable_scratch) as folder:
        yield folder


def lasting_scratch() -> Path:
    """A folder as of `scratch_folder` that is there until this process ends."""
    stack = ExitStack()
    folder = stack.enter_context(scratch_folder())
    atexit.register(stack.close)
    return folder


def take_away_scratch():
    """Takes away what killed runs left among the system's temporary files, also for who makes none."""
    with suppress(OSError):  # there is no such folder
        take_away_forsaken(Path(tempfile.gettempdir()), SCRATCH)


@contextmanager
def naming_scratch(folder: Path) -> Iterator[None]:
    """Turns what the system says of writing to a scratch folder into a JobError that names it and not the output."""
    try:
        yield
    except OSError as error:
        raise unwritable_scratch(error, folder) from error


def unwritable_scratch(error: OSError, folder: Path) -> JobError:
    """The sentence for temporary files that find no room."""
    reason = error.strerror or error
    return JobError(f"cannot hold temporary files ({reason}); expected room there, or another TMPDIR", folder)


@contextmanager
def own_folder(parent: Path, prefix: str, trouble: Callable[[OSError, Path], JobError]) -> Iterator[Path]:
    """A new folder in `parent`, gone at the end. Raises what `trouble` makes of it where none can be made."""
    with ExitStack() as stack:
        folder = None
        while folder is None:  # somebody who looks for forsaken ones may take away what is just being made
            path = parent / f"{prefix}{uuid.uuid4().hex[:TOKEN]}"
            OWN.add(path)  # before it is made: a request to end may come at any line
            stack.callback(_remove, path)
            try:
                # Only its user may look into it; a run that failed meanwhile may have taken `parent` away.
                path.mkdir(mode=0o700, parents=True)
                with suppress(FileNotFoundError):
                    lock = stack.enter_context((path / LOCK).open("xb", buffering=0))
                    folder = path if _hold(lock, path / LOCK) else None
            except OSError as error:
                raise trouble(error, parent) from None
        yield folder


def take_away_own():
    """Takes away the folders of this process whose blocks a request to end broke between two lines."""
    while OWN:
        _remove(next(iter(OWN)))


def leave(folder: Path):
    """Leaves a folder of this process to the next run, which finishes it and takes it away."""
    OWN.discard(folder)


def _remove(folder: Path):
    if folder in OWN:
        _clear(folder)
        _drop(folder)
        OWN.discard(folder)


def _clear(folder: Path):
    """Takes away all that is in a folder but its lock, by which the next run knows what is left if it cannot be."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            # Windows does not give up files that are still looked at.
            with suppress(OSError):
                if entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(entry.path)
                elif entry.name != LOCK:
                    Path(entry.path).unlink()


def _drop(folder: Path):
    """Takes away a folder in which there is nothing but its lock, if that."""
    with suppress(OSError):
        if [path.name for path in folder.iterdir()] == [LOCK]:
            (folder / LOCK).unlink()
        folder.rmdir()


def _hold(lock: IO, path: Path) -> bool:
    """Locks a new folder's lock for as long as it is open; False where somebody has it, or took it away."""
    try:
        lock_now(lock)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        lock.write(NO_LOCKS)
    return os.path.samestat(os.fstat(lock.fileno()), path.stat())


def take_away_forsaken(parent: Path, prefix: str, rescue: Callable[[Path], bool] | None = None):
    """Takes away those of `own_folder` in `parent` whose makers are gone.

    `rescue` sees each before, and says whether it may go.
    """
    wanted = re.compile(f"{re.escape(prefix)}[0-9a-f]{{{TOKEN}}}")
    try:
        with os.scandir(parent) as entries:
            found = [Path(entry.path) for entry in entries if wanted.fullmatch(entry.name) and _is_ours(entry)]
    except OSError:  # not there, or not to be read
        return
    for folder in found:
        with suppress(OSError):
            _take_away(folder, rescue)


def _is_ours(entry: os.DirEntry) -> bool:
    """Whether an entry is a real folder of the same user."""
    if not entry.is_dir(follow_symlinks=False):
        return False
    return os.name == "nt" or entry.stat(follow_symlinks=False).st_uid == os.getuid()


def _take_away(folder: Path, rescue: Callable[[Path], bool] | None):
    try:
        lock = (folder / LOCK).open("r+b")
    except FileNotFoundError:  # about to be made, or somebody was killed while taking the folder away
        folder.rmdir()  # if it is empty; who is just making it makes another
        return
    with lock:
        # Where its maker could lock none, nobody knows whether that is gone.
        gone = _locked(lock) and (
            lock.read(len(NO_LOCKS)) != NO_LOCKS or (time.time() - folder.stat().st_mtime > FORSAKEN_S)
        )
        gone = gone and (rescue is None or rescue(folder))
        if gone:
            _clear(folder)
    if gone:
        _drop(folder)


def _locked(file: IO) -> bool:
    """Locks a file for as long as it is open; False where somebody else has it, or the file system knows no locks."""
    try:
        lock_now(file)
    except OSError:
        return False
    return True


def lock_now(file: IO):
    """Locks a file for as long as it is open. BlockingIOError or PermissionError where somebody else has it."""
    if sys.platform == "win32":
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
