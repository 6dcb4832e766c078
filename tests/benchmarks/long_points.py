# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of long takes of points, stage by stage: python -m tests.benchmarks.long_points [--frames 432000] [--blend].

A virtual person's markers are mirrored in time until the take is as long as asked, hidden in bursts, and among ghosts;
the pieces share the columns of a C3D file, as recorders write them, which is labelled from file to files. So that an
hour is measured in minutes the names of single frames are read off the points, which say in the fractions of their x,
in mm, what marker they are: naming holds some frames at a time, however long the take is. With --blend a Blender file
is saved as well, and opened, played and saved again by another process. Linux only.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import process_time

import numpy as np

from addon.core.data.lanes import Lanes
from addon.core.data.takes import BY_LIKELIHOOD, NO_STEP, Labels
from addon.core.points.whole_take import pipeline
from addon.demo.take import make_performance
from addon.io.c3d.writing import write_c3d_file
from addon.io.markersets import open_markerset
from addon.jobs import LabelJob, label_file

from .long_blobs import open_saved
from .memory import forget_peak, megabytes

RATE, PARTS = 120.0, 128  # frames a second; of a millimetre, of which the first are the markers'
BURST, HIDDEN, MOST = 80, 20, 5  # a burst begins every so many frames, hides for so many, so many markers at most
GHOST_EVERY, GHOST = 60, 40  # frames from one ghost to the next, and that it lasts
REST = 120  # frames between two pieces in one column


class NamesToldByPoints:
    """A namer that reads off the points what they are."""

    step = BY_LIKELIHOOD

    def __init__(self, markers: int):
        self.markers = markers

    def name(self, points: np.ndarray, rate: float) -> Iterator[Labels]:
        """See `naming.Namer`."""
        for first in range(0, len(points), 1000):
            told = np.rint((np.nan_to_num(points[first : first + 1000, :, 0]) * 1000 % 1) * PARTS) - 1
            marker = np.where((told >= 0) & (told < self.markers), told, -1).astype(np.int16)
            named = marker >= 0
            yield Labels(marker, np.where(named, self.step, NO_STEP), named * 0.999, named * 0.9999)


def write_take(path: Path, frames: int, markerset: str) -> tuple[int, int]:
    """Writes the take, and gives how many pieces and columns it has."""
    walk = make_performance(open_markerset(markerset)).take.xyz
    index = np.abs((np.arange(frames) + len(walk) - 1) % (2 * len(walk) - 2) - (len(walk) - 1))
    rng, markers = np.random.default_rng(0), walk.shape[1]
    shown = np.ones((frames, markers), bool)
    for first in range(0, frames, BURST):
        gone = rng.choice(markers, rng.integers(0, MOST + 1), replace=False)
        shown[first : first + HIDDEN, gone] = False
    pieces = [
        (first, after, marker)
        for marker in range(markers)
        for first, after in np.flatnonzero(np.diff(np.r_[0, shown[:, marker], 0])).reshape(-1, 2).tolist()
    ]
    starts = rng.integers(0, frames - GHOST, frames // GHOST_EVERY)
    pieces += [(int(first), int(first) + GHOST, -1) for first in starts]
    pieces = [pieces[one] for one in rng.permutation(len(pieces)).tolist()]
    first, after, _ = np.array(pieces).T
    lanes = Lanes.packed(first, after - 1 + REST)
    xyz = np.full((frames, lanes.count, 3), np.nan, np.float32)
    for (begin, end, marker), lane in zip(pieces, lanes.lane.tolist(), strict=True):
        own = walk[index[begin:end], max(marker, 0)].copy()
        if marker < 0:
            own += rng.normal(0, 0.4, 3)
        own[:, 0] = (np.floor(own[:, 0] * 1000) + (marker + 1) / PARTS) / 1000
        xyz[begin:end, lane] = own
    residual = np.where(np.isfinite(xyz[..., 0]), np.float32(0.0005), np.float32(np.nan))
    write_c3d_file(path, [f"*{column}" for column in range(1, lanes.count + 1)], xyz, residual, RATE, 1)
    return len(pieces), lanes.count


def measure(path: Path, out: Path, markerset: str, blend: bool):
    """Labels the take and prints a row for every stage."""
    import scipy.optimize  # noqa: F401 - which is not the take's

    pipeline.namer_of = lambda *_: NamesToldByPoints(len(open_markerset(markerset)))
    before, stage, begin = megabytes("VmRSS"), "read", process_time()
    forget_peak()
    print("| stage | peak, MB | seconds |\n| --- | ---: | ---: |")

    def row():
        print(f"| {stage} | {megabytes('VmHWM') - before:.0f} | {process_time() - begin:.0f} |", flush=True)

    for step in label_file(LabelJob(path, None, markerset, out=out, up="z", blend=blend)):
        note = "name" if step.note.startswith("frame ") else step.note
        if note != stage:
            row()
            stage, begin = note, process_time()
            forget_peak()
    row()
    report = json.loads(next(out.glob("*.report.json")).read_text(encoding="utf-8"))
    print(f"\n{report['points']} points, {report['points'] - report['unlabelled']} named")


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=432_000)
    parser.add_argument("--markerset", default="actor53")
    parser.add_argument("--only-write", type=Path, help="write the take there, and label nothing")
    parser.add_argument("--take", type=Path, help="one that was written so; else it is made, which needs memory too")
    parser.add_argument("--blend", action="store_true", help="save a Blender file as well, and open it")
    given = parser.parse_args()
    if given.only_write:
        print(*write_take(given.only_write, given.frames, given.markerset))
        return
    with tempfile.TemporaryDirectory() as folder:
        path = given.take or Path(folder) / "long.c3d"
        if not given.take:
            print("{} pieces in {} columns\n".format(*write_take(path, given.frames, given.markerset)))
        out = Path(folder) / "out"
        measure(path, out, given.markerset, given.blend)
        if given.blend:
            open_saved(out / f"{path.stem}.blend")


if __name__ == "__main__":
    main()
