# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that arrive in folders: which of the files are takes, and which of these are there whole."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core.data.errors import InputError
from .batch import is_result
from .edits import edits_beside
from .textpoints import is_other_tsv

# Endings of takes. Of files that share the rest of their name the first is the take: what was recorded comes before
# what another program made of it.
TAKE_ENDINGS = (".qtm", ".csv", ".c3d", ".trc", ".tsv")


LOOK_EVERY_S = 1.0  # s between two looks into a folder
# s for which a file has to be as it is before it is whole: copies over a network and programs that save pause for a
# second or two
SETTLED_S = 3.0

State = tuple[int, ...]  # what tells a file, and the edits beside it, from how they were before


@dataclass
class Arrival:
    """A file of a folder."""

    state: State  # as it was at the last look, and since when
    since: float
    tried: State | None = None  # the state in which it was worked on, None where it never was
    left_out: State | None = None  # the state in which it was seen to be no take

    @property
    def is_new(self) -> bool:
        """Whether nobody has looked at what it holds now."""
        return self.state not in (self.tried, self.left_out)


class Arrivals:
    """The takes in folders, as they come. The folders in them are not looked into."""

    def __init__(self, folders: Sequence[Path], look_s: float = LOOK_EVERY_S, settled_s: float = SETTLED_S):
        """Raises InputError where one is no folder, or cannot be read."""
        self.folders, self.look_s, self.settled_s = folders, look_s, settled_s
        self.files: dict[Path, Arrival] = {}
        self.taken: dict[str, Path] = {}  # by the name that results get
        self.passed: list[str] = []  # sentences on files that are left out, and on folders that cannot be read
        self._away: set[Path] = set()
        for folder in folders:
            if not folder.is_dir():
                raise InputError("is no folder; expected one to watch", folder)
            try:
                os.scandir(folder).close()
            except OSError as error:
                raise _unreadable(error, folder) from None

    def look(self, now: float) -> list[Path]:
        """Looks into the folders at a time, s; the takes that are whole, and were not tried as they are now."""
        found = dict(self._states())
        for path in self.files.keys() - found.keys():
            if path.parent not in self._away:
                del self.files[path]
        for path, state in found.items():
            known = self.files.setdefault(path, Arrival(state, now))
            if known.state != state:
                known.state, known.since = state, now
        ready = [path for path in self.files if path in found and self._is_ready(path, now)]
        return [path for path in sorted(ready, key=_rank) if self._is_take(path)]

    def try_now(self, path: Path) -> bool:
        """Notes that a take is worked on as it is; False where it has changed since the last look, or is gone."""
        known, state = self.files.get(path), _state_of(path)
        if known is None or known.state != state:
            return False
        known.tried = state
        return True

    def is_arriving(self, now: float) -> bool:
        """Whether a file may still be on its way at a time, s."""
        return any(one.is_new and now - one.since < self.settled_s for one in self.files.values())

    @property
    def empty(self) -> list[Path]:
        """Files without content: nobody knows whether they are about to get some."""
        return [path for path, one in self.files.items() if not one.state[0]]

    def _is_ready(self, path: Path, now: float) -> bool:
        known = self.files[path]
        # A file without content is about to get some.
        return known.is_new and known.state[0] > 0 and now - known.since >= self.settled_s

    def _is_take(self, path: Path) -> bool:
        """Whether a file is a take, and the only one that results get their name from; says so where it is not."""
        name, known = path.stem.casefold(), self.files[path]
        if is_result(path) or is_other_tsv(path):
            known.left_out = known.state
            return False
        rivals = [one for one in self.files if one != path and one.stem.casefold() == name]
        taken = self.taken.get(name)
        if taken in rivals:
            known.left_out = known.state
            self.passed.append(f"{path}: is left out, because {taken} has the same results; expected other names")
            return False
        before = [self.files[one] for one in rivals if _rank(one) < _rank(path)]
        if any(one.left_out is None and one.state[0] > 0 for one in before):
            return False  # until that one is there
        self.taken[name] = path
        return True

    def _states(self) -> Iterator[tuple[Path, State]]:
        for folder in self.folders:
            try:
                with os.scandir(folder) as entries:
                    names = [entry.name for entry in entries if _may_be_take(entry)]
            except OSError as error:  # a share that is away for a while
                if folder not in self._away:
                    self.passed.append(str(_unreadable(error, folder)))
                self._away.add(folder)
                continue
            self._away.discard(folder)
            for name in sorted(names):
                state = _state_of(folder / name)
                if state is not None:
                    yield folder / name, state


def _rank(path: Path) -> tuple[int, str]:
    return TAKE_ENDINGS.index(path.suffix.lower()), str(path)


def _may_be_take(entry: os.DirEntry) -> bool:
    """Whether a file has the name of a take; hidden ones and those of office programs are somebody's temporary ones."""
    try:
        return (
            not entry.name.startswith((".", "~$"))
            and Path(entry.name).suffix.lower() in TAKE_ENDINGS
            and entry.is_file()
        )
    except OSError:
        return False


def _state_of(path: Path) -> State | None:
    """Size and time of a take, and of the edits beside it; None where it is gone."""
    try:
        own = path.stat()
        edits = edits_beside(path)
        beside = None if edits is None else edits.stat()
    except OSError:
        return None
    state = (own.st_size, own.st_mtime_ns, own.st_ino)
    return state if beside is None else (*state, beside.st_size, beside.st_mtime_ns)


def _unreadable(error: OSError, folder: Path) -> InputError:
    return InputError(f"cannot be read ({error.strerror or error}); expected a folder of takes", folder)
