# SPDX-License-Identifier: GPL-3.0-or-later
"""What one correction does to the labels that it does not name: python -m tests.accuracy.edits.

The takes of whole_takes.py, of people and motions that training left out. Somebody who knows the truth names the
trajectory that has the most points wrong or unnamed: in one frame, or for as long as it is there. With --keep DIR,
models are kept there and used again. With --blobs, virtual captures of recorded motion instead, of a person whom the
built-in set was not learned from, of which one blob is named: the middle one of the commonest wrong name.
"""

import argparse
import csv
import io
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from addon.capturing import truth_path
from addon.cli import main as run_command
from addon.core.data.errors import JobError
from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.core.edits.kinds import AssignBlob, AssignPoint, Edits
from addon.core.points.models import Model
from addon.core.points.whole_take.pipeline import USUAL_TARGET, PointOptions, label_points
from addon.demo.take import MODEL, make_performance
from addon.io.cameras import write_cameras
from addon.io.markersets import open_markerset
from addon.io.points import write_c3d
from addon.jobs import LabelJob, label_file

from .tables import table
from .whole_takes import CASES, Case, Take, actors, cut_up, model_of

ACTOR, PERSON = "actor41", "bd"
MARKERS = open_markerset(ACTOR).markers
CAPTURED, CAPTURED_FRAMES = (400, 1000, 2000, 3000), 150


@dataclass(frozen=True)
class Change:
    """What other labels became by an edit: right, wrong, or no longer right."""

    right: int
    wrong: int
    lost: int


def labelled(model: Model, points: Points, edits: Edits) -> np.ndarray | None:
    """The markers (T, P) that the product names, None where it refuses the take."""
    try:
        options = PointOptions("likelihood", USUAL_TARGET, edits=edits)
        return finished(label_points(points, model, options)).labels.marker
    except JobError:
        return None


def change(before: np.ndarray, after: np.ndarray, truth: np.ndarray, edited: np.ndarray) -> Change:
    """What changed among the labels (T, P) that the edit does not name; it names `edited` (T, P)."""
    other = ~edited & (before != after)
    was, now = (((given == truth) & (truth >= 0)) for given in (before, after))
    wrong = (after >= 0) & (after != truth)
    return Change(int((other & now).sum()), int((other & wrong).sum()), int((other & was).sum()))


def rows(case: Case, model: Model) -> Iterator[list[str]]:
    """A line of the table for each way to edit each take that is not right already."""
    for seed, take in enumerate(case.tested):
        points, marker = cut_up(take, case.markers, case.pieces, seed)
        truth = np.where(points.present, marker, -1)
        before = labelled(model, points, Edits())
        if before is None:
            continue
        bad = points.present & (before != truth) & (truth >= 0)
        wrong = int(((before >= 0) & (before != truth)).sum())
        if not bad.any():
            continue
        column = int(bad.sum(axis=0).argmax())
        frames = np.flatnonzero(bad[:, column]) + points.first_frame
        middle = int(frames[len(frames) // 2])
        name = case.markers[marker[column]]
        for span, what in (((middle, middle), "one frame"), (None, "all of it")):
            edit = AssignPoint(column, name, frames=span)
            edited = np.zeros(truth.shape, bool)
            edited[slice(None) if span is None else middle - points.first_frame, column] = True
            after = labelled(model, points, Edits((edit,)))
            assert (after[edited & points.present] == marker[column]).all()
            found = change(before, after, truth, edited)
            yield [
                f"{case.name}, {take.subject}",
                f"{int(bad.sum()) - wrong}, {wrong}",
                f"{name}, {what}",
                str(int((edited & bad).sum())),
                f"{found.right}, {found.wrong}, {found.lost}",
            ]


def blob_rows() -> Iterator[list[str]]:
    """A line of the table for each part of a person's take that is captured, of those that are not right already."""
    room = make_performance(open_markerset(MODEL)).cameras
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_cameras(folder / "room.toml", room)
        for first in CAPTURED:
            take = actors("cmu41")[PERSON].part(first, first + CAPTURED_FRAMES)
            source = folder / f"{first}.csv"
            captured(take, folder / "room.toml", source)
            with truth_path(source).open(newline="") as file:
                rows = list(csv.DictReader(file))
            truth = np.array([MARKERS.index(row["marker"]) if row["marker"] in MARKERS else -1 for row in rows])
            merged = np.array(["|" in row["marker"] for row in rows])
            job = LabelJob(source, room, ACTOR, folder / "out", rate=take.rate, keep=True, overwrite=True)
            before = markers_of_blobs(job)
            wrong = np.flatnonzero((before >= 0) & (before != truth) & ~merged & (truth >= 0))
            if not len(wrong):
                continue
            pairs, count = np.unique(np.stack([before[wrong], truth[wrong]]), axis=1, return_counts=True)
            most = pairs[:, count.argmax()]
            own = wrong[(before[wrong] == most[0]) & (truth[wrong] == most[1])]
            row = rows[own[len(own) // 2]]
            edit = AssignBlob(row["camera"], int(row["frame"]), float(row["x"]), float(row["y"]), row["marker"])
            after = markers_of_blobs(replace(job, edits=Edits((edit,))))
            edited = np.arange(len(rows)) == own[len(own) // 2]
            truth = np.where(merged, -2, truth)
            found = change(before, after, truth, edited | merged)
            yield [
                f"{first} to {first + CAPTURED_FRAMES}",
                str(len(rows)),
                str(len(wrong)),
                f"{row['marker']}, which was {MARKERS[most[0]]}",
                f"{found.right}, {found.wrong}, {found.lost}",
            ]


def captured(take: Take, cameras: Path, target: Path):
    """A virtual capture of a take in the middle of a room, with the usual trouble and the body in the way."""
    xyz = take.xyz.copy()
    xyz[..., :2] -= np.nanmean(xyz, axis=(0, 1))[:2]
    path = target.with_suffix(".c3d")
    write_c3d(path, Points(take.markers, xyz, np.zeros(xyz.shape[:2]), take.rate, 1))
    with redirect_stdout(io.StringIO()):
        assert run_command(["simulate", str(path), "--cameras", str(cameras), "--out", str(target)]) == 0


def markers_of_blobs(job: LabelJob) -> np.ndarray:
    """(N,) the markers that the product names the blobs of a take."""
    return np.concatenate([chunk.labels.marker for _, chunk in finished(label_file(job)).chunks])


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", help=f"as their names begin, of {' '.join(CASES)}; all unless said")
    parser.add_argument("--keep", type=Path, help="a folder for the models")
    parser.add_argument("--blobs", action="store_true", help="virtual captures instead")
    given = parser.parse_args()
    if given.blobs:
        heads = ["frames of bd", "blobs", "wrong", "edit", "others: right, wrong, lost"]
        print(table(heads, list(blob_rows())))
        return
    found = []
    for make in CASES.values():
        for case in make():
            if not given.cases or any(case.name.startswith(name) for name in given.cases):
                for row in rows(case, model_of(case, given.keep)):
                    found.append(row)
                    print(row, flush=True)
    print(table(["take", "unnamed, wrong", "edit", "labels that it names", "others: right, wrong, lost"], found))


if __name__ == "__main__":
    main()
