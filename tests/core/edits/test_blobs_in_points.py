# SPDX-License-Identifier: GPL-3.0-or-later
"""Points that a person named by naming their blobs."""

import numpy as np
import pytest

from addon.core.data.takes import Blobs
from addon.core.edits.blobs_in_points import NamedThroughBlobs
from addon.core.edits.kinds import (
    AssignBlob,
    AssignPoint,
    DeleteBlob,
    Edits,
    Place,
    Swap,
    UnlabelBlob,
    UnlabelMarker,
)

CAMERAS = ("left", "right")
FRAMES = 6  # 11 to 16, in two chunks; in each two points, of trajectories 4 and 7, of a blob in both cameras


def heard(*edits) -> NamedThroughBlobs:
    """What is heard of the take, of whose points the first is at x = 100 + frame and the second at x = 200 + frame."""
    named = NamedThroughBlobs(Edits(edits), CAMERAS)
    for first in (11, 14):
        index, camera, point = (one.ravel() for one in np.meshgrid(range(3), range(2), range(2), indexing="ij"))
        xy = np.column_stack([100.0 * (point + 1) + first + index, 50.0 + camera])
        blobs = Blobs(first + np.arange(3), index, camera, xy, np.ones(len(xy)))
        rows = np.arange(len(xy)).reshape(3, 2, 2).transpose(0, 2, 1).reshape(6, 2)  # frame by frame, point by point
        named.add(blobs, rows, np.repeat(first + np.arange(3), 2), np.tile([4, 7], 3))
    return named


def place() -> np.ndarray:
    found = np.full(9, -1)
    found[[4, 7]] = [1, 0]
    return found


def blob(kind, frame: int, marker: str = "", *, point: int = 0, frames=None):
    """An edit of a point's blob in the left camera, with its trail there."""
    numbers = np.arange(11, 17) if frames is None else np.arange(frames[0], frames[1] + 1)
    trail = np.column_stack([numbers, 100.0 * (point + 1) + numbers, np.full(len(numbers), 50.0)])
    given = {"camera": "left", "frame": frame, "x": 100.0 * (point + 1) + frame, "y": 50.0, "frames": frames}
    given |= {"marker": marker} if marker else {}
    return kind(**given, trail=trail if frames else None)


def said(named: NamedThroughBlobs) -> list[tuple]:
    return [(one.point, one.marker, one.frames) for one in named.edits_of(place())]


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


def test_points_that_are_not_of_the_take_and_blobs_of_none_are_passed_over():
    named = heard(blob(AssignBlob, 12, "LKNE"))
    assert not named.edits_of(np.full(9, -1))
    far = AssignBlob(marker="LKNE", camera="left", frame=12, x=900.0, y=50.0)
    assert not heard(far).edits_of(place())
    assert not heard(Swap(("LKNE", "RKNE"))).edits_of(place())
    assert all(isinstance(one, AssignPoint) for one in named.edits_of(place()))
