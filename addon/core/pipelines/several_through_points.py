# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs of several subjects named through the points that they make, and checked back in the images.

Who is who is a matter of the whole take, so all of it is reconstructed first and named as a take of points; its blobs
are looked at twice, and never held. In the images all bodies are in the way: one hides the other's markers. A body
fitted to each subject then names what too few cameras see for a point (`fitted_subjects`).
"""

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from ..data.errors import JobError
from ..data.lanes import Lanes
from ..data.markersets import MarkerSet
from ..data.progress import Progress, within
from ..data.room import IN_MEMORY, MakeTable
from ..data.takes import Blobs, LabelledChunk, Labels, Motion, Points, Suspect, touched_samples
from ..edits.blobs_in_points import NamedThroughBlobs
from ..edits.kinds import NO_EDITS, Edits
from ..geometry.cameras import Cameras
from ..geometry.measuring import measured_again
from ..geometry.triangulation import meet_rows
from ..papers.virtual_occlusions.occlusion import OCCLUDING, CapsuleOcclusion, Occlusion, hidden_by_any
from ..points.several.motion import LabelledSubjects, beside, measured_of_first
from ..points.several.pipeline import label_several
from ..points.several.wearers import SetsWorn, SeveralOptions
from ..points.whole_take.pipeline import PointOptions
from ..reconstruction.trajectories import Reconstructor, TrajectorySpans
from .fitted_subjects import FollowedSubjects


@dataclass(frozen=True)
class CheckingBackOptions:
    """When a blob keeps the name of its point. Costs are in nats: half the square of a distance over the blobs' noise.

    hidden    what it costs that a body is in the way: nobody's body is exactly the model's, so a blob that goes well
              with its marker's other blobs keeps its name all the same
    most      beyond which a blob is not its marker's, and
    lead      by which it must be cheaper than by any marker of somebody else that can be seen there: else both explain
              it about as well, as where images melt into one blob. All three were chosen on the first four takes of
              each kind in tests/accuracy/actor_blobs.py
    share     of the work that is reconstruction, as measured
    """

    hidden: float = 15.0
    most: float = 24.0
    lead: float = 2.0
    share: float = 0.4


CHECKING_BACK = CheckingBackOptions()


@dataclass(frozen=True, eq=False)
class _Part:
    """The points of a chunk of so many frames, from frame `first` of the take on: rows (Q,) as `PointsOfBlobs.kind`."""

    first: int
    frames: int
    rows: np.ndarray


class PointsOfBlobs:
    """The points that the blobs of a take make, chunk by chunk, in tables that `make_table` gives."""

    def __init__(self, cameras: Cameras, rate: float, make_table: MakeTable = IN_MEMORY):
        self.rate, self.make_table, self.first_frame, self.frames = rate, make_table, 0, 0
        self.reconstructor = Reconstructor(cameras, rate)
        row = [("frame", "<i4"), ("trajectory", "<i4"), ("xyz", "<f4", 3), ("residual", "<f4")]
        self.kind = np.dtype([*row, ("blobs", "<i4", len(cameras))])
        self.spans = TrajectorySpans()
        self.parts: list[_Part] = []
        self.place: np.ndarray | None = None
        self.lanes: Lanes | None = None

    def add(self, blobs: Blobs):
        """Adds the next chunk of the take. Raises JobError where a frame has more blobs than any capture."""
        made = self.reconstructor.reconstruct(blobs)
        rows = np.empty(len(made.points), self.kind)
        values = self.frames + made.frame, made.trajectory, made.points, made.residual, made.rows
        for name, column in zip(self.kind.names, values, strict=True):
            rows[name] = column
        self.spans.note(made.trajectory, rows["frame"])
        table = self.make_table(rows.shape, self.kind) if len(rows) else rows
        table[:] = rows
        self.first_frame = self.first_frame if self.parts else int(blobs.frames[0])
        self.parts.append(_Part(self.frames, len(blobs.frames), table))
        self.frames += len(blobs.frames)

    def take(self) -> Points:
        """All of them as a take, passing coincidences of rays left out; JobError where there are none."""
        kept = self.spans.lasting(self.frames)
        if not len(kept):
            raise JobError(
                "shows no markers that two cameras see together; expected blobs, and the cameras that saw them"
            )
        self.lanes = Lanes.packed(*self.spans.table[kept, 1:].T)
        self.place = np.full(len(self.spans.table), -1)
        self.place[kept] = np.arange(len(kept))
        shape = self.frames, self.lanes.count
        xyz, residual = np.full((*shape, 3), np.nan, np.float32), np.full(shape, np.nan, np.float32)
        for part in self.parts:
            rows, lane = self._lasting(part)
            xyz[rows["frame"], lane] = rows["xyz"]
            residual[rows["frame"], lane] = rows["residual"]
        return Points(("",) * len(kept), xyz, residual, self.rate, self.first_frame, lanes=self.lanes)

    def named(self, index: int, labels: Labels, blobs: int) -> Labels:
        """What labels (T, L) of the take say of so many blobs (N,) of a chunk."""
        part = self.parts[index]
        rows, lane = self._lasting(part)
        own = labels[part.first : part.first + part.frames][rows["frame"] - part.first, lane]
        found = Labels.none(blobs)
        point, camera = np.nonzero((rows["blobs"] >= 0) & own.named[:, None])
        at = rows["blobs"][point, camera]
        found.marker[at], found.step[at], found.confidence[at] = (
            column[point] for column in (own.marker, own.step, own.confidence)
        )
        return found

    def _lasting(self, part: _Part) -> tuple[np.ndarray, np.ndarray]:
        """The points of a chunk that are in the take, and their lanes."""
        rows = part.rows[:]
        place = self.place[rows["trajectory"]]
        return rows[place >= 0], self.lanes.lane[place[place >= 0]]


@dataclass(frozen=True, eq=False)
class SubjectsInImages:
    """A take of blobs whose points are named: what these say of its blobs, for whoever reads them again.

    labelled  that of everybody in the take, those who were asked for before the others
    worn    the sets of those who were asked for
    bodies  what is in the way, a volume for everybody
    seconds that reconstruction took
    """

    cameras: Cameras
    points: PointsOfBlobs
    labelled: LabelledSubjects
    worn: SetsWorn
    bodies: tuple[Occlusion, ...]
    seconds: float

    def chunks(self, chunks: Iterable[Blobs]) -> Iterator[LabelledChunk]:
        """The same chunks as were reconstructed, with the names of their blobs."""
        suspects = tuple(_of_blobs(one) for one in self.labelled.suspects)
        spent = {"place": self.seconds, **self.labelled.seconds}
        fitted = FollowedSubjects.of(self.labelled.worn, self.cameras, self.points.rate, self.bodies)
        for index, blobs in enumerate(chunks):
            begin = perf_counter()
            with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
                labels, motion, unedited = self._checked(index, blobs, fitted)
            mine = tuple(one for one in suspects if blobs.frames[0] <= one.first <= blobs.frames[-1])
            spent["label"] = spent.get("label", 0.0) + perf_counter() - begin
            yield LabelledChunk(labels, motion, mine, spent, unedited)
            spent = {}

    def _checked(self, index: int, blobs: Blobs, fitted: FollowedSubjects) -> tuple[Labels, Motion, Labels | None]:
        """The labels of a chunk's blobs that its images and bodies bear out, and the markers where these meet.

        Also the labels without what edits say of points; None where they say nothing.
        """
        part, said = self.points.parts[index], self.labelled
        each = said.motion.each(slice(part.first, part.first + part.frames))
        motion = beside(each)
        given = self.points.named(index, said.labels, len(blobs))
        hidden = hidden_by_any(self.bodies, each, motion.markers, self.cameras.centres)
        checked = given.kept(self._borne_out(blobs, given, motion, hidden, _subject(each)))

        def by_others(own: int, markers: np.ndarray) -> np.ndarray:
            others = [number for number in range(len(each)) if number != own]
            volumes, moving = [self.bodies[number] for number in others], [each[number] for number in others]
            return hidden_by_any(volumes, moving, markers, self.cameras.centres)

        labels = fitted.read(blobs, checked, by_others)
        there = np.isfinite(motion.markers).all(axis=2)
        meeting = labels.kept(self._meeting(blobs, checked, labels, motion))
        motion = measured_again(motion, blobs, given, meeting, self.cameras, there)
        unedited = None
        if said.unedited is not None:
            before = self.points.named(index, said.unedited, len(blobs))
            unedited = labels.replaced(before.marker != given.marker, before)
            unedited = unedited.kept(unedited.marker < len(self.worn))
        labels = labels.kept(labels.marker < len(self.worn))
        return labels, measured_of_first(motion, each[: len(self.worn.subjects)]), unedited

    def _meeting(self, blobs: Blobs, before: Labels, labels: Labels, motion: Motion) -> np.ndarray:
        """(N,) True for the labels whose rays are their markers'; a blob of two markers, named anew, is beside both."""
        new = labels.marker != before.marker
        changed = touched_samples(blobs, before, labels, motion.residual.shape)
        rows = np.flatnonzero(labels.named)
        rows = rows[changed[blobs.frame[rows], labels.marker[rows]]]
        off = np.nan_to_num(self._off_alone(blobs, rows, labels, motion) / self._noise)
        found = labels.named.copy()
        found[rows] = ~new[rows] | (off**2 / 2 <= CHECKING_BACK.most)
        return found

    @property
    def _noise(self) -> float:
        """px, standard deviation of a blob's position in the take."""
        return self.points.reconstructor.circumstances.pixel

    def _borne_out(
        self, blobs: Blobs, labels: Labels, motion: Motion, hidden: np.ndarray, subject: np.ndarray
    ) -> np.ndarray:
        """(N,) True for the blobs that go with their markers, seen or hidden (F, C, M), and with nobody else's."""
        rows = np.flatnonzero(labels.named)
        frame, camera, marker = blobs.frame[rows], blobs.camera[rows], labels.marker[rows]
        noise, images = self._noise, self.cameras.project(motion.markers)
        away = np.linalg.norm(images[camera, frame] - blobs.xy[rows, None], axis=2) / noise
        at = np.arange(len(rows)), marker
        extra = CHECKING_BACK.hidden * hidden[frame, camera]
        cost = away**2 / 2 + extra
        others = np.where(subject == subject[marker][:, None], np.inf, np.nan_to_num(cost, nan=np.inf))
        alone = np.nan_to_num(self._off_alone(blobs, rows, labels, motion) / noise) ** 2 / 2 + extra[at]
        found = np.zeros(len(blobs), bool)
        nearest = others.min(axis=1, initial=np.inf)
        found[rows] = (alone <= CHECKING_BACK.most) & (cost[at] + CHECKING_BACK.lead < nearest)
        return found

    def _off_alone(self, blobs: Blobs, rows: np.ndarray, labels: Labels, motion: Motion) -> np.ndarray:
        """(N,) px, how far blobs are from where the others of their markers meet; NaN where these are too few."""
        frame, camera = blobs.frame[rows], blobs.camera[rows]
        image = self.cameras.undistort(blobs.xy[rows], camera)
        sample = frame * motion.markers.shape[1] + labels.marker[rows]
        number, place = np.unique(sample, return_inverse=True)
        if not len(number):
            return np.zeros(0)
        points = meet_rows(self.cameras, camera, image, place, len(number), others=True)
        off = np.full(len(rows), np.nan)
        for index in range(len(self.cameras)):
            own = camera == index
            images = self.cameras.select([index]).project(points[own])[0]
            off[own] = np.linalg.norm(images - blobs.xy[rows[own]], axis=1)
        return off


def _subject(each: Sequence[Motion]) -> np.ndarray:
    """(M,) whose each marker is."""
    return np.repeat(np.arange(len(each)), [one.markers.shape[1] for one in each])


def label_several_blobs(
    read: Callable[[], Iterable[tuple[Blobs, float]]],
    cameras: Cameras,
    asked: SeveralOptions,
    options: PointOptions,
    rate: float,
    body_of: Callable[[MarkerSet], Occlusion] | None = None,
    edits: Edits = NO_EDITS,
) -> Generator[Progress, None, SubjectsInImages]:
    """Names the points of a take of blobs, which `read` gives chunk by chunk, each with the share that is read by then.

    Of `edits` the naming hears which points a person named; they are yet to be applied to the chunks. `body_of` makes
    the volume of a subject that is in the way; None for the marker set's capsules. `options.room` keeps what is not
    held. Raises JobError where there are fewer than two cameras, a frame has more blobs than any capture, or as
    `label_several` does, which raises InputError where edits are of somebody who is not there.
    """
    if len(cameras) < 2:
        raise JobError(f"{len(cameras)} camera cannot fix a point in space; expected two or more")
    seconds, points = 0.0, PointsOfBlobs(cameras, rate, options.room)
    named = NamedThroughBlobs(edits, cameras.names, asked.possible)
    for blobs, share in read():
        begin = perf_counter()
        points.add(blobs)
        if edits:
            rows = points.parts[-1].rows[:]
            named.add(blobs, rows["blobs"], rows["trajectory"])
        seconds += perf_counter() - begin
        yield Progress(CHECKING_BACK.share * share, f"reconstruct frame {blobs.frames[-1]}")
    asked = replace(asked, others=True)  # they have blobs, and are in the way
    take = points.take()
    options = replace(options, edits=named.edits_of(points.place))
    labelled = yield from within(label_several(take, asked, options, edits), CHECKING_BACK.share, 1.0)
    del take
    worn = [one.model.markerset for one in labelled.worn.subjects]
    bodies = tuple(body_of(one) if body_of else CapsuleOcclusion(one, OCCLUDING.fitted_shrink) for one in worn)
    return SubjectsInImages(cameras, points, labelled, labelled.worn.asked, bodies, seconds)


def _of_blobs(suspect: Suspect) -> Suspect:
    """The suspect without the numbers of trajectories, which are in no file here."""
    words = suspect.words
    if suspect.trajectory is not None:
        words = f"a trajectory of points {words}"
    elif words.startswith("trajectories "):
        as_one = words.partition(": as trajectory ")[2].partition(" ")[2]
        words = f"several trajectories of points, one of which {as_one}"
    return replace(suspect, words=words, trajectory=None)
