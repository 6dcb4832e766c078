# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames named one by one, by what a window came to."""

import numpy as np
import pytest

from addon.core.geometry.rotations import turn_of
from addon.core.points.whole_take.live import FIRST_S, LiveNamer, WindowNames
from addon.core.points.whole_take.pairs import PairDistances

RATE, MARKERS = 100.0, 8
PLACES = np.random.default_rng(4).uniform(-0.5, 0.5, (MARKERS, 3)) + np.array([0, 0, 1.0])
IDS, NO_IDS, ALL = np.arange(MARKERS), np.full(MARKERS, -1), list(range(MARKERS))
REST, BACK = slice(1, None), np.append(77, IDS[1:])  # all but the first, which comes back as another trajectory
FIRST = slice(1)  # the first alone
REFUSED = "who is this; expected somebody"


def body(frame: int) -> np.ndarray:
    """A stiff body that goes ahead by a metre a second."""
    return PLACES + np.array([frame / RATE, 0, 0])


def namer_of(people: int = 1) -> LiveNamer:
    """That of so many, all learned from the stiff body."""
    apart = np.linalg.norm(PLACES[:, None] - PLACES, axis=2)
    unsure, within = np.full((2, MARKERS, MARKERS), 1e-6)
    return LiveNamer([PairDistances(apart, unsure + 0.02**2, within)] * people, RATE)


def go_on(namer: LiveNamer, frames, there=slice(None), ids: np.ndarray = IDS) -> list[int]:
    """Names frames of which some markers are there; gives what those of the last one are."""
    for frame in frames:
        marker, _ = namer.name(frame, body(frame)[there], ids[there])
    return marker.tolist()


def settled(ids: np.ndarray = IDS, people: int = 1) -> LiveNamer:
    """A namer that has heard in frame 35 of 40 who is who."""
    namer = namer_of(people)
    for frame in range(40):
        if frame == 35:
            window = namer.window()
            assert window.xyz.shape == (frame, MARKERS, 3) and window.row == 0 and window.rate == RATE
            namer.hear(WindowNames(window.number, IDS))
        assert go_on(namer, [frame], ids=ids) == NO_IDS.tolist() or frame >= 35
    return namer


@pytest.mark.parametrize("ids", [IDS + 5, NO_IDS, np.where(IDS % 2, 3, -1)])
def test_names_stay_with_their_points_whatever_the_sender_says_of_them(ids):
    namer = settled(ids)
    for frame in range(40, 60):
        order = np.random.default_rng(frame).permutation(MARKERS)
        assert go_on(namer, [frame], order, ids) == order.tolist()


@pytest.mark.parametrize(("away", "off", "named"), [(10, 0.0, True), (10, 0.05, False), (200, 0.0, False)])
def test_a_new_point_is_named_where_a_marker_was_a_moment_ago_by_its_distances_on_this_subject(away, off, named):
    namer = settled()
    go_on(namer, range(40, 40 + away), REST)
    moved = body(40 + away) + off * (IDS == 0)[:, None]
    assert namer.name(40 + away, moved, BACK)[0].tolist() == [0 if named else -1, *ALL[1:]]


@pytest.mark.parametrize("apart", [0.02, 0.3])
def test_a_trajectory_goes_on_under_another_number_where_those_around_it_carry_it(apart):
    namer, turning = namer_of(), PLACES.copy()
    turning[1] = turning[0] + [apart, 0, 0]
    for frame in range(100):  # two are lost for a quarter of a second, while all turn by a radian
        points = turning @ turn_of(np.array([0, 0, frame / 25])).T
        away = slice(2 if 50 <= frame < 75 else 0, None)
        _, number = namer.name(frame, points[away], IDS[away] + MARKERS * ((frame >= 75) & (IDS[away] < 2)))
    assert number.tolist() == ([MARKERS, MARKERS + 1, *ALL[2:]] if apart < 0.1 else ALL), "which of two is no guess"


def test_a_marker_is_named_again_beside_those_on_its_bone_although_others_move_more_than_training_knows():
    namer = settled()
    far = np.where(IDS < 4, 0.0, 0.01)[:, None] * [0.0, 1.0, 0.0]  # m a frame: a metre a second
    for frame in range(40, 50):
        namer.name(frame, (body(frame) + (frame - 40) * far)[1:], IDS[1:])
    assert namer.name(50, body(50) + 10 * far, BACK)[0].tolist() == ALL


@pytest.mark.parametrize(("around", "off", "after"), [
    (slice(None), 0.04, [0]), (slice(None), 0.06, [None]),
    (FIRST, 0.02, [0]), (FIRST, 0.04, range(10, 60)), (FIRST, 0.06, [None]),
])  # fmt: skip
def test_a_new_point_that_may_be_a_ghost_is_named_once_it_was_there_for_long_enough(around, off, after):
    namer, moved = settled(), off * (IDS == 0)[:, None]
    go_on(namer, [40], around)  # what was around it then tells where it goes on
    go_on(namer, range(41, 70), REST)
    # It came in time, and is asked for on and on.
    named = [namer.name(frame, body(frame) + moved, BACK)[0][0] == 0 for frame in range(70, 270)]
    assert (named.index(True) if any(named) else None) in after


def test_a_settled_name_is_taken_back_only_by_a_line_that_says_so():
    namer = settled()
    _, number = namer.name(40, body(40), IDS)
    swapped = [1, 0, *ALL[2:]]
    namer.hear(WindowNames(number, np.array(swapped)))
    frames = iter(range(41, 60))
    while not namer.renamed:
        given = go_on(namer, [frame := next(frames)])
    assert namer.renamed == [(0, 1), (1, 0)] and given == swapped
    namer.hear(WindowNames(number, NO_IDS, REFUSED))
    assert go_on(namer, [frame + 1]) == swapped
    assert namer.renamed == []


def test_a_name_that_the_solver_does_not_give_is_taken_back_once_it_was_shown_enough():
    namer, asked = settled(), 0
    go_on(namer, [40], FIRST)
    go_on(namer, [41], REST)
    for frame in range(42, 90):
        marker, number = namer.name(frame, body(frame), BACK)
        if namer.renamed:
            break
        assert marker.tolist() == ALL
        if (window := namer.window()) is not None:
            asked = len(window.xyz)
            namer.hear(WindowNames(number, NO_IDS, REFUSED))
            namer.hear(WindowNames(number, np.append(-1, IDS[1:])))
    assert namer.renamed == [(0, -1)] and asked - 42 >= round(FIRST_S * RATE)
    for later in range(frame + 1, frame + 10):
        assert go_on(namer, [later], ids=BACK) == [-1, *ALL[1:]]


@pytest.mark.parametrize(("others", "given"), [((), 0), ((0,), -1)])
def test_a_name_that_was_settled_is_taken_back_where_another_is_likelier_though_not_sure(others, given):
    namer = settled()
    go_on(namer, range(40, 50))
    window = namer.window()
    namer.hear(WindowNames(window.number, np.append(-1, IDS[1:]), others=others))
    assert go_on(namer, range(50, 60)) == [given, *ALL[1:]]


def test_what_comes_while_a_window_is_solved_is_named_by_it_too():
    namer = namer_of()
    go_on(namer, range(40))
    window = namer.window()
    for frame in range(40, 120):  # meanwhile each marker is lost once, and comes back as another trajectory
        lost = (frame - 40) // 10
        go_on(namer, [frame], lost != IDS, IDS + MARKERS * (lost > IDS))
    namer.hear(WindowNames(window.number, IDS))
    frames = iter(range(120, 135))
    while go_on(namer, [frame := next(frames)], ids=IDS + MARKERS) == NO_IDS.tolist():
        assert namer.window() is None, "asked before what was heard has come through"
    assert go_on(namer, [frame + 1], ids=IDS + MARKERS) == ALL


def test_who_was_lost_is_looked_for_in_what_is_there_since_by_what_is_known_of_them():
    namer, first = settled(), round(FIRST_S * RATE)
    go_on(namer, range(40, 240))
    window = namer.window()
    assert len(window.xyz) == 200 and len(window.shown) >= 20
    for frame in range(240, 340):
        go_on(namer, [frame], slice(0))
        assert namer.window() is None, "nobody is there"
    for frame in range(340, 340 + first):
        assert namer.window() is None
        go_on(namer, [frame], ids=IDS + MARKERS)
    window = namer.window()
    assert len(window.xyz) == first
    np.testing.assert_allclose(np.ptp(window.shown - window.shown.mean(axis=1, keepdims=True), axis=0), 0, atol=1e-5)
    namer.hear(WindowNames(window.number, IDS, "not whom I know", anew=True))
    go_on(namer, [frame + 1], ids=IDS + MARKERS)
    assert len(namer.window().shown) == 0


def test_one_of_many_who_is_there_alone_is_named_and_known_from_then_on():
    namer = settled(people=5)
    assert all(go_on(namer, [frame]) == ALL for frame in range(40, 60))
    shown = namer.window().shown
    assert len(shown) and (np.isfinite(shown[:, :, 0]) == (np.arange(5 * MARKERS) < MARKERS)).all()


def test_a_ghost_that_took_a_name_loses_it_once_the_marker_is_said_to_be_there():
    namer = settled()
    for frame in range(40, 100):  # a ghost comes where a marker is hidden for a moment
        hidden = REST if frame in range(50, 54) else slice(None)
        points, number = body(frame)[hidden], IDS[hidden]
        if frame >= 50:
            points, number = np.vstack([body(frame)[0] + 0.003, points]), np.append(99, number)
        marker, trajectory = namer.name(frame, points, number)
    assert marker.tolist() == [0, -1, *ALL[1:]]
    window = namer.window()
    said = dict(zip(trajectory[1:].tolist(), ALL, strict=True))
    namer.hear(WindowNames(window.number, np.array([said.get(one, -1) for one in window.number.tolist()])))
    for frame in range(100, 120):
        marker, _ = namer.name(frame, np.vstack([body(frame)[0] + 0.003, body(frame)]), np.append(99, IDS))
    assert marker.tolist() == [-1, *ALL]


def test_a_subject_is_known_by_the_names_of_the_solver_alone():
    namer = settled()
    go_on(namer, [40], FIRST)
    for frame in range(41, 240):  # the first one is another trajectory from here on, and is named at once
        assert go_on(namer, [frame], ids=BACK) == ALL
    assert not np.isfinite(namer.window().shown[10:, 0]).any() and np.isfinite(namer.window().shown[:, 1:]).all()


def test_names_of_trajectories_that_are_long_gone_are_forgotten():
    namer = settled()
    for frame in range(40, 4000):  # the first comes back again and again, under the number that it had
        go_on(namer, [frame], slice(frame // 50 % 2, None))
        if frame % 25 == 0 and (window := namer.window()) is not None:
            namer.hear(WindowNames(window.number, np.where(window.number < MARKERS, window.number, 0)))
    assert max(len(namer.given.marker), len(namer.given.solved)) < 2 * MARKERS


def test_who_comes_after_nobody_was_there_for_long_may_be_somebody_else():
    namer = settled()
    go_on(namer, [40])
    go_on(namer, range(41, 260), slice(0))
    go_on(namer, range(260, 300), ids=IDS + MARKERS)
    assert len(namer.window().shown) == 0


def test_frames_by_which_somebody_is_known_are_of_all_the_stream_and_not_too_many():
    namer = settled()
    go_on(namer, range(40, 6000))
    at = namer.window().shown[:, 0, 0] - PLACES[0, 0]
    assert 20 <= len(at) <= 40 and at[0] < 1 and at[-1] > 50


@pytest.mark.parametrize("number", [0, 40, 10**9])
def test_a_sender_that_begins_anew_or_was_away_is_named_anew(number):
    namer = settled()
    go_on(namer, [40])
    marker, trajectory = namer.name(number, body(41), IDS)
    assert (marker == -1).all() and trajectory.min() >= MARKERS and namer.row == 41
    assert namer.window() is None


def test_frames_that_are_lost_are_gaps_and_names_go_on_behind_them():
    namer = settled(NO_IDS)
    assert go_on(namer, [43], ids=NO_IDS) == ALL and namer.row == 43
    window = namer.window()
    assert np.isnan(window.xyz[40:43]).all() and len(window.xyz) == 44


def test_what_a_sender_lies_of_ids_names_nobody_twice_and_fills_no_memory():
    namer = settled()
    rng = np.random.default_rng(1)
    for frame in range(40, 800):
        points = rng.uniform(-1, 1, (rng.integers(0, 30), 3))
        marker, trajectory = namer.name(frame, points, rng.integers(-1, 10**9 if frame % 2 else 5, len(points)))
        assert np.bincount(marker[marker >= 0], minlength=1).max() <= 1
        assert len(set(trajectory.tolist())) == len(points)
    assert len(namer.trails) < 100 * 30 and len(namer.past) <= 200 and len(namer.given.marker) < 100 * 30
