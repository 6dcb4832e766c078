# SPDX-License-Identifier: GPL-3.0-or-later
"""Points that a person named by naming their blobs, and tracks of blobs, along which edits hold."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.takes import BY_EDIT, NO_MARKER, Blobs, Labels
from addon.core.edits.applying import Cells, apply_edits, cells_of_blobs
from addon.core.edits.blob_tracks import BlobTracks, followed
from addon.core.edits.blobs_in_points import NamedThroughBlobs
from addon.core.edits.kinds import AssignBlob, AssignPoint, DeleteBlob, Edits, Place, Swap, UnlabelBlob, UnlabelMarker
from addon.io.markersets import open_markerset

CAMERAS = ("left", "right")
WORN = open_markerset("body26")
FRAMES = 6  # 11 to 16, in two chunks; in each two points, of trajectories 4 and 7, of a blob in both cameras


def heard(*edits) -> NamedThroughBlobs:
    """What is heard of the take, of whose points the first is at x = 100 + frame and the second at x = 200 + frame."""
    named = NamedThroughBlobs(Edits(edits), CAMERAS, WORN)
    for first in (11, 14):
        index, camera, point = (one.ravel() for one in np.meshgrid(range(3), range(2), range(2), indexing="ij"))
        xy = np.column_stack([100.0 * (point + 1) + first + index, 50.0 + camera])
        blobs = Blobs(first + np.arange(3), index, camera, xy, np.ones(len(xy)))
        rows = np.arange(len(xy)).reshape(3, 2, 2).transpose(0, 2, 1).reshape(6, 2)  # frame by frame, point by point
        named.add(blobs, rows, np.tile([4, 7], 3))
    return named


PLACE = np.array([-1, -1, -1, -1, 1, -1, -1, 0, -1])  # of the points of each trajectory


def blob(kind, frame: int, marker: str = "", *, point: int = 0, frames=None):
    """An edit of a point's blob in the left camera, with its trail there."""
    numbers = np.arange(11, 17) if frames is None else np.arange(frames[0], frames[1] + 1)
    trail = np.column_stack([numbers, 100.0 * (point + 1) + numbers, np.full(len(numbers), 50.0)])
    given = {"camera": "left", "frame": frame, "x": 100.0 * (point + 1) + frame, "y": 50.0, "frames": frames}
    given |= {"marker": marker} if marker else {}
    return kind(**given, trail=trail if frames else None)


def said(named: NamedThroughBlobs) -> list[tuple]:
    return [(one.point, one.marker, one.frames) for one in named.edits_of(PLACE)]


def test_a_blob_names_its_point_in_its_frame_and_a_track_in_all_of_its_frames():
    assert said(heard(blob(AssignBlob, 12, "LKNE"))) == [(1, "LKNE", (12, 12))]
    assert said(heard(blob(AssignBlob, 12, "LKNE", frames=(12, 15)))) == [(1, "LKNE", (12, 15))]
    both = blob(AssignBlob, 12, "LKNE", frames=(12, 15)), blob(AssignBlob, 12, "RKNE", point=1)
    assert said(heard(*both)) == [(1, "LKNE", (12, 15)), (0, "RKNE", (12, 12))]


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (blob(AssignBlob, 14, "C7"), [(12, 13, "LKNE"), (14, 14, "C7"), (15, 15, "LKNE")]),
        (blob(UnlabelBlob, 13), [(12, 12, "LKNE"), (14, 15, "LKNE")]),
        (blob(DeleteBlob, 13), [(12, 12, "LKNE"), (14, 15, "LKNE")]),
        (UnlabelMarker("LKNE", frames=(14, 99)), [(12, 13, "LKNE")]),
        (UnlabelMarker("RKNE"), [(12, 15, "LKNE")]),
        (Swap(("RKNE", "LKNE"), frames=(12, 13)), [(12, 13, "RKNE"), (14, 15, "LKNE")]),
        (Swap(("LKNE", "C7")), [(12, 15, "C7")]),
        (Place("LKNE", 13, (0.0, 0.0, 1.0)), [(12, 15, "LKNE")]),
    ],
)
def test_what_is_said_last_holds(edit, expected):
    found = said(heard(blob(AssignBlob, 12, "LKNE", frames=(12, 15)), edit))
    assert [(*frames, marker) for _, marker, frames in found] == expected


def test_points_not_of_the_take_and_blobs_and_names_of_none_are_passed_over():
    named = heard(blob(AssignBlob, 12, "LKNE"))
    assert not named.edits_of(np.full(9, -1))
    far = AssignBlob(marker="LKNE", camera="left", frame=12, x=900.0, y=50.0)
    assert not heard(far).edits_of(PLACE)
    assert not heard(Swap(("LKNE", "RKNE"))).edits_of(PLACE)
    assert all(isinstance(one, AssignPoint) for one in named.edits_of(PLACE))
    assert said(heard(blob(AssignBlob, 12, "LFWT"), Swap(("LASI", "RKNE")))) == [(1, "RKNE", (12, 12))]
    assert said(heard(blob(AssignBlob, 12, "LASI"), UnlabelMarker("LFWT"))) == []
    assert said(heard(blob(AssignBlob, 12, "3:LKNE"))) == []


def test_a_marker_is_the_point_that_was_named_it_last_whatever_its_number():
    one, other = blob(AssignBlob, 12, "LKNE", frames=(12, 15)), blob(AssignBlob, 13, "LKNE", point=1)
    assert said(heard(one, other)) == [(1, "LKNE", (12, 12)), (1, "LKNE", (14, 15)), (0, "LKNE", (13, 13))]
    assert said(heard(other, one)) == [(1, "LKNE", (12, 15))]
    swapped = heard(one, blob(AssignBlob, 13, "RKNE", point=1), Swap(("LKNE", "RKNE"), frames=(13, 13)))
    assert said(swapped) == [
        (1, "LKNE", (12, 12)), (1, "RKNE", (13, 13)), (1, "LKNE", (14, 15)), (0, "LKNE", (13, 13))
    ]  # fmt: skip


def test_a_name_stays_when_another_camera_s_blob_is_refused():
    """It is gone with the blob that it was given through, unless another one bears it out."""
    named = blob(AssignBlob, 12, "LKNE")
    for kind in (UnlabelBlob, DeleteBlob):
        refused = blob(kind, 12)
        elsewhere = replace(refused, camera="right", y=51.0)
        assert said(heard(named, elsewhere)) == said(heard(elsewhere, named)) == [(1, "LKNE", (12, 12))]
        assert said(heard(named, refused)) == []
        assert said(heard(named, replace(named, camera="right", y=51.0), refused)) == [(1, "LKNE", (12, 12))]


def test_a_marker_s_blob_that_makes_no_point_takes_it_from_the_point_named_in_its_image():
    """Left shows a third blob, which no other camera sees; another image's may be of the marker, too."""
    xy = np.array([[112.0, 50.0], [112.0, 51.0], [312.0, 50.0]])
    blobs = Blobs(np.array([12]), np.zeros(3, int), np.array([0, 1, 0]), xy, np.ones(3))
    left = blob(AssignBlob, 12, "LKNE")
    right, alone = replace(left, camera="right", y=51.0), replace(left, x=312.0)

    def after(*edits):
        named = NamedThroughBlobs(Edits(edits), CAMERAS, WORN)
        named.add(blobs, np.array([[0, 1]]), np.array([4]))
        return said(named)

    kept = [(1, "LKNE", (12, 12))]
    assert after(left, alone) == []
    assert after(alone, left) == after(right, alone) == after(left, right, alone) == kept
    assert after(left, replace(alone, marker="RKNE")) == kept


LENGTH, FIRST = 40, 11
NAMES = {"A": 0, "B": 1, "C": 2}
PAIR = ("cam1", "cam2")


def paths() -> dict[str, np.ndarray]:
    """Of three markers in an image where they are (F, 2) px: A and B cross at frame 20, C is seen in some frames."""
    time = np.arange(LENGTH, dtype=float)
    a = np.column_stack([100 + 5 * time, np.full(LENGTH, 200.0)])
    b = np.column_stack([300 - 5 * time, np.full(LENGTH, 201.0)])
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
    return Blobs(np.arange(FIRST, FIRST + LENGTH), frame, camera, table[:, 2:4], area), truth


@pytest.fixture
def take():
    return take_of({0: paths(), 1: {"A": paths()["A"] + 50, "B": paths()["B"] + [0, 200]}})


def row_of(blobs: Blobs, truth: np.ndarray, name: str, frame: int, camera: int = 0) -> int:
    found = (blobs.frame == frame) & (blobs.camera == camera) & (truth == NAMES[name])
    return int(np.flatnonzero(found)[0])


def test_a_track_ends_where_two_cross_where_a_blob_is_not_seen_and_before_its_neighbour(take):
    blobs, truth = take
    tracks = BlobTracks(blobs, PAIR)
    for name, frame, last in (("A", 3, 19), ("A", 39, 21), ("C", 2, 14), ("C", 30, 18)):
        rows = tracks.rows(row_of(blobs, truth, name, frame))
        assert set(truth[rows]) == {NAMES[name]}
        assert set(blobs.camera[rows]) == {0}
        own = blobs.frame[rows]
        assert (np.diff(own) == 1).all()
        assert own.max() <= last if frame < last else own.min() >= last
        assert len(own) >= 10
    apart = tracks.rows(row_of(blobs, truth, "B", 5, camera=1))
    assert len(apart) == LENGTH, "nothing comes near in this camera"
    near = {"A": paths()["A"].copy(), "B": paths()["A"] + [14, 3]}
    near["A"][10:] = np.nan
    blobs, truth = take_of({0: near})
    rows = BlobTracks(blobs, PAIR).rows(row_of(blobs, truth, "A", 2))
    assert set(truth[rows]) == {NAMES["A"]}
    assert blobs.frame[rows].max() == 9


def test_an_edit_of_a_track_holds_in_its_frames_and_in_its_camera(take):
    blobs, truth = take
    x, y = blobs.xy[row_of(blobs, truth, "B", 5, camera=1)]
    said = Edits((AssignBlob("cam2", FIRST + 5, float(x), float(y), "C", frames=(FIRST + 2, FIRST + 9)),))
    chunks = [blobs.between(FIRST, FIRST + 6), blobs.between(FIRST + 7, FIRST + LENGTH)]
    known = followed(said, lambda frames: (part.between(*frames) for part in chunks), PAIR)
    assert known.items == said.items, "the track is no part of what was said"
    done = [apply_edits(Labels.none(len(part)), known, cells_of(part)) for part in chunks]
    named = np.concatenate([one.labels.marker for one in done]) == NAMES["C"]
    meant = (blobs.camera == 1) & (truth == NAMES["B"]) & (blobs.frame >= 2) & (blobs.frame <= 9)
    np.testing.assert_array_equal(named, meant)
    assert [one.outcomes[0].labels for one in done] == [5, 3]
    alone = apply_edits(Labels.none(len(blobs)), said, cells_of(blobs))
    assert (alone.labels.step == BY_EDIT).sum() == 1, "without its track it is of its own frame"


def cells_of(blobs: Blobs) -> Cells:
    return cells_of_blobs(blobs, PAIR, NAMES, len(NAMES))


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
