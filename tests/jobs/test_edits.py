# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits as an editor gives them, a list and no file: what is named holds, and what lies below is kept."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from addon.capturing import truth_path
from addon.core.data.progress import finished
from addon.core.edits.applying import apply_edits, cells_of_blobs
from addon.core.edits.kinds import AssignBlob, Edits
from addon.demo.take import MODEL
from addon.io.cameras import read_cameras
from addon.io.markersets import open_markerset
from addon.jobs import LabelJob, label_file
from scripts.virtual_take import write_virtual_take

FRAMES = (100, 199)
PART = (100, 140)


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """Blobs of a virtual person, the cameras, and the truth of a part."""
    folder = tmp_path_factory.mktemp("walk")
    write_virtual_take(folder, FRAMES[1], FRAMES[0], "walk.csv", "room.toml")
    blobs = folder / "walk.csv"
    with truth_path(blobs).open(newline="") as file:
        truth = [row for row in csv.DictReader(file) if int(row["frame"]) <= PART[1]]
    return blobs, read_cameras(folder / "room.toml"), truth


def test_one_blob_named_holds_and_hardly_costs_others_their_names(capture, tmp_path):
    """A person names one blob of one camera, near where a foot's markers are easily taken for each other."""
    source, cameras, truth = capture
    chosen = next(row for row in truth if (row["frame"], row["camera"], row["marker"]) == ("101", "cam3", "RTOE"))
    edits = Edits((AssignBlob("cam3", 101, float(chosen["x"]) + 1, float(chosen["y"]), "RTOE"),))
    job = LabelJob(source, cameras, MODEL, tmp_path, frames=PART, keep=True, occlusion="capsules")
    first = finished(label_file(replace(job, out=tmp_path / "first")))
    labelled = finished(label_file(replace(job, edits=edits)))
    ((blobs, chunk),) = labelled.chunks
    markerset = open_markerset(MODEL)
    names = np.array([*markerset.markers, ""])
    one = truth.index(chosen)
    assert chunk.labels.marker[one] == markerset.index("RTOE")
    assert chunk.labels.confidence[one] == 1
    again = apply_edits(chunk.unedited, edits, cells_of_blobs(blobs, cameras.names, markerset.by_name, len(markerset)))
    assert (again.labels.marker == chunk.labels.marker).all()
    counts = []
    for labels in (first.chunks[0][1].labels, chunk.labels):
        given = [
            (name, row["marker"].split("|")) for name, row in zip(names[labels.marker], truth, strict=True) if name
        ]
        counts.append((sum(name in true for name, true in given), sum(name not in true for name, true in given)))
    assert counts[1][1] <= min(counts[0][1], 2)
    assert counts[1][0] >= 0.998 * counts[0][0]
    assert labelled.report["edits"] == {"file": None, "applied": {"assign": 1}, "found_nothing": []}
