# SPDX-License-Identifier: GPL-3.0-or-later
"""Output files that appear whole or not at all, together, and never in the place of what they are made from.

They are written beside their place, flushed to disk, then renamed. A list of what is to be renamed is on disk before
the first is: who is killed between two renames leaves it, and the next run in that folder finishes them. One run at a
time gives files their names in a folder, so that those of two never mix: a lock on a file there says whose turn it is.
"""

import json
import ntpath
import os
import stat
import sys
import time
import unicodedata
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import filterfalse
from pathlib import Path, PurePath
from typing import IO

from ..core.data.errors import InputError, JobError
from .scratch import LOCK, leave, lock_now, own_folder, take_away_forsaken
from .source import open_at_once, read_json

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


PART = ".part-mocap-autolabel-"
LIST = ".mocap-autolabel.json"  # in a folder of parts: what each part is like, and what it is to take the place of


class LeftAlone(UserWarning):
    """Something that was found and stays as it is, as it is not, or may not be, what it looks like."""


@contextmanager
def whole_file(target: Path, overwrite: bool = False, read: Iterable[Path] = ()) -> Iterator[Path]:
    """Gives the temporary path to write; at success the file takes its place, at failure nothing is left.

    Raises InputError when `target` exists and `overwrite` is not set, when it is one of the files that are `read`, or
    cannot be written there.
    """
    with whole_files([target], overwrite, read) as (temporary,):
        yield temporary


@contextmanager
def whole_files(targets: Sequence[Path], overwrite: bool = False, read: Iterable[Path] = ()) -> Iterator[list[Path]]:
    """The same for the several files of one job: they appear together when the block ends well, in their order.

    The temporary paths are in the order of `targets`, in folders within the same folders, with the same names. A
    temporary that the block did not write stands for an optional file: its target does not appear. Missing folders are
    made, and are gone again where nothing appears in them.
    """
    targets = [Path(target) for target in targets]
    parents = dict.fromkeys(target.parent for target in targets)
    for parent in parents:
        finish_renaming(parent)
    check_targets(targets, overwrite, read)
    with ExitStack() as stack:
        for parent in parents:
            stack.enter_context(_made_folder(parent))
        folders = {parent: stack.enter_context(own_folder(parent, PART, _unwritable)) for parent in parents}
        temporaries = [folders[target.parent] / target.name for target in targets]
        try:
            yield temporaries
        except OSError as error:
            raise _of_whom(error, targets[0].parent, list(folders.values())) from error
        pairs = [(part, target) for part, target in zip(temporaries, targets, strict=True) if part.exists()]
        for parent, folder in folders.items():
            if not (folder / LOCK).exists():  # and of a share that is gone no file was written
                raise JobError("went away while files were written there; expected it to stay", parent)
        _appear(pairs, overwrite)


def check_targets(targets: Sequence[Path], overwrite: bool = False, read: Iterable[Path] = ()):
    """Raises InputError where `whole_files` would, before any work."""
    keep_apart(read, targets)
    for target in targets:
        _refuse(target, overwrite)


def keep_apart(read: Iterable[Path], written: Iterable[Path]):
    """Raises InputError where a file that is to be written is one that is read, or is written twice.

    Links are followed, hard ones too, and names that differ in case are one file, as on Windows and macOS.
    """
    taken: dict[object, Path] = {}
    for path in written:
        own = _identities(path)
        other = next((taken[identity] for identity in own if identity in taken), None)
        if other is not None:
            raise InputError(f"would be written twice, also as {other}; expected different files", path)
        taken |= dict.fromkeys(own, path)
    for path in read:
        for identity in _identities(path):
            if identity in taken:
                what = "is read" if Path(path) == Path(taken[identity]) else f"is the file {path}, which is read,"
                raise InputError(f"{what} and would be written over; expected another name or folder", taken[identity])


def is_read(path: Path, read: Iterable[Path]) -> bool:
    """Whether a file is one of those that are read, under whatever name."""
    own = _identities(path)
    return any(own & _identities(one) for one in read)


def finish_renaming(folder: Path):
    """Finishes in a folder what a killed run had begun to rename, and takes away what it left half-written."""
    if _holds_remains(folder):
        with turns([folder]):
            take_away_forsaken(folder, PART, _rename_rest)


def free_path(place: Path, ending: str) -> Path:
    """The path with an ending, and with a number before it where something has that name."""
    path, number = place.with_name(place.name + ending), 1
    while path.exists() or path.is_symlink():
        number += 1
        path = place.with_name(f"{place.name}-{number}{ending}")
    return path


def _holds_remains(folder: Path) -> bool:
    try:
        with os.scandir(folder) as entries:
            return any(entry.name.startswith((PART, TURN)) for entry in entries)
    except OSError:  # not there, or not to be read
        return False


def _identities(path: Path) -> set[object]:
    """What a path has in common with every other one of the same file."""
    try:
        found: set[object] = {unicodedata.normalize("NFC", os.path.realpath(path)).casefold()}
    except (OSError, ValueError):  # no path at all, or longer than Windows takes
        return set()
    with suppress(OSError, ValueError):  # nothing is there yet
        status = Path(path).stat()
        if status.st_ino:
            found.add((status.st_dev, status.st_ino))
    return found


def _appear(pairs: Sequence[tuple[Path, Path]], overwrite: bool):
    """Renames parts to their targets, all or none of them as far as the system allows."""
    for part, target in pairs:
        try:
            _flush(part)
        except OSError as error:
            raise _unwritable(error, target) from None
    parents = dict.fromkeys(target.parent for _, target in pairs)
    with turns(parents):
        for parent in parents:
            take_away_forsaken(parent, PART, _rename_rest)  # or what one was killed at would mix with these later
        for _, target in pairs:
            _refuse(target, overwrite)
        _list(pairs)
        _rename(pairs)
    for parent in parents:
        _flush_folder(parent)


def _list(pairs: Sequence[tuple[Path, Path]]):
    """Puts into each folder of parts what is to be renamed, and what each is to take the place of."""
    for folder in dict.fromkeys(part.parent for part, _ in pairs):
        try:
            states: dict[str, list] = {
                part.name: [_state(part), _state(target)] for part, target in pairs if part.parent == folder
            }
            states[LOCK] = _mark(folder / LOCK)
            begun = folder / f"{LIST}~"
            begun.write_text(json.dumps(states), encoding="utf-8", newline="\n")
            _flush(begun)
            os.replace(begun, folder / LIST)  # noqa: PTH105 so that it is whole or not there
        except OSError as error:
            raise _unwritable(error, folder.parent) from None
        _flush_folder(folder)


def _rename(pairs: Sequence[tuple[Path, Path]]):
    done = 0
    try:
        for part, target in pairs:
            try:
                part.replace(target)
            except OSError as error:
                if done:  # the next run finds the rest of them, and their list
                    for folder in dict.fromkeys(part.parent for part, _ in pairs):
                        leave(folder)
                raise _unwritable(error, target) from None
            done += 1
    except KeyboardInterrupt:
        _rename([(part, target) for part, target in pairs if part.exists()])
        raise


def _rename_rest(folder: Path) -> bool:
    """Renames what is left in a folder of parts, unless its place is not as it was; whether the folder may go then.

    It stays where its list is not surely this program's own: whoever copies or plants one cannot know the mark.
    """
    if not os.path.lexists(folder / LIST):  # killed while it was still at work
        return True
    try:
        states = read_json(folder / LIST, "what a killed run left")
        ours = isinstance(states, dict) and states.pop(LOCK, None) == _mark(folder / LOCK)
    except (InputError, OSError):
        ours = False
    if not ours:
        words = "is left alone, as somebody else may have put it there; expected what a killed run of your own left"
        warnings.warn(LeftAlone(f"{folder}: {words}"), stacklevel=2)
        return False
    for name, (own, state) in states.items():
        part, target = folder / name, folder.parent / name
        if own is not None and _state(part) == own and _state(target) == state:
            part.replace(target)
    _flush_folder(folder.parent)
    return True


def _mark(lock: Path) -> list[int]:
    """What tells a folder of parts, by its lock, from a copy, and from one that was made to look like it.

    No copy and no archive can set when the system last changed what it knows of a file.
    """
    status = lock.lstat()
    return [status.st_ino, status.st_ctime_ns]


def _state(target: Path) -> list[int] | None:
    """What tells a file from any other that was put in its place; None where there is none."""
    try:
        status = target.lstat()
    except FileNotFoundError:
        return None
    return [status.st_size, status.st_mtime_ns]


def _flush(path: Path):
    """Waits until a file is on the disk."""
    with path.open("r+b") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path):
    """The same for the names in a folder, where the system can."""
    with suppress(OSError):  # Windows opens no folders
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def _refuse(target: Path, overwrite: bool):
    there = next(filter(os.path.exists, target.parents), target.parent)
    if os.name == "nt" and _is_reserved(target):  # the device may be there or not
        raise InputError("cannot be the name of a file (Windows reserves it); expected another name", target)
    try:
        for name in target.relative_to(there).parts:  # in a folder that is not there the system takes any
            with suppress(FileNotFoundError, NotADirectoryError):
                (there / name).lstat()
        kind = target.lstat().st_mode
        kind = target.stat().st_mode if overwrite and stat.S_ISLNK(kind) else kind
    except (FileNotFoundError, NotADirectoryError):
        return
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be the name of a file ({reason}); expected another name", target) from None
    if stat.S_ISDIR(kind):
        raise InputError("is a folder; expected the name of a file to write", target)
    if not overwrite:
        raise InputError("exists already; expected a new name, or --overwrite", target)
    # Renaming would put a file where a device was.
    if not stat.S_ISREG(kind):
        raise InputError("is no ordinary file; expected the name of a file to write", target)
    if os.name == "nt":  # which lets no file be replaced that a program has open: said before the first one is
        try:
            target.rename(target)
        except OSError as error:
            words = f"cannot be replaced ({error.strerror}); expected no other program to have it open"
            raise InputError(words, target) from None


def _is_reserved(path: PurePath) -> bool:
    """Whether a path of Windows has the name of a device, such as aux.tar.c3d."""
    if sys.version_info >= (3, 13):  # which warns of what paths had for it
        return ntpath.isreserved(path)
    return path.is_reserved()


@contextmanager
def none_left_empty(folder: Path) -> Iterator[None]:
    """Where a folder and those above it were missing, they go at the end if nothing is in them, whoever made them."""
    missing = list(filterfalse(os.path.exists, (folder, *folder.parents)))
    try:
        yield
    finally:
        with suppress(OSError):
            for one in missing:
                one.rmdir()


@contextmanager
def _made_folder(folder: Path) -> Iterator[None]:
    """Makes a folder, with those above it, of which none is left empty."""
    with none_left_empty(folder):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot be made a folder ({error.strerror}); expected a place to write", folder) from None
        # Said before the work, not after it.
        if not os.access(folder, os.W_OK | os.X_OK):
            raise InputError("is a folder that may not be written; expected a place to write", folder)
        yield


def _of_whom(error: OSError, place: Path, parts: Sequence[Path]) -> JobError:
    """The sentence for what the system says while the block runs: of the file that it names, else of the output."""
    named = Path(os.fsdecode(error.filename)) if isinstance(error.filename, str | bytes) else None
    if named is None or any(named.is_relative_to(folder) for folder in parts):
        return _unwritable(error, place)
    return JobError(f"the system says: {error.strerror or error}; expected a path that can be used", named)


def _unwritable(error: OSError, place: Path) -> JobError:
    return JobError(f"cannot be written ({error.strerror or error}); expected room and leave to write", place)
