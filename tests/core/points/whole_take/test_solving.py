# SPDX-License-Identifier: GPL-3.0-or-later
"""A take solved as a whole, of which frames say little or err; and what a person says of it, which holds."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.lanes import LaneOptions
from addon.core.data.progress import finished
from addon.core.data.takes import BY_LIKELIHOOD, BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Verdict
from addon.core.edits.applying import apply_edits, cells_of_take
from addon.core.edits.kinds import AssignPoint, Delete, Edits, UnlabelMarker
from addon.core.points.likelihood.sides import NO_SIDES
from addon.core.points.models import TrainingTake
from addon.core.points.tracklets import cut
from addon.core.points.whole_take.deciding import can_be_solved, labels_of
from addon.core.points.whole_take.layout import Question, named_by_layout
from addon.core.points.whole_take.layout_odds import Unmoved
from addon.core.points.whole_take.likeness import LIKENESS, likeness
from addon.core.points.whole_take.objective import OBJECTIVE, USUAL_FREEDOM, Objective, fullest_frames
from addon.core.points.whole_take.pairs import PairDistances, in_take, moments, trained_pairs
from addon.core.points.whole_take.rulings import Rulings
from addon.core.points.whole_take.search import Search
from addon.core.points.whole_take.solution import Solution
from addon.core.points.whole_take.solving import solve_take
from addon.core.points.whole_take.tracklets import Tracklets, seen_in, tracklets_of
from tests.core.scenes import anonymous, in_pieces

RATE = 100.0
FRAMES = 300
BURST = 20
LEFT_WRIST = "LWRA", "LWRB"


def pieces(markers: np.ndarray, seed: int = 1, hidden: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """The markers as anonymous pieces (T, P, 3), and whose each is (P,)."""
    rng = np.random.default_rng(seed)
    markers = markers.copy()
    for first in range(0, len(markers), BURST):
        gone = rng.choice(markers.shape[1], rng.integers(0, hidden + 1), replace=False)
        markers[first : first + BURST, gone] = np.nan
    return in_pieces(markers, rng)


def said(points: np.ndarray, whose: np.ndarray, where: np.ndarray | bool, confidence: float = 0.97) -> Labels:
    """What frames say on their own: the truth of the points `where` (T, P), nothing elsewhere."""
    known = np.isfinite(points[..., 0]) & where
    chance = np.where(known, confidence, 0.0)
    return Labels(np.where(known, whose, NO_MARKER), np.where(known, BY_LIKELIHOOD, NO_STEP), chance, chance)


def solved_of(model, points: np.ndarray, named: Labels, rate: float = RATE) -> Solution:
    return finished(solve_take(points, cut(points, rate), named, model, rate))


def told(model, solution: Solution, named: Labels, target: float = 0.999) -> Verdict:
    return labels_of(solution, named, target, model.markerset.markers)


def test_a_third_of_the_frames_name_the_whole_take_and_no_less_of_it_with_a_lax_target(model, markers):
    points, whose = pieces(markers)
    named = said(points, whose, np.arange(FRAMES)[:, None] < FRAMES // 3)
    solution = solved_of(model, points, named)
    labels, present = told(model, solution, named).labels, np.isfinite(points[..., 0])
    assert (labels.marker == np.where(present, whose, NO_MARKER))[labels.named].all()
    assert labels.named[present].mean() > 0.99
    assert (labels.step[FRAMES // 2 :][labels.named[FRAMES // 2 :]] == BY_TRAJECTORY).all()
    targets = (0.9, 0.999, 0.99999, 1 - 1e-15)
    given = [told(model, solution, named, target).labels.named.sum() for target in targets]
    assert given == sorted(given, reverse=True)
    assert given[-1] < given[0]


@pytest.mark.parametrize("every", [1, 4])
def test_an_unmodelled_marker_that_lasts_half_a_second_competes_at_any_rate(model, markers, every):
    """Not by its frames: at 25 a second it has few."""
    beside = markers[:, :1] + [0.3, 0.0, 0.3]
    beside[int(0.5 * RATE) :] = np.nan
    points, rate = np.concatenate([markers, beside], axis=1)[::every], RATE / every
    whose = np.append(np.arange(markers.shape[1]), NO_MARKER)
    assert solved_of(model, points, said(points, whose, whose >= 0), rate).extras == 1


def test_names_that_nothing_has_or_that_no_answer_makes_sure_are_not_asked_about(model, markers):
    points, whose = pieces(markers)
    named, names = said(points, whose, True), model.markerset.markers
    solution = solved_of(model, points, named)
    pair = names.index("LELB"), names.index("RELB")
    words = "LELB and RELB may be either way round in the whole take: each stays unnamed"
    for unworn, answered, asks in (((), 9.0, True), (pair[:1], 9.0, True), (pair, 9.0, False), ((), 1.0, False)):
        marker = np.where(np.isin(solution.marker, unworn), NO_MARKER, solution.marker)
        asked = (Question(*pair, 0.1, answered), Question(*pair[::-1], 0.1, answered))
        verdict = told(model, replace(solution, marker=marker, questions=asked), named)
        said_so = [set(one.words.split()) for one in verdict.suspects]
        assert said_so.count(set(words.split())) == asks, "once, whichever of the two comes first"
        assert not np.isin(verdict.labels.marker, pair).any() or not asks


def test_who_has_left_leaves_no_marker_behind_on_the_same_trajectory(model, markers):
    """A trajectory that went over to somebody else while its subject was gone keeps no name there."""
    toe, gone = model.markerset.index("RTOE"), slice(FRAMES // 2, FRAMES // 2 + 40)
    points, whose = markers.copy(), np.arange(markers.shape[1])
    points[gone, whose != toe] = np.nan
    named = said(points, whose, np.ones(points.shape[:2], bool))
    solution = finished(solve_take(points, cut(points, RATE), named, model, RATE))
    given = labels_of(solution, named, 0.999, model.markerset.markers).labels.marker[:, toe]
    there = np.ones(FRAMES, bool)
    there[gone] = False
    assert (given[there] == toe).all() and (given[gone] == NO_MARKER).all()
    said_so = replace(solution, tracklets=replace(solution.tracklets, held=solution.marker))
    assert (labels_of(said_so, named, 0.999, model.markerset.markers).labels.marker[:, toe] == toe).all()


def exchanged(model, one: str, other: str) -> np.ndarray:
    """(M,) the markers, of which two have each other's names."""
    order, pair = np.arange(len(model.markerset)), [model.markerset.index(name) for name in (one, other)]
    order[pair] = pair[::-1]
    return order


def tracklets_in(model, points: np.ndarray, whose: np.ndarray) -> tuple[Tracklets, Labels]:
    """The tracklets of points (T, P, 3) m, and what frames say: nothing."""
    nothing = said(points, whose, False)
    return tracklets_of(points, cut(points, RATE), nothing, len(model.markerset)), nothing


def objective_of(model, points: np.ndarray, whose: np.ndarray) -> tuple[Objective, np.ndarray]:
    """The objective of points (T, P, 3) m of whose frames nothing is said, and what its tracklets are."""
    tracklets, nothing = tracklets_in(model, points, whose)
    truth = whose[tracklets.lane]
    objective = Objective(points, tracklets, nothing, model, RATE)
    objective.look_at(truth)
    return objective, truth


def test_an_exchange_for_a_while_is_undone(model, markers):
    """Both wrists' markers are hidden at once twice, and their names exchanged in between."""
    one, other = (model.markerset.index(name) for name in LEFT_WRIST)
    hidden = markers.copy()
    for first in (100, 160):
        hidden[first : first + 10, [one, other]] = np.nan
    points, whose = pieces(hidden, hidden=0)
    first = np.isfinite(points[..., 0]).argmax(axis=0)
    between = np.isin(whose, (one, other)) & (first == 110)
    assert between.sum() == 2
    given = np.where(between, one + other - whose, whose)
    solution = solved_of(model, points, said(points, given, True, 0.6))
    assert solution.marker.tolist() == whose[solution.tracklets.lane].tolist()


@pytest.mark.parametrize("limb", [("LELB", "LWRA", "LWRB", "LFIN"), ("LKNE", "LANK", "LHEE", "LTOE")])
def test_a_limb_that_is_one_place_off_is_put_right(model, markers, limb):
    points, whose = pieces(markers)
    limb = [model.markerset.markers.index(name) for name in limb]
    given = whose.copy()
    for one, other in zip(limb, [*limb[1:], NO_MARKER], strict=True):
        given[whose == one] = other
    solution = solved_of(model, points, said(points, given, True, 0.9))
    assert (solution.marker == whose[solution.tracklets.lane]).mean() > 0.95


def test_a_few_frames_that_are_right_begin_it_anew(model, markers):
    points, whose = pieces(markers)
    lower = [at for at, name in enumerate(model.markerset.markers) if name[1:] in ("KNE", "ANK", "HEE", "TOE", "ASI")]
    worn = np.isin(whose, lower)
    points, whose = points[:, worn], whose[worn]
    upper = np.arange(26)
    upper[lower] = np.setdiff1d(upper, lower)[: len(lower)]
    right = np.arange(FRAMES)[:, None] % 50 == 7
    solution = solved_of(model, points, said(points, np.where(right, whose, upper[whose]), True))
    assert (solution.marker == whose[solution.tracklets.lane]).mean() > 0.95


def is_tried(marker: np.ndarray, proposals) -> bool:
    return any((one == marker).all() for one in proposals)


def test_a_name_that_another_has_for_a_while_goes_to_what_is_likelier_it(model, markers):
    one, other = (model.markerset.index(name) for name in LEFT_WRIST)
    hidden = markers.copy()
    hidden[BURST : BURST + 5, other] = np.nan
    hidden[2 * BURST : 2 * BURST + 5, one] = np.nan
    objective, truth = objective_of(model, *pieces(hidden, hidden=0))
    count = objective.tracklets.count
    given = np.where(count == 2 * BURST, NO_MARKER, np.where(count == BURST, one, truth))
    goes = np.where(count == BURST, NO_MARKER, truth)
    assert is_tried(goes, Search(objective, given, USUAL_FREEDOM)._alone())


def test_markers_of_a_long_take_are_looked_up_where_they_are_asked_for(model, markers):
    points, whose = pieces(markers)
    tracklets, _ = tracklets_in(model, points, whose)
    own = whose[tracklets.lane]
    placed = tracklets.placed(points, own, len(model.markerset))
    looked_up = tracklets.placed(points, own, len(model.markerset), LaneOptions(whole_cells=0))
    assert (seen_in(looked_up) == seen_in(placed)).all()
    np.testing.assert_array_equal(looked_up[5:90], placed[5:90])
    about = own, in_take(trained_pairs(model), placed), RATE
    np.testing.assert_array_equal(likeness(tracklets, looked_up, *about), likeness(tracklets, placed, *about))


def test_a_search_asks_the_shape_of_frames_that_the_names_it_begins_with_show(model, markers):
    """Of whole trajectories frames on their own may say this as often as that, and none is begun with by them."""
    tracklets, nothing = tracklets_in(model, markers, np.arange(26))
    search = Search(Objective(markers, tracklets, nothing, model, RATE), np.arange(26)[tracklets.lane], USUAL_FREEDOM)
    assert search.best.settled is not None


def test_an_extra_that_lasts_is_not_left_out_again_and_a_marker_may_be(model, markers):
    objective, truth = objective_of(model, *pieces(markers))
    objective.extras = 1
    marker = np.where(truth == 3, 26, truth)
    search = Search(objective, marker, USUAL_FREEDOM)
    for name, is_left_out in ((0, True), (26, False)):
        of = int(np.flatnonzero(marker == name)[0])
        assert any(one[of] == NO_MARKER for one in search._of_one(of)) == is_left_out


def test_what_had_the_name_of_an_extra_that_takes_it_may_be_nothing(model, markers):
    toe, extra = model.markerset.index("LTOE"), len(model.markerset)
    points, whose = np.concatenate([markers, markers[:, [toe]] + [0.0, 0.0, 0.01]], axis=1), np.arange(extra + 1)
    objective, truth = objective_of(model, points, whose)
    objective.extras = 1
    search = Search(objective, truth, USUAL_FREEDOM)
    tried = [one for one in search._exchanges() if (one[truth == extra] == toe).all()]
    assert {int(one[truth == toe][0]) for one in tried} == {NO_MARKER, extra}


def test_of_a_marker_and_an_extra_the_shape_knows_what_it_knows_of_one_marker(model, markers):
    toe, extra = model.markerset.index("LTOE"), len(model.markerset)
    points, whose = np.concatenate([markers, markers[:, [toe]] + [0.3, 0.0, 0.3]], axis=1), np.arange(extra + 1)
    objective, truth = objective_of(model, points, whose)
    objective.extras = 1
    order = np.arange(extra + 1)
    order[[toe, extra]] = extra, toe
    right, wrong = objective.of(truth), objective.of(order[truth])
    by_distances = (wrong.total - right.total) / objective.length
    by_distances += (wrong.layout - right.layout) / LIKENESS.max_samples
    lost = by_distances - objective.gain(wrong, right)
    assert lost == pytest.approx(OBJECTIVE.shape * OBJECTIVE.max_marker)


def test_what_another_solution_names_otherwise_is_not_sure_but_what_a_person_named(model, markers):
    points, whose = pieces(markers, hidden=0)
    solution = solved_of(model, points, said(points, whose, True))
    one, other = (model.markerset.index(name) for name in LEFT_WRIST)
    turned = replace(solution, marker=exchanged(model, *LEFT_WRIST)[solution.marker])
    assert (solution.margin > 0).all()
    assert ((solution.doubted(turned).margin == 0) == np.isin(solution.marker, (one, other))).all()
    held = np.where(solution.marker == one, one, NO_MARKER)
    sure = replace(solution, tracklets=replace(solution.tracklets, held=held)).doubted(turned)
    assert ((sure.margin == 0) == (solution.marker == other)).all()
    gone = replace(solution, marker=np.where(solution.marker == one, NO_MARKER, solution.marker))
    assert (solution.doubted(gone).margin == solution.margin).all(), "it is nowhere by the other"


def test_what_has_the_name_of_one_that_is_seldom_there_changes_it_and_the_name_is_given_again_or_not(model, markers):
    one, other = (model.markerset.index(name) for name in LEFT_WRIST)
    hidden = markers.copy()
    hidden[FRAMES // 3 : FRAMES // 3 + 5, one] = np.nan
    objective, truth = objective_of(model, *pieces(hidden, hidden=0))
    objective.extras = 1
    short = objective.tracklets.count < FRAMES // 2
    given = np.select([truth == other, (truth == one) & short, truth == one], [one, other, len(model.markerset)], truth)
    assert is_tried(truth, Search(objective, given, USUAL_FREEDOM)._shifted())
    ghost = (truth == one) & short
    given = np.select([ghost, truth == one], [other, one], np.where(truth == other, NO_MARKER, truth))
    dropped = np.where(ghost, NO_MARKER, given)
    assert is_tried(np.where(given == one, other, dropped), Search(objective, given, USUAL_FREEDOM)._shifted())


@pytest.mark.parametrize("size", [1.0, 0.8])
def test_wrists_that_have_each_others_names_are_on_the_wrong_side(model, markers, size):
    """By the sides alone: without them the same naming loses less."""
    points, whose = pieces(markers * size, hidden=0)
    lost = {}
    for sides in (model.likelihood.sides, NO_SIDES):
        own = replace(model, likelihood=replace(model.likelihood, sides=sides))
        objective, truth = objective_of(own, points, whose)
        right, wrong = (objective.of(names[truth]) for names in (np.arange(26), exchanged(own, *LEFT_WRIST)))
        lost[len(sides)] = right.layout - wrong.layout
    assert lost[len(model.likelihood.sides)] > lost[0] + 1


def test_a_group_is_tried_as_most_frames_on_their_own_have_it(model, markers):
    points, whose = np.concatenate([markers, markers[:, -2:] + 0.03], axis=1), np.arange(28)
    named = said(points, whose, whose < 26)
    tracklets = tracklets_of(points, cut(points, RATE), named, 26)
    objective, truth = Objective(points, tracklets, named, model, RATE), whose[tracklets.lane]
    objective.extras = 2
    order = np.array([*exchanged(model, *LEFT_WRIST)[:24], 26, 27, 24, 25])
    search = Search(objective, order[truth], USUAL_FREEDOM)
    assert search.best.marker[truth == 24] == 26
    for tried in search._as_said():
        search.propose(tried)
    assert (search.best.marker == truth).all()
    assert not list(search._as_said())


def test_of_a_limb_nobody_wears_one_marker_alone(model, markers):
    """Of a toe without anything near the program is not sure, though frames are; beside a heel and an ankle it is."""
    toe = model.markerset.index("LTOE")
    feet = [at for at, name in enumerate(model.markerset.markers) if name[1:] in ("KNE", "ANK", "HEE", "TOE")]
    for away in ([], [at for at in feet if at != toe]):
        worn = markers.copy()
        worn[:, away] = np.nan
        points, whose = pieces(worn, hidden=0)
        solution = solved_of(model, points, said(points, whose, True))
        margin = solution.margin[solution.marker == toe]
        assert len(margin) and ((margin == 0) == bool(away)).all()


def layout_names(model, placed: np.ndarray):
    """What the layout says of markers placed (T, M, 3) m, of which nobody has named one."""
    shown = placed[fullest_frames(np.isfinite(placed[..., 0]))]
    return named_by_layout(model.likelihood, shown, np.zeros(0, int))


def test_names_exchanged_in_all_of_the_take_are_put_right_and_those_that_are_right_stay(model, markers):
    for pair in (LEFT_WRIST, ("LANK", "LTOE"), ("LELB", "RELB")):
        order = exchanged(model, *pair)
        name, _ = layout_names(model, markers[:, order])
        assert name.tolist() == order.tolist(), pair
    name, questions = layout_names(model, markers)
    assert name.tolist() == list(range(len(model.markerset)))
    assert all(question.odds >= -1 for question in questions)


def test_names_that_some_poses_contradict_are_a_question(model, markers):
    one, other = (model.markerset.markers.index(name) for name in ("LANK", "LTOE"))
    placed = markers.copy()
    placed[::3, [one, other]] = placed[::3, [other, one]]
    placed[1::9, [one, other]] = placed[1::9, [other, one]]
    name, questions = layout_names(model, placed)
    assert name.tolist() == list(range(len(name)))
    assert {one, other} in [{question.one, question.other} for question in questions]


@pytest.mark.parametrize(("frames", "heard", "targets"), [(80, False, (0.9, 0.999)), (15, True, (0.999,))])
def test_a_ghost_is_no_marker_that_is_not_there(model, markers, frames, heard, targets):
    """It bears itself out, and frames may hear of it; but a marker that is worn is there for longer."""
    hidden = model.markerset.markers.index("LKNE")
    points, whose = pieces(np.where(np.arange(markers.shape[1])[:, None] == hidden, np.nan, markers))
    ghost = np.full((FRAMES, 1, 3), np.nan)
    ghost[100 : 100 + frames, 0] = markers[100 : 100 + frames, hidden] + [0.01, 0.0, 0.01]
    points, whose = np.concatenate([points, ghost], axis=1), np.r_[whose, hidden if heard else NO_MARKER]
    named = said(points, whose, whose >= 0)
    solution = solved_of(model, points, named)
    assert hidden in solution.marker
    for target in targets:
        assert not told(model, solution, named, target).labels.named[:, -1].any()


def test_what_is_carried_along_is_no_marker_that_is_not_worn(model, markers):
    """It keeps its distances, and so bears out whatever it is called; who stood for the set has them otherwise."""
    foot = [model.markerset.index(name) for name in ("LKNE", "LANK", "LHEE", "LTOE")]
    tool = [[0.1, 0.2, -0.3], [0.15, 0.25, -0.3], [0.1, 0.3, -0.4], [0.2, 0.2, -0.5]]
    worn, held = markers.copy(), markers[:, [model.markerset.index("SACR")]] + tool
    worn[:, foot] = np.nan
    points, whose = pieces(worn, hidden=0)
    points, whose = np.concatenate([points, held], axis=1), np.r_[whose, foot]
    named, stood = said(points, whose, True), TrainingTake("who", ("stands",), 1, markers[:1])
    solution = solved_of(replace(model, training_takes=(stood,)), points, named)
    assert np.isin(foot, solution.marker).any()
    assert not told(model, solution, named).labels.named[:, -4:].any()


def test_frames_in_no_order_and_sets_on_rigid_bodies_are_not_solved(model):
    assert can_be_solved(model, np.tile(np.arange(4), (20, 1)))
    assert not can_be_solved(model, np.arange(80).reshape(20, 4))
    assert not can_be_solved(model, np.full((20, 4), -1))


def test_a_plate_turned_round_is_worth_less_however_far_it_sits_from_its_place(model, markers):
    """As much off for all of its markers is less than twice as much for some: squares have no limit."""
    four = [model.markerset.index(name) for name in ("LKNE", "LANK", "LHEE", "LTOE")]
    moved = markers.copy()
    moved[:, four] += [0.0, 0.0, 0.12]
    objective, truth = objective_of(model, *pieces(moved, hidden=0))
    round_about = np.arange(len(model.markerset))
    round_about[four] = four[::-1]
    assert objective.of(truth).layout > objective.of(round_about[truth]).layout


@pytest.mark.parametrize(("off", "part"), [(0.0, 0.9), (0.015, 0.1)], ids=["as learned", "put on again"])
def test_an_exchange_of_markers_that_were_not_put_on_again_is_told_by_millimetres(off, part):
    """Three corners of a plate may change places with 12 mm of difference; who wears it elsewhere says nothing."""
    rng = np.random.default_rng(4)
    places = np.concatenate([[[0, 0, 0], [0.1, 0, 0], [0.05, 0.09, 0], [0.05, 0.04, 0.07]], rng.random((16, 3)) * 0.5])
    worn = places + off * rng.standard_normal(places.shape)
    still = moments(worn + 0.001 * rng.standard_normal((50, *places.shape)))
    turned = moments(worn[[1, 2, 0, *range(3, 20)]] + 0.001 * rng.standard_normal((50, *places.shape)))
    mean = moments(np.repeat(places[None], 2, axis=0)).mean
    known = PairDistances(mean, (0.04 * mean) ** 2 + 0.015**2, np.zeros_like(mean))
    unmoved = Unmoved(known, np.zeros(len(places), int), still)
    assert unmoved.part > part if off == 0 else unmoved.part < part
    lead = unmoved.odds(still) - unmoved.odds(turned)
    assert lead > 5 if off == 0 else abs(lead) < 1


@pytest.fixture(scope="module")
def everything(model, markers):
    """Labels by which both wrists' markers have each other's names in all of the take."""
    return said(markers, exchanged(model, *LEFT_WRIST), True)


def rulings_of(model, markers, labels: Labels, *edits) -> Rulings:
    cells = cells_of_take(anonymous(markers, RATE), model.markerset.by_name, len(model.markerset))
    return Rulings(apply_edits(labels, Edits(edits), cells).edited, labels, cut(markers, RATE), None)


def solved(model, markers, labels: Labels, rulings: Rulings) -> np.ndarray:
    """(T, P) the markers of the take once it is solved with the rulings."""
    heard = rulings.applied_to(labels)
    solution = finished(solve_take(markers, rulings.parted(), heard, model, RATE, rulings=rulings))
    return told(model, solution, heard).labels.marker


def test_one_frame_of_one_marker_puts_the_whole_take_right(model, markers, everything):
    """The other marker too, before that frame and after it, though every frame says otherwise."""
    one = model.markerset.index(LEFT_WRIST[0])
    rulings = rulings_of(model, markers, everything, AssignPoint(one, LEFT_WRIST[0], frames=(100, 100)))
    marker = solved(model, markers, everything, rulings)
    assert (marker == np.where(np.isfinite(markers[..., 0]), np.arange(len(model.markerset)), NO_MARKER)).all()


def test_a_held_name_is_believed_against_everything_and_is_nobody_elses(model, markers, everything):
    knee, toe = (model.markerset.index(name) for name in ("RKNE", "LTOE"))
    rulings = rulings_of(model, markers, everything, AssignPoint(knee, "LTOE", frames=(50, 150)))
    marker = solved(model, markers, everything, rulings)
    assert (marker[49:150, knee] == toe).all()
    assert not (marker[49:150, toe] == toe).any()
    # So odd a word may cost the toe its name elsewhere, and gives it to nobody else.
    assert np.isin(marker[:, toe], (toe, NO_MARKER)).all()
    assert (np.isin(marker, toe).sum(axis=1) <= 1).all()


def test_tracklets_end_where_what_is_said_of_them_does(model, markers, everything):
    knee, toe, back = (model.markerset.index(name) for name in ("RKNE", "LTOE", "C7"))
    edits = AssignPoint(knee, "LTOE", frames=(11, 20)), Delete(back, frames=(1, 30))
    rulings = rulings_of(model, markers, everything, *edits)
    tracklet = rulings.parted()
    ends = [np.flatnonzero(np.diff(tracklet[:, column])).tolist() for column in (knee, toe, back)]
    assert ends == [[9, 19], [9, 19], [29]]
    assert (tracklet[:30, back] == -1).all()
    pieces = rulings.of(tracklets_of(markers, tracklet, everything, len(model.markerset)))
    (held,) = np.flatnonzero(pieces.held != NO_MARKER)
    assert (pieces.held[held], pieces.first[held], pieces.last[held]) == (toe, 10, 19)
    assert pieces.votes[held].argmax() == toe


def test_a_tracklet_is_cut_at_a_gap_in_which_another_has_its_name(model, markers, everything):
    toe = model.markerset.index("LTOE")
    broken = np.concatenate([markers, np.full((FRAMES, 1, 3), np.nan)], axis=1)
    broken[100:120, -1] = broken[100:120, toe]
    broken[98:122, toe] = np.nan
    labels = Labels(*(np.pad(column, ((0, 0), (0, 1))) for column in vars(everything).values()))
    labels.marker[:, -1] = NO_MARKER
    whole = cut(broken, RATE)
    assert whole[0, toe] == whole[-1, toe]
    parted = rulings_of(model, broken, labels, AssignPoint(broken.shape[1] - 1, "LTOE")).parted()
    assert parted[0, toe] != parted[-1, toe]
    without = rulings_of(model, broken, labels, UnlabelMarker("C7")).parted()
    assert without[0, toe] == without[-1, toe]


def test_what_is_nobodys_is_not_named_and_what_has_no_name_goes_on_as_a_person_called_it(model, markers, everything):
    rulings = rulings_of(model, markers, everything, UnlabelMarker("LTOE", frames=(1, 200)))
    marker = solved(model, markers, everything, rulings)
    toe = model.markerset.index("LTOE")
    assert not (marker[:200] == toe).any()
    assert (marker[202:, toe] == toe).all()
    toe, back, knee = (model.markerset.index(name) for name in ("LTOE", "C7", "RKNE"))
    labels = everything.kept(~np.isin(np.arange(markers.shape[1]), [toe, back]) & everything.named)
    edits = AssignPoint(toe, "LTOE", frames=(100, 100)), UnlabelMarker("LTOE", frames=(200, 210))
    rulings = rulings_of(model, markers, labels, *edits, AssignPoint(knee, "LKNE", frames=(5, 6)))
    present = np.isfinite(markers[:, toe, 0])
    carried = np.flatnonzero(rulings.carried[:, toe] == toe)
    expected = np.setdiff1d(np.flatnonzero(present), [99, *range(199, 210)])
    assert carried.tolist() == expected.tolist()
    assert (np.delete(rulings.carried, toe, axis=1) == NO_MARKER).all()
    assert (rulings.applied_to(labels).marker[expected, toe] == toe).all()
    assert (rulings.start[99, toe], rulings.start[98, toe]) == (toe, toe)
