# SPDX-License-Identifier: GPL-3.0-or-later
"""The last moment of a stream of several: who is there, and who is who."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.errors import JobError
from addon.core.points.models import TrainingTake
from addon.core.points.several import live
from addon.core.points.several.live import solved_of_several
from addon.core.points.several.wearers import Wearer
from addon.core.points.unordered import of_subject
from addon.core.points.whole_take import pipeline
from addon.core.points.whole_take.live import Window, solved_window
from addon.demo.take import MODEL
from addon.io.models import open_model
from scripts.virtual_take import write_virtual_take

MARKERS = 26
NOTHING = np.zeros((0, 2 * MARKERS, 3))
SUBJECTS = tuple(Wearer(name, open_model(MODEL)) for name in ("1", "2"))


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    """(2, T, M, 3) m, two who walk beside each other, the second larger, by the markers' order in the set."""
    found = []
    for seed in (1, 5):
        take = write_virtual_take(tmp_path_factory.mktemp("live"), 120, seed, "walk.csv", "room.toml")
        order = [take.names.index(name) for name in SUBJECTS[0].model.markerset.markers]
        found.append((1 + 0.06 * len(found)) * take.xyz[:, order] + np.array([0.0, 2.0 * len(found), 0.0]))
    return np.stack([one[:110] for one in found])


def window(xyz: np.ndarray, marker: np.ndarray | None = None, shown: np.ndarray | None = None) -> Window:
    """That of markers (T, L, 3) m in the last frames, called so (L,) before, and so in some frames (K, 2 M, 3)."""
    lanes = xyz.shape[1]
    marker, shown = np.full(lanes, -1) if marker is None else marker, NOTHING if shown is None else shown
    return Window(0, 60.0, np.arange(lanes), xyz, marker, shown)


def named(given: Window, true: np.ndarray):
    """Whether all that is named is what is true (L,), and most is named."""
    said = solved_of_several(SUBJECTS, given)
    own = said.marker >= 0
    return own.mean() > 0.9 and (said.marker[own] == true[own]).all()


def test_who_is_who_stays_as_names_were_and_else_as_distances_are(people):
    late = np.concatenate(people[:, 50:], axis=1)
    same, other = np.arange(2 * MARKERS), np.roll(np.arange(2 * MARKERS), MARKERS)
    assert named(window(late, same), same) and named(window(late, other), other)
    some = np.where(np.arange(2 * MARKERS) % 5, -1, other)
    assert named(window(late, some), other)
    for order, true in ((people[:, :50], same), (people[::-1, :50], other)):
        assert named(window(late, shown=np.concatenate(order, axis=1)), true)


def test_exchanges_alone_are_tried_once_everybody_is_known(people, monkeypatch):
    tried, solve = [], pipeline.solve_take
    monkeypatch.setattr(pipeline, "solve_take", lambda *given: tried.append(given[-2]) or solve(*given))
    late, shown, same = (np.concatenate(people[:, some], axis=1) for some in (slice(50, 110), slice(50), slice(0)))
    one = np.where(np.arange(2 * MARKERS)[:, None] < MARKERS, shown, np.nan)
    for known, moves in ((shown, "exchanges"), (one, "all"), (same, "all")):
        tried.clear()
        said = solved_of_several(SUBJECTS, window(late, shown=known))
        assert (said.marker >= 0).mean() > 0.9 and set(tried) == {moves}


def test_of_two_one_may_be_there_alone(people):
    shown = np.concatenate(people[:, :50], axis=1)
    for person in (0, 1):
        true = np.arange(MARKERS) + person * MARKERS
        assert named(window(people[person, 50:], true), true)
        assert named(window(people[person, 50:], shown=shown), true)


def test_of_different_sets_who_is_there_alone_wears_the_one_that_names_most(people):
    other = Wearer("bob", open_model("gait15"))
    said = solved_of_several((other, SUBJECTS[0]), window(people[0, 50:]))
    assert said.marker.tolist() == list(range(15, 15 + MARKERS))


def test_of_many_different_sets_few_groups_are_tried_and_in_the_end_all_who_may_be_there(people, monkeypatch):
    model, tried = SUBJECTS[0].model, []
    six = tuple(Wearer(name, replace(model, fingerprint=name)) for name in "abcdef")

    def nobody(_, some):
        tried.append("".join(one.model.fingerprint for one in some.at_least.subjects))
        raise JobError("shows nobody; expected somebody")

    monkeypatch.setattr(live, "everybody", nobody)
    nothing = np.zeros((0, 6 * MARKERS, 3))
    solved_of_several(six, window(people[0, :50], shown=nothing))
    assert tried == ["abcdef", *"abcdef"]
    tried.clear()
    some = np.arange(MARKERS) + MARKERS * np.where(np.arange(MARKERS) % 2, 1, 4)
    for row in range(40):
        solved_of_several(six, replace(window(people[0, :50], some, nothing), row=row))
    assert len(tried) == 40 * 11 and {one for one in tried if len(one) == 2} == {"be"}
    assert {one for one in tried if len(one) == 3} == {"abe", "bce", "bde", "bef"}
    tried.clear()
    left = people[0, :50].copy()
    left[-1, 1::2] = np.nan
    for row in range(40):
        solved_of_several(six, replace(window(left, some, nothing), row=row))
    assert {one for one in tried if len(one) == 2} == {"ae", "be", "ce", "de", "ef"}, "b has left"


def own(name: str, xyz: np.ndarray) -> Wearer:
    """Whose model was learned from the places (T, M, 3) m of their markers alone."""
    model, takes = SUBJECTS[0].model, (TrainingTake(name, ("walk",), len(xyz), xyz),)
    known = of_subject(model.likelihood, xyz[::3])
    return Wearer(name, replace(model, likelihood=known, fingerprint=name, training_takes=takes))


def test_of_two_with_models_of_their_own_who_is_there_alone_is_who_has_that_size(people):
    both = own("ann", people[0]), own("bob", people[1])
    for order, first in ((both, MARKERS), (both[::-1], 0)):
        said = solved_of_several(order, window(people[1, 50:]))
        assert said.marker.tolist() == list(range(first, first + MARKERS))


def test_of_two_who_cannot_be_told_apart_none_is_named(people):
    twins = own("ann", people[0]), own("twin", people[0])
    said = solved_of_several(twins, window(np.concatenate(people[:, 50:], axis=1)))
    assert "who is ann and twin cannot be told" in said.refused and (said.marker == -1).all()


def test_whom_one_knows_is_named_by_that_in_less_work_and_somebody_else_is_told(people, monkeypatch):
    model, tried = SUBJECTS[0].model, []
    solve = pipeline.solve_take
    monkeypatch.setattr(pipeline, "solve_take", lambda *given: tried.append(given[-2:]) or solve(*given))
    for known, anew in ((people[0, :40], False), (1.6 * people[0, :40], True), (people[0, :0], False)):
        said = solved_window(model, window(people[0, 50:], shown=known))
        assert (said.marker == np.arange(MARKERS)).all() and said.anew == anew
    assert [moves for moves, _ in tried] == ["exchanges", "exchanges", "all", "all"]
    assert [shown is not None for _, shown in tried] == [True, True, False, False]
    said = solved_window(model, window(people[0, 50:, :5], shown=people[0, :40]))
    assert said.refused and not said.anew, "who is hidden is not somebody else"


def test_what_is_likelier_another_marker_than_it_was_called_is_told(people):
    called = np.append([1, 0], np.arange(2, MARKERS))
    assert solved_window(SUBJECTS[0].model, window(people[0, 50:], called)).others == (0, 1)


def test_where_nobody_is_it_is_said(people):
    said = solved_of_several(SUBJECTS, window(people[0, 50:, :5]))
    assert said.refused and (said.marker == -1).all()
