# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs of several subjects named through the points that they make, and checked back in the images.

Who is who is a matter of the whole take, so all of it is reconstructed first and named as a take of points; its blobs
are looked at twice, and never held. In the images all bodies are in the way: one hides the other's markers. A body
fitted to each subject then names what too few cameras see for a point (`fitted_subjects`).
"""

from collections.abc import Generator, Iterable, Iterator
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from itertools import tee
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from ..data.progress import Progress, within
from ..data.takes import NO_MARKER, Blobs, LabelledChunk, Labels, Motion, Suspect, touched_samples
from ..edits.blobs_in_points import NamedThroughBlobs
from ..geometry.cameras import Cameras
from ..geometry.measuring import measured_again
from ..geometry.triangulation import meet_rows
from ..papers.virtual_occlusions.occlusion import Occlusion, hidden_by_any
from ..points.several.pipeline import label_several
from ..points.several.together import LabelledSubjects, beside, measured_of_first
from ..points.several.wearers import SetsWorn
from ..points.whole_take.pipeline import PointOptions
from ..review.suspects import EITHER_WAY
from .asked_in_space import Asked, asked_in_space
from .fitted_subjects import FollowedSubjects
from .followed_together import FOLLOWED_TOGETHER, FollowedTogether, SeveralBlobs, label_together
from .through_points import PointsOfBlobs, without_number


class CHECKING_BACK:
    """When a blob keeps the name of its point. Costs are in nats: half the square of a distance over the blobs' noise.

    The first two were chosen on the first four takes of each kind in tests/accuracy/actors.py.
    """

    # what it costs that a body is in the way: nobody's body is exactly the model's, so a blob that goes well with its
    # marker's other blobs keeps its name all the same
    hidden: float = 15.0  # measured
    most: float = 24.0  # measured: beyond which a blob is not its marker's, and
    # by which it must be cheaper than by any marker of somebody else that can be seen there: else both explain it about
    # as well, as where images melt into one blob
    lead: float = FOLLOWED_TOGETHER.lead
    share: float = 0.4  # measured: of the time of the work that is reconstruction


@dataclass(frozen=True, eq=False)
class SubjectsInImages:
    """A take of blobs whose points are named: what these say of its blobs, for whoever reads them again."""

    cameras: Cameras
    points: PointsOfBlobs
    labelled: LabelledSubjects  # that of everybody in the take, those who were asked for before the others
    worn: SetsWorn  # the sets of those who were asked for
    bodies: tuple[Occlusion, ...]  # what is in the way, a volume for everybody
    options: PointOptions  # how they were named
    seconds: float  # that reconstruction took

    def chunks(self, chunks: Iterable[Blobs]) -> Iterator[LabelledChunk]:
        """The same chunks as were reconstructed, with the names of their blobs, which were asked about in space."""
        chunks, own = tee(chunks)
        labelled = self._named(own)
        for subject, first in zip(self.worn.subjects, self.worn.firsts, strict=True):
            chunks, own = tee(chunks)
            given = self.worn, subject.model, first, self.points.rate, self.options.target, self.options.edits
            asked = Asked(*given, subject, self._by_points)
            labelled = asked_in_space(own, labelled, self.cameras, asked)
        return labelled

    def _by_points(self, blobs: Blobs) -> Labels:
        """What the points say of the blobs of a chunk, without what a person did."""
        first = int(blobs.frames[0]) - self.points.first_frame
        index = next(at for at, part in enumerate(self.points.parts) if part.first == first)
        return self.points.named(index, self.labelled.unedited or self.labelled.labels, len(blobs))

    def _named(self, chunks: Iterable[Blobs]) -> Iterator[LabelledChunk]:
        """The chunks with the names that points and bodies give."""
        left = [without_number(one) for one in self.labelled.suspects]
        spent = {"place": self.seconds, **self.labelled.seconds}
        fitted = FollowedSubjects.of(self.labelled.worn, self.cameras, self.points.rate, self.bodies)
        for index, blobs in enumerate(chunks):
            begin = perf_counter()
            with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
                labels, motion, unedited = self._checked(index, blobs, fitted)
            named = {self.worn.markers[one] for one in np.unique(labels.marker[labels.named])}
            mine = [one for one in left if one.first <= blobs.frames[-1] and _is_due(one, named)]
            left = [one for one in left if one not in mine]
            # What bodies name of it is asked about anew.
            mine = [one for one in mine if EITHER_WAY not in one.words or named.isdisjoint(one.markers)]
            spent["label"] = spent.get("label", 0.0) + perf_counter() - begin
            yield LabelledChunk(labels, motion, tuple(mine), spent, unedited)
            spent = {}

    def _checked(self, index: int, blobs: Blobs, fitted: FollowedSubjects) -> tuple[Labels, Motion, Labels | None]:
        """The labels of a chunk's blobs that its images and bodies bear out, and the markers where these meet.

        Also the labels without what edits say of points; None where they say nothing.
        """
        part, chunk = self.points.parts[index], self.labelled
        each = chunk.motion.each(slice(part.first, part.first + part.frames))
        motion = beside(each)
        given = self.points.named(index, chunk.labels, len(blobs))
        hidden = hidden_by_any(self.bodies, each, motion.markers, self.cameras.centres)
        subject = np.repeat(np.arange(len(each)), [one.markers.shape[1] for one in each])
        checked = given.kept(self._borne_out(blobs, given, motion, hidden, subject))

        labels, alone = self._read(index, blobs, checked, fitted)
        there = np.isfinite(motion.markers).all(axis=2)
        meeting = labels.kept(self._meeting(blobs, checked, labels, motion))
        motion = measured_again(motion, blobs, given, meeting, self.cameras, there)
        unedited = None
        if chunk.unedited is not None:
            before = self.points.named(index, chunk.unedited, len(blobs))
            changed, whose = before.marker != given.marker, np.append(subject, NO_MARKER)
            unedited = labels.replaced(changed, before)
            # Of its own markers a body says what it said before, whatever the points were told.
            own = alone.named & (~before.named | (whose[before.marker] == whose[alone.marker]))
            unedited = unedited.replaced(changed & own, alone)
            unedited = unedited.kept(unedited.marker < len(self.worn))
        labels = labels.kept(labels.marker < len(self.worn))
        return labels, measured_of_first(motion, each[: len(self.worn.subjects)]), unedited

    def _read(self, index: int, blobs: Blobs, checked: Labels, fitted: FollowedSubjects) -> tuple[Labels, Labels]:
        """What bodies say of a chunk, but for the blobs of whoever is there of whom it cannot be told who it is."""
        free = np.ones(len(blobs), bool)
        free[self.points.rows_of(index, self.labelled.left)] = False
        rows = np.flatnonzero(free | checked.named)
        own = blobs.part(slice(0, len(blobs.frames)), rows)
        whole = Labels.none(len(blobs)), Labels.none(len(blobs))
        for labels, read in zip(whole, fitted.read(own, checked[rows]), strict=True):
            labels.put(rows, read)
        return whole

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
        images = self.cameras.project(motion.markers)
        behind = hidden[frame, camera, marker]
        away = np.linalg.norm(images[camera, frame, marker] - blobs.xy[rows], axis=1)
        most = self._cost(away, behind) + CHECKING_BACK.lead
        # A marker that is farther off than that along the first axis alone cannot explain the blob as well.
        off = np.abs(images[camera, frame, :, 0] - blobs.xy[rows, 0, None])
        near = self._cost(off, False) <= most[:, None]
        row, other = np.nonzero(near & (subject != subject[marker][:, None]))
        away = np.linalg.norm(images[camera[row], frame[row], other] - blobs.xy[rows[row]], axis=1)
        clear = np.isfinite(most)
        clear[row[self._cost(away, hidden[frame[row], camera[row], other]) <= most[row]]] = False
        alone = self._cost(np.nan_to_num(self._off_alone(blobs, rows, labels, motion)), behind)
        found = np.zeros(len(blobs), bool)
        found[rows] = clear & (alone <= CHECKING_BACK.most)
        return found

    def _cost(self, away: np.ndarray, hidden: np.ndarray | bool) -> np.ndarray:
        """Nats, as `CHECKING_BACK` counts them, of blobs so far `away`, px, from markers, `hidden` or not."""
        return (away / self._noise) ** 2 / 2 + CHECKING_BACK.hidden * hidden

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


def _is_due(doubt: Suspect, named: AbstractSet[str]) -> bool:
    """Whether a doubt is to be told where some markers are `named`: which is which, as soon as its subject is there."""
    there = {one.partition(":")[0] for one in named}
    return EITHER_WAY not in doubt.words or not there.isdisjoint(one.partition(":")[0] for one in doubt.markers)


def label_several_blobs(take: SeveralBlobs) -> Generator[Progress, None, FollowedTogether | SubjectsInImages]:
    """Names a take of blobs by bodies that are followed together, or through its points.

    Points are needed for who is who where somebody comes or goes. Who is 1 is told by where they are, in either way.
    """
    followed = yield from label_together(take)
    if isinstance(followed, FollowedTogether):
        return followed
    return (yield from within(label_by_points(take), followed, 1.0))


def label_by_points(take: SeveralBlobs) -> Generator[Progress, None, SubjectsInImages]:
    """Names the points of a take of blobs; the naming hears which points a person's edits name.

    Raises JobError where there are fewer than two cameras, a frame has more blobs than any capture, or as
    `label_several` does, which raises InputError where edits are of somebody who is not there.
    """
    cameras, edits = take.cameras, take.options.edits
    seconds, points = 0.0, PointsOfBlobs(cameras, take.rate, take.options.room)
    named = NamedThroughBlobs(edits, cameras.names, take.asked.possible)
    for blobs, share in take.read():
        begin = perf_counter()
        points.add(blobs)
        if edits:
            rows = points.parts[-1].rows[:]
            named.add(blobs, rows["blobs"], rows["trajectory"])
        seconds += perf_counter() - begin
        yield Progress(CHECKING_BACK.share * share, f"reconstruct frame {blobs.frames[-1]}")
    asked = replace(take.asked, others=True, in_room=True)  # others have blobs, and are in the way
    made = points.take()
    options = replace(take.options, edits=named.edits_of(points.place), traced=True)
    labelled = yield from within(label_several(made, asked, options, edits), CHECKING_BACK.share, 1.0)
    del made
    bodies = tuple(take.body(one.model.markerset) for one in labelled.worn.subjects)
    return SubjectsInImages(cameras, points, labelled, labelled.worn.asked, bodies, take.options, seconds)
