# SPDX-License-Identifier: GPL-3.0-or-later
"""A body among several: the take as it is for it, what single frames say of it, and its solution."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...data.lanes import PACKING, blocks
from ...data.made import Made
from ...data.progress import Stage
from ...data.takes import NO_MARKER, Labels, Points
from ..models import Model, Namer
from ..refusals import REFUSAL, Sample, SubjectsError, UnsuitedError, refuse_others
from ..whole_take.objective import usual_fit
from ..whole_take.pipeline import NamedFrames, PointOptions, Refuse, Steps, name_frames, solution_for
from ..whole_take.solution import Solution
from ..whole_take.tracklets import FrameLabels
from .affinity import Affinity
from .parting import firm_tracklets, is_whole


@dataclass(eq=False)
class NamedBody:
    """A body on its way: its model, what its frames say, and the solution; None where it cannot be solved.

    `sure` says whether single frames were sure of it.
    """

    model: Model
    frames: NamedFrames
    solution: Solution | None
    sure: bool = True

    @property
    def is_whole(self) -> bool:
        """Whether what is named on it is a whole one, and no half."""
        if self.solution is None:
            return True
        named = np.append(self.solution.marker != NO_MARKER, False)[self.solution.tracklets.table]
        return is_whole(named, len(self.model.markerset))

    @property
    def fits(self) -> bool:
        """Whether its markers sit as the set has them, however it lies, where frames alone were not sure of any."""
        likelihood = self.model.likelihood
        if self.sure or self.solution is None or likelihood is None:
            return self.sure
        placed = self.solution.tracklets.placed(self.frames.take.xyz, self.solution.marker, len(self.model.markerset))
        return 0 < usual_fit(likelihood, placed, upright=False).residual <= REFUSAL.max_residual


@dataclass(frozen=True, eq=False)
class OnlyWhere:
    """What frames say of the points of some tracklets (T, L), -1 for all others; `FrameLabels` of them."""

    labels: FrameLabels
    tracklet: np.ndarray

    def __getitem__(self, part: slice) -> Labels:
        return self.labels[part].kept(self.tracklet[part] >= 0)

    def whole(self) -> Labels:
        """All of it at once."""
        return self.labels.whole().kept(self.tracklet >= 0)


class BodyNaming:
    """A body's way to its names by one model; it can stop where the model has been recognised.

    may (N,) are the tracklets that may be its.
    """

    def __init__(self, crowd: "Crowd", may: np.ndarray, model: Model, refuse: Refuse):
        self.model, self._sure = model, refuse is not take_will_say
        self._tracklet = crowd.tracklets_of(may)
        self._occupied = crowd.occupied
        self._work = name_frames(crowd.points_of(may), self._tracklet, model, crowd.options, refuse)
        self._begun: list[Stage] = []

    def begin(self):
        """Goes on until single frames have said whether the body is of the model; UnsuitedError where it is not."""
        while not self._begun:
            step = next(self._work)
            self._begun += [step] if isinstance(step, Stage) and step.name == "name" else []

    def named(self) -> Steps[NamedBody]:
        """The rest of it."""
        yield from self._begun
        frames = replace((yield from self._work), occupied=self._occupied)
        yield Stage("vote", "solve the take of each")
        solution = yield from solution_for(frames, frames.labels, self._tracklet)
        return NamedBody(self.model, frames, solution, self._sure)


def frames_are_sure(model: Model, namer: Namer, points: Made, solvable: bool) -> Sample | None:  # noqa: ARG001
    """Frames on their own must be sure of a body that was parted from others."""
    return refuse_others(model, namer, points)


def take_will_say(model: Model, namer: Namer, points: Made, solvable: bool) -> None:
    """Of a body that single frames are not sure of; UnsuitedError where the take cannot be solved as a whole either."""
    if not solvable:
        frames_are_sure(model, namer, points, solvable)


def recognised_before(model: Model, namer: Namer, points: Made, solvable: bool) -> None:
    """Of a body whose markers were recognised by another model of them."""


class Crowd:
    """The N tracklets (T, L) of a take of several, their affinity to each other, and which of them have any.

    `every` is N where some of them are left out.
    """

    def __init__(self, take: Points, tracklet: np.ndarray, options: PointOptions, every: int | None = None):
        self.take, self.tracklet, self.options = take, tracklet, options
        self.every = int(tracklet.max(initial=-1)) + 1 if every is None else every

    def __len__(self) -> int:
        return self.every

    @cached_property
    def occupied(self) -> int:
        """How many frames there are from the first that shows anything to the last."""
        there = np.flatnonzero((self.tracklet >= 0).any(axis=1))
        return int(np.ptp(there)) + 1 if len(there) else len(self.tracklet)

    @cached_property
    def affinity(self) -> Affinity:
        """Their affinity to each other."""
        return Affinity.of(self.take.xyz, self.tracklet, self.take.rate, len(self))

    @cached_property
    def firm(self) -> np.ndarray:
        """(N,) True for those whose affinity to others is that of markers on a body."""
        return firm_tracklets(self.affinity)

    @cached_property
    def size(self) -> np.ndarray:
        """(N,) how many points each has."""
        return self.count(self.tracklet >= 0)

    def count(self, there: np.ndarray) -> np.ndarray:
        """(N,) how many of some points (T, L) are each tracklet's."""
        found = np.zeros(len(self), int)
        for part in blocks(*there.shape):
            own = self.tracklet[part][there[part]]
            found += np.bincount(own[own >= 0], minlength=len(self))
        return found

    def without(self, some: np.ndarray) -> "Crowd":
        """The same without some of the tracklets (N,)."""
        return Crowd(self.take, self.tracklets_of(~some), self.options, len(self))

    def tracklets_of(self, may: np.ndarray) -> np.ndarray:
        """(T, L) the tracklets that may be a body's (N,), -1 for all others."""
        return np.where(np.append(may, False)[self.tracklet], self.tracklet, self.tracklet.dtype.type(-1))

    def points_of(self, may: np.ndarray) -> Points:
        """The take without the points of tracklets that are not a body's (N,); a long one's as they are looked at."""
        points, kept = self.take.xyz, np.append(may, False)
        own = np.broadcast_to(self.tracklet[..., None], points.shape)
        xyz = Made(points.shape, lambda index: np.where(kept[own[index]], points[index], np.nan))
        return replace(self.take, xyz=xyz if self.tracklet.size > PACKING.whole_cells else xyz[...])

    def recognised(
        self, may: np.ndarray, body: np.ndarray, models: tuple[Model, ...], refuse: Refuse
    ) -> list["BodyNaming"]:
        """The naming of a body by each of the models that it may wear, by one of those with the same markers.

        may (N,) are the tracklets that may be its, and body (N,) those that are. Each is begun with as far as single
        frames say whether it is of the model. Raises SubjectsError where two are on it.
        """
        found: dict[tuple[str, ...], BodyNaming] = {}
        there = np.append(body & self.firm, False)[self.tracklet]
        for model in models:
            if model.markerset.markers in found or not is_whole(there, len(model.markerset)):
                continue
            naming = BodyNaming(self, may, model, refuse)
            try:
                naming.begin()
            except SubjectsError:
                raise
            except UnsuitedError:
                continue
            found[model.markerset.markers] = naming
        return list(found.values())

    def solve_again(self, one: NamedBody, may: np.ndarray) -> Generator[float, None, None]:
        """The same body with other tracklets (N,), in place: frames have said what they have to say."""
        tracklet = self.tracklets_of(may)
        labels = OnlyWhere(one.frames.labels, tracklet)
        one.frames = replace(one.frames, take=self.points_of(may), tracklet=tracklet, labels=labels)
        one.solution = yield from solution_for(one.frames, labels, tracklet)

    def named_points(self, one: NamedBody) -> np.ndarray:
        """(N,) how many points of each tracklet a body's solution names, or has where there is none."""
        solution, own = one.solution, one.frames.tracklet
        if solution is not None:
            named = np.append(solution.marker != NO_MARKER, False)
            own = np.where(named[solution.tracklets.table], self.tracklet, -1)
        return np.bincount(own[own >= 0], minlength=len(self))
