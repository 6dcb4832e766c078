# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that moved up to the next marker, and crowds of more points than markers."""

from types import SimpleNamespace

import numpy as np
import pytest

from addon.core.data.errors import JobError
from addon.core.data.progress import finished
from addon.core.data.takes import NO_MARKER
from addon.core.points.likelihood.distances import DistanceConstraints
from addon.core.points.likelihood.naming import settle
from addon.core.points.likelihood.shape import Latent, Shape
from addon.core.points.models import namer_of
from addon.core.points.refusals import REFUSAL, refuse_unlike
from addon.core.points.tracklets import cut
from addon.core.points.whole_take.layout import block_exchanges, named_by_layout
from addon.core.points.whole_take.objective import usual_fit
from addon.core.points.whole_take.solving import solve_take

from .test_solving import said, solved_of, told

UNHELD = DistanceConstraints(np.zeros((0, 2), int), np.zeros(0), np.zeros(0), 0.05)


def side_by_side(seed: int, slipped: tuple[int, ...] = ()):
    """Some frames of a shape of seven markers, three of which sit side by side, those `slipped` one place off."""
    rng = np.random.default_rng(seed)
    mean = rng.normal(0, 2, (7, 3))
    mean[1:3] = mean[0] + np.array([[0.3, 0, 0], [0, 0.2, 0.2]])
    model = Latent(Shape(mean, rng.normal(0, 0.03, (7, 3, 2)), np.full(7, 4e-4)))
    latent = rng.normal(size=(9, model.size)) * np.where(np.arange(model.size) < 4, 0.01, 1)
    points = model.positions(latent) + rng.normal(0, 0.02, (9, 7, 3))
    points[:, np.roll(slipped, 1).astype(int)] = points[:, list(slipped)]
    present = rng.random((9, 7)) < 0.95
    naming = np.where(present, np.arange(7), -1)
    return SimpleNamespace(fine=model), settle(model, UNHELD, np.where(present[..., None], points, 0), present, naming)


def test_names_that_moved_up_are_put_right_at_once_where_a_block_is_seen_for_long():
    known, now = side_by_side(3, slipped=(0, 1, 2))
    assert [2, 0, 1, 3, 4, 5, 6] in block_exchanges(known, now, np.arange(7)).tolist()
    known, now = side_by_side(3)
    now.present[::2, 0] = False
    now.present[1::3, 0] = False
    assert block_exchanges(known, now, np.arange(7)).shape == (0, 7)


FRAMES = 200
FOOT = "LANK", "LHEE", "LTOE"


def test_a_crowd_is_told_from_the_set_where_frames_know_the_trunk_only(model, markers):
    """A point more is on the way from each marker to the one that is usually next to it."""
    count = markers.shape[1]
    between = np.nanmean(np.linalg.norm(markers[::10, :, None] - markers[::10, None], axis=3), axis=0)
    near = (between + np.diag(np.full(count, np.inf))).argmin(axis=1)
    order = np.random.default_rng(3).permutation(2 * count)
    points = np.concatenate([markers, markers + 0.4 * (markers[:, near] - markers)], axis=1)[:, order]
    whose = np.where(order < count, order, NO_MARKER)
    trunk = [model.markerset.index(name) for name in ("LASI", "RASI", "SACR", "LSHO", "RSHO", "LELB", "RELB")]
    named = said(points, whose, np.isin(whose, trunk))
    solution = solved_of(model, points, named)
    given, truth = told(model, solution, named).labels.marker, np.where(np.isfinite(points[..., 0]), whose, NO_MARKER)
    assert solution.crowd
    assert (given[given != NO_MARKER] == truth[given != NO_MARKER]).all()
    assert (given == truth)[truth != NO_MARKER].mean() > 0.9
    assert solution.fit.residual < REFUSAL.max_residual
    unsure = finished(solve_take(points, cut(points, 100.0), named, model, 100.0, sure=False))
    assert not unsure.crowd and unsure.near is not None, "it is searched for what else it may be"


@pytest.mark.parametrize("turned", [(1, 2, 0), (2, 0, 1)])
def test_three_that_are_each_in_the_place_of_the_next_are_put_right(model, markers, turned):
    foot = [model.markerset.markers.index(name) for name in FOOT]
    placed = markers.copy()
    placed[:, foot] = markers[:, [foot[index] for index in turned]]
    name, _ = named_by_layout(model.likelihood, placed[::20], np.zeros(0, int))
    assert (name[foot] == [foot[index] for index in turned]).all()
    assert (np.delete(name, foot) == np.delete(np.arange(len(name)), foot)).all()


def test_another_set_sits_elsewhere_and_is_refused(model, markers):
    own = usual_fit(model.likelihood, markers)
    rng = np.random.default_rng(4)
    elsewhere = markers + rng.normal(0, 0.08, (1, markers.shape[1], 3))
    other = usual_fit(model.likelihood, elsewhere)
    assert own.residual < REFUSAL.max_residual < other.residual
    namer = namer_of(model, "likelihood")
    refuse_unlike(model, namer, markers, own)
    with pytest.raises(JobError, match="does not look like a take of model body26"):
        refuse_unlike(model, namer, markers, other)
