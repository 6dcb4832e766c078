# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line as a measurement calls it, and what it wrote."""

import csv
import json
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from time import process_time

from addon.cli import main

KEYS = ("frame", "camera", "x", "y")


@dataclass(frozen=True)
class Files:
    """A take of blobs as files, the model that names it, and its rate in frames a second."""

    blobs: Path
    truth: Path
    cameras: Path
    model: Path | str
    rate: float


@dataclass(frozen=True)
class Answer:
    """What `label` wrote, the report and the labels file, and the seconds of one core that it took.

    The core's seconds hold reading and writing too, and depend little on what else the machine does.
    """

    report: dict
    labels: Path
    seconds: float


def command(*words):
    """Runs a command line; RuntimeError where it fails."""
    with redirect_stdout(StringIO()) as said:
        status = main([str(word) for word in words])
    if status:
        raise RuntimeError(f"{words} ended with status {status}: {said.getvalue()}")


def labelled(take: Files, out: Path, *words) -> Answer:
    """Labels a take with `label`, the options `words` and no hints."""
    where = ("--cameras", take.cameras, "--model", take.model, "--rate", take.rate, "--out", out)
    begin = process_time()
    command("label", take.blobs, *where, "--overwrite", *words)
    seconds = process_time() - begin
    stem = out / take.blobs.stem
    report = json.loads(Path(f"{stem}.report.json").read_text(encoding="utf-8"))
    return Answer(report, Path(f"{stem}.labels.csv"), seconds)


def rows_of(path: Path, frames: tuple[int, int] | None = None) -> list[dict[str, str]]:
    """The rows of a file of labels or truth, of some frames."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file)
        return [row for row in rows if frames is None or frames[0] <= int(row["frame"]) <= frames[1]]


def side_by_side(labels: list[dict[str, str]], truth: list[dict[str, str]]):
    """Pairs of rows of one take's labels and truth; ValueError where they are not the same blobs in the same order."""
    for given, true in zip(labels, truth, strict=True):
        if any(given[key] != true[key] for key in KEYS[:2]) or any(float(given[k]) != float(true[k]) for k in KEYS[2:]):
            raise ValueError(f"{given} is not the blob {true}")
        yield given, true
