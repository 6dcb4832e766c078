# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs of several subjects named by their bodies alone, which are followed together and share out the blobs.

That is the short way of a take in which everybody is there all the time: not every frame is reconstructed, nor are its
points searched. Some frames of each chunk are looked at: their blobs make points, which single frames name for sure, or
do not. In the frame that says most everybody is found, and from there all are followed. Where the bodies contradict a
frame, they are found in that frame instead. Who is lost, or goes on to contradict, is for the points of all frames to
name: `several_through_points`. What a person said holds bodies that follow once more, and who is 1 stays who that is.
"""

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from time import perf_counter
from typing import Self, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from ..blobs.pipeline import TAKES, ChunkInWork, TakeLabeller
from ..blobs.search import FINDING, NO_HINTS, Found, find_subject
from ..blobs.sharing import followed_in_step, without
from ..blobs.subject import Setup
from ..data.made import MakeTable, Table
from ..data.markersets import MarkerSet
from ..data.progress import Progress
from ..data.takes import NO_MARKER, Blobs, LabelledChunk, Labels, Motion, Suspect, evenly_spread, summed
from ..edits.applying import apply_edits, cells_of_blobs
from ..edits.kinds import Edits
from ..geometry.cameras import Cameras
from ..geometry.measuring import measured_again
from ..geometry.views import View, split_views
from ..papers.virtual_occlusions.occlusion import OCCLUDING, CapsuleOcclusion, Occlusion
from ..points.models import Model, namer_of
from ..points.possible import refuse_impossible
from ..points.refusals import is_sure
from ..points.several.parting import NO_BODY, along_the_line, grouped, usual_count
from ..points.several.pipeline import is_prop
from ..points.several.together import beside, said_of
from ..points.several.wearers import MAX_SUBJECTS, SetsWorn, SeveralOptions
from ..points.whole_take.pipeline import USUAL_TARGET, PointOptions
from ..reconstruction.matching import FramePoints, padded
from ..reconstruction.trajectories import Reconstructor


class FOLLOWED_TOGETHER:
    """When bodies that are followed together are believed."""

    looked_at_s: float = 0.2  # physical: between frames that are looked at; a limb swings for half a second
    # What follows was chosen on what cameras see of `passing`, `beside`, `behind` and `acting` of accuracy/actors.py:
    # part of the points that frames must be sure of, for bodies to be judged by them at all
    sure: float = 0.65  # measured
    # part of the names that frames are sure of which bodies may contradict, as frames err, too
    contradicted: float = 0.007  # measured
    # part of the points that bodies must explain, each by one name in all cameras
    explained: float = 0.975  # measured
    lead: float = 2.0  # physical: nats, by which one of two must have a blob nearer to be called its only owner


LEAST_LOOKED_AT = 4  # frames of a chunk, at least
LEARNED_FROM = 2  # frames: whose points have many rays need not know the capture well
MAX_STARTS = 4  # of a chunk, in different frames; by time
NARROW = {"f": "<f4", "i": "<i4"}  # numbers as they lie in a room


@dataclass(frozen=True, eq=False)
class LookedAt:
    """A frame whose blobs make Q points of three rays or more: slots (Q, C) of its view, -1 where none."""

    at: int
    slots: np.ndarray
    group: np.ndarray  # (Q,) whose they are, if they lie in as many groups as there are subjects; -1 where they do not
    marker: np.ndarray  # (Q,) what the frame is sure that each is, NO_MARKER for nothing

    def least_sure(self, count: int) -> tuple[int, int]:
        """How many names it is sure of: of whomever it has the fewest of so many, and of all."""
        sure = np.bincount(self.group[self.marker >= 0], minlength=count)
        return int(sure.min()), int(sure.sum())

    def blobs_of(self, some: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Point, camera and slot of every blob of some of the points (Q,)."""
        point, camera = np.nonzero((self.slots >= 0) & some[:, None])
        return point, camera, self.slots[point, camera]

    def contradicted(self, owner: np.ndarray, markers: int) -> np.ndarray:
        """(Q,) True for the points that it is sure of, most of whose named blobs have another name by owners (C, K).

        Or are somebody else's than those of their group.
        """
        own, sure = self.owners(owner), self.marker != NO_MARKER
        given = own != NO_MARKER
        whose = np.zeros(len(own), int)
        for group in np.unique(self.group[sure]):
            rows = sure & (self.group == group)
            whose[rows] = np.bincount(own[rows][given[rows]] // markers, minlength=1).argmax()
        right = own == (self.marker + whose * markers)[:, None]
        return sure & ((given & ~right).sum(axis=1) > (given & right).sum(axis=1))

    def denied(self, owner: np.ndarray, markers: int) -> set[tuple[int, int]]:
        """The names that it is sure of and owners (C, K) contradict, each with that of most blobs of its point."""
        rows, own = np.flatnonzero(self.contradicted(owner, markers)), self.owners(owner)
        usual = [np.bincount(own[row][own[row] != NO_MARKER] % markers).argmax() for row in rows]
        return {(int(self.marker[row]), int(one)) for row, one in zip(rows, usual, strict=True)}

    def explained(self, owner: np.ndarray, markers: int) -> np.ndarray:
        """(Q,) True for the points most of whose blobs have an owner (C, K), and all the same, which it is sure of."""
        own = self.owners(owner)
        given = own != NO_MARKER
        same = (~given | (own == own.max(axis=1, keepdims=True))).all(axis=1)
        many = 2 * given.sum(axis=1) > (self.slots >= 0).sum(axis=1)
        return same & many & ~self.contradicted(owner, markers)

    def owners(self, owner: np.ndarray) -> np.ndarray:
        """(Q, C) the owners (C, K) of the points' blobs, NO_MARKER where there is none."""
        return np.where(self.slots >= 0, owner[np.arange(len(owner)), np.maximum(self.slots, 0)], NO_MARKER)


class Doubts:
    """Which names of the frames that are looked at bodies contradict, as they are followed from several starts.

    What they contradict alike from a start before a frame and from one after it is an error of such frames.
    """

    def __init__(self, looked: Sequence[LookedAt], markers: int, most: float | None = None):
        self.looked, self.markers = {one.at: one for one in looked}, markers
        sure = sum(int((one.marker != NO_MARKER).sum()) for one in looked)
        self.most = FOLLOWED_TOGETHER.contradicted * sure if most is None else most
        self.count: dict[int, int] = {}
        self.are_confirmed = False
        self.seen: set[tuple[int, bool, tuple[int, int]]] = set()
        self.excused: set[tuple[int, int]] = set()
        self.start = -1

    def begin(self, start: int):
        """Another start, in that frame; -1 for before all."""
        self.count, self.start, self.are_confirmed = {}, start, False

    def add(self, at: int, owner: np.ndarray):
        """What a frame is named as, by owners (C, K), if it is one of those that are looked at."""
        if at not in self.looked:
            return
        denied, later = self.looked[at].denied(owner, self.markers), at > self.start
        self.seen |= {(at, later, one) for one in denied}
        self.excused |= {one for one in denied if (at, not later, one) in self.seen}
        self.count[at] = len(denied - self.excused)

    def confirm(self, at: int, owner: np.ndarray, beside: LookedAt, owner_beside: np.ndarray):
        """Hears of a frame beside: what bodies contradict in both alike is no error of a single frame."""
        denied = self.looked[at].denied(owner, self.markers) & beside.denied(owner_beside, self.markers)
        self.are_confirmed |= bool(denied - self.excused)

    @property
    def are_many(self) -> bool:
        """Whether there are so many that some body is elsewhere."""
        return sum(self.count.values()) > self.most


@dataclass(frozen=True, eq=False)
class Begun:
    """Where a chunk is begun: in frame `at`, in which everybody was `found`; where all were before it if nobody was."""

    at: int
    found: tuple[Found, ...]


BEFORE = Begun(-1, ())


class SubjectsFollowed:
    """The bodies of so many subjects who wear one model, followed from chunk to chunk; 1 is first along a line."""

    def __init__(self, cameras: Cameras, model: Model, count: int, rate: float, body: Occlusion):
        self.cameras, self.rate, self.markers = cameras, rate, len(model.markerset)
        setups = [Setup.of(cameras, model.markerset, body, rate=rate) for _ in range(count)]
        self.labellers = [TakeLabeller(setup) for setup in setups]
        self.reconstructor, self.namer = Reconstructor(cameras, rate), namer_of(model, "likelihood")
        self.last: np.ndarray | None = None  # (S, M, 3) m, where the markers were in the last frame
        self.begun, self.looked = BEFORE, list[LookedAt]()  # of the last chunk

    def kept(self) -> Self:
        """The same as they are now, whatever these label next."""
        kept = copy(self)
        kept.labellers = [one.kept() for one in self.labellers]
        return kept

    def label(self, blobs: Blobs) -> list[LabelledChunk] | None:
        """What each body says of the next chunk; None where they do not explain it."""
        views = split_views(blobs, self.cameras)
        self.looked = self._look(views, frames_looked_at(len(views), self.rate))
        sure = np.concatenate([one.marker != NO_MARKER for one in self.looked])
        if sure.sum() <= FOLLOWED_TOGETHER.sure * len(sure):
            return None
        left, doubts = list(self.looked), Doubts(self.looked, self.markers)
        for turn in range(MAX_STARTS):
            self.begun = BEFORE
            if turn or self.last is None:
                left.sort(key=lambda one: (doubts.count.get(one.at, 0), one.least_sure(len(self.labellers))))
                if not left or not left[-1].least_sure(len(self.labellers))[0]:
                    return None
                start = left.pop()
                self.begun = Begun(start.at, self._found(views[start.at], start))
            is_begun = self.begun is BEFORE or self.begun.found
            if is_begun and (made := self._made(blobs, views, doubts)) is not None:
                return self._in_order(made)
            if doubts.count and not doubts.are_many and not doubts.are_confirmed:
                return None  # another start would not mend that somebody is lost, or does not explain the points
        return None

    def held(
        self, blobs: Blobs, seeds: np.ndarray, led: Self, said: Sequence[LabelledChunk]
    ) -> list[LabelledChunk] | None:
        """What each says of the next chunk, of whose blobs a person named some: `seeds` (N,) by the markers of all.

        It is begun as by those who were `led` by nobody, and who `said` that of it. A person's names need no frames to
        bear them out. None where the bodies do not explain it, or somebody goes over to where another was.
        """
        self.begun, doubts = led.begun, Doubts(led.looked, self.markers, np.inf)
        made = self._made(blobs, split_views(blobs, self.cameras), doubts, seeds)
        if made is None:
            return None
        before, now = (np.array([one.motion.expected for one in each]) for each in (said, made))
        away = np.linalg.norm(now[:, None] - before, axis=4).mean(axis=3)
        own = np.arange(len(made))[:, None]
        return self._gone_on(made) if (away.argmin(axis=1) == own).all() else None

    def _made(
        self, blobs: Blobs, views: list[View], doubts: Doubts, seeds: np.ndarray | None = None
    ) -> list[LabelledChunk] | None:
        """The chunk followed from where it is begun; None as `label` has it."""
        labellers = [one.kept() for one in self.labellers]
        chunks = []
        for subject, labeller in enumerate(labellers):
            own, known = None, None
            if seeds is not None:
                own = np.where(seeds // self.markers == subject, seeds % self.markers, NO_MARKER)
            if self.begun.found:
                labeller.track, known = None, (self.begun.at, self.begun.found[subject])
            chunks.append(ChunkInWork(blobs, views, own, self.markers, known))
        doubts.begin(self.begun.at)
        if not self._explain(labellers, chunks, doubts):
            return None
        self.labellers = labellers
        return [chunk.labelled(one.setup) for one, chunk in zip(labellers, chunks, strict=True)]

    def _explain(self, labellers: Sequence[TakeLabeller], chunks: Sequence[ChunkInWork], doubts: Doubts) -> bool:
        """Follows all through the chunk; whether they stay there, and go with the frames that are looked at."""
        for at in followed_in_step(labellers, chunks):
            doubts.add(at, self._owner(chunks, at))
            if doubts.are_many:
                return False
        if any(len(chunk.results) < len(chunk.views) for chunk in chunks):
            return False
        good = [one.explained(self._owner(chunks, at), self.markers) for at, one in doubts.looked.items()]
        if np.concatenate(good).mean() < FOLLOWED_TOGETHER.explained:
            return False
        self._confirm(chunks, doubts)
        return not doubts.are_confirmed

    def _confirm(self, chunks: Sequence[ChunkInWork], doubts: Doubts):
        """Looks half-way to the next frames beside those that are contradicted, where doubts count."""
        views, half = chunks[0].whole, max(round(FOLLOWED_TOGETHER.looked_at_s * self.rate / 2), 1)
        for at in (at for at, count in doubts.count.items() if count and doubts.most < np.inf):
            near = [one for one in (at - half, at + half) if 0 <= one < len(views)]
            for one in self._look(views, near) if near else ():
                doubts.confirm(at, self._owner(chunks, at), one, self._owner(chunks, one.at))

    def _owner(self, chunks: Sequence[ChunkInWork], at: int) -> np.ndarray:
        """(C, K) which marker each blob of a frame is, the markers of all in a row; NO_MARKER where it is nobody's."""
        owner = np.full(chunks[0].whole[at].real.shape, NO_MARKER)
        for subject, chunk in enumerate(chunks):
            own = chunk.results[at].naming.owner
            owner = np.where((own >= 0) & (owner == NO_MARKER), own + subject * self.markers, owner)
        return owner

    def _found(self, view: View, look: LookedAt) -> tuple[Found, ...]:
        """Everybody in a frame that is looked at, among their own points and whatever is nobody's; none if not all."""
        known = []
        for subject, labeller in enumerate(self.labellers):
            own, taken = look.group == subject, np.zeros_like(view.real)
            _, camera, slot = look.blobs_of(~own)
            taken[camera, slot] = True
            point, camera, slot = look.blobs_of(own & (look.marker >= 0))
            fixed = np.full((len(view.real), self.markers), -1)
            fixed[camera, look.marker[point]] = slot
            found = find_subject(without(view, taken), labeller.setup, NO_HINTS, fixed)
            if found is None or found.confidence <= FINDING.clear_confidence:
                return ()
            known.append(found)
        return tuple(known)

    def _in_order(self, made: Sequence[LabelledChunk]) -> list[LabelledChunk] | None:
        """The bodies of a chunk as in the chunk before, or by where they are; None where that cannot be said."""
        if self.last is None:
            markers = np.concatenate([one.motion.markers for one in made], axis=1)
            whose = np.repeat(np.arange(len(made)), self.markers)
            body = np.where(np.isfinite(markers[..., 0]), whose, NO_BODY)
            order = along_the_line(markers, body, [self.markers] * len(made))
        else:
            away = np.array([one.motion.expected[0] for one in made]) - self.last[:, None]
            order = np.linalg.norm(away, axis=3).sum(axis=2).argmin(axis=1).tolist()
        if order is None or len(set(order)) < len(made):
            return None
        self.labellers = [self.labellers[one] for one in order]
        self.begun = replace(self.begun, found=tuple(self.begun.found[one] for one in order if self.begun.found))
        return self._gone_on([made[one] for one in order])

    def _gone_on(self, made: list[LabelledChunk]) -> list[LabelledChunk]:
        """The same, once it is kept where they end."""
        self.last = np.array([one.motion.expected[-1] for one in made])
        return made

    def _look(self, views: Sequence[View], frames: Sequence[int]) -> list[LookedAt]:
        """Some frames of a chunk, with the names that they are sure of."""
        each = points_of(views, frames, self.reconstructor)
        groups = []
        for one in each:
            group, _ = grouped(one.points, len(self.labellers))
            groups.append(np.full(len(one.points), -1) if group is None else group)
        markers = self._sure_names([one.points for one in each], groups)
        return [LookedAt(at, one.slots, *more) for at, one, *more in zip(frames, each, groups, markers, strict=True)]

    def _sure_names(self, points: Sequence[np.ndarray], groups: Sequence[np.ndarray]) -> list[np.ndarray]:
        """What the frames, with points (Q, 3) m in groups (Q,) each, are sure of, every group on its own."""
        group, place = np.concatenate(groups), np.repeat(np.arange(len(groups)), [len(one) for one in groups])
        marker = np.full(len(group), NO_MARKER)
        some = np.flatnonzero(group >= 0)
        if len(some):
            row = place[some] * len(self.labellers) + group[some]
            table = padded(np.concatenate(points)[some], row, int(row.max()) + 1, np.nan)
            labels = Labels.join(self.namer.name(table, 0.0))
            given = np.where(is_sure(labels), labels.marker, NO_MARKER)
            marker[some[np.argsort(row, kind="stable")]] = given[np.isfinite(table[..., 0])]
        return np.split(marker, np.cumsum([len(one) for one in groups])[:-1])

    def joined(self, blobs: Blobs, made: Sequence[LabelledChunk], worn: SetsWorn) -> LabelledChunk:
        """What all say of a chunk as one: of blobs that two want the nearer's, if it is clearly nearer."""
        motion, labels = beside([one.motion for one in made]), Labels.none(len(blobs))
        named = np.array([one.labels.named for one in made])
        owner = np.where(named.any(axis=0), named.argmax(axis=0), NO_MARKER)
        wanted = np.flatnonzero(named.sum(axis=0) > 1)
        owner[wanted] = self._nearest(blobs, wanted, made)
        lost = np.zeros(motion.residual.shape, bool)
        suspects: list[Suspect] = []
        seconds: dict[str, float] = {}
        for subject, (one, first) in enumerate(zip(made, worn.firsts, strict=True)):
            own = owner == subject
            labels.marker[own], labels.step[own] = one.labels.marker[own] + first, one.labels.step[own]
            labels.confidence[own] = one.labels.confidence[own]
            other = named[subject] & ~own
            lost[blobs.frame[other], one.labels.marker[other] + first] = True
            suspects += [said_of(suspect, worn.subjects[subject]) for suspect in one.suspects]
            seconds = summed(seconds, one.seconds)
        motion = measured_again(motion, blobs, labels, labels, self.cameras, lost)
        return LabelledChunk(labels, motion, tuple(suspects), seconds)

    def _nearest(self, blobs: Blobs, rows: np.ndarray, made: Sequence[LabelledChunk]) -> np.ndarray:
        """(R,) who has the marker that is nearest to each of some blobs; NO_MARKER where another's is about as near."""
        camera, sight = blobs.camera[rows], self.labellers[0].setup.sight
        seen = self.cameras.undistort(blobs.xy[rows], camera)
        cost = np.full((len(made), len(rows)), np.inf)
        for subject, one in enumerate(made):
            own = np.flatnonzero(one.labels.named[rows])
            points = one.motion.markers[blobs.frame[rows[own]], one.labels.marker[rows[own]]]
            image = sight.image(sight.local(points[None])[0])[camera[own], np.arange(len(own))]
            pixels = np.linalg.norm(image - seen[own], axis=1) * sight.focal[camera[own]]
            cost[subject, own] = np.nan_to_num((pixels / self.reconstructor.circumstances.pixel) ** 2 / 2, nan=np.inf)
        order = np.sort(cost, axis=0)
        with np.errstate(invalid="ignore"):  # two of whom neither has a place
            return np.where(order[1] - order[0] >= FOLLOWED_TOGETHER.lead, cost.argmin(axis=0), NO_MARKER)


def frames_looked_at(count: int, rate: float) -> list[int]:
    """Those of so many frames of a chunk."""
    return evenly_spread(count, max(round(count / (FOLLOWED_TOGETHER.looked_at_s * rate)), LEAST_LOOKED_AT)).tolist()


def points_of(views: Sequence[View], frames: Sequence[int], reconstructor: Reconstructor) -> list[FramePoints]:
    """The points of three rays or more in some frames of a chunk, each on its own."""
    reconstructor.learn_once(views, LEARNED_FROM)
    found = [reconstructor.matcher([views[at]]).match(0, 1) for at in frames]
    return [one.of(one.support >= 3) for one in found]


@dataclass(frozen=True, eq=False)
class ChunkInRoom:
    """What is said of a chunk, its arrays in tables of a room: a row for each blob, or for each frame."""

    labels: Table
    motion: Table
    unedited: Table | None
    suspects: tuple[Suspect, ...]
    seconds: dict[str, float]

    @classmethod
    def of(cls, chunk: LabelledChunk, make_table: MakeTable) -> Self:
        """The chunk, in tables that `make_table` gives."""
        before = None if chunk.unedited is None else _in_room(chunk.unedited, make_table)
        rows = _in_room(chunk.labels, make_table), _in_room(chunk.motion, make_table)
        return cls(*rows, before, chunk.suspects, chunk.seconds)

    def read(self) -> LabelledChunk:
        """The chunk as it was, to the accuracy of single floats."""
        before = None if self.unedited is None else _read(Labels, self.unedited)
        labels, motion = _read(Labels, self.labels), _read(Motion, self.motion)
        return LabelledChunk(labels, motion, self.suspects, self.seconds, before)


def _in_room(data: Labels | Motion, make_table: MakeTable) -> Table:
    """The arrays beside each other in a table, a row for each of theirs."""
    arrays = {one.name: getattr(data, one.name) for one in fields(data)}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    kind = np.dtype([(name, NARROW.get(one.dtype.kind, one.dtype), one.shape[1:]) for name, one in arrays.items()])
    rows = np.empty(len(next(iter(arrays.values()))), kind)
    for name, array in arrays.items():
        rows[name] = array
    table = make_table(rows.shape, kind) if len(rows) else rows
    table[:] = rows
    return table


Arrays = TypeVar("Arrays", Labels, Motion)


def _read(kind: type[Arrays], table: Table) -> Arrays:
    rows, made = table[:], {}
    for name in rows.dtype.names or ():
        made[name] = rows[name].astype(float if rows[name].dtype.kind == "f" else int)
    return kind(**made)


@dataclass(frozen=True, eq=False)
class FollowedTogether:
    """A take of blobs named by bodies: whose sets are worn, and what is said of its chunks."""

    worn: SetsWorn
    said: tuple[ChunkInRoom, ...]

    def chunks(self, chunks: Iterable[Blobs]) -> Iterator[LabelledChunk]:
        """The same chunks as were followed, with the names of their blobs; edits are yet to be applied to them."""
        for one, _ in zip(self.said, chunks, strict=True):
            yield one.read()


class EditedBodies:
    """Bodies followed together and, from the first blob on that a person named, once more by what `edits` say."""

    def __init__(self, bodies: SubjectsFollowed, worn: SetsWorn, edits: Edits):
        self.bodies, self.worn, self.edits = bodies, worn, edits
        self.held: SubjectsFollowed | None = None

    def label(self, blobs: Blobs) -> LabelledChunk | None:
        """What all say of the next chunk, and before the edits; None where bodies do not explain it.

        Where they do not go with what a person named, the chunk is as it was without that.
        """
        before = self.bodies.kept() if self.edits and self.held is None else None
        made = self.bodies.label(blobs)
        if made is None:
            return None
        found = self.bodies.joined(blobs, made, self.worn)
        if not self.edits:
            return found
        cells = cells_of_blobs(blobs, self.bodies.cameras.names, self.worn.by_name, len(self.worn))
        edited = apply_edits(found.labels, self.edits, cells).edited
        seeds = np.where(edited.named, edited.labels.marker, NO_MARKER)
        if self.held is None and (seeds != NO_MARKER).any():
            self.held = before
        again = self.held and self.held.held(blobs, seeds, self.bodies, made)
        if not again:
            self.held = None
            return found
        whole = self.bodies.joined(blobs, again, self.worn)
        return replace(whole, unedited=found.labels, seconds=summed(found.seconds, whole.seconds))


@dataclass(frozen=True, eq=False)
class SeveralBlobs:
    """A take of blobs that several subjects are in, and how they are to be named."""

    # gives its chunks, each with the share that is read by then, as often as it is asked
    read: Callable[[], Iterable[tuple[Blobs, float]]]
    cameras: Cameras
    asked: SeveralOptions
    # whose edits are of blobs, and yet to be applied to the chunks; its room keeps what is not held
    options: PointOptions
    rate: float  # frames a second
    # makes the volume of a subject that is in the way; None for the marker set's capsules
    body_of: Callable[[MarkerSet], Occlusion] | None = None

    def body(self, markerset: MarkerSet) -> Occlusion:
        """The volume of somebody who wears a set."""
        return self.body_of(markerset) if self.body_of else CapsuleOcclusion(markerset, OCCLUDING.fitted_shrink)


def label_together(take: SeveralBlobs) -> Generator[Progress, None, FollowedTogether | float]:
    """The take's blobs named by everybody's body.

    How much of the take they explain, where that is not all, or where bodies cannot name it as is asked for.
    Raises ForceableError where they move as nobody can.
    """
    asked, options, rate, cameras = take.asked, take.options, take.rate, take.cameras
    model = asked.models[0]
    if not _can_follow(asked, options) or rate < TAKES.min_rate or len(cameras) < 3:
        return 0.0
    count = len(asked.subjects) or asked.count or _count_in(take.read(), cameras, model, rate)
    if count < 2:
        return 0.0
    worn = SetsWorn(asked.subjects or asked.numbered(count))
    if any(name not in worn.by_name for edit in options.edits for name in edit.names):
        return 0.0  # of who enters later, or of nobody
    followed = SubjectsFollowed(cameras, model, count, rate, take.body(model.markerset))
    bodies = EditedBodies(followed, worn, options.edits)
    said: list[ChunkInRoom] = []
    reached = 0.0
    for blobs, share in take.read():
        begin = perf_counter()
        with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
            one = bodies.label(blobs)
            if one is None:
                return reached
        spent = {**one.seconds, "place": one.seconds["place"] + perf_counter() - begin - sum(one.seconds.values())}
        said.append(ChunkInRoom.of(replace(one, seconds=spent), options.room))
        yield Progress(share, f"follow everybody to frame {blobs.frames[-1]}")
        reached = share
    if not said:
        return reached
    if not options.force:
        refuse_impossible(_markers(said, len(worn), options.room), rate, None, asked.models)
    return FollowedTogether(worn, tuple(said))


def _can_follow(asked: SeveralOptions, options: PointOptions) -> bool:
    """Whether bodies name who is asked for, by the method that is asked for: people in one set, and all of them."""
    model = asked.models[0]
    usual = options.method == "likelihood" and options.target == USUAL_TARGET
    return usual and len(asked.models) == 1 and model.likelihood is not None and not is_prop(model)


def _count_in(chunks: Iterable[tuple[Blobs, float]], cameras: Cameras, model: Model, rate: float) -> int:
    """How many wear the model in the first chunk, by how many points it shows."""
    blobs, _ = next(iter(chunks), (None, 0.0))
    if blobs is None:
        return 0
    frames = frames_looked_at(len(blobs.frames), rate)
    found = points_of(split_views(blobs, cameras), frames, Reconstructor(cameras, rate))
    count = round(usual_count(np.array([len(one.points) for one in found])) / len(model.markerset))
    return min(count, MAX_SUBJECTS)


def _markers(said: Sequence[ChunkInRoom], count: int, make_table: MakeTable) -> Table:
    """(T, M, 3) m, where so many markers are in all of the take."""
    ends = np.cumsum([len(one.motion) for one in said])
    table = make_table((int(ends[-1]), count, 3), "<f4")
    for one, end in zip(said, ends.tolist(), strict=True):
        table[end - len(one.motion) : end] = one.motion[:]["markers"]
    return table
