# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders for what is not finished. Where their maker was killed the next run takes them away, and only those.

The maker holds a lock on a file in its folder; the system lets go of it when the process ends, however it ends. So a
folder whose lock can be had is nobody's any more, on whichever machine or in whichever container its maker ran.
"""

import os
import re
import shutil
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

from ..core.data.errors import JobError

if os.name == "nt":
    import msvcrt
else:
    import fcntl

SCRATCH = "mocap-autolabel-"
LOCK = ".mocap-autolabel.lock"
TOKEN = 12  # letters that tell one folder from another
LOCKED = b"locked\n"
OWN: set[Path] = set()  # folders of this process that are there, or about to be
FORSAKEN_S = 86400.0  # s; nobody takes so long from making a lock to holding it


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
    folder = parent / f"{prefix}{uuid.uuid4().hex[:TOKEN]}"
    with ExitStack() as stack:
        OWN.add(folder)  # before it is made: a request to end may come at any line
        stack.callback(_remove, folder)
        try:
            folder.mkdir(mode=0o700)  # only its user may look into it
            lock = stack.enter_context((folder / LOCK).open("xb", buffering=0))
            _hold(lock)
        except OSError as error:
            raise trouble(error, parent) from None
        yield folder


def take_away_own():
    """Takes away the folders of this process whose blocks a request to end broke between two lines."""
    while OWN:
        _remove(next(iter(OWN)))


def _remove(folder: Path):
    # Windows does not give up files that are still looked at; then the next run takes them away.
    shutil.rmtree(folder, ignore_errors=True)
    OWN.discard(folder)


def _hold(lock: IO):
    """Locks a new folder's lock for as long as it is open, and says so in it."""
    # Where a file system knows no locks the file stays empty, and nobody ever takes the folder for forsaken.
    if _locked(lock):
        lock.write(LOCKED)


def take_away_forsaken(parent: Path, prefix: str, rescue: Callable[[Path], None] | None = None):
    """Takes away those of `own_folder` in `parent` whose makers are gone; `rescue` sees each before."""
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


def _take_away(folder: Path, rescue: Callable[[Path], None] | None):
    try:
        lock = (folder / LOCK).open("r+b")
    except FileNotFoundError:  # about to be made, or somebody was killed while taking the folder away
        gone = _forsaken(folder)
    else:
        with lock:
            # Held once, so it is free because its maker is gone, not because it is just being made.
            gone = _locked(lock) and (os.fstat(lock.fileno()).st_size > 0 or _forsaken(folder))
            if gone and rescue is not None:
                rescue(folder)
    if gone:
        shutil.rmtree(folder, ignore_errors=True)


def _forsaken(folder: Path) -> bool:
    return time.time() - folder.stat().st_mtime > FORSAKEN_S


def _locked(file: IO) -> bool:
    """Locks a file for as long as it is open; False where somebody else has it, or the file system knows no locks."""
    try:
        if os.name == "nt":
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
