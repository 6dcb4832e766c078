# SPDX-License-Identifier: GPL-3.0-or-later
"""What bodies fitted to several subjects say of blobs whose names by points are known."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from addon.core.data.takes import NO_MARKER, Blobs, Labels
from addon.core.pipelines.fitted_subjects import FollowedSubject, FollowedSubjects, _Reading

MARKERS = 3  # of each of two


def blobs_of(camera: list[int]) -> Blobs:
    """A frame with a blob in each of these cameras."""
    count = len(camera)
    empty = np.zeros((count, 2)), np.full(count, np.nan)
    return Blobs(np.array([7]), np.zeros(count, int), np.array(camera), *empty)


def labels_of(marker: list[int]) -> Labels:
    given = np.array(marker)
    return Labels(given, (given != NO_MARKER).astype(int), (given != NO_MARKER) * 0.9)


@dataclass
class Body:
    """A subject who says what it is told to say, has its first marker at `has` m, and a point of it at `point` m.

    Where it is not `clear` the point is at `tempts` m with somebody else's blobs among its own.
    """

    number: int
    says: list[int]
    denies: tuple[int, ...] = ()
    has: float = np.nan
    point: float = np.nan
    clear: bool = True
    tempts: float = np.nan

    @property
    def first(self) -> int:
        return MARKERS * self.number

    size = MARKERS

    def owns(self, labels: Labels) -> np.ndarray:
        return (labels.marker >= self.first) & (labels.marker < self.first + MARKERS)

    def read(self, marker: list[int], point: float) -> _Reading:
        expected, points = np.full((2, 1, MARKERS, 3), np.nan)
        expected[0, 0], points[0, 0] = (self.has, 0, 1), (point, 0, 1)
        return _Reading(labels_of(marker), SimpleNamespace(expected=expected, markers=points), self.first)

    def alone(self, blobs: Blobs, labels: Labels) -> _Reading:
        return self.read(np.where(self.owns(labels), labels.marker, NO_MARKER).tolist(), self.point)

    def agreeing(self, blobs: Blobs, labels: Labels, alone: _Reading) -> np.ndarray:
        return self.owns(labels) & ~np.isin(np.arange(len(blobs)), self.denies)

    def reading(self, blobs: Blobs, labels: Labels) -> _Reading:
        held = np.where(labels.named, np.where(self.owns(labels), labels.marker, NO_MARKER), self.says)
        return self.read(held.tolist(), self.point)

    def tempted(self, blobs: Blobs, labels: Labels, others: np.ndarray) -> _Reading:
        assert not self.clear
        assert (others <= (labels.named & ~self.owns(labels))).all()
        return self.read(self.says, self.tempts)


def read(blobs: Blobs, given: list[int], *bodies: Body):
    return FollowedSubjects(bodies, 2 * MARKERS).read(blobs, labels_of(given)).marker.tolist()


def test_what_one_body_adds_is_named_and_what_it_denies_or_two_claim_is_not():
    blobs = blobs_of([0, 1, 2, 3])
    one = Body(0, [0, 1, -1, 2], denies=(1,))
    assert read(blobs, [0, 2, 4, -1], one, Body(1, [-1, -1, 4, -1])) == [0, 1, 4, 2]
    blobs = blobs_of([0, 1, 2])
    assert read(blobs, [-1, 0, 3], Body(0, [1, 0, -1]), Body(1, [4, -1, 3])) == [-1, 0, 3]
    assert read(blobs_of([0, 1]), [0, 5], Body(0, [0, -1])) == [0, 5]


@pytest.mark.parametrize(("has", "named"), [(0.03, 0), (0.05, 3)])
def test_a_point_that_is_nearer_to_a_marker_that_another_lacks_is_offered_to_both(has, named):
    owner, lacking = Body(1, [-1, -1], has=0, point=0.02), Body(0, [0, 0], has=has)
    assert read(blobs_of([0, 1]), [3, 3], lacking, owner) == [named] * 2


@pytest.mark.parametrize(("tempts", "named"), [(0.06, 0), (0.08, 3)])
def test_whoever_is_not_clear_is_fitted_to_the_points_of_others_first(tempts, named):
    owner, lacking = Body(1, [-1, -1], has=0, point=0.02), Body(0, [0, 0], has=0.05, clear=False, tempts=tempts)
    assert read(blobs_of([0, 1]), [3, 3], lacking, owner) == [named] * 2


def test_a_point_far_from_what_another_lacks_is_its_own():
    owner, lacking = Body(1, [-1, -1], has=0, point=0.5), Body(0, [0, 0], has=0.7)
    assert read(blobs_of([0, 1]), [3, 3], lacking, owner) == [3, 3]


class Labeller:
    """Says the same of every chunk."""

    found, placement = None, 0.0

    def __init__(self, says: list[int]):
        self.says = says

    def label(self, blobs: Blobs, seeds: np.ndarray | None = None, known: None = None) -> SimpleNamespace:
        motion = SimpleNamespace(confidence=np.ones(len(blobs.frames)))
        return SimpleNamespace(labels=labels_of(self.says[: len(blobs)]), motion=motion)


def test_a_body_that_agrees_with_little_is_not_heard():
    own = object.__new__(FollowedSubject)
    own.number, own.first, own.size = 1, MARKERS, MARKERS
    own.free, own.held = Labeller([1, 2, 0]), Labeller([0, 1, 2])
    blobs, labels = blobs_of([0, 1, 2]), labels_of([3, 4, 5])
    assert own.agreeing(blobs, labels, own.alone(blobs, labels)).all()
    assert not own.reading(blobs, labels).labels.named.any()
