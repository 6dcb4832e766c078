# SPDX-License-Identifier: GPL-3.0-or-later
"""Learned from one labelled frame of a person, all of another part or take labelled: python -m tests.accuracy.one_frame

The frame is the fullest of the first third of a take, or of a standing take; what it shows is the set. Prints the table
of results/one_frame.json.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from addon.core.data.errors import UserError
from addon.core.training.takes import LabelledTake
from addon.io.points import read_points
from scripts.results import markdown

from . import people, whole_takes
from .registry import Outcome, labelled_points

STRANGERS = people.DATA.parent / "strangers"
FRAMES = 3000  # that are labelled, at most
OF_ONE_TAKE = (
    *(people.DATA / people.OTHERS[name] for name in ("serve", "ball", "s02", "s135", "p2")),
    people.DATA / "blobs/qualisys_run/run.c3d",
    people.DATA / "rooms/vicon12/walking_1.c3d",
    people.DATA / "people/gaps/test_walking.c3d",
    *(people.DATA / f"people/clouthier/{name}.c3d" for name in ("KneeltoProne01", "PronetoRun01")),
    *(STRANGERS / f"plugin_gait/{name}.c3d" for name in ("nick", "pete", "jack_bat", "player1", "pigsimple_normal1")),
    *(STRANGERS / f"plates/{name}.trc" for name in ("S02", "S04", "S06")),
)


def worn(path: Path) -> people.Take:
    """A take in the markers that are named in it and there for a third of it."""
    take = read_points(path)
    seen = np.isfinite(take.xyz[..., 0]).mean(axis=0) > 1 / 3
    kept = [at for at, name in enumerate(take.names) if seen[at] and not name.startswith("*")]
    return people.Take(path.stem, path.stem, tuple(take.names[at] for at in kept), take.xyz[:, kept], take.rate)


def trials() -> Iterator[tuple[str, people.Take, people.Take]]:
    """What is learned from, and what is labelled, which begins with the frame after the one that is learned."""
    for path in OF_ONE_TAKE:
        take = worn(path)
        frame = fullest(take.part(0, max(len(take.xyz) // 3, 1)))
        yield path.stem, take.part(frame, frame + 1), take.part(frame + 1, frame + 1 + FRAMES)
    for person in people.WALKERS:
        still, walk = (people.read(path, person).of(whole_takes.lab59()) for path in people.files_of(person)[:2])
        frame = fullest(still)
        yield f"{person}, standing", still.part(frame, frame + 1), walk


def fullest(take: people.Take) -> int:
    """The frame that shows most markers."""
    return int(np.isfinite(take.xyz[..., 0]).sum(axis=1).argmax())


def main():
    """Prints how each was named."""
    people.need_people()
    rows, total = [], np.zeros(3, int)
    for name, frame, tested in trials():
        there = np.isfinite(frame.xyz[0, :, 0])
        markers = tuple(marker for marker, seen in zip(frame.markers, there, strict=True) if seen)
        shown = tested.of(markers)
        with threadpool_limits(1, user_api="blas"):
            try:
                known = LabelledTake("frame", "somebody", markers, frame.of(markers).xyz)
                model = whole_takes.learned("one", [known], markers)
            except UserError as error:
                rows.append([name, str(len(markers)), "", "not learned", str(error)])
                continue
            outcome = labelled_points(*whole_takes.anonymous(shown, markers), model)
        counts = counts_of(outcome)
        total += counts
        rows.append([name, str(len(markers)), *shares(counts)])
        print(*rows[-1], outcome.refused, file=sys.stderr, flush=True)
    rows.append(["all", "", *shares(total)])
    print(markdown(["take", "markers", "labels", "right", "wrong"], rows))


def counts_of(outcome: Outcome) -> np.ndarray:
    """How many labels are right, wrong and there."""
    return np.array([part.sum() for part in (outcome.right, outcome.wrong, outcome.there)])


def shares(counts: np.ndarray) -> tuple[str, str, str]:
    """Of labels that are right, wrong and there: how many are there, and the shares of the others."""
    right, wrong, there = counts.tolist()
    return str(there), f"{100 * right / max(there, 1):.1f} %", f"{100 * wrong / max(right + wrong, 1):.2f} %"


if __name__ == "__main__":
    main()
