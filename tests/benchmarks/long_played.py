# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender files of long takes: python -m tests.benchmarks.long_played [--frames 5000 50000 432000].

The demo's virtual take is labelled once; its motion there and back again, for as long as asked, is saved as a Blender
file that plays it, whatever its length, which another process opens, plays and saves again. No blob is labelled twice,
so this is only the Blender part of `long_blobs --blend`. Linux only.
"""

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from time import process_time

import numpy as np

from addon.blendfile import save_played, start_blender
from addon.core.data.takes import Motion, Points
from addon.demo.take import MODEL
from addon.io.markersets import open_markerset
from addon.io.poses import PoseFile
from addon.io.whole import whole_files
from addon.jobs import LabelJob, label_file

from .long_blobs import RATE, open_saved, write_take
from .memory import forget_peak, megabytes

ONCE = 2000  # frames that are labelled


class ThereAndBack:
    """Places (F, M, 3) of which any slice can be had, made of a take's own (T, M, 3)."""

    def __init__(self, once: np.ndarray, frames: int):
        self.once, self.shape = once, (frames, *once.shape[1:])

    def __getitem__(self, part: slice) -> np.ndarray:
        return self.once[there_and_back(part.start, part.stop, len(self.once))]


def there_and_back(first: int, last: int, count: int) -> np.ndarray:
    """Which of `count` frames each of the frames from `first` up to `last` is."""
    number = np.arange(first, last) % (2 * count)
    return np.minimum(number, 2 * count - 1 - number)


def labelled_once(folder: Path) -> Motion:
    """The motion of the demo's take."""
    write_take(folder, ONCE)
    job = LabelJob(folder / "take.csv", folder / "cameras.toml", MODEL, out=folder / "once", rate=RATE, keep=True)
    steps = label_file(job)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            parts = [chunk.motion for _, chunk in end.value.chunks]
            return Motion(*(np.concatenate([getattr(one, field.name) for one in parts]) for field in fields(Motion)))


def chunks(once: Motion, frames: int, size: int = 500) -> Iterator[Motion]:
    """The motion there and back until there are so many frames."""
    for start in range(0, frames, size):
        stop = min(start + size, frames)
        rows = there_and_back(start, stop, len(once.frames))
        part = Motion(*(getattr(once, field.name)[rows] for field in fields(Motion)))
        yield replace(part, frames=np.arange(1 + start, 1 + stop))


def measure(folder: Path, once: Motion, frames: int):
    """Saves the take, and prints the peak beyond what Blender and the program take themselves."""
    folder.mkdir()
    worn = open_markerset(MODEL)
    targets = [folder / "take.motion.pc2", folder / "take.blend"]
    begin, before = process_time(), megabytes("VmRSS")
    forget_peak()
    with PoseFile(folder) as poses, whole_files(targets) as (motion, blend):
        for part in chunks(once, frames):
            poses.append(part)
        none = np.broadcast_to(np.float32(np.nan), (frames, len(worn.markers)))
        points = Points(worn.markers, ThereAndBack(once.markers, frames), none, RATE, 1)
        save_played(blend, motion, Path("take.csv"), worn, points, poses, (), ())
    took, peak = process_time() - begin, megabytes("VmHWM") - before
    print(f"{frames} frames: saved with {peak:.0f} MB beyond {before:.0f}, {took:.0f} s of the processor", flush=True)
    open_saved(folder / "take.blend")


def main():
    """Prints what it takes to save, open and play takes of several lengths."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, nargs="*", default=[5_000, 50_000, 432_000])
    given = parser.parse_args()
    start_blender()
    with tempfile.TemporaryDirectory() as name:
        once = labelled_once(Path(name))
        for frames in given.frames:
            measure(Path(name) / str(frames), once, frames)


if __name__ == "__main__":
    main()
