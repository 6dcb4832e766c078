# SPDX-License-Identifier: GPL-3.0-or-later
"""Which known marker set a take is of: sets that share most places, one that is part of another, two bodies."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.data.errors import JobError
from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.core.pipelines import known_sets
from addon.core.pipelines.known_sets import model_worn, set_worn
from addon.core.points.refusals import UnsuitedError
from addon.core.simulation.virtual import draw_person
from addon.io.markersets import builtin_markersets
from addon.io.models import open_model

RATE, FRAMES = 60.0, 60
KNOWN = [open_model(name) for name in builtin_markersets()]


def standing(markers: np.ndarray, seed: int = 1) -> Points:
    """Somebody who stands, markers (M, 3) m, breathing, as trajectories in another order and without names."""
    generator = np.random.default_rng(seed)
    xyz = markers[generator.permutation(len(markers))] + generator.normal(0, 0.001, (FRAMES, len(markers), 3))
    return Points(("",) * len(markers), xyz, np.zeros(xyz.shape[:2]), RATE, 1)


def drawn(name: str, seed: int = 3) -> np.ndarray:
    """(M, 3) m a person in a set."""
    markerset = open_model(name).markerset
    return BodyModel(markerset).pose(draw_person(markerset, np.random.default_rng(seed))).markers[0]


def names(markers: np.ndarray, known=KNOWN) -> list[str]:
    """The set that is found, or all that may be worn."""
    worn, likely = finished(set_worn(standing(markers), known))
    return [model.markerset.name for model in ([worn] if worn else likely)]


@pytest.mark.parametrize("name", ["actor41", "actor53", "body26", "body39", "gait15"])
def test_a_built_in_set_is_found(name):
    assert names(drawn(name)) == [name]


def test_the_set_of_somebody_who_is_there_for_a_moment_is_found():
    take = standing(drawn("body39"))
    xyz = np.full((10 * FRAMES, *take.xyz.shape[1:]), np.nan)
    xyz[5 * FRAMES : 5 * FRAMES + FRAMES // 2] = take.xyz[: FRAMES // 2]
    worn, _ = finished(set_worn(replace(take, xyz=xyz, residual=np.zeros(xyz.shape[:2])), KNOWN))
    assert worn is not None and worn.markerset.name == "body39"


def without(name: str, *some: str) -> np.ndarray:
    """(M, 3) m a person in a set who does not wear some of its markers."""
    return np.delete(drawn(name), [open_model(name).markerset.index(one) for one in some], axis=0)


def test_of_sets_that_name_the_same_points_the_one_that_lacks_less_is_worn():
    assert names(without("actor41", "LMT5", "RMT5")) == ["body39"]
    assert names(without("body39", "LUPA", "RUPA", "LFRM", "RFRM")) == ["body39"]


def test_of_a_set_that_one_person_taught_many_markers_may_be_taken_off():
    own = next(model for model in KNOWN if model.markerset.name == "body39")
    off = [side + name for side in "LR" for name in ("THI", "TIB", "UPA", "FRM", "FIN", "WRB")]
    left = without("body39", *off)
    assert names(left, [replace(own, likelihood=replace(own.likelihood, subjects=1))]) == ["body39"]
    assert names(left, [own]) == []


def test_no_more_than_what_is_worn_for_sure_is_searched_for(monkeypatch):
    searched, search = [], known_sets._searched

    def noted(begun):
        searched.append(begun.model.markerset.name)
        return (yield from search(begun))

    monkeypatch.setattr(known_sets, "_searched", noted)
    assert names(drawn("actor53")) == searched == ["actor53"]


def test_a_set_that_would_be_refused_makes_another_unsure(monkeypatch):
    def refuse(frames, *given):
        if frames.model.markerset.name == "body39":
            raise UnsuitedError("is of none")

    monkeypatch.setattr(known_sets, "refuse_solved", refuse)
    words = "looks like a take of actor41, but not surely; expected the one that is worn, by --model actor41"
    with pytest.raises(JobError, match=words):
        finished(model_worn(standing(drawn("body39")), None, {model: model.markerset.name for model in KNOWN}))


@pytest.mark.parametrize(("name", "lacks"), [("body39", 8), ("actor53", 6)])
def test_a_smaller_set_is_not_sure_where_one_that_lacks_markers_is_likelier(name, lacks):
    some = open_model(name).markerset.markers
    away = [some[place] for place in np.random.default_rng(0).permutation(len(some))[:lacks]]
    worn, likely = finished(set_worn(standing(without(name, *away)), KNOWN))
    assert worn is None and likely


def test_somebody_else_far_away_and_ghosts_change_nothing():
    ghosts = np.random.default_rng(5).uniform([5, 5, 0], [9, 9, 2], (6, 3))
    assert names(np.concatenate([drawn("body39"), drawn("body39", 4) + np.array([3.0, 0, 0]), ghosts])) == ["body39"]


def test_of_sets_with_the_same_markers_one_stands_for_both():
    whole = open_model("body39")
    alike = replace(whole, markerset=replace(whole.markerset, name="ours"))
    assert names(drawn("body39"), [open_model("gait15"), alike, whole]) in (["ours"], ["body39"])
