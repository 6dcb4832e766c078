# SPDX-License-Identifier: GPL-3.0-or-later
"""What training on does to takes of people who are in no training: python -m tests.accuracy.training_on FOLDER.

Takes of `body26` alone are written to the folder, and models of them are trained on through the command line: with
people whose names are right, in the model's own place from two people on, and with takes whose names are exchanged,
some by whoever recorded them. Three people are kept to check the models on, and never learned from.
"""

import argparse
import json
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from addon.cli import main as command_line
from addon.core.data.takes import Points
from addon.io.markersets import SUFFIX
from addon.io.points import write_c3d

from . import people
from .tables import table

KEPT = ("HC002D", "HC033A", "HC039A")
KNOWN = ("HC031A", "HC032A", "HC036A", "HC044A")
RIGHT = ("HC038A", "HC055A")
RECORDED_WRONG = "HC030A"  # both markers of the left wrist exchanged in all three takes


@dataclass(frozen=True)
class Lesson:
    """A training on: what it is called, whose takes, and what becomes of their names."""

    name: str
    person: str
    renamed: Callable[[str], str] = str
    as_recorded: bool = False


def other_side(name: str) -> str:
    """The marker's name with left and right exchanged."""
    return {"L": "R", "R": "L"}.get(name[0], name[0]) + name[1:]


def exchanged(one: str, other: str) -> Callable[[str], str]:
    """Names with two of them exchanged."""
    return lambda name: {one: other, other: one}.get(name, name)


LESSONS = (
    *(Lesson(f"{person}, names right", person) for person in RIGHT),
    Lesson(f"{RECORDED_WRONG} as recorded: markers of a wrist exchanged", RECORDED_WRONG, as_recorded=True),
    Lesson("HC055A, LKNE and LANK exchanged", "HC055A", exchanged("LKNE", "LANK")),
    Lesson("HC055A, left and right exchanged", "HC055A", other_side),
)


def written(folder: Path, lesson: Lesson) -> list[Path]:
    """The takes of a lesson as files."""
    exchanges = dict(people.EXCHANGED)
    if lesson.as_recorded:
        people.EXCHANGED.clear()
    people._read.cache_clear()
    try:
        takes = people.takes([lesson.person])
    finally:
        people.EXCHANGED.update(exchanges)
    paths = []
    for take in takes:
        path = folder / lesson.name.replace(" ", "_").replace(":", "") / lesson.person / take.path.name
        path.parent.mkdir(parents=True, exist_ok=True)
        own = [index for index, name in enumerate(take.names) if name in people.BODY26]
        names = tuple(lesson.renamed(take.names[index]) for index in own)
        xyz = take.xyz[:, own]
        residual = np.where(np.isfinite(xyz[..., 0]), 0.0004, np.nan)
        write_c3d(path, Points(names, xyz, residual, take.rate, 1))
        paths.append(path)
    return paths


def taught(takes: list[Path], out: Path, *words) -> dict:
    """The report of a training; with what its exit status was."""
    report = out.with_suffix(".report")
    line = ["train", *takes, "--out", out, "--report", report, "--overwrite", "--by", "measured", *words]
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        status = command_line([str(word) for word in line])
    return json.loads(report.read_text(encoding="utf-8")) | {"status": status}


def row(name: str, report: dict) -> list[str]:
    """What a training on did, for the table."""
    check = report["check"]
    kept = [take for take in check["takes"] if take["names"] == "kept"]
    shares = []
    for what in ("recall", "wrong"):
        for rows in ([check["all"]], kept):
            weights = [1] if rows is not kept else [take["points"] for take in kept]
            before, after = (np.average([one[what][at] for one in rows], weights=weights) for at in (0, 1))
            shares.append(f"{100 * before:.2f} → {100 * after:.2f}")
    return [name, str(len(check["takes"])), *shares, "no" if report["status"] else "yes"]


HEADS = ("trained on with", "takes", "right, all, %", "right, kept, %", "wrong, all, %", "wrong, kept, %", "adopted")


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.accuracy.training_on", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="an empty folder for takes and models")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    right = {person: written(folder, Lesson("right", person)) for person in (*KEPT, *KNOWN, *RIGHT)}
    kept = [path for person in KEPT for path in right[person]]
    rows = []
    grown = folder / f"grown{SUFFIX}"
    taught([path for person in KNOWN[:2] for path in right[person]], grown, "--check", *kept)
    for person in (*KNOWN[2:], *RIGHT):
        report = taught(right[person], grown, "--from", grown)
        rows.append(row(f"{KNOWN[0]}, {KNOWN[1]} and whoever was adopted; {person}, names right", report))
    base = folder / f"lab{SUFFIX}"
    taught([path for person in KNOWN for path in right[person]], base, "--check", *kept)
    for number, lesson in enumerate(LESSONS):
        report = taught(written(folder, lesson), folder / f"lesson{number}{SUFFIX}", "--from", base)
        rows.append(row(f"{', '.join(KNOWN)}; {lesson.name}", report))
    print(table(HEADS, rows))


if __name__ == "__main__":
    main()
