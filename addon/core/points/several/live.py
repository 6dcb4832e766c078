# SPDX-License-Identifier: GPL-3.0-or-later
"""The last moment of a stream that several are in, named as takes of several are; who is who stays as it was said."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from ...data.errors import JobError
from ...data.physical import MARKER_LIMITS
from ...data.progress import finished
from ...data.takes import NO_MARKER
from ..models import Model
from ..tracklets import cut
from ..whole_take.live import Window, WindowNames, as_take, at_the_end
from ..whole_take.pairs import trained_pairs
from ..whole_take.pipeline import PointOptions
from .bodies import Crowd
from .identification import PersonBuild
from .pipeline import everybody
from .together import Everybody
from .wearers import SetsWorn, SeveralOptions, Wearer, is_same, kinds

UNRELATED = 1.0  # m², how the distance between markers of two varies: so much that it says nothing


def within_of(models: list[Model]) -> np.ndarray:
    """How the distances between the markers of several in a row vary, as `LiveNamer` takes it."""
    whose = np.repeat(np.arange(len(models)), [len(model.markerset) for model in models])
    found = np.full((len(whose), len(whose)), UNRELATED)
    for person, model in enumerate(models):
        found[np.ix_(whose == person, whose == person)] = trained_pairs(model).within
    return found


def solved_of_several(subjects: tuple[Wearer, ...], window: Window) -> WindowNames:
    """The names at the end of a window of those who are there, by the markers of all `subjects` in a row."""
    trouble, whole = "", SetsWorn(subjects)
    take, options = as_take(window), PointOptions("likelihood")
    crowd = Crowd(take, cut(take.xyz, take.rate), options)
    for some in _who_may_be_there(whole, window):
        try:
            found = finished(everybody(crowd, some))
        except JobError as error:
            trouble = trouble or error.message
            continue
        marker = at_the_end(window, found.verdict.labels.marker)
        return WindowNames(window.number, _as_before(whole, found, window, marker))
    return WindowNames(window.number, np.full(len(window.number), NO_MARKER), trouble)


def _who_may_be_there(whole: SetsWorn, window: Window) -> Iterator[SeveralOptions]:
    """All of them, and then fewer and fewer; of as many first those of whom most is named already.

    By how many they are, where nothing tells them from each other.
    """
    count = [int(np.isin(window.marker, own).sum()) for own in markers_of(whole)]
    worn = [one.model for one in kinds(whole.subjects)]
    for many in range(len(worn), 0, -1):
        tried: set[tuple[Model, ...]] = set()
        for group in sorted(combinations(range(len(worn)), many), key=lambda group: -sum(count[one] for one in group)):
            models = tuple(worn[one] for one in group)
            if models not in tried:
                tried.add(models)
                some = tuple(whole.subjects[one] for one in group)
                yield SeveralOptions(models[0], many) if len(set(models)) == 1 else SeveralOptions(subjects=some)


def markers_of(whole: SetsWorn) -> list[np.ndarray]:
    """Which of the markers in a row are each subject's."""
    return [
        first + np.arange(len(one.model.markerset)) for one, first in zip(whole.subjects, whole.firsts, strict=True)
    ]


def _as_before(whole: SetsWorn, found: Everybody, window: Window, marker: np.ndarray) -> np.ndarray:
    """The markers (L,) of those who were found, as those of `whole` who they are.

    That is who has most of the names so far or, where there are none, whose distances theirs are.
    """
    from scipy.optimize import linear_sum_assignment

    every, said = markers_of(whole), np.full(len(marker), NO_MARKER)
    score = np.full((len(found.found), len(every)), -1e9)
    for row, (one, own) in enumerate(zip(found.found, markers_of(found.worn), strict=True)):
        theirs, build = np.isin(marker, own), PersonBuild.of(one.body)
        for column, (other, names) in enumerate(zip(whole.subjects, every, strict=True)):
            if is_same(one.subject.model, other.model):
                before = PersonBuild.shown(other.model, window.shown[:, names])
                cost = min(build.cost(before, np.sqrt(2) * MARKER_LIMITS.noise_m), len(names))
                score[row, column] = len(names) * np.isin(window.marker[theirs], names).sum() - cost
    for row, column in zip(*linear_sum_assignment(score, maximize=True), strict=True):
        own = markers_of(found.worn)[row]
        theirs = np.isin(marker, own)
        said[theirs] = marker[theirs] - own[0] + every[column][0]
    return said
