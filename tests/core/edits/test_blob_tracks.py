# SPDX-License-Identifier: GPL-3.0-or-later
"""The track of a blob goes on while it is plain, ends before it could be another's, and edits hold along it."""

import numpy as np
import pytest

from addon.core.data.takes import BY_EDIT, NO_MARKER, Blobs, Labels
from addon.core.edits.applying import Cells, apply_edits, cells_of_blobs
from addon.core.edits.blob_tracks import BlobTracks, followed
from addon.core.edits.kinds import AssignBlob, DeleteBlob, Edits, UnlabelBlob

FRAMES, FIRST = 40, 11
NAMES = {"A": 0, "B": 1, "C": 2}
CAMERAS = ("cam1", "cam2")


def paths() -> dict[str, np.ndarray]:
    """Of three markers in an image where they are (F, 2) px: A and B cross at frame 20, C is seen in some frames."""
    time = np.arange(FRAMES, dtype=float)
    a = np.column_stack([100 + 5 * time, np.full(FRAMES, 200.0)])
    b = np.column_stack([300 - 5 * time, np.full(FRAMES, 201.0)])
    c = np.column_stack([400 + 0 * time, 100 + 3 * time])
    c[15:18] = np.nan
    return {"A": a, "B": b, "C": c}


def take_of(camera_of: dict[int, dict[str, np.ndarray]]) -> tuple[Blobs, np.ndarray]:
    """The blobs of some cameras, and which marker each is."""
    rows = []
    for camera, seen in camera_of.items():
        for name, path in seen.items():
            there = np.flatnonzero(np.isfinite(path[:, 0])).tolist()
            rows += [(frame, camera, *path[frame], NAMES[name]) for frame in there]
    table = np.array(sorted(rows, key=lambda row: (row[0], row[1], (7 * row[4] + row[0]) % 3)))
    frame, camera, truth = (table[:, column].astype(int) for column in (0, 1, 4))
    area = np.full(len(table), np.nan)
    return Blobs(np.arange(FIRST, FIRST + FRAMES), frame, camera, table[:, 2:4], area), truth


@pytest.fixture
def take():
    return take_of({0: paths(), 1: {"A": paths()["A"] + 50, "B": paths()["B"] + [0, 200]}})


def row_of(blobs: Blobs, truth: np.ndarray, name: str, frame: int, camera: int = 0) -> int:
    found = (blobs.frame == frame) & (blobs.camera == camera) & (truth == NAMES[name])
    return int(np.flatnonzero(found)[0])


def test_a_track_ends_where_two_cross_where_a_blob_is_not_seen_and_before_its_neighbour(take):
    blobs, truth = take
    tracks = BlobTracks(blobs, CAMERAS)
    for name, frame, last in (("A", 3, 19), ("A", 39, 21), ("C", 2, 14), ("C", 30, 18)):
        rows = tracks.rows(row_of(blobs, truth, name, frame))
        assert set(truth[rows]) == {NAMES[name]}
        assert set(blobs.camera[rows]) == {0}
        own = blobs.frame[rows]
        assert (np.diff(own) == 1).all()
        assert own.max() <= last if frame < last else own.min() >= last
        assert len(own) >= 10
    apart = tracks.rows(row_of(blobs, truth, "B", 5, camera=1))
    assert len(apart) == FRAMES, "nothing comes near in this camera"
    near = {"A": paths()["A"].copy(), "B": paths()["A"] + [14, 3]}
    near["A"][10:] = np.nan
    blobs, truth = take_of({0: near})
    rows = BlobTracks(blobs, CAMERAS).rows(row_of(blobs, truth, "A", 2))
    assert set(truth[rows]) == {NAMES["A"]}
    assert blobs.frame[rows].max() == 9


def test_an_edit_of_a_track_holds_in_its_frames_and_in_its_camera(take):
    blobs, truth = take
    x, y = blobs.xy[row_of(blobs, truth, "B", 5, camera=1)]
    said = Edits((AssignBlob("cam2", FIRST + 5, float(x), float(y), "C", frames=(FIRST + 2, FIRST + 9)),))
    chunks = [blobs.between(FIRST, FIRST + 6), blobs.between(FIRST + 7, FIRST + FRAMES)]
    known = followed(said, chunks, CAMERAS)
    assert known.items == said.items, "the track is no part of what was said"
    done = [apply_edits(Labels.none(len(part)), known, cells_of(part)) for part in chunks]
    named = np.concatenate([one.labels.marker for one in done]) == NAMES["C"]
    meant = (blobs.camera == 1) & (truth == NAMES["B"]) & (blobs.frame >= 2) & (blobs.frame <= 9)
    np.testing.assert_array_equal(named, meant)
    assert [one.outcomes[0].labels for one in done] == [5, 3]
    alone = apply_edits(Labels.none(len(blobs)), said, cells_of(blobs))
    assert (alone.labels.step == BY_EDIT).sum() == 1, "without its track it is of its own frame"


def cells_of(blobs: Blobs) -> Cells:
    return cells_of_blobs(blobs, CAMERAS, NAMES, len(NAMES))


def test_names_are_taken_from_blobs_and_given_to_none(take):
    blobs, truth = take
    labels = Labels(truth, np.ones(len(truth), int), np.ones(len(truth)))
    row = row_of(blobs, truth, "A", 5)
    x, y = map(float, blobs.xy[row])
    for kind, deleted in ((UnlabelBlob, False), (DeleteBlob, True)):
        done = apply_edits(labels, Edits((kind("cam1", FIRST + 5, x, y),)), cells_of(blobs))
        assert np.flatnonzero(done.labels.marker != truth).tolist() == [row]
        assert done.labels.marker[row] == NO_MARKER
        assert done.edited.deleted.any() == deleted
    nothing = apply_edits(Labels.none(len(blobs)), Edits((UnlabelBlob("cam1", FIRST + 5, x, y),)), cells_of(blobs))
    assert "has no name" in nothing.outcomes[0].reason
