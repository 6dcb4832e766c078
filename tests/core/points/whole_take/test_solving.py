# SPDX-License-Identifier: GPL-3.0-or-later
"""A take solved as a whole: the virtual person's, cut to pieces, of which frames on their own say little or err."""

import numpy as np
import pytest

from addon.core.data.takes import BY_LIKELIHOOD, BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels
from addon.core.points.tracklets import cut
from addon.core.points.whole_take.deciding import can_be_solved, labels_of, parted
from addon.core.points.whole_take.exchanges import undone
from addon.core.points.whole_take.layout import named_by_layout
from addon.core.points.whole_take.pairs import in_take, trained_pairs
from addon.core.points.whole_take.solving import solve_take
from addon.core.points.whole_take.tracklets import tracklets_of
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from addon.io.models import open_model

RATE = 100.0
FRAMES = 300
BURST = 20
LEFT_WRIST = "LWRA", "LWRB"


@pytest.fixture(scope="module")
def model():
    return open_model("body26")


@pytest.fixture(scope="module")
def markers():
    """(T, M, 3) m of the virtual person."""
    return make_performance(open_markerset("body26")).take.xyz[:FRAMES]


def pieces(markers: np.ndarray, seed: int = 1, hidden: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """The markers as anonymous pieces (T, P, 3), and whose each is (P,)."""
    rng = np.random.default_rng(seed)
    markers = markers.copy()
    for first in range(0, len(markers), BURST):
        markers[first : first + BURST, rng.choice(markers.shape[1], rng.integers(0, hidden + 1), replace=False)] = (
            np.nan
        )
    tracks, whose = [], []
    for marker in range(markers.shape[1]):
        seen = np.isfinite(markers[:, marker, 0]).astype(int)
        for first, after in np.flatnonzero(np.diff(np.r_[0, seen, 0])).reshape(-1, 2):
            track = np.full((len(markers), 3), np.nan)
            track[first:after] = markers[first:after, marker]
            tracks.append(track)
            whose.append(marker)
    order = rng.permutation(len(tracks))
    return np.stack(tracks, axis=1)[:, order], np.array(whose)[order]


def said(points: np.ndarray, whose: np.ndarray, where: np.ndarray, confidence: float = 0.97) -> Labels:
    """What frames say on their own: the truth of the points `where` (T, P), nothing elsewhere."""
    known = np.isfinite(points[..., 0]) & where
    marker = np.where(known, whose, NO_MARKER)
    step = np.where(known, BY_LIKELIHOOD, NO_STEP)
    chance = np.where(known, confidence, 0.0)
    return Labels(marker, step, chance, chance)


def wrong_and_missing(marker: np.ndarray, points: np.ndarray, whose: np.ndarray) -> tuple[int, float]:
    present = np.isfinite(points[..., 0])
    truth = np.where(present, whose, NO_MARKER)
    named = marker != NO_MARKER
    return int((named & (marker != truth)).sum()), float((present & ~named).sum() / present.sum())


def test_a_third_of_the_frames_name_the_whole_take(model, markers):
    points, whose = pieces(markers)
    early = np.arange(FRAMES)[:, None] < FRAMES // 3
    named = said(points, whose, np.broadcast_to(early, points.shape[:2]))
    solution = solve_take(points, cut(points, RATE), named, named.marker, model, RATE)
    labels = labels_of(solution, named, 0.999, model.markerset.markers).labels
    wrong, missing = wrong_and_missing(labels.marker, points, whose)
    assert wrong == 0
    assert missing < 0.01
    assert (labels.step[FRAMES // 2 :][labels.named[FRAMES // 2 :]] == BY_TRAJECTORY).all()


def test_points_that_are_no_marker_get_no_name(model, markers):
    points, whose = pieces(markers)
    rng = np.random.default_rng(2)
    ghosts = np.full((FRAMES, 6, 3), np.nan)
    for column in range(6):
        first = 40 * column
        ghosts[first : first + 50, column] = (
            points[first, 0] * 0 + np.nanmean(markers[first], axis=0) + rng.normal(0, 0.3, 3)
        )
        ghosts[first : first + 50, column] += np.cumsum(rng.normal(0, 0.002, (50, 3)), axis=0)
    points, whose = np.concatenate([points, ghosts], axis=1), np.r_[whose, np.full(6, NO_MARKER)]
    named = said(points, whose, whose >= 0)
    solution = solve_take(points, cut(points, RATE), named, named.marker, model, RATE)
    labels = labels_of(solution, named, 0.999, model.markerset.markers).labels
    assert (labels.marker[:, whose == NO_MARKER] == NO_MARKER).all()


def exchanged_for_a_while(markers: np.ndarray, names) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pieces in which both wrists' markers are hidden at once twice, whose they are, and names exchanged in between."""
    one, other = (names.index(name) for name in LEFT_WRIST)
    markers = markers.copy()
    for first in (100, 160):
        markers[first : first + 10, [one, other]] = np.nan
    points, whose = pieces(markers, hidden=0)
    given = whose.copy()
    first = np.array([np.flatnonzero(np.isfinite(column))[0] for column in points[..., 0].T])
    between = np.isin(whose, (one, other)) & (first == 110)
    given[between] = one + other - whose[between]
    assert between.sum() == 2
    return points, whose, given


def test_an_exchange_for_a_while_is_undone(model, markers):
    points, whose, given = exchanged_for_a_while(markers, model.markerset.markers)
    nothing = said(points, whose, np.zeros(points.shape[:2], bool))
    tracklets = tracklets_of(points, cut(points, RATE), nothing, len(whose))
    column = tracklets.column[tracklets.begin[:-1]]
    placed = tracklets.placed(points, given[column], len(model.markerset))
    trained = trained_pairs(model)
    marker = undone(tracklets, placed, given[column], trained, in_take(trained, placed), RATE)
    assert marker.tolist() == whose[column].tolist()


def test_names_exchanged_in_all_of_the_take_are_put_right(model, markers):
    names = model.markerset.markers
    for one, other in (LEFT_WRIST, ("LANK", "LTOE"), ("LELB", "RELB")):
        order = np.arange(len(names))
        pair = [names.index(one), names.index(other)]
        order[pair] = order[pair[::-1]]
        name, _ = named_by_layout(model.likelihood, markers[:, order], absent=False)
        assert name.tolist() == order.tolist(), (one, other)


def test_names_that_are_right_stay_and_what_is_hardly_surer_is_a_question(model, markers):
    name, questions = named_by_layout(model.likelihood, markers, absent=True)
    assert name.tolist() == list(range(len(model.markerset)))
    assert all(question.odds >= -1 for question in questions)


def test_a_tracklet_is_parted_where_its_frames_go_over_to_another_marker():
    tracklet = np.zeros((10, 2), int)
    tracklet[:, 1] = 1
    voted = np.full((10, 2), 3)
    voted[6:, 0] = 5
    voted[4:6, 0] = NO_MARKER
    found = parted(tracklet, voted)
    assert found[:, 1].tolist() == [1] * 10
    assert found[:6, 0].tolist() == [0] * 6
    assert set(found[6:, 0].tolist()) == {2}


def test_frames_in_no_order_and_sets_on_rigid_bodies_are_not_solved(model):
    assert can_be_solved(model, np.tile(np.arange(4), (20, 1)))
    assert not can_be_solved(model, np.arange(80).reshape(20, 4))
    assert not can_be_solved(model, np.full((20, 4), -1))


def test_a_strict_target_names_no_more_than_a_lax_one(model, markers):
    points, whose = pieces(markers)
    early = np.arange(FRAMES)[:, None] < FRAMES // 3
    named = said(points, whose, np.broadcast_to(early, points.shape[:2]))
    solution = solve_take(points, cut(points, RATE), named, named.marker, model, RATE)
    given = [
        labels_of(solution, named, target, model.markerset.markers).labels.named.sum()
        for target in (0.9, 0.999, 0.9999, 0.99999)
    ]
    assert given == sorted(given, reverse=True)
    assert given[-1] == 0  # nothing promises that, as no frame is so sure
