# SPDX-License-Identifier: GPL-3.0-or-later
"""Disks that are small, that may not be written, and that go away: what Linux can make of them for its user.

All mounts are made in a mount namespace of this process's own, so none is left and nobody else sees one.
"""

import os
import shutil
import subprocess
import time
from contextlib import suppress
from pathlib import Path

WITHOUT_PRIVILEGES = ("setpriv", "--bounding-set=-all")  # by which root may do what the owner of its files may


def own_mounts() -> list[str] | None:
    """The words that start a command in a mount namespace of its own; None where this system has none for its user."""
    for words in (["unshare", "--mount"], ["unshare", "--user", "--map-root-user", "--mount"]):
        with suppress(OSError):
            if not subprocess.run([*words, "true"], capture_output=True, check=False).returncode:
                return words
    return None


def mount(*words: object) -> bool:
    """Whether a mount could be made or changed."""
    return _call("mount", *words)


def unmount(place: Path, at_once: bool = False):
    """Takes a mount away, also where files of it are open if `at_once`."""
    _call("umount", *(["--lazy"] if at_once else []), place)


def _call(*words: object) -> bool:
    with suppress(OSError):
        return not subprocess.run([str(word) for word in words], capture_output=True, check=False).returncode
    return False


class SmallDisk:
    """A disk of so many bytes and files, in memory."""

    def __init__(self, place: Path, size: int, files: int):
        self.place = place
        place.mkdir(parents=True, exist_ok=True)
        if not mount("-t", "tmpfs", "-o", f"size={max(size // 4096, 1) * 4096},nr_inodes={files}", "tmpfs", place):
            raise OSError(f"{place} cannot be made a small disk")

    def grow(self):
        """Room again."""
        mount("-o", "remount,size=64m,nr_inodes=100000", self.place)

    def seal(self, seconds: float) -> bool:
        """Lets nobody write any more; False where somebody always did."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if mount("-o", "remount,ro", self.place):
                return True
        return False

    def open(self):
        """Lets everybody write again."""
        mount("-o", "remount,rw", self.place)

    def close(self):
        """Takes it away."""
        unmount(self.place, at_once=True)


class MovedFolder:
    """A folder that goes away for a while and comes back; an empty one is in its place meanwhile, or none.

    `place` is it, `between` where that lies which was made in its place.
    """

    def __init__(self, folder: Path, replaced: bool):
        self.place, self._elsewhere, self.between = folder / "share", folder / "elsewhere", folder / "between"
        self._replaced = replaced
        self.place.mkdir(parents=True)

    def come(self):
        """Calls it as before."""
        while True:
            with suppress(FileNotFoundError):
                self.place.rename(self.between)
            try:
                self._elsewhere.rename(self.place)
            except OSError:  # a batch made another just then
                shutil.rmtree(self.between, ignore_errors=True)
                continue
            return

    def go(self):
        """Calls it otherwise."""
        self.place.rename(self._elsewhere)
        if self._replaced:
            self.place.mkdir()


def possible(folder: Path) -> dict[str, bool]:
    """Which of these this system has for its user: "mounts", and "leave" that one lacks."""
    found = {"mounts": False, "leave": False}
    with suppress(OSError):
        SmallDisk(folder / "small", 4096, 10).close()
        found["mounts"] = True
    forbidden = folder / "forbidden"
    forbidden.mkdir(parents=True)
    forbidden.chmod(0o555)
    words = WITHOUT_PRIVILEGES if os.geteuid() == 0 else ()
    found["leave"] = not _call(*words, "mkdir", forbidden / "made") and _call(*words, "true")
    shutil.rmtree(folder, ignore_errors=True)
    return found
