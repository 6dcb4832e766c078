# SPDX-License-Identifier: GPL-3.0-or-later
"""What one correction does to the labels that it does not name: python -m tests.accuracy.edits.

The takes of whole_takes.py, of people and motions that training left out. Somebody who knows the truth names the
trajectory that has the most points wrong or unnamed: in one frame, or for as long as it is there. With --keep DIR,
models are kept there and used again.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from addon.core.data.errors import JobError
from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.core.edits.kinds import AssignPoint, Edits
from addon.core.pipelines.points import USUAL_TARGET, PointOptions, label_points
from addon.core.points.models import Model

from .tables import table
from .whole_takes import CASES, Case, cut_up, model_of


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


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", help=f"as their names begin, of {' '.join(CASES)}; all unless said")
    parser.add_argument("--keep", type=Path, help="a folder for the models")
    given = parser.parse_args()
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
