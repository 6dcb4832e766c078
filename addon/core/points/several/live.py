# SPDX-License-Identifier: GPL-3.0-or-later
"""The last moment of a stream that several are in, named as takes of several are; who is who stays as it was said."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ...data.errors import JobError
from ...data.physical import MARKER_LIMITS
from ...data.progress import finished
from ...data.takes import NO_MARKER
from ..models import Model
from ..refusals import REFUSAL
from ..tracklets import cut
from ..whole_take.live import LiveNamer, Window, WindowNames, as_take, at_the_end
from ..whole_take.pairs import trained_pairs
from ..whole_take.pipeline import PointOptions
from ..whole_take.search import Moves
from .bodies import Crowd
from .identification import PersonBuild
from .pipeline import UnidentifiedError, everybody
from .together import Everybody
from .wearers import SetsWorn, SeveralOptions, Wearer, is_same, kinds


def namer_of(models: list[Model], rate: float) -> LiveNamer:
    """What names the frames of those who wear some models, by the markers of all in a row."""
    return LiveNamer([trained_pairs(model) for model in models], rate)


def solved_of_several(subjects: tuple[Wearer, ...], window: Window) -> WindowNames:
    """The names at the end of a window of those who are there, by the markers of all `subjects` in a row.

    With all moves where exchanges alone, of people who are known, find nobody: it may be somebody else.
    """
    whole = SetsWorn(subjects)
    known = _are_known(whole, window)
    found = _solved(whole, window, "exchanges" if known else "all")
    return _solved(whole, window, "all") if known and found.refused else found


def _solved(whole: SetsWorn, window: Window, moves: Moves) -> WindowNames:
    trouble, take, options = "", as_take(window), PointOptions("likelihood", search=moves)
    crowd = Crowd(take, cut(take.xyz, take.rate), options)
    nobody = WindowNames(window.number, np.full(len(window.number), NO_MARKER))
    for either in _who_may_be_there(whole, window):
        every: list[Everybody] = []
        for some in either:
            try:
                every.append(finished(everybody(crowd, some)))
            except UnidentifiedError as error:
                return replace(nobody, refused=error.message)
            except JobError as error:
                trouble = trouble or error.message
        if every:
            found = max(every, key=lambda one: one.verdict.labels.named.sum())
            marker = at_the_end(window, found.verdict.labels.marker)
            return WindowNames(window.number, _as_before(whole, found, window, marker))
    return replace(nobody, refused=trouble)


def _are_known(whole: SetsWorn, window: Window) -> bool:
    """Whether the stream has shown half of everybody's markers."""
    seen = np.isfinite(window.shown[..., 0]).any(axis=0)
    return all(seen[own].mean() >= REFUSAL.min_half for own in markers_of(whole))


def _who_may_be_there(whole: SetsWorn, window: Window) -> Iterator[list[SeveralOptions]]:
    """All of them, then fewer and fewer, and at last each alone; where several are given, who has most names is there.

    Of as many it is one group, as there are too many: that of whom most is named already and, of equals, another one
    each time. Where nothing is named yet, whoever is there alone is told sooner than some who wear different sets.
    """
    now = window.marker[np.isfinite(window.xyz[-1, :, 0])]  # who left may have left in many pieces
    count = np.array([np.isin(now, own).sum() for own in markers_of(whole)])
    worn = [one.model for one in kinds(whole.subjects)]
    chance = np.random.default_rng(window.row)
    for many in range(len(worn), 1, -1):
        groups = chance.permutation(list(combinations(range(len(worn)), many))).tolist()
        if many < len(worn) and not count.any():
            groups = [group for group in groups if len({worn[one] for one in group}) == 1]
        if groups:
            yield [_asked(whole, max(groups, key=lambda group: count[group].sum()))]
    kind = {model: sum(named for one, named in zip(worn, count, strict=True) if one is model) for model in worn}
    alone = [_asked(whole, [worn.index(model)]) for model in sorted(kind, key=lambda model: -kind[model])]
    yield from [[one] for one in alone] if count.any() else [alone]


def _asked(whole: SetsWorn, group: Sequence[int]) -> SeveralOptions:
    """Some of all subjects, by how many they are where nothing tells them from each other."""
    some = tuple(whole.subjects[one] for one in group)
    if all(is_same(one.model, some[0].model) for one in some):
        return SeveralOptions(some[0].model, len(some))
    return SeveralOptions(subjects=some)


def markers_of(whole: SetsWorn) -> list[np.ndarray]:
    """Which of the markers in a row are each subject's."""
    return [
        first + np.arange(len(one.model.markerset)) for one, first in zip(whole.subjects, whole.firsts, strict=True)
    ]


def _as_before(whole: SetsWorn, found: Everybody, window: Window, marker: np.ndarray) -> np.ndarray:
    """The markers (L,) of those who were found, as those of `whole` who they are.

    That is who has most of the names so far or, where there are none, whose distances theirs are. Where not all are
    there, it may be anybody with these markers, whatever the model that names them.
    """
    from scipy.optimize import linear_sum_assignment

    every, owns, said = markers_of(whole), markers_of(found.worn), np.full(len(marker), NO_MARKER)
    score = np.full((len(found.found), len(every)), -1e9)
    for row, (one, own) in enumerate(zip(found.found, owns, strict=True)):
        theirs, build, model = np.isin(marker, own), PersonBuild.of(one.body), one.subject.model
        may_be = [other for other in whole.subjects if other.model.markerset.markers == model.markerset.markers]
        if len(found.found) == len(every):
            may_be = [other for other in may_be if is_same(other.model, model)]
        by_models = len(set(kinds(tuple(may_be)))) > 1
        for column, (other, names) in enumerate(zip(whole.subjects, every, strict=True)):
            if other in may_be:
                cost = min(_unlike(build, other.model, window.shown[:, names], by_models), len(names))
                score[row, column] = len(names) * np.isin(window.marker[theirs], names).sum() - cost
    for row, column in zip(*linear_sum_assignment(score, maximize=True), strict=True):
        theirs = np.isin(marker, owns[row])
        said[theirs] = marker[theirs] - owns[row][0] + every[column][0]
    return said


def _unlike(build: PersonBuild, model: Model, shown: np.ndarray, by_model: bool) -> float:
    """How badly who is there goes with who was shown (K, M, 3) m before or, where nothing was, with the model."""
    before = PersonBuild.shown(model, shown)
    if by_model and not np.isfinite(before.mean).any():
        return build.cost(PersonBuild.trained(model), MARKER_LIMITS.placed_m)
    return build.cost(before, np.sqrt(2) * MARKER_LIMITS.noise_m)
