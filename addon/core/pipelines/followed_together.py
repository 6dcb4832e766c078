# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs of several subjects named by their bodies alone, which are followed together and share out the blobs.

That is the short way of a take in which everybody is there all the time: not every frame is reconstructed, nor are its
points searched. Some frames of each chunk are looked at: their blobs make points, which single frames name for sure, or
do not. In the frame that says most everybody is found, and from there all are followed. Where the bodies contradict a
frame, they are found in that frame instead. Who is lost, or goes on to contradict, is for the points of all frames to
name: `several_through_points`.
"""

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import permutations
from time import perf_counter
from typing import TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from ..blobs.pipeline import TAKES, ChunkInWork, TakeLabeller
from ..blobs.search import FINDING, NO_HINTS, Found, find_subject
from ..blobs.sharing import followed_in_step, without
from ..blobs.subject import Setup
from ..data.made import MakeTable
from ..data.markersets import MarkerSet
from ..data.progress import Progress
from ..data.takes import NO_MARKER, Blobs, LabelledChunk, Labels, Motion, Suspect, evenly_spread, summed
from ..geometry.cameras import Cameras
from ..geometry.measuring import measured_again
from ..geometry.views import View, split_views
from ..papers.virtual_occlusions.occlusion import OCCLUDING, CapsuleOcclusion, Occlusion
from ..points.models import Model, namer_of
from ..points.refusals import is_sure
from ..points.several.parting import grouped
from ..points.several.together import beside, said_of
from ..points.several.wearers import AUTO, SetsWorn, SeveralOptions
from ..reconstruction.matching import padded
from ..reconstruction.trajectories import Reconstructor


@dataclass(frozen=True)
class FollowedTogetherOptions:
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


FOLLOWED_TOGETHER = FollowedTogetherOptions()
LEAST_LOOKED_AT = 4  # frames of a chunk, at least
LEARNED_FROM = 2  # frames: whose points have many rays need not know the capture well
MAX_STARTS = 4  # of a chunk, in different frames; by time


@dataclass(frozen=True, eq=False)
class LookedAt:
    """A frame whose blobs make Q points of three rays or more: slots (Q, C) of its view, -1 where none.

    group   (Q,) whose they are, if they lie in as many groups as there are subjects; -1 where they do not
    marker  (Q,) what the frame is sure that each is, NO_MARKER for nothing
    """

    at: int
    slots: np.ndarray
    group: np.ndarray
    marker: np.ndarray

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

    What they contradict alike from a start before a frame and from one after it is the frame's error.
    """

    def __init__(self, looked: Sequence[LookedAt], markers: int):
        self.looked, self.markers = {one.at: one for one in looked}, markers
        self.most = FOLLOWED_TOGETHER.contradicted * sum(int((one.marker != NO_MARKER).sum()) for one in looked)
        self.count: dict[int, int] = {}
        self.seen: set[tuple[int, bytes, bool]] = set()
        self.start = -1

    def begin(self, start: int):
        """Another start, in that frame; -1 for before all."""
        self.count, self.start = {}, start

    def add(self, at: int, owner: np.ndarray):
        """What a frame is named as, by owners (C, K), if it is one of those that are looked at."""
        if at not in self.looked:
            return
        look = self.looked[at]
        wrong = look.contradicted(owner, self.markers)
        key, later = np.where(wrong[:, None], look.owners(owner) % self.markers, NO_MARKER).tobytes(), at > self.start
        self.seen.add((at, key, later))
        self.count[at] = 0 if (at, key, not later) in self.seen else int(wrong.sum())

    @property
    def are_many(self) -> bool:
        """Whether there are so many that some body is elsewhere."""
        return sum(self.count.values()) > self.most


class SubjectsFollowed:
    """The bodies of so many subjects who wear one model, followed from chunk to chunk."""

    def __init__(self, cameras: Cameras, model: Model, count: int, rate: float, body: Occlusion):
        self.cameras, self.rate, self.markers = cameras, rate, len(model.markerset)
        setups = [Setup.of(cameras, model.markerset, body, rate=rate) for _ in range(count)]
        self.labellers = [TakeLabeller(setup) for setup in setups]
        self.reconstructor, self.namer = Reconstructor(cameras, rate), namer_of(model, "likelihood")
        self.last: np.ndarray | None = None  # (S, M, 3) m, where the markers were in the last frame

    def label(self, blobs: Blobs) -> list[LabelledChunk] | None:
        """What each body says of the next chunk; None where they do not explain it."""
        views = split_views(blobs, self.cameras)
        looked = self._looked_at(views)
        sure = np.concatenate([one.marker != NO_MARKER for one in looked])
        if sure.sum() <= FOLLOWED_TOGETHER.sure * len(sure):
            return None
        left, doubts = list(looked), Doubts(looked, self.markers)
        for turn in range(MAX_STARTS):
            start = None
            if turn or self.last is None:
                left.sort(key=lambda one: (doubts.count.get(one.at, 0), one.least_sure(len(self.labellers))))
                if not left or not left[-1].least_sure(len(self.labellers))[0]:
                    return None
                start = left.pop()
            made = self._made(blobs, views, start, doubts)
            if made is not None or (doubts.count and not doubts.are_many):
                return made  # another start would not mend that somebody is lost, or does not explain the points
        return None

    def _made(
        self, blobs: Blobs, views: list[View], start: LookedAt | None, doubts: Doubts
    ) -> list[LabelledChunk] | None:
        """The chunk followed from its beginning, or from a frame in which all are found; None as `label` has it."""
        labellers = [one.kept() for one in self.labellers]
        known: list = [None] * len(labellers)
        if start is not None:
            known = self._found(views[start.at], start)
            if not known:
                return None
            for one in labellers:
                one.track = None
        chunks = [ChunkInWork(blobs, views, None, self.markers, one) for one in known]
        doubts.begin(-1 if start is None else start.at)
        if not self._explain(labellers, chunks, doubts):
            return None
        made = [chunk.labelled(one.setup) for one, chunk in zip(labellers, chunks, strict=True)]
        order = self._as_before(made)
        self.labellers, made = [labellers[one] for one in order], [made[one] for one in order]
        self.last = np.array([one.motion.expected[-1] for one in made])
        return made

    def _explain(self, labellers: Sequence[TakeLabeller], chunks: Sequence[ChunkInWork], doubts: Doubts) -> bool:
        """Follows all through the chunk; whether they stay there, and go with the frames that are looked at."""
        for at in followed_in_step(labellers, chunks):
            doubts.add(at, self._owner(chunks, at))
            if doubts.are_many:
                return False
        if any(len(chunk.results) < len(chunk.views) for chunk in chunks):
            return False
        good = [one.explained(self._owner(chunks, at), self.markers) for at, one in doubts.looked.items()]
        return bool(np.concatenate(good).mean() >= FOLLOWED_TOGETHER.explained)

    def _owner(self, chunks: Sequence[ChunkInWork], at: int) -> np.ndarray:
        """(C, K) which marker each blob of a frame is, the markers of all in a row; NO_MARKER where it is nobody's."""
        owner = np.full(chunks[0].whole[at].real.shape, NO_MARKER)
        for subject, chunk in enumerate(chunks):
            own = chunk.results[at].naming.owner
            owner = np.where((own >= 0) & (owner == NO_MARKER), own + subject * self.markers, owner)
        return owner

    def _found(self, view: View, look: LookedAt) -> list[tuple[int, Found]]:
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
                return []
            known.append((look.at, found))
        return known

    def _as_before(self, made: Sequence[LabelledChunk]) -> list[int]:
        """The order in which the bodies of a chunk are those of the chunk before."""
        every = range(len(made))
        if self.last is None:
            return list(every)
        away = np.linalg.norm(np.array([one.motion.expected[0] for one in made]) - self.last[:, None], axis=3).sum(
            axis=2
        )
        return list(
            min(permutations(every), key=lambda order: sum(away[one, other] for one, other in enumerate(order)))
        )

    def _looked_at(self, views: Sequence[View]) -> list[LookedAt]:
        """Frames spread over a chunk, with the names that they are sure of."""
        count = max(round(len(views) / (FOLLOWED_TOGETHER.looked_at_s * self.rate)), LEAST_LOOKED_AT)
        self.reconstructor.learn_once(views, LEARNED_FROM)
        frames, each = evenly_spread(len(views), count).tolist(), []
        for at in frames:
            made = self.reconstructor.matcher([views[at]]).match(0, 1)
            each.append(made.of(made.support >= 3))
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


@dataclass(frozen=True, eq=False)
class FollowedTogether:
    """A take of blobs named by bodies: whose sets are worn, and what is said of its chunks, in tables of its room."""

    worn: SetsWorn
    said: tuple[LabelledChunk, ...]

    def chunks(self, chunks: Iterable[Blobs]) -> Iterator[LabelledChunk]:
        """The same chunks as were followed, with the names of their blobs."""
        for one, _ in zip(self.said, chunks, strict=True):
            yield replace(one, labels=_through(one.labels, np.array), motion=_through(one.motion, np.array))


def label_together(
    read: Callable[[], Iterable[tuple[Blobs, float]]],
    cameras: Cameras,
    asked: SeveralOptions,
    rate: float,
    room: MakeTable,
    body_of: Callable[[MarkerSet], Occlusion] | None = None,
) -> Generator[Progress, None, FollowedTogether | None]:
    """The take's blobs named by everybody's body, as `label_several_blobs` takes them.

    None where it is not said how many there are, or who, or they do not explain the take.
    """
    model, count = asked.model, asked.count
    if (
        model is None
        or model.likelihood is None
        or count in (AUTO, 1)
        or min(rate / TAKES.min_rate, len(cameras) / 3) < 1
    ):
        return None
    worn = SetsWorn(asked.numbered(count))
    body = body_of(model.markerset) if body_of else CapsuleOcclusion(model.markerset, OCCLUDING.fitted_shrink)
    bodies, said = SubjectsFollowed(cameras, model, count, rate, body), []
    for blobs, share in read():
        begin = perf_counter()
        with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
            made = bodies.label(blobs)
            if made is None:
                return None
            one = bodies.joined(blobs, made, worn)
        spent = {**one.seconds, "place": one.seconds["place"] + perf_counter() - begin - sum(one.seconds.values())}
        put = partial(_put, room)
        said.append(replace(one, labels=_through(one.labels, put), motion=_through(one.motion, put), seconds=spent))
        yield Progress(share, f"follow everybody to frame {blobs.frames[-1]}")
    return FollowedTogether(worn, tuple(said)) if said else None


Arrays = TypeVar("Arrays", Labels, Motion)


def _through(data: Arrays, made: Callable) -> Arrays:
    """The same with every array as what is made of it."""
    known = {one.name: getattr(data, one.name) for one in fields(data)}
    return replace(data, **{name: made(array) for name, array in known.items() if array is not None})


def _put(make_table: MakeTable, array: np.ndarray):
    """An array in a table of a room."""
    table = make_table(array.shape, array.dtype) if array.size else array
    table[:] = array
    return table
