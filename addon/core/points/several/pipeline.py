# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of several subjects from end to end: bodies are parted, each is named as one subject's take, and who is who.

What may be on two bodies is offered to both, and whoever is surer of it keeps it. Everybody is solved by the code that
solves a take of one, from the tracklets that may be theirs. Bodies that nobody asked for stay unnamed.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from ...data.errors import JobError
from ...data.made import Made
from ...data.physical import MARKER_LIMITS
from ...data.progress import Progress, Stage, within
from ...data.takes import Points, Suspect
from ...edits.applying import refuse_unknown
from ...edits.kinds import NO_EDITS, Edits
from ...review.answering import unanswered, without_accepted
from ...review.suspects import MOMENT_S, summarised, suspect_ranges
from ..models import Model
from ..possible import refuse_impossible
from ..refusals import UnsuitedError, refuse_floods
from ..tracklets import cut
from ..whole_take.pipeline import PointOptions, Refuse, Steps, as_in_file, name_frames
from .bodies import BodyNaming, Crowd, NamedBody, frames_are_sure, recognised_before, take_will_say
from .identification import (
    IDENTIFICATION,
    PersonBuild,
    UnidentifiedPresence,
    costs_of,
    identified,
    share,
    spans_of,
    told,
    ways_of,
)
from .parting import NO_BODY, PartedBodies, along_the_line, count_bodies, parted
from .together import Everybody, FoundSubject, LabelledSubjects, motion_of_all, verdict_on, with_edits
from .wearers import AUTO, SeveralOptions, Wearer, is_same, kinds

# How far along the work is when each stage of a body's begins, of all of the body's: as measured.
SHARES = {
    "adapt": 0.0,
    "others": 0.01,
    "name": 0.1,
    "learn": 0.6,
    "name again": 0.6,
    "vote": 0.6,
}


class UnidentifiedError(JobError):
    """As many are there as were asked for, but who is who cannot be told."""


def label_several(
    take: Points, asked: SeveralOptions, options: PointOptions, written: Edits = NO_EDITS
) -> Generator[Progress, None, LabelledSubjects]:
    """Names the points of a take that several subjects are in; labels count the markers of all subjects in a row.

    `written` is what a person said, where the edits of `options` only follow from it: an error has their numbers.
    Raises JobError where fewer subjects are found than were asked for, or who is who cannot be told; InputError where
    edits are of somebody who is not there.
    """
    begin = perf_counter()
    refuse_floods(take.xyz)
    if not options.force:
        refuse_impossible(take.xyz, take.rate, take.lanes, asked.models)
    if options.method != "likelihood":
        raise JobError(f"several subjects cannot be named by the method {options.method}; expected likelihood")
    with threadpool_limits(1, user_api="blas"):
        yield Progress(0.0, "look how many there are")
        crowd = Crowd(take, cut(take.xyz, take.rate, lanes=take.lanes), options)
        found = yield from everybody(crowd, asked)
        verdict, unedited, applied = found.verdict, None, None
        refuse_unknown(written or options.edits, found.worn.asked.by_name)
        if options.edits:
            work = with_edits(crowd, found, options.edits)
            words = "solve the take again with the edits"
            unedited, applied, verdict = yield from within(work, 0.9, 0.92, words, _spans(0.9, 0.92))
        labels, worn = verdict.labels, found.worn
        unidentified = [one for one in found.unidentified if one.is_open(crowd.tracklet, labels)]
        suspects = verdict.suspects + _questions(crowd, found, unidentified)
        nobodys = [one.tracklets for one in unidentified]
        left = crowd.tracklets_of(np.any([*nobodys, np.zeros(len(crowd), bool)], axis=0)) >= 0
        del crowd, found, unidentified  # a long take's are large
        seconds = {"label": perf_counter() - begin}
        yield Progress(0.92, "pose the bodies")
        bodies, places = worn.finer if options.finer else worn, applied.places if applied else {}
        motion = motion_of_all(take, labels, bodies, options, places)
        seconds["fit"] = perf_counter() - begin - seconds["label"]
        own = set(worn.asked.markers)
        doubts = tuple(one for one in motion.suspects(worn.markers, take.rate) if own.issuperset(one.markers))
        suspects = unanswered(as_in_file(suspects + doubts, take), options.edits, worn.by_name)
        suspects = without_accepted(summarised(suspects, take.rate), options.edits)
        outcomes = applied.outcomes if applied else ()
        return LabelledSubjects(labels, motion, suspects, seconds, unedited, outcomes, doubts, worn, left)


def _questions(crowd: Crowd, found: Everybody, unidentified: Sequence[UnidentifiedPresence]) -> tuple[Suspect, ...]:
    """Who it may be who is there without names."""
    if not unidentified:
        return ()
    people = [one.name for one in found.worn.asked.subjects if not is_prop(one.model)]
    if len(found.worn.asked.subjects) < len(found.worn.subjects):
        people.append("somebody else")
    words = f"somebody here is left without names, who may be {' or '.join(people)}"
    most = round(MOMENT_S * crowd.take.rate)
    there = np.any([one.there for one in unidentified], axis=0)
    return tuple(suspect_ranges(crowd.take.frames, there, words, most))


def everybody(crowd: Crowd, asked: SeveralOptions) -> Generator[Progress, None, Everybody]:
    """Everybody who is asked for, in their order: props first, people in what these leave."""
    found: list[FoundSubject] = []
    unidentified: tuple[UnidentifiedPresence, ...] = ()
    for prop in (one for one in asked.subjects if is_prop(one.model)):
        found.append((yield from within(_found_prop(crowd, prop), 0.0, 0.0, spans=_spans(0.0, 0.05))))
        crowd = crowd.without(found[-1].may)
    people = tuple(one for one in asked.subjects if not is_prop(one.model))
    if people or not asked.subjects:
        persons, unidentified = yield from _Parties(crowd, replace(asked, subjects=people)).named()
        found += persons
    place = {subject: at for at, subject in enumerate(asked.subjects)}
    found.sort(key=lambda one: place.get(one.subject, len(place)))
    return Everybody.of(found, unidentified)


def is_prop(model: Model) -> bool:
    """Whether all markers of a set are on one rigid body."""
    bodies = model.rigid_bodies
    return bodies is not None and len(bodies.members) == 1 and len(bodies.members[0]) == len(model.markerset)


def _found_prop(crowd: Crowd, prop: Wearer) -> Steps[FoundSubject]:
    """A prop named among everything else, by its form, with its tracklets; JobError where it is not there."""
    # A body's parts are rigid, too: what a take shows of them must not be learned as the prop's form.
    model = replace(prop.model, training_takes=())
    try:
        frames = yield from name_frames(crowd.take, crowd.tracklet, model, crowd.options)
        yield Stage("vote", f"look where {prop.name} is")
        body = NamedBody(prop.model, frames, None)
        verdict = verdict_on(body, crowd.options.target)
    except UnsuitedError:
        words = f"shows no {prop.name}, or not often enough to know it by the form of {prop.model.markerset.name}"
        raise JobError(f"{words}; expected a take with that prop, so leave it out") from None
    own = 2 * crowd.count(verdict.labels.named) > np.maximum(crowd.size, 1)
    labels = verdict.labels.kept(crowd.tracklets_of(own) >= 0)
    return FoundSubject(prop, body, own, replace(verdict, labels=labels))


@dataclass(frozen=True, eq=False)
class _Parties:
    """Who may be in a crowd, on the way to those who were asked for."""

    crowd: Crowd
    asked: SeveralOptions

    def named(self) -> Generator[Progress, None, tuple[list[FoundSubject], tuple[UnidentifiedPresence, ...]]]:
        """Everybody who is asked for, with their names, and presences of which it cannot be told whose they are."""
        crowd, wanted = self.crowd, len(self.asked.subjects) or self.asked.count
        counts = self._counts(wanted)
        ways = [(count, frames_are_sure) for count in counts]
        # Who is mixed up with others for long is known by the whole take, where single frames are not sure of anybody.
        for count, refuse in (*ways, (counts[0], take_will_say)):
            presences = parted(crowd.take.xyz, crowd.tracklet, crowd.affinity, count, self._smallest)
            try:
                bodies, unidentified = yield from self._people_of(presences, count, refuse)
                named = yield from self._each(bodies, wanted, count, refuse)
            except UnsuitedError:
                continue  # two are on one body, or the set does not suit it
            found = None if named is None else (yield from self._identified(bodies, named, wanted))
            if found is not None:
                return found, unidentified
        raise self._too_few(wanted)

    @property
    def _smallest(self) -> int:
        """Markers of the smallest set that anybody may wear."""
        return min(len(one.markerset) for one in self.asked.models)

    def _people_of(
        self, presences: PartedBodies, count: int, refuse: Refuse
    ) -> Generator[Progress, None, tuple[PartedBodies, tuple[UnidentifiedPresence, ...]]]:
        """The bodies of so many people, whose presences are in the take: who comes back is who left.

        Stays of which it cannot be told whose they are are nobody's, and given, too.
        """
        every = presences.may.shape[1]
        if every == count:
            return presences, ()
        there = spans_of(self.crowd.tracklet, presences.body, every)
        ways = ways_of(there, count)
        if len(ways) == 1:
            return presences.joined(np.array([*range(count), *ways[0]]), count), ()
        later, way = range(count, every), (NO_BODY,) * (every - count)
        if ways:
            builds = yield from self._builds(presences, refuse)
            cost = [[_unlike(builds[one], other) for other in builds[:count]] for one in later]
            way = told(ways, np.array(cost), self._smallest / 2)
        open_ones = [one for one, given in zip(later, way, strict=True) if given == NO_BODY]
        unidentified = tuple(UnidentifiedPresence(there[:, one], presences.body == one) for one in open_ones)
        return presences.joined(np.array([*range(count), *way]), count), unidentified

    def _builds(self, presences: PartedBodies, refuse: Refuse) -> Generator[Progress, None, list[list[PersonBuild]]]:
        """How whoever is there in each presence is built, by every set that it may be; none where it is nobody."""
        found: list[list[PersonBuild]] = []
        for presence in range(presences.may.shape[1]):
            found.append([])
            given = presences.may[:, presence], presences.body == presence, self.asked.models, refuse
            for naming in self.crowd.recognised(*given):
                named = yield from within(naming.named(), 0.05, 0.05, spans=_spans(0.05, 0.05))
                found[-1].append(PersonBuild.of(named))
        return found

    def _counts(self, wanted: int) -> list[int]:
        """How many bodies to look for, the likeliest first."""
        apart, most = count_bodies(self.crowd.take.xyz, self.crowd.tracklet, self.crowd.affinity, self._smallest)
        if wanted == AUTO:
            return list(range(max(most, apart), 0, -1))
        first = max(wanted, apart)
        return list(dict.fromkeys([first, *range(wanted, max(first, most, wanted + 1) + 1)]))

    def _each(
        self, bodies: PartedBodies, wanted: int, count: int, refuse: Refuse
    ) -> Generator[Progress, None, dict[int, list[NamedBody]] | None]:
        """What there is on each body by its number, for every model that it may wear; None where they are too few.

        Where nobody said how many, all bodies must be of the model.
        """
        chosen: list[list[BodyNaming]] = [[] for _ in range(count)]
        sizes = np.bincount(bodies.body + 1, minlength=count + 1)[1 : count + 1]
        order = np.argsort(sizes, kind="stable").tolist()  # where one is too many, the smallest is it
        for body in order:
            given = bodies.may[:, body], bodies.body == body, self.asked.models, refuse
            chosen[body] = self.crowd.recognised(*given)
            if wanted == AUTO and not chosen[body]:
                return None
        if sum(map(bool, chosen)) < max(wanted, 1):
            return None
        named: dict[int, list[NamedBody]] = {}
        for place, body in enumerate(order):
            first, found = 0.05 + 0.8 * place / count, []
            for naming in chosen[body]:
                spans = _spans(first, first + 0.8 / count)
                found.append((yield from within(naming.named(), first, first, spans=spans)))
            whole = [one for one in found if one.is_whole]
            # What has another's tracklets does not fit yet. Of several sets it must, as nothing else says which it is.
            if fitting := whole if len(whole) == 1 else [one for one in whole if one.fits]:
                named[body] = fitting
            elif wanted == AUTO:
                return None
        return None if len(named) < wanted else dict(sorted(named.items()))

    def _identified(
        self, bodies: PartedBodies, named: dict[int, list[NamedBody]], wanted: int
    ) -> Generator[Progress, None, list[FoundSubject] | None]:
        """Who is who, each solved as whoever it is, and no tracklet on two of them; None where one does not fit."""
        subjects, chosen = self._who(named, wanted)
        people = []
        for subject, (body, own) in zip(subjects, chosen, strict=True):
            if not is_same(own.model, subject.model):
                again = BodyNaming(self.crowd, bodies.may[:, body], subject.model, recognised_before)
                own = yield from within(again.named(), 0.85, 0.85, spans=_spans(0.85, 0.88))
            people.append(own)
        # Whoever nobody asked for has no name in the end, but certainty what is theirs.
        asked = [body for body, _ in chosen]
        others = [body for body in named if body not in asked]
        people += [named[body][0] for body in others]
        work = share(self.crowd, people, bodies.may[:, asked + others])
        may = yield from within(work, 0.88, 0.9, "share out what lies between them")
        if not all(one.fits for one in people):
            return None
        strangers = [Wearer(f"?{index}", named[body][0].model, asked=False) for index, body in enumerate(others)]
        each = [*subjects, *(strangers if self.asked.others else ())]
        found = []
        for subject, own, theirs in zip(each, people, may.T, strict=False):
            try:
                found.append(FoundSubject(subject, own, theirs, verdict_on(own, self.crowd.options.target)))
            except UnsuitedError:
                if subject.asked:
                    return None
        return found

    def _who(
        self, named: dict[int, list[NamedBody]], wanted: int
    ) -> tuple[tuple[Wearer, ...], list[tuple[int, NamedBody]]]:
        """The subjects in their order, and the body of each with what was named on it."""
        lasting = {body: self.crowd.named_points(own[0]) for body, own in named.items()}
        order = self._first_to_last(named, lasting)
        models = [one.model for one in kinds(self.asked.subjects)]
        kind = [models.index(model) for model in models]
        if len(kind) != 1 and not any(kind):  # whom nothing tells apart
            kept = sorted(order, key=lambda body: -lasting[body].sum())[: wanted or len(order)]
            chosen = [(body, named[body][0]) for body in order if body in kept]
            return self.asked.subjects or self.asked.numbered(len(kept)), chosen
        place, lead = identified(np.array([costs_of(named[body], tuple(models)) for body in order]), kind)
        if lead == -np.inf:  # no way to be all of them
            raise self._too_few(wanted)
        if lead < IDENTIFICATION.lead:
            names = " and ".join(one.name for one in self.asked.subjects)
            raise UnidentifiedError(
                f"who is {names} cannot be told by the sizes of their models; expected models of people who differ, "
                f"or --subjects {max(wanted, len(order))} with one model"
            )
        chosen = []
        for index, model in enumerate(models):
            body, markers = order[place[index]], model.markerset.markers
            chosen.append((body, next(own for own in named[body] if own.model.markerset.markers == markers)))
        return self.asked.subjects, chosen

    def _first_to_last(self, named: dict[int, list[NamedBody]], lasting: dict[int, np.ndarray]) -> list[int]:
        """The bodies in the order in which they are counted, by how many points of tracklets (N,) are each one's."""
        order = sorted(lasting, key=lambda body: int(np.flatnonzero(lasting[body])[0]))  # who is first in the file
        if not self.asked.in_room:
            return order
        whose, tracklet = np.full(len(self.crowd) + 1, NO_BODY), self.crowd.tracklet
        for place, body in enumerate(order):
            whose[:-1][lasting[body] > 0] = place
        markers = [len(named[body][0].model.markerset) for body in order]
        along = along_the_line(self.crowd.take.xyz, Made(tracklet.shape, lambda index: whose[tracklet[index]]), markers)
        return order if along is None else [order[place] for place in along]

    def _too_few(self, wanted: int) -> JobError:
        """What is said where not as many are there as were asked for."""
        names = ", ".join(dict.fromkeys(one.markerset.name for one in self.asked.models))
        if wanted in (AUTO, 1):
            return JobError(f"shows nobody who wears {names}; expected a take of that marker set: choose its model")
        return JobError(f"shows fewer than {wanted} subjects who wear {names}; expected as many, so ask for fewer")


def _unlike(some: list[PersonBuild], others: list[PersonBuild]) -> float:
    """How badly those who are there in two presences go together, in the sets that go best."""
    varies = np.sqrt(2) * MARKER_LIMITS.noise_m  # in one take a distance is the same but for the noise of either mean
    return min((one.cost(other, varies) for one in some for other in others), default=np.inf)


def _spans(first: float, last: float) -> dict[str, tuple[float, float]]:
    edges = [first + (last - first) * share for share in (*SHARES.values(), 1.0)]
    return dict(zip(SHARES, pairwise(edges), strict=True))
