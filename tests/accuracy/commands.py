# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line as a measurement calls it, and what it wrote."""

import csv
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


def command(*words):
    """Runs a command line; RuntimeError where it fails."""
    with redirect_stdout(StringIO()) as said:
        status = main([str(word) for word in words])
    if status:
        raise RuntimeError(f"{words} ended with status {status}: {said.getvalue()}")


def labelled(take: Files, out: Path, *words) -> tuple[Path, float]:
    """The labels file that `label` writes of a take with the options `words` and no hints, and its seconds of one core.

    They hold reading and writing too, and depend little on what else the machine does.
    """
    where = ("--cameras", take.cameras, "--model", take.model, "--rate", take.rate, "--out", out)
    begin = process_time()
    command("label", take.blobs, *where, "--overwrite", *words)
    return out / f"{take.blobs.stem}.labels.csv", process_time() - begin


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
