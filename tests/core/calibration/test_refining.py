# SPDX-License-Identifier: GPL-3.0-or-later
"""A room refined by a take: what was moved is found, what is good stays, what cannot be mended is refused.

The labelling is one that knows: a blob has its true name where the cameras in use see its marker near it, else none.
"""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from addon.core.calibration import refining
from addon.core.calibration.refining import REFINED_AT_ONCE, parts_of, refine_cameras
from addon.core.data.errors import JobError
from addon.core.data.progress import finished
from addon.core.data.takes import NO_MARKER, Blobs, LabelledChunk, Labels
from addon.core.geometry.cameras import Cameras
from addon.core.simulation.rigs import ring_rig
from tests.core.calibration.test_adjusting import image_error, moved
from tests.core.scenes import built_in

REACH = 12.0  # px from where a marker should be that the labelling looks for its blob
BODY = built_in("body26")
COUNT = len(BODY)


class Room:
    """Somebody who walks past cameras, in parts of the take; names as the cameras in use would show them."""

    def __init__(self, true: Cameras, monkeypatch, frames: int = 60, seed: int = 0, noise: float = 0.3):
        random = np.random.default_rng(seed)
        way = np.linspace([-0.7, -0.4, 0], [0.7, 0.5, 0], frames)[:, None]
        self.markers = 1.7 * BODY.rest_markers + way + 0.03 * random.standard_normal((frames, COUNT, 3))
        pixels = np.moveaxis(true.project(self.markers), 0, 1)
        there = (random.random(pixels.shape[:3]) < 0.75) & ((pixels > 0) & (pixels < true.size[:, None])).all(axis=3)
        frame, camera, marker = np.nonzero(there)
        xy = pixels[there] + noise * random.standard_normal((len(frame), 2))
        self.parts, self.truth = [], {}
        for first, last in parts_of(0, frames - 1):
            rows = (frame >= first) & (frame <= last)
            numbers = np.arange(first, last + 1)
            blobs = Blobs(numbers, frame[rows] - first, camera[rows], xy[rows], np.full(int(rows.sum()), np.nan))
            self.parts.append(blobs)
            self.truth[first] = marker[rows]
        self.rounds = 0
        monkeypatch.setattr(refining, "label_blobs", self.label)

    def label(self, chunks, cameras, model, options):
        """One part, labelled."""
        [blobs] = chunks
        self.rounds += blobs is self.parts[0]
        expected, truth = self.markers[blobs.frames], self.truth[blobs.frames[0]]
        with np.errstate(invalid="ignore"):
            where = cameras.project(expected)[blobs.camera, blobs.frame, truth]
            near = np.linalg.norm(where - blobs.xy, axis=1) < REACH
        marker = np.where(near, truth, NO_MARKER)
        motion = SimpleNamespace(expected=expected)
        return iter([LabelledChunk(Labels(marker, 0 * marker, 0.0 * marker), motion)])

    def refine(self, cameras: Cameras):
        return finished(refine_cameras(self.parts, cameras, SimpleNamespace(markerset=BODY), None))


@pytest.mark.parametrize(
    ("which", "degrees", "millimetres", "rounds"), [([4], 0.3, 10, 2), ([4], 2.0, 50, 2), ([1, 4], 1.0, 30, 3)]
)
def test_cameras_that_were_moved(monkeypatch, which, degrees, millimetres, rounds):
    true = ring_rig(7, generator=np.random.default_rng(3))
    room = Room(true, monkeypatch)
    calibrated = moved(true, which, degrees, millimetres, seed=2)
    found = room.refine(calibrated)
    assert found.refined
    assert image_error(found.cameras, true).max() < 0.25
    assert found.after.max() < 0.5 < found.before[which].min()
    assert found.rounds == room.rounds <= rounds
    assert len(found.doubts) == len(which)
    for index in which:
        assert any(f"camera cam{index + 1} seems to have moved" in words for words in found.doubts)
        assert 1000 * found.shifted[index] == pytest.approx(millimetres, abs=5)
        assert np.degrees(found.turned[index]) == pytest.approx(degrees, abs=0.1)


def test_what_moving_cameras_cannot_mend_is_refused(monkeypatch):
    true = ring_rig(6, generator=np.random.default_rng(4))
    room = Room(true, monkeypatch)
    other = Cameras(true.names, *(getattr(ring_rig(6, radius=5.0), name) for name in FIELDS))
    with pytest.raises(JobError, match="not to be this take's"):
        room.refine(other)
    large = Cameras(true.names, *(getattr(true, name) * (1000 if name == "translation" else 1) for name in FIELDS))
    with pytest.raises(JobError, match="about 1000 times too large, as if millimetres were read as metres"):
        room.refine(large)
    order = [0, 3, 2, 1, 4, 5]
    mixed = Cameras(true.names, *(getattr(true, name)[order] for name in FIELDS))
    with pytest.raises(JobError, match=r"cam2 and cam4 seem to have each other's names.*; expected"):
        room.refine(mixed)
    with pytest.raises(JobError, match="2 cameras cannot tell which of them was moved; expected three"):
        room.refine(true.select([0, 1]))


FIELDS = ("size", "matrix", "distortion", "rotation", "translation")


def test_nobody_there(monkeypatch):
    true = ring_rig(5, generator=np.random.default_rng(5))
    room = Room(true, monkeypatch)
    room.truth = {first: np.full_like(marker, 0) for first, marker in room.truth.items()}
    with pytest.raises(JobError, match=r"nobody was recognised.*expected a take of somebody who wears body26"):
        room.refine(true)


@pytest.mark.parametrize("count", [1, 2, 3, 19, 20, 57, 480, 481, 20000])
def test_parts_are_spread_over_the_take(count):
    parts = parts_of(11, 10 + count)
    assert parts[0][0] == 11
    assert parts[-1][1] == 10 + count
    assert all(first <= last for first, last in parts)
    assert all(last < following for (_, last), (following, _) in pairwise(parts))
    assert all(last - first < REFINED_AT_ONCE for first, last in parts)
    assert len(parts) == min(12, count)
