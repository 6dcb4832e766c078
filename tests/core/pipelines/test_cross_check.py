# SPDX-License-Identifier: GPL-3.0-or-later
"""Two namings of the same blobs: counted, set against each other, and one filling the other's gaps."""

import numpy as np
import pytest

from addon.core.data.takes import (
    BY_TRAJECTORY,
    EXCLUSIVE,
    NO_MARKER,
    STEPS,
    Blobs,
    LabelledChunk,
    Labels,
    Motion,
    Suspect,
)
from addon.core.pipelines.cross_check import MethodAgreement, label_by_both

NAMES = ("A", "B", "C")
FRAMES, CAMERAS = 30, 3


@pytest.fixture
def blobs() -> Blobs:
    """Three markers seen by three cameras, frame by frame."""
    frame, camera = np.repeat(np.arange(FRAMES), 9), np.tile(np.repeat(np.arange(CAMERAS), 3), FRAMES)
    return Blobs(100 + np.arange(FRAMES), frame, camera, np.zeros((9 * FRAMES, 2)), np.full(9 * FRAMES, np.nan))


def chunk(marker: np.ndarray, step: int, place: float, suspects=(), found=True) -> LabelledChunk:
    """What one way says: the markers (N,), everybody at `place`."""
    named = marker != NO_MARKER
    labels = Labels(marker, np.where(named, step, 0), np.where(named, 0.9, 0))
    at = np.full((FRAMES, 3, 3), place)
    flat, joints = np.full((FRAMES, 3), place), np.full((FRAMES, 1, 3), place)
    turns = np.full((FRAMES, 1, 3, 3), place)
    sure = np.broadcast_to(np.asarray(found, float), FRAMES)
    frames = 100 + np.arange(FRAMES)
    motion = Motion(frames, at, flat, flat, flat.astype(int), at, joints, turns, flat, sure)
    return LabelledChunk(labels, motion, tuple(suspects), {"fit": 1.0})


def both(blobs, body, points):
    agreement = MethodAgreement()
    [made] = label_by_both([blobs], iter([body]), iter([points]), NAMES, agreement)
    return made, agreement.as_dict()


def test_what_they_disagree_on_is_a_suspect_and_the_body_has_the_say(blobs):
    truth = np.tile([0, 1, 2], CAMERAS * FRAMES)
    other = truth.copy()
    # From frame 105 to 109 two cameras' A and B are each other's; in frame 120 one camera's.
    wrong = (blobs.frame >= 5) & (blobs.frame < 10) & (blobs.camera < 2) | (blobs.frame == 20) & (blobs.camera == 0)
    other[wrong] = np.array([1, 0, 2])[truth[wrong]]
    other[0] = NO_MARKER
    made, counts = both(blobs, chunk(truth, EXCLUSIVE, 1.0), chunk(other, BY_TRAJECTORY, 2.0))
    assert counts == {"same": 9 * FRAMES - 1 - 22, "different": 22, "only_fit": 1, "only_points": 0}
    assert (made.labels.marker == truth).all()
    assert (made.labels.step == EXCLUSIVE).all()
    assert [(s.first, s.last, s.reason) for s in made.suspects] == [
        (105, 109, "A by the fitted body is B by the points in space"),
        (105, 109, "B by the fitted body is A by the points in space"),
    ]
    assert made.seconds == {"fit": 2.0}


def test_where_the_body_found_nobody_the_points_have_the_say(blobs):
    truth = np.tile([0, 1, 2], CAMERAS * FRAMES)
    lost = np.arange(FRAMES) < 12
    body = np.where(lost[blobs.frame], NO_MARKER, truth)
    nobody = [Suspect(100, 111, "no subject was recognised")]
    made, counts = both(blobs, chunk(body, EXCLUSIVE, 1.0, nobody, ~lost), chunk(truth, BY_TRAJECTORY, 2.0))
    assert counts == {"same": 9 * 18, "different": 0, "only_fit": 0, "only_points": 9 * 12}
    assert (made.labels.marker == truth).all()
    assert {STEPS[step] for step in made.labels.step[lost[blobs.frame]]} == {"trajectory"}
    assert {STEPS[step] for step in made.labels.step[~lost[blobs.frame]]} == {"exclusive"}
    assert made.suspects == ()
    assert (made.motion.markers[lost] == 2.0).all()
    assert (made.motion.markers[~lost] == 1.0).all()
