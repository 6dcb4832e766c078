# SPDX-License-Identifier: GPL-3.0-or-later
"""Disks that are small, that may not be written, and that go away: what Linux can make of them for its user.

All mounts are made in a mount namespace of this process's own, so none is left and nobody else sees one.
"""

import array
import fcntl
import os
import shutil
import struct
import subprocess
import time
from contextlib import suppress
from pathlib import Path

GET_FLAGS, SET_FLAGS, IMMUTABLE = 0x80086601, 0x40086602, 0x10  # of linux/fs.h
SHUT_DOWN, WITHOUT_LOG = 0x8004587D, 2  # of fs/ext4/ext4.h: what is not on the disk by now never gets there
IMAGE_MB = 16
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


class Share:
    """A folder that is mounted from elsewhere, goes away and comes back.

    `place` is it, `between` where that lies which was made in its place meanwhile.
    """

    def __init__(self, folder: Path):
        self.place, self._behind, self._view = folder / "share", folder / "behind", folder / "view"
        self.between = self._view / "share"
        for each in (self.place, self._behind, self._view):
            each.mkdir(parents=True)
        # A folder without what is mounted in it.
        if not mount("--bind", folder, self._view):
            raise OSError(f"{folder} cannot be mounted")
        self.come()

    def come(self):
        """Mounts it."""
        if not mount("--bind", self._behind, self.place):
            raise OSError(f"{self.place} cannot be mounted")

    def go(self):
        """Takes it from under whoever uses it: an empty folder is there instead."""
        unmount(self.place, at_once=True)

    def close(self):
        """Takes it away for good."""
        self.go()
        unmount(self._view, at_once=True)


class MovedFolder:
    """A folder that is called otherwise for a while; an empty one is in its place, or none."""

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

    def close(self):
        """Leaves it."""


class Disk:
    """A disk with a journal, which loses power: what was not flushed is gone, and whoever uses it hears so."""

    def __init__(self, folder: Path):
        self.place, self._image, self.between = folder / "share", folder / "image", folder / "between"
        self.place.mkdir(parents=True)
        with self._image.open("wb") as file:
            file.truncate(IMAGE_MB << 20)
        if not (_call("mkfs.ext4", "-q", "-F", "-m", "0", self._image) and self._mount()):
            raise OSError(f"{self.place} cannot be made a disk")

    def _mount(self) -> bool:
        return mount("-o", "loop", self._image, self.place)

    def go(self):
        """Takes its power."""
        number = os.open(self.place, os.O_RDONLY)
        try:
            device = os.fstat(number).st_dev
            if not Path(f"/sys/dev/block/{os.major(device)}:{os.minor(device)}/loop").is_dir():
                raise OSError(f"{self.place} is on a disk that others use")
            fcntl.ioctl(number, SHUT_DOWN, struct.pack("I", WITHOUT_LOG))
        finally:
            os.close(number)

    def come(self):
        """Power again, for which nobody may use it any more."""
        unmount(self.place)
        if not self._mount():
            raise OSError(f"{self.place} cannot be mounted again")

    def close(self):
        """Takes it away."""
        unmount(self.place)


def set_fast(folder: Path, fast: bool):
    """Forbids or allows anybody, root too, to put a file into a folder or to take one out."""
    number = os.open(folder, os.O_RDONLY)
    try:
        flags = array.array("L", [0])
        fcntl.ioctl(number, GET_FLAGS, flags)
        flags[0] = flags[0] | IMMUTABLE if fast else flags[0] & ~IMMUTABLE
        fcntl.ioctl(number, SET_FLAGS, flags)
    finally:
        os.close(number)


def possible(folder: Path) -> dict[str, bool]:
    """Which of these this system has for its user: "mounts", "disks", "fast" folders, "leave" that one lacks."""
    found = {"mounts": False, "disks": False, "fast": False, "leave": False}
    with suppress(OSError):
        SmallDisk(folder / "small", 4096, 10).close()
        found["mounts"] = True
    # Of a namespace of one's own user neither is asked for.
    with suppress(OSError):
        disk = Disk(folder / "disk")
        disk.go()
        disk.come()
        disk.close()
        found["disks"] = True
    fast = folder / "fast"
    fast.mkdir(parents=True)
    with suppress(OSError):
        set_fast(fast, True)
        set_fast(fast, False)
        found["fast"] = True
    fast.chmod(0o555)
    words = WITHOUT_PRIVILEGES if os.geteuid() == 0 else ()
    found["leave"] = not _call(*words, "mkdir", fast / "made") and _call(*words, "true")
    shutil.rmtree(folder, ignore_errors=True)
    return found
