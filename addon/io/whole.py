# SPDX-License-Identifier: GPL-3.0-or-later
"""Output files that appear whole or not at all: written beside their place, then renamed."""

import os
import stat
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from ..core.data.errors import InputError, JobError

PART, TOKEN = ".part-", 12  # how the name of a temporary begins, and how many letters tell one job's from another's


@contextmanager
def whole_file(target: Path, overwrite: bool = False) -> Iterator[Path]:
    """Gives the temporary path to write; at success the file takes its place, at failure nothing is left.

    Raises InputError when `target` exists and `overwrite` is not set, or cannot be written there.
    """
    with whole_files([target], overwrite) as (temporary,):
        yield temporary


@contextmanager
def whole_files(targets: Sequence[Path], overwrite: bool = False) -> Iterator[list[Path]]:
    """The same for the several files of one job: they appear together when the block ends well.

    The temporary paths are in the order of `targets`, in the same folders, with the same suffixes. A temporary that
    the block did not write stands for an optional file: its target does not appear. Missing folders are made.
    """
    targets = [Path(target) for target in targets]
    for target in targets:
        _refuse(target, overwrite)
    token = uuid.uuid4().hex[:TOKEN]
    temporaries = [target.with_name(f"{PART}{token}-{target.name}") for target in targets]
    _make_folders(targets)
    try:
        try:
            yield temporaries
        except OSError as error:
            raise _unwritable(error, targets[0].parent) from error
        written = [
            (temporary, target) for temporary, target in zip(temporaries, targets, strict=True) if temporary.exists()
        ]
        for _, target in written:
            _refuse(target, overwrite)
        for temporary, target in written:
            try:
                temporary.replace(target)
            except OSError as error:
                raise _unwritable(error, target) from None
    finally:
        for temporary in temporaries:
            with suppress(OSError):  # a name that could not be written cannot be taken away either
                temporary.unlink(missing_ok=True)


def final_name(path: Path) -> str:
    """The name that a file will have when it is whole: what a format that names itself should say."""
    name = Path(path).name
    return name[len(PART) + TOKEN + 1 :] if name.startswith(PART) else name


def _refuse(target: Path, overwrite: bool):
    try:
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


def _make_folders(targets: Sequence[Path]):
    for target in targets:
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"cannot be made a folder ({error.strerror}); expected a place to write", target.parent
            ) from None
        # Told before the work, not after it.
        if not os.access(target.parent, os.W_OK | os.X_OK):
            raise InputError("is a folder that may not be written; expected a place to write", target.parent)


def _unwritable(error: OSError, place: Path) -> JobError:
    return JobError(f"cannot be written ({error.strerror or error}); expected room and leave to write", place)
