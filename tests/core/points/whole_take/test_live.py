# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames named one by one, by what a window came to."""

import numpy as np
import pytest

from addon.core.points.whole_take.live import FIRST_S, LiveNamer, WindowNames
from addon.core.points.whole_take.pairs import PairDistances

RATE, MARKERS = 100.0, 8
PLACES = np.random.default_rng(4).uniform(-0.5, 0.5, (MARKERS, 3)) + np.array([0, 0, 1.0])
NO_IDS = np.full(MARKERS, -1)


def body(frame: int) -> np.ndarray:
    """A stiff body that goes ahead by a metre a second."""
    return PLACES + np.array([frame / RATE, 0, 0])


def namer_of(people: int = 1) -> LiveNamer:
    """That of so many, all learned from the stiff body."""
    apart = np.linalg.norm(PLACES[:, None] - PLACES, axis=2)
    unsure, within = np.full((2, MARKERS, MARKERS), 1e-6)
    return LiveNamer([PairDistances(apart, unsure + 0.02**2, within)] * people, RATE)


def settled(ids: np.ndarray, frames: int = 40, people: int = 1) -> LiveNamer:
    """A namer that has heard who is who in some frames, all but the last few of which were asked."""
    namer = namer_of(people)
    for frame in range(frames):
        if frame == frames - 5:
            window = namer.window()
            assert window.xyz.shape == (frame, MARKERS, 3) and window.row == 0 and window.rate == RATE
            namer.hear(WindowNames(window.number, np.arange(MARKERS)))
        marker, _ = namer.name(frame, body(frame), ids)
        assert frame >= frames - 5 or (marker == -1).all()
    return namer


@pytest.mark.parametrize("ids", [np.arange(MARKERS) + 5, NO_IDS, np.where(np.arange(MARKERS) % 2, 3, -1)])
def test_names_stay_with_their_points_whatever_the_sender_says_of_them(ids):
    namer = settled(ids)
    for frame in range(40, 60):
        order = np.random.default_rng(frame).permutation(MARKERS)
        marker, _ = namer.name(frame, body(frame)[order], ids[order])
        assert marker.tolist() == order.tolist()


def test_a_point_that_comes_back_is_named_at_once_and_what_is_elsewhere_is_not():
    ids = np.arange(MARKERS)
    namer = settled(ids)
    for frame in range(40, 50):
        namer.name(frame, body(frame)[1:], ids[1:])
    marker, _ = namer.name(50, body(50), np.append(77, ids[1:]))
    assert marker.tolist() == list(range(MARKERS))
    ghost = np.vstack([body(51)[1:], [9.0, 9.0, 1.0]])
    marker, _ = namer.name(51, ghost, np.append(ids[1:], 99))
    assert marker.tolist() == [*range(1, MARKERS), -1]


@pytest.mark.parametrize(("away", "off", "named"), [(10, 0.0, True), (10, 0.05, False), (200, 0.0, False)])
def test_a_new_point_is_named_where_a_marker_was_a_moment_ago_by_its_distances_on_this_subject(away, off, named):
    ids = np.arange(MARKERS)
    namer = settled(ids)
    for frame in range(40, 40 + away):
        namer.name(frame, body(frame)[1:], ids[1:])
    moved = body(40 + away) + off * (ids == 0)[:, None]
    assert namer.name(40 + away, moved, np.append(77, ids[1:]))[0].tolist() == [0 if named else -1, *range(1, MARKERS)]


def test_a_marker_is_named_again_beside_those_on_its_bone_although_others_move_more_than_training_knows():
    ids, limb = np.arange(MARKERS), np.arange(MARKERS) < 4
    namer = settled(ids)
    far = np.where(limb, 0.0, 0.01)[:, None] * [0.0, 1.0, 0.0]  # m a frame: a metre a second
    for frame in range(40, 50):
        namer.name(frame, (body(frame) + (frame - 40) * far)[1:], ids[1:])
    marker, _ = namer.name(50, body(50) + 10 * far, np.append(77, ids[1:]))
    assert marker.tolist() == list(range(MARKERS))


@pytest.mark.parametrize(("off", "after"), [(0.02, [0]), (0.04, range(10, 60)), (0.06, [None])])
def test_a_new_point_that_may_be_a_ghost_is_named_once_it_was_there_for_long_enough(off, after):
    ids = np.arange(MARKERS)
    namer = settled(ids)
    for frame in range(40, 70):
        namer.name(frame, body(frame)[1:], ids[1:])
    named = [
        namer.name(frame, body(frame) + off * (ids == 0)[:, None], np.append(77, ids[1:]))[0][0] == 0
        for frame in range(70, 270)  # it came in time, and is asked for on and on
    ]
    assert (named.index(True) if any(named) else None) in after


def test_a_settled_name_is_taken_back_only_by_a_line_that_says_so():
    namer = settled(np.arange(MARKERS))
    _, number = namer.name(40, body(40), np.arange(MARKERS))
    swapped = np.arange(MARKERS)
    swapped[:2] = 1, 0
    namer.hear(WindowNames(number, swapped))
    frames = iter(range(41, 60))
    while not namer.renamed:
        frame = next(frames)
        given = namer.name(frame, body(frame), np.arange(MARKERS))[0].tolist()
    assert namer.renamed == [(0, 1), (1, 0)] and given == swapped.tolist()
    namer.hear(WindowNames(number, np.full(MARKERS, -1), "who is this; expected somebody"))
    assert namer.name(frame + 1, body(frame + 1), np.arange(MARKERS))[0].tolist() == swapped.tolist()
    assert namer.renamed == []


def test_a_name_that_the_solver_does_not_give_is_taken_back_once_it_was_shown_enough():
    ids = np.arange(MARKERS)
    namer = settled(ids)
    namer.name(40, body(40)[1:], ids[1:])
    back, asked = np.append(77, ids[1:]), 0
    for frame in range(41, 90):
        marker, number = namer.name(frame, body(frame), back)
        if namer.renamed:
            break
        assert marker.tolist() == list(range(MARKERS))
        if (window := namer.window()) is not None:
            asked = len(window.xyz)
            namer.hear(WindowNames(number, np.full(MARKERS, -1), "who is this; expected somebody"))
            namer.hear(WindowNames(number, np.append(-1, ids[1:])))
    assert namer.renamed == [(0, -1)] and asked - 41 >= round(FIRST_S * RATE)
    for later in range(frame + 1, frame + 10):
        assert namer.name(later, body(later), back)[0].tolist() == [-1, *range(1, MARKERS)]


def test_what_comes_while_a_window_is_solved_is_named_by_it_too():
    ids = np.arange(MARKERS)
    namer = namer_of()
    for frame in range(40):
        namer.name(frame, body(frame), ids)
    window = namer.window()
    for frame in range(40, 120):  # meanwhile each marker is lost once, and comes back as another trajectory
        there = np.arange(MARKERS) != (frame - 40) // 10
        number = ids + MARKERS * (ids < (frame - 40) // 10)
        namer.name(frame, body(frame)[there], number[there])
    namer.hear(WindowNames(window.number, ids))
    frames = iter(range(120, 135))
    while (namer.name(frame := next(frames), body(frame), ids + MARKERS)[0] == -1).all():
        assert namer.window() is None, "asked before what was heard has come through"
    assert namer.name(frame + 1, body(frame + 1), ids + MARKERS)[0].tolist() == ids.tolist()


def test_who_was_lost_is_looked_for_in_what_is_there_since_by_what_is_known_of_them():
    ids, nobody = np.arange(MARKERS), np.zeros((0, 3))
    namer = settled(ids)
    for frame in range(40, 240):
        namer.name(frame, body(frame), ids)
    window = namer.window()
    assert len(window.xyz) == 200 and len(window.shown) >= 20
    for frame in range(240, 340):
        namer.name(frame, nobody, ids[:0])
        assert namer.window() is None, "nobody is there"
    for frame in range(340, 340 + round(FIRST_S * RATE)):
        assert namer.window() is None
        namer.name(frame, body(frame), ids + MARKERS)
    window = namer.window()
    assert len(window.xyz) == round(FIRST_S * RATE)
    np.testing.assert_allclose(np.ptp(window.shown - window.shown.mean(axis=1, keepdims=True), axis=0), 0, atol=1e-5)
    namer.hear(WindowNames(window.number, ids, "not whom I know", anew=True))
    namer.name(frame + 1, body(frame + 1), ids + MARKERS)
    assert len(namer.window().shown) == 0


def test_one_of_many_who_is_there_alone_is_named_and_known_from_then_on():
    namer = settled(np.arange(MARKERS), people=5)
    for frame in range(40, 60):
        marker, _ = namer.name(frame, body(frame), np.arange(MARKERS))
        assert marker.tolist() == list(range(MARKERS))
    shown = namer.window().shown
    assert len(shown) and (np.isfinite(shown[:, :, 0]) == (np.arange(5 * MARKERS) < MARKERS)).all()


def test_a_ghost_that_took_a_name_loses_it_once_the_marker_is_said_to_be_there():
    namer, ids = settled(np.arange(MARKERS)), np.arange(MARKERS)
    for frame in range(40, 100):  # a ghost comes where a marker is hidden for a moment
        hidden = slice(1, None) if frame in range(50, 54) else slice(None)
        points, number = body(frame)[hidden], ids[hidden]
        if frame >= 50:
            points, number = np.vstack([body(frame)[0] + 0.003, points]), np.append(99, number)
        marker, trajectory = namer.name(frame, points, number)
    assert marker.tolist() == [0, -1, *range(1, MARKERS)]
    window = namer.window()
    true = np.where(np.isin(window.number, trajectory[1:]), window.number, -1)
    namer.hear(WindowNames(window.number, true))
    for frame in range(100, 120):
        marker, _ = namer.name(frame, np.vstack([body(frame)[0] + 0.003, body(frame)]), np.append(99, ids))
    assert marker.tolist() == [-1, *range(MARKERS)]


def test_a_subject_is_known_by_the_names_of_the_solver_alone():
    ids, namer = np.arange(MARKERS), settled(np.arange(MARKERS))
    for frame in range(40, 240):
        back = np.where(ids == 0, 77, ids)  # the first one is another trajectory from here on, and is named at once
        assert namer.name(frame, body(frame), back)[0].tolist() == ids.tolist()
    assert not np.isfinite(namer.window().shown[10:, 0]).any() and np.isfinite(namer.window().shown[:, 1:]).all()


def test_names_of_trajectories_that_are_long_gone_are_forgotten():
    namer, ids = settled(np.arange(MARKERS)), np.arange(MARKERS)
    for frame in range(40, 4000):
        there = slice(frame // 50 % 2, None)  # the first comes back again and again, under the number that it had
        namer.name(frame, body(frame)[there], ids[there])
        if frame % 25 == 0 and (window := namer.window()) is not None:
            namer.hear(WindowNames(window.number, np.where(window.number < MARKERS, window.number, 0)))
    assert max(len(namer.given.marker), len(namer.given.solved)) < 2 * MARKERS


def test_who_comes_after_nobody_was_there_for_long_may_be_somebody_else():
    namer, ids = settled(np.arange(MARKERS)), np.arange(MARKERS)
    for frame in range(40, 300):
        there = slice(0, 0) if 40 < frame < 260 else slice(None)
        namer.name(frame, body(frame)[there], ids[there] + MARKERS * (frame > 40))
    assert len(namer.window().shown) == 0


def test_frames_by_which_somebody_is_known_are_of_all_the_stream_and_not_too_many():
    ids, namer = np.arange(MARKERS), settled(np.arange(MARKERS))
    for frame in range(40, 6000):
        namer.name(frame, body(frame), ids)
    at = namer.window().shown[:, 0, 0] - PLACES[0, 0]
    assert 20 <= len(at) <= 40 and at[0] < 1 and at[-1] > 50


def test_a_sender_that_begins_anew_or_was_away_is_named_anew():
    for number in (0, 40, 10**9):
        namer = settled(np.arange(MARKERS))
        namer.name(40, body(40), np.arange(MARKERS))
        marker, trajectory = namer.name(number, body(41), np.arange(MARKERS))
        assert (marker == -1).all() and trajectory.min() >= MARKERS and namer.row == 41
        assert namer.window() is None


def test_frames_that_are_lost_are_gaps_and_names_go_on_behind_them():
    namer = settled(NO_IDS)
    marker, _ = namer.name(43, body(43), NO_IDS)
    assert marker.tolist() == list(range(MARKERS)) and namer.row == 43
    window = namer.window()
    assert np.isnan(window.xyz[40:43]).all() and len(window.xyz) == 44


def test_what_a_sender_lies_of_ids_names_nobody_twice_and_fills_no_memory():
    namer = settled(np.arange(MARKERS))
    rng = np.random.default_rng(1)
    for frame in range(40, 800):
        points = rng.uniform(-1, 1, (rng.integers(0, 30), 3))
        marker, trajectory = namer.name(frame, points, rng.integers(-1, 10**9 if frame % 2 else 5, len(points)))
        assert np.bincount(marker[marker >= 0], minlength=1).max() <= 1
        assert len(set(trajectory.tolist())) == len(points)
    assert len(namer.trails) < 100 * 30 and len(namer.past) <= 200 and len(namer.given.marker) < 100 * 30
