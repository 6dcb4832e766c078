# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames whose names do not suit the subject that the take shows: read again, from the frames beside them.

A frame is named with what was known of the subject up to it. A name goes wrong while its marker is hidden, above all
where the subject has just been found and nobody knows yet how its markers sit. In the end all frames show how tall the
subject is and where the markers sit; names that were wrong for a while do not suit that body, however it bends. From
the frames around, the stretch is followed again, forwards and backwards, and what explains it best stays. Where that
names an edge otherwise, the frames beyond are read again, too, and so on.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import PLACEMENT, Bodies, BodyModel
from ..data.physical import MARKER_LIMITS, SIGMAS
from ..papers.virtual_occlusions.cost import RayPull
from ..papers.virtual_occlusions.fit import fit_body
from ..papers.virtual_occlusions.labelling import Naming
from ..review.suspects import runs
from .subject import Setup, Subject, expect, name, named_pull, refit
from .swaps import MAX_EXCHANGES, SWAP_STEPS, SWAPS, swap_names, try_swaps
from .tracking import Followed, FrameResult, Track, advanced, difference, follow

# Iterations of the fits to the names, from the fits as they were: these are near.
JUDGING_STEPS = 3


class REREADING:
    """Which frames are read again, and which reading is better."""

    # that show a subject, half a second: a marker that is in half of them has its place in them
    min_frames: int = 30  # physical
    # frames around a doubtful one that are looked at, and that may lie between two of a stretch
    around: int = 6  # physical


@dataclass(frozen=True, eq=False)
class KnownSubject:
    """The subject of a take as all frames show it, in no pose of its own.

    known (M,) says whose place is known, found (M,) in how many frames of the last ones each marker was found in space.
    """

    subject: Subject
    known: np.ndarray
    found: np.ndarray

    def posed_as(self, poses: Bodies) -> Bodies:
        """The subject in the places and poses of B bodies."""
        return _with_body_of(self.subject.bodies, poses)

    def track(self, earlier: FrameResult | None, begin: FrameResult, model: BodyModel) -> Track:
        """A track of the subject from a labelled frame, as fast as it came from the one before."""
        subject = replace(self.subject, bodies=self.posed_as(begin.bodies))
        track = Track.begin(subject, begin.naming.meeting.points, begin.expected.visible, model)
        if earlier is None:
            return track
        velocity = difference(begin.bodies, earlier.bodies)
        velocity[:, 6:PLACEMENT] = 0
        return replace(track, velocity=velocity)


# Frames that were read again, first and last both included, and the track where one read forwards to its end was.
Stretch = tuple[int, int, Track | None]


class Rereader:
    """Judges frames of a take by the subject that they show. The subject is kept from chunk to chunk."""

    def __init__(self, setup: Setup):
        self.setup = setup
        self.known: KnownSubject | None = None

    def read_again(self, results: dict[int, FrameResult], before: FrameResult | None) -> list[Stretch]:
        """Puts better readings into the labelled frames, by index in their order; returns the stretches it changed.

        `before` is the frame before the first, None where there is none.
        """
        if len(results) < REREADING.min_frames:
            return []
        known = self.known = known_subject_of(list(results.values()), self.setup, self.known)
        # What is over in half the frames around is not worth the time.
        frames = np.array(list(results))
        doubtful = self._doubtful(results, frames[:: REREADING.around // 2], known)
        near = frames[(np.abs(frames[:, None] - doubtful) <= REREADING.around).any(axis=1)]
        waiting: list[tuple[int, int, int | None]] = [
            (*each, None) for each in _stretches(self._doubtful(results, near, known), results)
        ]
        found = []
        while waiting:
            first, last, come_from = waiting.pop(0)
            old = {index: results[index].naming for index in (first, last)}
            stretch = self._read_stretch(results, before, first, last, known)
            if stretch is None:
                continue
            found.append(stretch)
            for edge, step in ((first, -1), (last, 1)):
                if edge + step != come_from and _contradict(old[edge], results[edge].naming):
                    waiting += [(*beyond, edge) for beyond in _beyond(edge, step, last - first + 1, results)]
        return [*found, *self._withdrawn(results, near, known)]

    def _withdrawn(self, results: dict[int, FrameResult], frames: np.ndarray, known: KnownSubject) -> list[Stretch]:
        """Takes back names of frames (K,) that suit the subject in no reading: a marker that is not of the set has one.

        It leaps there by more than three standard deviations; what comes to it step by step may be a jaw that opens and
        was learned closed, and stays, as what a person named. Without it 1.2 % of real blobs that nine cameras saw are
        named wrongly, and 0.1 % with it.
        """
        if not len(frames):
            return []
        rules, changed = self.setup.rules, np.zeros(frames[-1] + 1, bool)
        off = np.zeros((len(changed), self.setup.model.marker_count))
        _, off[frames] = self._judged([results[index] for index in frames.tolist()], known)
        for marker, start, stop in _leaps(off, rules.max_on_point):
            for index in (start + np.flatnonzero(off[start:stop, marker] > rules.max_square)).tolist():
                naming = results[index].naming
                camera = np.flatnonzero((naming.slot[:, marker] >= 0) & (naming.frame.fixed[:, marker] < 0))
                if len(camera):
                    naming.withdraw(camera, np.full(len(camera), marker))
                    changed[index] = True
        ends = [(start, stop - 1) for start, stop in runs(changed)]
        model = self.setup.model
        return [(first, last, known.track(results.get(last - 1), results[last], model)) for first, last in ends]

    def _doubtful(self, results: Mapping[int, FrameResult], frames: np.ndarray, known: KnownSubject) -> np.ndarray:
        """Those of the frames (K,) in which a name does not suit the subject."""
        if not len(frames):
            return frames
        _, off = self._judged([results[index] for index in frames.tolist()], known)
        return frames[(off > self.setup.rules.max_on_point).any(axis=1)]

    def _judged(self, results: Sequence[FrameResult], known: KnownSubject) -> tuple[np.ndarray, np.ndarray]:
        """How badly the subject's own body, fitted to the names of F frames, explains them: all frames are one batch.

        (F,) the costs of the fits and of unnamed blobs, and (F, M) the squared deviations by which names are off.
        """
        setup = self.setup
        pulls = [named_pull(one.naming, known.subject, setup) for one in results]
        image, deviation = (np.concatenate([getattr(pull, name) for pull in pulls]) for name in ("image", "deviation"))
        pull = RayPull(image, deviation, setup.sight)
        poses = known.posed_as(Bodies.join([one.bodies for one in results]))
        fit = fit_body(setup.model, poses, pull, JUDGING_STEPS, setup.prior)
        unnamed = [(one.naming.frame.view.real & (one.naming.owner < 0)).sum() for one in results]
        return fit.cost + setup.rules.min_lead * np.array(unnamed), _strain(fit.state.posed.markers, pull)

    def _read_stretch(
        self, results: dict[int, FrameResult], before: FrameResult | None, first: int, last: int, known: KnownSubject
    ) -> Stretch | None:
        """Keeps the best of three readings: as it was, or forwards up to some frame and backwards down to it."""
        labelled = [results[index] for index in range(first, last + 1)]
        old, _ = self._judged(labelled, known)
        earlier = results.get(first - 2), results.get(first - 1) if first else before
        later = results.get(last + 2), results.get(last + 1)
        forth = self._follow(earlier, labelled, known)
        back = self._follow(later, labelled[::-1], known)[::-1]
        cost, count = np.full((2, len(labelled)), np.inf), len(labelled)
        ahead = [_read_as(old, new) for old, new in zip(labelled, forth, strict=False)]
        behind = [_read_as(old, new) for old, new in zip(labelled[count - len(back) :], back, strict=True)]
        if ahead:
            cost[0, : len(ahead)], _ = self._judged(ahead, known)
        if behind:
            cost[1, count - len(behind) :], _ = self._judged(behind, known)
        both = np.append(0, np.cumsum(cost[0])) + np.append(np.cumsum(cost[1, ::-1])[::-1], 0)
        split = int(np.argmin(both))
        if not both[split] < old.sum():
            return None
        results.update(enumerate([*ahead[:split], *behind[len(behind) - count + split :]], first))
        return first, last, forth[-1].track if split == count else None

    def _follow(
        self, start: tuple[FrameResult | None, FrameResult | None], frames: Sequence[FrameResult], known: KnownSubject
    ) -> list[Followed]:
        """The frames followed from the last one of `start`, in their order; fewer where the subject is lost."""
        found: list[Followed] = []
        earlier, begin = start
        if begin is None:
            return found
        track = known.track(earlier, begin, self.setup.model)
        for frame in frames:
            followed = follow(track, frame.naming.frame.view, self.setup)
            followed = self._thought_over(followed, track, known)
            if followed.track.lost:
                break
            track = followed.track
            found.append(followed)
        return found

    def _thought_over(self, followed: Followed, track: Track, known: KnownSubject) -> Followed:
        """The frame after `track`, with names exchanged for as long as that suits the subject better."""
        setup, naming = self.setup, followed.naming
        subject = replace(known.subject, bodies=known.posed_as(followed.track.subject.bodies))
        subject, state = refit(naming, subject, setup, SWAP_STEPS, setup.prior)
        if _strain(state.posed.markers, named_pull(naming, known.subject, setup)).max() < setup.rules.min_lead:
            return followed
        changed = False
        for _ in range(MAX_EXCHANGES):
            swaps = try_swaps(naming, subject, state, setup, setup.prior)
            if not len(swaps.loss) or swaps.loss.min() > -SWAPS.min_gain:
                break
            swap_names(naming, swaps.orders[swaps.loss.argmin()])
            subject, state = refit(naming, subject, setup, SWAP_STEPS, setup.prior)
            changed = True
        if not changed:
            return followed
        expected = expect(subject, state, setup)
        naming = name(naming.frame.view, expected, subject, setup)
        return Followed(advanced(track, subject, state.posed, naming, expected, setup), naming, expected)


def _leaps(off: np.ndarray, least: float) -> Iterator[tuple[int, int, int]]:
    """Markers, and ranges without their stop in which each is `off` (F, M) by more than the least; 0 is not found.

    Only where it came to that at once, since it was found last.
    """
    strain = np.sqrt(off)
    for marker in np.flatnonzero((off > least).any(axis=0)).tolist():
        for start, stop in runs(off[:, marker] > least):
            before = strain[:start, marker]
            if strain[start, marker] - before[before > 0][-1:].sum() > SIGMAS:
                yield marker, start, stop


def _stretches(doubtful: np.ndarray, results: Mapping[int, FrameResult]) -> list[tuple[int, int]]:
    """First and last frames of what is to be read again; all of it was labelled."""
    parts = np.split(doubtful, np.flatnonzero(np.diff(doubtful) > REREADING.around) + 1)
    found = []
    for part in parts:
        if not len(part):
            continue
        first, last = int(part[0]), int(part[-1])
        if any(index not in results for index in range(first, last + 1)):
            continue
        for _ in range(REREADING.around // 3):  # names go wrong slowly
            first -= first - 1 in results
            last += last + 1 in results
        found.append((first, last))
    return found


def _beyond(edge: int, step: int, count: int, results: Mapping[int, FrameResult]) -> list[tuple[int, int]]:
    """First and last of up to `count` labelled frames beyond the edge of a stretch at which blobs got other names."""
    end = edge
    while end + step in results and abs(end - edge) < count:
        end += step
    return [] if end == edge else [(min(edge + step, end), max(edge + step, end))]


def _contradict(one: Naming, other: Naming) -> bool:
    """Whether a blob of a frame has different names."""
    return bool(((one.owner != other.owner) & (one.owner >= 0) & (other.owner >= 0)).any())


def _read_as(old: FrameResult, followed: Followed) -> FrameResult:
    bodies = followed.track.subject.bodies
    return replace(old, bodies=bodies, naming=followed.naming, expected=followed.expected)


def _strain(markers: np.ndarray, pull: RayPull) -> np.ndarray:
    """(F, M) squared deviations by which named blobs are off a body's markers (F, M, 3) m; 0 where none is named.

    However many rays a marker has, they share how far it may be off its place.
    """
    found, _, depth = pull.sight.looked_at(markers)
    off = (depth / pull.deviation.swapaxes(1, 2))[..., None] * (pull.image.swapaxes(1, 2) - found)
    return np.einsum("fmci,fmci->fm", off, off)


def known_subject_of(results: Sequence[FrameResult], setup: Setup, before: KnownSubject | None) -> KnownSubject:
    """The subject that labelled frames show: medians over all of them, so that a part with wrong names does not count.

    A marker sits where it mostly was found, in enough frames, unless nobody wears it there; one that was hardly found
    sits where it did `before`.
    """
    poses = Bodies.join([result.bodies for result in results])
    scale, shape = (np.median(part, axis=0)[None] for part in (poses.scale, poses.shape))
    points = np.array([result.naming.meeting.points for result in results])
    pixel = float(np.median([result.naming.frame.rules.pixel for result in results]))
    anywhere = setup.marker_sd * float(scale.mean())
    own, sd = np.zeros_like(poses.own[0]), anywhere.copy()
    plain = replace(poses.pick([0]), scale=scale, shape=shape, own=own[None])
    found = np.isfinite(points[..., 0]).sum(axis=0)
    known = found >= REREADING.min_frames // 2
    if known.any():
        posed = setup.model.pose(_with_body_of(plain, poses))
        turn = posed.rotations[:, setup.model.attachment].swapaxes(-1, -2)
        local = (turn @ (points - posed.markers)[..., None])[..., 0][:, known] / scale
        own[known] = np.nanmedian(local, axis=0)
        off = np.linalg.norm((local - own[known]) * scale, axis=2)
        sd[known] = np.clip(np.nanmedian(off, axis=0), MARKER_LIMITS.skin_m, anywhere[known])
        # A marker that is found farther off is another one.
        known &= np.linalg.norm(own, axis=1) < np.sqrt(setup.rules.max_square) * setup.marker_sd
    if before is not None:
        earlier = ~known & before.known
        own[earlier], sd[earlier] = before.subject.bodies.own[0, earlier], before.subject.own_sd[earlier]
        known = known | earlier
    subject = Subject(replace(plain, own=np.where(known[:, None], own, 0)[None]), np.where(known, sd, anywhere), pixel)
    return KnownSubject(subject, known, found)


def _with_body_of(subject: Bodies, poses: Bodies) -> Bodies:
    """One subject in the places and poses of B bodies."""
    mine = {name: np.repeat(getattr(subject, name), len(poses), axis=0) for name in ("scale", "shape", "own")}
    return replace(poses, **mine)
