# SPDX-License-Identifier: GPL-3.0-or-later
"""What the replication page's figures rest on: the clouds that are tested, the counts, the claims about solvers."""

import json

import numpy as np
import pytest

from addon.core.evaluation.figures import Figures
from addon.core.papers.partial_solvers.model import FUNCTIONS, PAPER_FUNCTIONS
from addon.core.papers.partial_solvers.training import Training
from tests.accuracy.partial.clouds import Clouds, Trouble, spoilt
from tests.accuracy.partial.measuring import TARGETS
from tests.accuracy.partial.report import BLOCKS, Results, added
from tests.accuracy.partial.scores import score
from tests.core.papers.partial_solvers.plain import moving, named_by, trained

NAMES = ("MID", "LKNE", "RKNE", "LTOE", "RTOE")


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("hide", range(6))
def test_clouds_lack_as_many_markers_as_asked_in_any_order(hide):
    frames = moving(7, 200)
    clouds = spoilt(frames, Trouble(hide), rng())
    assert clouds.points.shape == (200, 7 - hide, 3)
    assert all(len(set(row)) == 7 - hide for row in clouds.truth.tolist())
    assert np.array_equal(clouds.points, np.take_along_axis(frames, clouds.truth[..., None], axis=1))
    # Every marker is hidden about equally often, and comes at every place.
    assert np.ptp(np.bincount(clouds.truth.ravel(), minlength=7)) < 60
    assert len(np.unique(clouds.truth[:, 0])) == 7


def test_clouds_repeat_themselves_for_a_seed_and_have_ghosts_and_noise():
    frames = moving(6, 50)
    clouds, again = (spoilt(frames, Trouble(2, 3, 0.01), rng(4)) for _ in range(2))
    assert np.array_equal(clouds.points, again.points)
    assert np.array_equal(clouds.truth, again.truth)
    assert not np.array_equal(clouds.truth, spoilt(frames, Trouble(2, 3, 0.01), rng(5)).truth)
    assert ((clouds.truth == -1).sum(axis=1) == 3).all()
    real = clouds.truth >= 0
    off = (clouds.points - np.take_along_axis(frames, np.maximum(clouds.truth, 0)[..., None], axis=1))[real]
    assert off.std() == pytest.approx(0.01, rel=0.15)


def test_scores_by_hand():
    # Three markers. First cloud: 0 right, 2 on the point of 1; second: a ghost is named 1, and 1 is hidden.
    truth = np.array([[0, 1, -1], [2, -1, 0]])
    named = np.array([[0, 2, -1], [-1, 1, 0]])
    found = score(named, Clouds(np.zeros((2, 3, 3)), truth, 3))
    assert found.given.tolist() == [2, 1, 1]
    assert found.wrong.tolist() == [0, 1, 1]
    assert found.there.tolist() == [2, 1, 1]
    # Declared occluded: 1 in the first cloud, which was there; 2 in the second, which was there.
    assert found.declared.tolist() == [0, 1, 1]
    assert found.missed.tolist() == [0, 1, 1]
    assert (found.false_assignments, found.false_occlusions, found.recall) == (0.5, 1.0, 0.5)


def random_names(seed: int, count=200, markers=5, points=6):
    generator = rng(seed)
    truth = generator.random((count, markers + 2)).argsort(axis=1)[:, :points]
    truth = np.where(truth < markers, truth, -1)
    shown = np.where(generator.random(truth.shape) < 0.3, np.roll(truth, 1, axis=1), truth)
    first = np.array([[point not in row[:at] for at, point in enumerate(row)] for row in shown.tolist()])
    return np.where(first & (generator.random(truth.shape) < 0.8), shown, -1), Clouds(
        np.zeros((*truth.shape, 3)), truth, 5
    )


@pytest.mark.parametrize("seed", range(3))
def test_scores_are_the_contracts_figures(seed):
    named, clouds = random_names(seed)
    texts = [*NAMES, ""]
    frame = np.repeat(np.arange(len(named)), named.shape[1])
    figures = Figures(NAMES).add(
        frame, None, [texts[name] for name in named.ravel()], [texts[name] for name in clouds.truth.ravel()]
    )
    found, total = score(named, clouds), figures.as_dict()
    assert found.false_assignments == pytest.approx(total["false_assignments"])
    assert found.recall == pytest.approx(total["recall"])


def test_a_mirror_changes_nothing_for_the_papers_functions_and_much_for_turn():
    points = moving(6, 260, sway=0.05, seed=3)
    for functions in (PAPER_FUNCTIONS, FUNCTIONS):
        options = Training(functions=functions, survey_frames=40, check_frames=120, wrong=300)
        partial_solvers = trained(points[:200], tuple("ABCDEF"), 0.95, options)
        plain, turned = (named_by(partial_solvers, some).marker for some in (points[200:], points[200:] * [1, -1, 1]))
        assert (plain >= 0).mean() > 0.5
        if functions == PAPER_FUNCTIONS:
            assert np.array_equal(plain, turned)
        else:
            assert (turned == plain)[plain >= 0].mean() < 0.5


def test_counts_of_people_are_put_together_in_blocks(tmp_path):
    counts = [[4] * 15, [1] * 15, [5] * 15, [3] * 15, [2] * 15]
    grid = {str(hide): {str(target): counts for target in TARGETS} for hide in range(6)}
    for person in ("ANN", "BOB+CAT"):
        (tmp_path / f"ours.{person}.json").write_text(json.dumps({"grid": grid}), encoding="utf-8")
    assert added([{"a": [1, [2, 3]]}, {"a": [10, [20, 30]]}]) == {"a": [11, [22, 33]]}
    results = Results(tmp_path)
    blocks = {name: BLOCKS[name](results) for name in set(BLOCKS) - {"conditions"}}
    assert "| 5 | ours, left out | 25.000 % |" in blocks["table4"]
    assert "| 5 | ours, left out | 66.67 % |" in blocks["table5"]
    assert "| 5 | ours, left out | 60.00 % |" in blocks["recall"]
    assert "ours" not in blocks["cover"]
    (column,) = [column for column, _ in results.with_study("grid")]
    assert results.people(column) == "3 people left out, 2 trainings"
