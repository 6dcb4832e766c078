# SPDX-License-Identifier: GPL-3.0-or-later
"""A take from end to end: find the subject, follow it through the frames, find it again when it is lost.

Memory does not grow with the take: one chunk of frames is held, and of the past only the track.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from threadpoolctl import threadpool_limits

from .body import Bodies
from .cameras import Cameras
from .confidence import label_confidences, swap_doubts
from .errors import JobError
from .labelling import Expectation, Naming
from .markersets import MarkerSet
from .occlusion import Occlusion
from .rivals import exchanged, swap_names
from .search import Found, Hints, find_subject
from .subject import Setup
from .suspects import find_suspects
from .takes import NO_MARKER, Blobs, LabelledChunk, Labels, Motion, Suspect
from .tracking import Followed, Track, follow
from .views import View, split_views

TRIALS = 9  # frames of a chunk in which a lost subject is looked for
SURE = 0.95  # a placement this sure that names enough markers is a good one
ENOUGH = 0.8
CONTENT = 3  # good placements after which the best of them will do
REVIEW = 120  # frames between two looks at whether neighbours have changed names
SECOND_LOOK = 6  # frames before it that must say the same
LEAST_SURE = 0.7  # a placement less sure than this names nothing
LEAST_NAMED = 0.4
UNSURE = 0.9  # placements below this are pointed out
LEAST_LABEL = 0.5  # a label less sure than this is not given


@dataclass(frozen=True)
class Options:
    """What the user may say about a take.

    hints  height and facing, never needed
    """

    hints: Hints = field(default_factory=Hints)


@dataclass(frozen=True, eq=False)
class FrameResult:
    """One labelled frame, before it is written into the chunk's arrays."""

    bodies: Bodies
    naming: Naming
    expected: Expectation
    placement: float
    sure: np.ndarray


def label_take(
    chunks: Iterable[Blobs],
    cameras: Cameras,
    markerset: MarkerSet,
    rate: float = 100.0,
    options: Options | None = None,
    occlusion: Occlusion | None = None,
) -> Iterator[LabelledChunk]:
    """Names the blobs of a take, chunk by chunk: one `LabelledChunk` for each of `chunks`, in their order.

    `rate` is frames a second, `occlusion` the body in the way (the marker set's capsules by default).
    Raises JobError when there are fewer than two cameras, or a frame has more blobs than any capture.
    """
    if len(cameras) < 2:
        raise JobError(f"{len(cameras)} camera cannot fix a position in space; expected two or more")
    labeller = TakeLabeller(Setup.of(cameras, markerset, occlusion, rate=rate), options or Options())
    for blobs in chunks:
        with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
            labelled = labeller.label(blobs)
        yield labelled


class TakeLabeller:
    """Labels the chunks of one take in their order; between them it keeps the track."""

    def __init__(self, setup: Setup, options: Options):
        self.setup, self.options = setup, options
        self.track: Track | None = None
        self.placement = 0.0
        self.sure = np.ones(setup.model.marker_count)

    def label(self, blobs: Blobs) -> LabelledChunk:
        """The labels and motion of the next chunk."""
        views = split_views(blobs, self.setup.cameras)
        results: list[FrameResult | None] = [None] * len(views)
        suspects: list[Suspect] = []
        at = 0
        while at < len(views):
            if self.track is None:
                at = self._find_from(views, results, blobs.frames, suspects, at)
            else:
                at = self._follow_from(views, results, blobs.frames, suspects, at)
        return _chunk(blobs, views, results, self.setup, tuple(suspects))

    def _follow_from(self, views, results, frames, suspects, at: int) -> int:
        """Follows the track from frame `at` until it is lost or the chunk ends; returns the frame to go on with."""
        first = at
        while at < len(views):
            followed = follow(self.track, views[at], self.setup)
            self.track = followed.track
            results[at] = self._result(followed)
            at += 1
            if self.track.lost:
                lost = max(at - self.track.poor, 0)
                results[lost:at] = [None] * (at - lost)
                suspects.append(Suspect(int(frames[lost]), int(frames[at - 1]), "the subject was lost"))
                self.track = None
                return at
            if at == len(views) or (at - first) % REVIEW == 0:
                self._review(views, results, frames, suspects, at - 1)
        return at

    def _review(self, views, results, frames, suspects, at: int):
        """Asks whether neighbours have changed names, and gives them back from where they may have done so."""
        earlier = max(at - SECOND_LOOK, 0)
        if results[earlier] is None:
            return
        with self.setup.clock("fit"):
            pairs = [set(self._exchanged(views[index], results[index])) for index in {earlier, at}]
        names = self.setup.model.markerset.markers
        for first, second in set.intersection(*pairs):
            since = _exchanged_since(results, first, second, at)
            for index in range(since, at + 1):
                swap_names(results[index].naming, first, second)
            self.track = self.track.doubting(first, second, self.setup)
            reason = f"{names[first]} and {names[second]} had changed names and got them back"
            suspects.append(Suspect(int(frames[since]), int(frames[at]), reason))

    def _exchanged(self, view: View, result: FrameResult) -> list[tuple[int, int]]:
        subject = replace(self.track.subject, bodies=result.bodies)
        return exchanged(view, result.naming, subject, self.setup)

    def _find_from(self, views, results, frames, suspects, at: int) -> int:
        """Looks for the subject in frames from `at` on; labels backwards to `at` and returns where to go on."""
        index, found = self._best_found(views, at)
        if found is None:
            suspects.append(Suspect(int(frames[at]), int(frames[-1]), "no subject was recognised"))
            return len(views)
        self.placement = found.confidence
        self.sure = swap_doubts(found.swaps, self.setup.model.marker_count)
        if found.confidence < UNSURE:
            frame = int(frames[index])
            suspects.append(Suspect(frame, frame, f"the placement is only {found.confidence:.0%} sure"))
        points, visible = found.naming.meeting.points, found.expected.visible
        start = Track.begin(found.subject, points, visible, self.setup.model)
        results[index] = FrameResult(found.subject.bodies, found.naming, found.expected, found.confidence, self.sure)
        self._follow_back(views, results, start, index, at)
        self.track = start
        return index + 1

    def _follow_back(self, views, results, track: Track, index: int, at: int):
        """Frames before the one in which the subject was found, last first."""
        for earlier in range(index - 1, at - 1, -1):
            followed = follow(track, views[earlier], self.setup)
            track = followed.track
            results[earlier] = self._result(followed)
            if track.lost:
                results[earlier : earlier + track.poor] = [None] * track.poor
                return

    def _best_found(self, views: list[View], at: int) -> tuple[int, Found | None]:
        """The surest frame of a few spread over the chunk."""
        best, best_index, tried = None, at, 0
        for index in _spread(at, len(views)):
            with self.setup.clock("place"):
                found = find_subject(views[index], self.setup, self.options.hints)
            if found is None or found.confidence < LEAST_SURE or found.named < LEAST_NAMED:
                continue
            if best is None or found.misfit < best.misfit:
                best, best_index = found, index
            tried += found.confidence > SURE and found.named > ENOUGH
            if tried >= CONTENT:
                break
        return best_index, best

    def _result(self, followed: Followed) -> FrameResult:
        bodies = followed.track.subject.bodies
        return FrameResult(bodies, followed.naming, followed.expected, self.placement, self.sure)


def _spread(first: int, end: int) -> list[int]:
    """Up to TRIALS frames of first … end - 1: the first one, then halving the gaps."""
    order = [0.0, 0.5, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875, 1.0]
    indices = [first + round(share * (end - 1 - first)) for share in order[:TRIALS]]
    return list(dict.fromkeys(indices))


def _exchanged_since(results, first: int, second: int, at: int) -> int:
    """The earliest frame, going back from `at`, since which two markers were always seen: they may have met there."""
    since = at
    while since > 0 and results[since - 1] is not None:
        points = results[since - 1].naming.meeting.points[[first, second]]
        if not np.isfinite(points).all():
            break
        since -= 1
    return since


def _chunk(blobs: Blobs, views, results, setup: Setup, suspects) -> LabelledChunk:
    count, markers = len(views), setup.model.marker_count
    labels = Labels(np.full(len(blobs), NO_MARKER), np.zeros(len(blobs), int), np.zeros(len(blobs)))
    points, residual = np.full((count, markers, 3), np.nan), np.full((count, markers), np.nan)
    residual_px, conflicts = np.full((count, markers), np.nan), np.zeros((count, markers), int)
    confidence = np.zeros(count)
    with setup.clock("label"):
        for index, (view, result) in enumerate(zip(views, results, strict=True)):
            if result is None:
                continue
            met = result.naming.meeting
            points[index], residual[index] = met.points, met.residual
            residual_px[index] = met.residual * _pixels_per_metre(result, setup)
            conflicts[index], confidence[index] = result.naming.conflicts, result.placement
            _write_labels(labels, view, result)
    motion = Motion(blobs.frames, points, residual, residual_px, conflicts, *_poses(results, setup), confidence)
    suspects += find_suspects(motion, setup.model.markerset.markers, setup.rate)
    return LabelledChunk(labels, motion, suspects, setup.clock.take())


def _write_labels(labels: Labels, view: View, result: FrameResult):
    camera, marker = np.nonzero(result.naming.slot >= 0)
    sure = label_confidences(result.naming, camera, marker) * result.placement * result.sure[marker]
    given = sure >= LEAST_LABEL
    camera, marker, sure = camera[given], marker[given], sure[given]
    rows = view.row[camera, result.naming.slot[camera, marker]]
    labels.marker[rows] = marker
    labels.step[rows] = result.naming.step[camera, marker]
    labels.confidence[rows] = sure


def _pixels_per_metre(result: FrameResult, setup: Setup) -> np.ndarray:
    """(M,) px that one metre at each marker is worth, mean over the cameras that named it."""
    depth = np.maximum(setup.sight.local(result.expected.points[None])[0, ..., 2], 0.05)
    seen = result.naming.slot >= 0
    return (setup.sight.focal[:, None] / depth * seen).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)


def _poses(results, setup: Setup) -> tuple[np.ndarray, ...]:
    """Expected markers, joints, rotations and scale of every frame; NaN where nobody was found."""
    count, model = len(results), setup.model
    expected, joints = np.full((count, model.marker_count, 3), np.nan), np.full((count, model.joint_count, 3), np.nan)
    turn, scale = np.full((count, model.joint_count, 3, 3), np.nan), np.full((count, 3), np.nan)
    found = [index for index, result in enumerate(results) if result is not None]
    if found:
        bodies = join_bodies([results[index].bodies for index in found])
        posed = model.pose(bodies)
        expected[found], joints[found], turn[found], scale[found] = (
            posed.markers,
            posed.joints,
            posed.rotations,
            bodies.scale,
        )
    return expected, joints, turn, scale


def join_bodies(parts: list[Bodies]) -> Bodies:
    """Several batches of bodies as one."""
    return Bodies(*(np.concatenate([getattr(part, name) for part in parts]) for name in Bodies.__dataclass_fields__))
