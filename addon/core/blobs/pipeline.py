# SPDX-License-Identifier: GPL-3.0-or-later
"""A take from end to end: find the subject, follow it through the frames, find it again when it is lost.

Memory does not grow with the take: one chunk of frames is held, and of the past only the track.
"""

from collections.abc import Generator, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from ..body.bodies import Bodies
from ..data.errors import JobError
from ..data.markersets import MarkerSet
from ..data.physical import MARKER_LIMITS
from ..data.takes import NO_MARKER, Blobs, LabelledChunk, Labels, Motion, Suspect, summed
from ..edits.applying import apply_edits, cells_of_blobs
from ..edits.kinds import NO_EDITS, Edits
from ..geometry.cameras import Cameras
from ..geometry.views import VIEWING, View, split_views
from ..papers.virtual_occlusions.labelling import Naming
from ..papers.virtual_occlusions.occlusion import Occlusion
from ..review.answering import WHOLE_FRAME
from ..review.suspects import find_suspects
from .confidence import CONFIDENCE, named_confidences, swap_doubts
from .image_tracklets import name_by_tracklets
from .rereading import REREADING, Rereader
from .search import FINDING, MAX_FINALISTS, NO_HINTS, Found, Hints, find_subject
from .subject import SUBJECT, Setup
from .swaps import exchange_loss, exchanged, swap_names
from .tracking import Followed, FrameResult, Track, follow

# A frame that is named next, and the track that leads there: blobs that are taken out of its view first stay unnamed.
Step = tuple[int, Track]
PARTS_LOOKED_IN = 8  # of a chunk, in which a lost subject is looked for, one frame each


class TAKES:
    """How a take is gone through, and what is believed."""

    # frames a second; below it nobody is followed, every frame is looked at on its own: a limb moves farther between
    # two frames than it is from the next
    min_rate: float = 20.0  # physical
    # share of the markers that a good placement, one that is clear, names of those that it lets the cameras see;
    # after `MAX_FINALISTS` of them the best will do
    good_named: float = 0.8  # physical
    # a placement less sure than this names nothing, a third of such would be wrong
    min_confidence: float = 0.7  # physical
    # until it is asked whether neighbours have changed names, a third of a second, as a wrong start stays wrong; and
    # again at a chunk's end
    review_frames: int = 20  # physical
    min_label_confidence: float = 0.5  # paper, 5: rather no label than one that is as likely to be wrong


def label_take(
    chunks: Iterable[Blobs],
    cameras: Cameras,
    markerset: MarkerSet,
    rate: float = 100.0,
    hints: Hints = NO_HINTS,
    occlusion: Occlusion | None = None,
    edits: Edits = NO_EDITS,
) -> Iterator[LabelledChunk]:
    """Names the blobs of a take, chunk by chunk: one `LabelledChunk` for each of `chunks`, in their order.

    `rate` is frames a second, `hints` what the user says of the subject, never needed, and `occlusion` the body in the
    way (the marker set's capsules by default). From the first blob on that `edits` name, directly or by what they say
    of the program's names, the take is labelled once more with these as seeds; the chunks are of that, and `unedited`
    is what was labelled without. To apply the edits is for the caller.
    Raises JobError when there are fewer than two cameras, or a frame has more blobs than any capture.
    """
    if len(cameras) < 2:
        raise JobError(f"{len(cameras)} camera cannot fix a position in space; expected two or more")
    labeller = TakeLabeller(Setup.of(cameras, markerset, occlusion, rate=rate), hints)
    seeded: TakeLabeller | None = None
    for blobs in chunks:
        with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
            # Whoever names blobs of this chunk has it labelled from where the take was before it.
            before = labeller.kept() if edits and seeded is None else None
            labelled = labeller.label(blobs)
            if edits:
                cells = cells_of_blobs(blobs, cameras.names, markerset.by_name, len(markerset))
                edited = apply_edits(labelled.labels, edits, cells).edited
                seeds = np.where(edited.named, edited.labels.marker, NO_MARKER)
                if seeded is None and (seeds != NO_MARKER).any():
                    seeded = before
                if seeded is not None:
                    again = seeded.label(blobs, seeds)
                    labelled = replace(again, unedited=labelled.labels, seconds=summed(labelled.seconds, again.seconds))
        yield labelled


class TakeLabeller:
    """Labels the chunks of one take in their order; between them it keeps the track, and nothing that is changed.

    What a `person` names also says where names before and after it had been exchanged.
    """

    person = True

    def __init__(self, setup: Setup, hints: Hints = NO_HINTS):
        self.setup, self.hints = setup, hints
        self.track: Track | None = None
        self.last: FrameResult | None = None
        self.found: tuple[int, Found] | None = None  # where in the chunk before it was found, if that was looked for
        self.rereader = Rereader(setup)
        self.placement = 0.0
        self.sure = np.ones(setup.model.marker_count)

    def kept(self) -> "TakeLabeller":
        """The same as it is now, whatever this one labels next."""
        kept = copy(self)
        kept.rereader = copy(self.rereader)
        return kept

    def label(
        self, blobs: Blobs, seeds: np.ndarray | None = None, known: tuple[int, Found] | None = None
    ) -> LabelledChunk:
        """The labels and motion of the next chunk, of whose blobs some are named already: `seeds` (N,) markers.

        `known` is where in it somebody `found` the subject, who is then not looked for first.
        """
        views, first = split_views(blobs, self.setup.cameras), self.rereader.known is None
        work = partial(ChunkInWork, blobs, views, seeds, self.setup.model.marker_count, known)
        chunk = work()
        for _ in self.steps(chunk):
            pass
        if first:
            chunk = self._found_elsewhere(chunk, work())
        return chunk.labelled(self.setup)

    def _found_elsewhere(self, chunk: "ChunkInWork", again: "ChunkInWork") -> "ChunkInWork":
        """The chunk, named `again` where that finds markers that this person wears elsewhere than others do.

        What was found of the subject is known then, and what was not is looked for as far off as labs differ. Where
        another loses its name by that, the marker is not worn. Without it people of other labs lose 1 % of their names.
        By two cameras there is no telling: their rays always meet somewhere. Where it was found is as it was.
        """
        known = self.rereader.known
        if known is None or known.known.all() or 0 not in chunk.results or len(self.setup.cameras) < 3:
            return chunk
        height, wide = float(known.subject.bodies.scale.mean()), np.where(known.known, 0.0, MARKER_LIMITS.lab_m)
        other = self.kept()
        other.setup = replace(self.setup, marker_sd=np.maximum(self.setup.marker_sd, wide / height))
        other.rereader = Rereader(other.setup)
        subject = replace(known.subject, own_sd=np.maximum(known.subject.own_sd, wide))
        track = replace(known, subject=subject).track(None, chunk.results[0], self.setup.model)
        other.track, other.last = track, None
        for _ in other.steps(again):
            pass
        new = other.rereader.known or known
        lost = known.known & (new.found < known.found - REREADING.min_frames // 2)
        if lost.any() or not (new.known & ~known.known).any():
            return chunk
        again.suspects += [one for one in chunk.suspects if one.words.startswith(WHOLE_FRAME)]
        vars(self).update(vars(other) | {"found": self.found})
        return again

    def steps(self, chunk: "ChunkInWork") -> Iterator[Step]:
        """Names the next chunk; gives what is named next before it is."""
        self.found = None
        if self.setup.rate < TAKES.min_rate:
            for at in range(len(chunk.views)):
                yield from self._find(chunk, at, at + 1)
                self.track = None
        else:
            at = (yield from self._follow(self.track, chunk, 0, len(chunk.views))) if self.track else 0
            while at < len(chunk.views):
                at = yield from self._find(chunk, at, len(chunk.views))
            self._look_again(chunk)

    def _look_again(self, chunk: "ChunkInWork"):
        """Judges the chunk by the subject that all of it shows, and puts right what does not suit it."""
        chunk.results = results = dict(sorted(chunk.results.items()))
        end = len(chunk.views) - 1
        with self.setup.clock("fit"):
            for first, last, track in self.rereader.read_again(results, self.last):
                if last == end and track is not None and self.track is not None:
                    self.track = track
                chunk.suspect(first, last, "names did not suit the rest of the take and were given anew or taken back")
            name_by_tracklets(chunk.views, results, self.setup.rate)
        self.last = results.get(end) if chunk.views else self.last

    def _follow(self, track: Track, chunk: "ChunkInWork", first: int, end: int) -> Generator[Step, None, int]:
        """Follows the track through frames `first` … until it is lost or at `end`; returns the frame to go on with."""
        at = first
        while at < end:
            yield at, track
            followed, order = self._next(track, chunk, at)
            if order is not None and at > first:
                self._give_back(track, chunk, order, at, -1)
            if followed.track.lost:
                self.track = None
                chunk.suspect(at, at, "the subject was lost")
                return at
            track = followed.track
            chunk.results[at] = self._result(followed)
            at += 1
            if at in (end, first + TAKES.review_frames):
                track = self._review(track, chunk, first, at - 1)
            self.track = track
        return at

    def _next(self, track: Track, chunk: "ChunkInWork", at: int) -> tuple[Followed, np.ndarray | None]:
        """Frame `at` followed, and the exchange (M,) of names, if any, that a person's names ask of those before it.

        What the track has learned of these markers under each other's names does not count then.
        """
        view, fixed = chunk.views[at], chunk.fixed[at]
        followed = follow(track, view, self.setup, None if self.person else fixed)
        if fixed is None or not self.person:
            return followed, None
        order = contradicted(followed.naming, fixed)
        if order is not None:
            track = track.doubting(np.flatnonzero(order != np.arange(len(order))), self.setup)
        return follow(track, view, self.setup, fixed), order

    def _give_back(self, track: Track, chunk: "ChunkInWork", order: np.ndarray, at: int, step: int) -> int:
        """Exchanges names in the frames before `at`, or after it with `step` 1, that ask for it; gives the last.

        Not where a person named them.
        """
        moved = np.flatnonzero(order != np.arange(len(order)))
        last = self._exchanged_to(track, chunk, tuple(order.tolist()), at, step)
        for index in range(at + step, last + step, step):
            if not chunk.is_fixed(index, moved):
                swap_names(chunk.results[index].naming, order)
        return last

    def _find(self, chunk: "ChunkInWork", at: int, end: int) -> Generator[Step, None, int]:
        """Finds the subject among frames `at` … `end` - 1, labels from there forwards and back; returns the next."""
        known, chunk.known = chunk.known, None
        if known is not None and not at <= known[0] < end:
            known = None
        index, found = known or self._best_found(chunk, at, end)
        if found is None:
            chunk.suspect(at, end - 1, "no subject was recognised")
            return end
        self.found = index, found
        self.hints = replace(self.hints, facing=None)
        self.placement = found.confidence
        self.sure = swap_doubts(found.swaps, self.setup.model.marker_count)
        if found.confidence < FINDING.clear_confidence:
            chunk.suspect(index, index, f"{WHOLE_FRAME} {found.confidence:.0%} sure")
        points, visible = found.naming.meeting.points, found.expected.visible
        start = Track.begin(found.subject, points, visible, self.setup.model)
        if known is None:
            chunk.results[index] = FrameResult(
                found.subject.bodies, found.naming, found.expected, found.confidence, self.sure
            )
        before, moved = yield from self._follow_back(chunk, start, index, at)
        while at < before:
            at = yield from self._find(chunk, at, before)
        self.track = start.doubting(moved, self.setup) if len(moved) else start
        return (yield from self._follow(self.track, chunk, index + (known is None), end))

    def _follow_back(
        self, chunk: "ChunkInWork", track: Track, index: int, at: int
    ) -> Generator[Step, None, tuple[int, np.ndarray]]:
        """Labels the frames before `index`, last first; returns the first frame that was reached.

        And the markers whose names were given back up to `index`, because a person names them otherwise.
        """
        given_back: list[int] = []
        for earlier in range(index - 1, at - 1, -1):
            yield earlier, track
            followed, order = self._next(track, chunk, earlier)
            if order is not None and self._give_back(track, chunk, order, earlier, 1) >= index:
                given_back += np.flatnonzero(order != np.arange(len(order))).tolist()
            if followed.track.lost:
                return earlier + 1, np.array(given_back, int)
            track = followed.track
            chunk.results[earlier] = self._result(followed)
        return at, np.array(given_back, int)

    def _best_found(self, chunk: "ChunkInWork", at: int, end: int) -> tuple[int, Found | None]:
        """The frame of a few spread over the range whose names suit a body best."""
        best, best_index, good = None, at, 0
        alone = len(chunk.views) == 1 or self.setup.rate < TAKES.min_rate
        for index in chunk.promising(at, end):
            with self.setup.clock("place"):
                found = find_subject(chunk.views[index], self.setup, self.hints, chunk.fixed[index], alone)
            if found is None or found.by_chance:
                continue
            if found.confidence < TAKES.min_confidence or found.named < SUBJECT.min_named:
                continue
            if best is None or found.marker_cost < best.marker_cost:
                best, best_index = found, index
            good += found.confidence > FINDING.clear_confidence and found.complete > TAKES.good_named
            if good >= MAX_FINALISTS:
                break
        return best_index, best

    def _review(self, track: Track, chunk: "ChunkInWork", first: int, at: int) -> Track:
        """Asks whether neighbours have changed names, and gives them back from where they may have done so.

        A frame before must say the same, as one may be blurred. Returns the track without what it learned of them.
        Needed by single walks, such as one of 20 in a ring (`gait15`), which has 1,160 right labels less without.
        """
        earlier = at - REREADING.around
        if earlier < first:
            return track
        with self.setup.clock("fit"):
            found, before = (self._looks_into(exchanged, track, chunk.results[index]) for index in (at, earlier))
        order = next((order for order in found if order in before), None)
        if order is None:
            return track
        moved = np.flatnonzero(np.array(order) != np.arange(len(order)))
        since = self._exchanged_to(track, chunk, order, earlier, -1)
        if any(chunk.is_fixed(index, moved) for index in range(since, at + 1)):  # a person has looked at them
            return track
        for index in range(since, at + 1):
            swap_names(chunk.results[index].naming, np.array(order))
        names = tuple(self.setup.model.markerset.markers[marker] for marker in moved)
        chunk.suspect(since, at, f"{', '.join(names)} had changed names and got them back", names)
        return track.doubting(moved, self.setup)

    def _looks_into(self, question, track: Track, result: FrameResult, *more):
        """Asks `question` of a labelled frame: `swaps.exchanged` or `swaps.exchange_loss`."""
        return question(result.naming, replace(track.subject, bodies=result.bodies), self.setup, *more)

    def _exchanged_to(self, track: Track, chunk: "ChunkInWork", order: tuple[int, ...], at: int, step: int) -> int:
        """The farthest frame of this spell, before `at` or with `step` 1 after it, that asks for an exchange of names.

        Given that frame `at` does; by halving. The track knows the subject.
        """
        end = at
        while end + step in chunk.results:
            end += step
        while at != end:
            middle = (at + end + (step > 0)) // 2
            if self._looks_into(exchange_loss, track, chunk.results[middle], order) < 0:
                at = middle
            else:
                end = middle - step
        return at

    def _result(self, followed: Followed) -> FrameResult:
        bodies = followed.track.subject.bodies
        return FrameResult(bodies, followed.naming, followed.expected, self.placement, self.sure)


class ChunkInWork:
    """One chunk while it is being labelled: its views, the results so far and what was noticed.

    Of the `whole` views those that are named may lack blobs, which are somebody else's.
    """

    def __init__(self, blobs: Blobs, views: list[View], seeds: np.ndarray | None, markers: int, known=None):
        self.blobs, self.whole, self.views, self.known = blobs, views, list(views), known
        self.fixed = [fixed_in(view, seeds, markers) for view in views]
        self.results: dict[int, FrameResult] = {}
        self.suspects: list[Suspect] = []

    def suspect(self, first: int, last: int, reason: str, markers: tuple[str, ...] = ()):
        """Notes frames `first` … `last` of the chunk, and the markers that it is about."""
        first, last = int(self.blobs.frames[first]), int(self.blobs.frames[last])
        self.suspects.append(Suspect(first, last, reason, markers=markers))

    def is_fixed(self, index: int, markers: np.ndarray) -> bool:
        """Whether a person named blobs of any of the markers in a frame."""
        fixed = self.fixed[index]
        return fixed is not None and bool((fixed[:, markers] >= 0).any())

    def promising(self, first: int, end: int) -> list[int]:
        """Frames to look for a subject in: the one with the most blobs of every part of the range, spread out first.

        Before them those of which a person named the most blobs.
        """
        fixed = [(index, fixed) for index, fixed in enumerate(self.fixed[first:end], first) if fixed is not None]
        named = [index for index, _ in sorted(fixed, key=lambda one: -(one[1] >= 0).sum())[:MAX_FINALISTS]]
        parts = np.array_split(np.arange(first, end), min(PARTS_LOOKED_IN, end - first))
        best = [int(part[np.argmax([self.views[index].count for index in part])]) for part in parts]
        # Far from each other first: by their numbers with the binary digits in reverse.
        order = sorted(range(len(best)), key=lambda part: f"{part:08b}"[::-1])
        return named + [best[part] for part in order if self.views[best[part]].count]

    def labelled(self, setup: Setup) -> LabelledChunk:
        """Everything as it is handed out."""
        there, results = list(self.results), list(self.results.values())
        with setup.clock("label"):
            labels, rays = _written(len(self.blobs), [self.views[index] for index in there], results)
        motion = self._motion(setup, there, results, rays)
        self.suspects += find_suspects(motion, setup.model.markerset.markers, setup.rate)
        return LabelledChunk(labels, motion, tuple(self.suspects), setup.clock.take())

    def _motion(self, setup: Setup, there: list[int], results: list[FrameResult], rays: np.ndarray) -> Motion:
        """Markers where two sure rays or more (F, M) meet, and the body; NaN in frames where nobody was found."""
        count, model = len(self.views), setup.model
        each = (count, model.marker_count)
        markers, expected = np.full((2, *each, 3), np.nan)
        residual, pixels = np.full((2, *each), np.nan)
        conflicts, confidence = np.zeros(each, int), np.zeros(count)
        joints, scale = np.full((count, model.joint_count, 3), np.nan), np.full((count, 3), np.nan)
        turn = np.full((count, model.joint_count, 3, 3), np.nan)
        if there:
            known, bodies = rays >= 2, Bodies.join([one.bodies for one in results])
            posed, met = model.pose(bodies), [one.naming.meeting for one in results]
            markers[there] = np.where(known[..., None], [one.points for one in met], np.nan)
            residual[there] = np.where(known, [one.residual for one in met], np.nan)
            pixels[there] = residual[there] * _pixels_per_metre(results, setup)
            conflicts[there] = [one.naming.conflicts for one in results]
            confidence[there] = [one.placement for one in results]
            expected[there], joints[there] = posed.markers, posed.joints
            turn[there], scale[there] = posed.rotations, bodies.scale
        return Motion(
            self.blobs.frames, markers, residual, pixels, conflicts, expected, joints, turn, scale, confidence
        )


def _written(blobs: int, views: Sequence[View], results: Sequence[FrameResult]) -> tuple[Labels, np.ndarray]:
    """The sure labels of all blobs, by F frames that have any, and how many rays of each marker (F, M) are sure."""
    labels = Labels(np.full(blobs, NO_MARKER), np.zeros(blobs, int), np.zeros(blobs))
    if not results:
        return labels, np.zeros((0, 0), int)
    slot, step, partner = (
        np.array([getattr(one.naming, name) for one in results]) for name in ("slot", "step", "partner")
    )
    doubt = np.array([one.placement * one.sure for one in results])
    sure = np.array([named_confidences(one.naming, CONFIDENCE) for one in results]) * doubt[:, None]
    frame, camera, marker = np.nonzero((slot >= 0) & (sure >= TAKES.min_label_confidence))
    own = slot[frame, camera, marker]
    ends = np.cumsum([0, *(view.row.size for view in views)])
    width = np.array([view.row.shape[1] for view in views])
    rows = np.concatenate([view.row.ravel() for view in views])[ends[frame] + camera * width[frame] + own]
    labels.marker[rows], labels.step[rows] = marker, step[frame, camera, marker]
    labels.confidence[rows] = sure[frame, camera, marker]
    rays = np.zeros((len(results), slot.shape[2]), int)
    alone = partner[frame, camera, marker] < 0
    np.add.at(rays, (frame[alone], marker[alone]), 1)
    return labels, rays


def _pixels_per_metre(results: Sequence[FrameResult], setup: Setup) -> np.ndarray:
    """(F, M) px that one metre at each marker is worth, mean over the cameras that named it."""
    expected = np.array([one.expected.points for one in results])
    depth = np.maximum(setup.sight.local(expected)[..., 2], VIEWING.min_depth_m)
    seen = np.array([one.naming.slot >= 0 for one in results])
    return (setup.sight.focal[:, None] / depth * seen).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)


def fixed_in(view: View, seeds: np.ndarray | None, markers: int) -> np.ndarray | None:
    """(C, M) the blob of a view that is each marker by the `seeds` (N,) of its chunk; None where none is."""
    if seeds is None:
        return None
    camera, slot = np.nonzero(view.real)
    marker = seeds[view.row[camera, slot]]
    known = marker != NO_MARKER
    if not known.any():
        return None
    fixed = np.full((len(view.real), markers), -1)
    fixed[camera[known], marker[known]] = slot[known]
    return fixed


def contradicted(naming: Naming, fixed: np.ndarray) -> np.ndarray | None:
    """(M,) the exchange of names that a person's names (C, M) ask of a frame that is named otherwise; None for none.

    Of two markers each, whose names one blob has: the program's and the person's.
    """
    order = np.arange(fixed.shape[1])
    camera, marker = np.nonzero(fixed >= 0)
    owner = naming.owner[camera, fixed[camera, marker]]
    for mine, other in zip(marker.tolist(), owner.tolist(), strict=True):
        if other not in (-1, mine) and order[mine] == mine and order[other] == other:
            order[[mine, other]] = other, mine
    return None if (order == np.arange(len(order))).all() else order
