# SPDX-License-Identifier: GPL-3.0-or-later
"""Two people who pass each other: whose tracklets are whose, how many there are, and their names from end to end."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.data.errors import JobError
from addon.core.data.lanes import LaneOptions
from addon.core.data.progress import finished
from addon.core.data.takes import Labels, Points, Suspect, Verdict
from addon.core.geometry.rotations import exponential
from addon.core.points.several import affinity, bodies, pipeline
from addon.core.points.several.affinity import Affinity
from addon.core.points.several.bodies import RecognisingOptions
from addon.core.points.several.counting import count_bodies
from addon.core.points.several.identification import PersonBuild, identified, likeliest
from addon.core.points.several.parting import parted
from addon.core.points.several.pipeline import label_several
from addon.core.points.several.presence import UnidentifiedPresence, ways_of
from addon.core.points.several.sharing import SHARING, share, shared_out
from addon.core.points.several.together import joined
from addon.core.points.several.wearers import AUTO, SetsWorn, SeveralOptions, Wearer
from addon.core.points.tracklets import cut
from addon.core.points.whole_take import asking
from addon.core.points.whole_take.pipeline import PointOptions, label_points, name_frames, name_more
from addon.core.simulation.virtual import Act, draw_person, perform
from addon.io.markersets import markerset_file
from addon.io.models import open_model, read_model

RATE = 60.0
FRAMES = 100
HIDDEN = slice(40, 52)


@cache
def person(seed: int, way: int, lane: float) -> np.ndarray:
    """(T, 15, 3) m: a virtual person in gait15 who walks along x, or the other way, and is at x = 0 in the middle."""
    markerset = open_model("gait15").markerset
    model, generator = BodyModel(markerset), np.random.default_rng(seed)
    bodies = perform(model, draw_person(markerset, generator), [Act(FRAMES / RATE)], rate=RATE)
    markers = model.pose(bodies).markers[:FRAMES]
    middle = markers[..., :2].mean(axis=1)
    along = middle[-1] - middle[0]
    turn = -np.arctan2(along[1], along[0]) + (np.pi if way < 0 else 0)
    cos, sin = np.cos(turn), np.sin(turn)
    flat = (markers[..., :2] - middle[FRAMES // 2]) @ np.array([[cos, sin], [-sin, cos]]) + [0, lane]
    return np.concatenate([flat, markers[..., 2:]], axis=2) + generator.normal(0, 0.0005, markers.shape)


@pytest.fixture(scope="module")
def passing() -> tuple[Points, np.ndarray]:
    """Two people who pass 0.6 m from each other, a few markers hidden as they do, shuffled; and whose which is."""
    columns, truth = [], []
    for index, whole in enumerate((person(1, 1, 0.0), person(2, -1, 0.6))):
        for marker in range(15):
            tracks = [whole[:, marker].copy()]
            if marker % 5 == index:
                tracks = [tracks[0], tracks[0].copy()]
                tracks[0][HIDDEN.start :] = np.nan
                tracks[1][: HIDDEN.stop] = np.nan
            columns += tracks
            truth += [marker + 15 * index] * len(tracks)
    order = np.random.default_rng(3).permutation(len(columns))
    xyz = np.stack([columns[index] for index in order], axis=1)
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0005, np.nan)
    return Points(("",) * len(order), xyz, residual, RATE, 1), np.array(truth)[order]


def matched(given: np.ndarray, truth: np.ndarray, present: np.ndarray) -> tuple[int, int]:
    """Right and wrong labels (T, P), whichever of the two is called 1."""
    wanted = np.where(present, truth, -1)
    best = None
    for shift in (0, 15):
        named = np.where(given >= 0, (given + shift) % 30, -1)
        right, wrong = int(((named == wanted) & (named >= 0)).sum()), int(((named != wanted) & (named >= 0)).sum())
        best = (right, wrong) if best is None or right > best[0] else best
    return best


def test_tracklets_are_parted_by_what_they_keep_their_distance_to(passing):
    take, truth = passing
    tracklet = cut(take.xyz, take.rate)
    held = Affinity.of(take.xyz, tracklet, take.rate)
    found = parted(take.xyz, tracklet, held, 2)
    assert set(found.body.tolist()) == {0, 1}
    for index in range(2):
        assert len(set(found.body[truth // 15 == index].tolist())) == 1
    assert (found.may.sum(axis=1) == 1).mean() > 0.8
    assert count_bodies(take.xyz, tracklet, held, 15)[1] == 2


@pytest.mark.parametrize("count", [2, AUTO])
def test_two_who_pass_each_other_are_named(passing, count):
    take, truth = passing
    asked = SeveralOptions(open_model("gait15"), count)
    found = finished(label_several(take, asked, PointOptions("likelihood")))
    assert [one.name for one in found.worn.subjects] == ["1", "2"]
    right, wrong = matched(found.labels.marker, truth, take.present)
    assert wrong == 0
    assert right > 0.95 * take.present.sum()
    motion = found.motion.part(slice(0, FRAMES))
    assert motion.markers.shape == (FRAMES, 30, 3)
    assert found.labels.marker[:, 0].max() < 15, "who is first in the file is 1"


def test_a_long_take_is_named_the_same_way(passing, monkeypatch):
    take, _ = passing
    asked, options = SeveralOptions(open_model("gait15"), AUTO), PointOptions("likelihood")
    whole = finished(label_several(take, asked, options))
    monkeypatch.setattr(bodies, "PACKING", LaneOptions(whole_cells=0))
    monkeypatch.setattr(affinity, "FRAMES_MET_AT_ONCE", 3)
    parts = finished(label_several(take, asked, options))
    for name in ("marker", "step", "confidence"):
        np.testing.assert_array_equal(getattr(parts.labels, name), getattr(whole.labels, name))


def alone() -> tuple[Points, np.ndarray]:
    """A take of one, and its tracklets (T, 15): one a marker."""
    whole = person(1, 1, 0.0)
    take = Points(("",) * 15, whole, np.full(whole.shape[:2], 0.0005), RATE, 1)
    return take, cut(take.xyz, take.rate)


def test_one_is_named_as_ever():
    take, _ = alone()
    model = open_model("gait15")
    found = finished(label_several(take, SeveralOptions(model, AUTO), PointOptions("likelihood")))
    ever = finished(label_points(take, model, PointOptions("likelihood")))
    assert [one.name for one in found.worn.subjects] == ["1"]
    assert np.array_equal(found.labels.marker, ever.labels.marker)


def test_frames_in_doubt_may_be_asked_later(monkeypatch):
    take, tracklet = alone()
    monkeypatch.setattr(asking, "ASKING", replace(asking.ASKING, max_unsure=-1.0))
    given = take, tracklet, open_model("gait15"), PointOptions("likelihood")
    first = finished(name_frames(*given, first_only=True))
    later, at_once = finished(name_more(first)), finished(name_frames(*given))
    assert first.first is not None
    assert later.first is at_once.first is None
    assert (first.labels.confidence != at_once.labels.confidence).any()
    for name in ("marker", "step", "confidence", "rate"):
        np.testing.assert_array_equal(getattr(later.labels, name), getattr(at_once.labels, name))


@pytest.mark.parametrize(("markers", "is_half"), [(15, False), (7, True)])
def test_half_a_body_is_known_by_what_single_frames_name(markers, is_half):
    take, tracklet = alone()
    crowd = bodies.Crowd(take, tracklet, PointOptions("likelihood"))
    some = np.arange(15) < markers
    naming = bodies.BodyNaming(crowd, some, some, open_model("gait15"), bodies.recognised_before)
    assert finished(naming.is_half()) == is_half


def test_two_where_one_was_asked_for_are_told_how_to_have_both(passing):
    take, _ = passing
    with pytest.raises(JobError, match="--subjects") as caught:
        finished(label_points(take, open_model("gait15"), PointOptions("likelihood")))
    assert "two subjects" in caught.value.message or "several subjects" in caught.value.message


def test_more_than_there_are_are_refused(passing):
    take, _ = passing
    with pytest.raises(JobError, match="fewer than 3 subjects who wear gait15; expected"):
        finished(label_several(take, SeveralOptions(open_model("gait15"), 3), PointOptions("likelihood")))


def test_whom_single_frames_are_not_sure_of_must_sit_as_the_set_has_them_once_all_is_shared_out(passing, monkeypatch):
    take, truth = passing
    asked = SeveralOptions(open_model("gait15"), 2)
    monkeypatch.setattr(pipeline, "frames_are_sure", bodies.take_will_say)
    found = finished(label_several(take, asked, PointOptions("likelihood")))
    right, wrong = matched(found.labels.marker, truth, take.present)
    assert wrong == 0
    assert right > 0.95 * take.present.sum()
    shared = []
    monkeypatch.setattr(pipeline, "share", lambda *given: shared.append(given) or share(*given))
    monkeypatch.setattr(bodies, "RECOGNISING", RecognisingOptions(max_residual=1e-3))
    with pytest.raises(JobError, match="fewer than 2 subjects"):
        finished(label_several(take, asked, PointOptions("likelihood")))
    assert shared, "nobody is judged before"


def test_two_who_lie_are_told_as_any_who_are_not_there():
    people = [lying(person(3, 1, 0.0), 0.15), lying(person(4, -1, 1.0), 0.4)]
    take, _ = shown(people)
    with pytest.raises(JobError, match="shows fewer than 2 subjects who wear gait15") as caught:
        finished(label_several(take, SeveralOptions(open_model("gait15"), 2), PointOptions("likelihood")))
    assert "--subjects" not in caught.value.message


def lying(whole: np.ndarray, height: float) -> np.ndarray:
    """Somebody (T, M, 3) m on their back but for the first and the last frames, so high (m)."""
    part = (1 - np.cos(np.pi * np.clip((1 - np.abs(np.linspace(-1, 1, len(whole)))) / 0.15, 0, 1))) / 2
    middle = whole.mean(axis=1, keepdims=True)
    turn = exponential(np.outer(part * np.pi / 2, [0.0, 1.0, 0.0]))[0]
    flat = np.einsum("tij,tmj->tmi", turn, whole - middle) + middle
    return flat + part[:, None, None] * (np.array([0.0, 0.0, height]) - middle)


def test_people_whose_models_are_one_have_their_names_in_the_order_of_the_file(passing):
    take, _ = passing
    model, again = open_model("gait15"), read_model(markerset_file("gait15"))
    asked = SeveralOptions(subjects=(Wearer("bob", model), Wearer("ann", again)))
    found = finished(label_several(take, asked, PointOptions("likelihood")))
    assert [one.name for one in found.worn.subjects] == ["bob", "ann"]
    numbered = finished(label_several(take, SeveralOptions(model, 2), PointOptions("likelihood")))
    assert np.array_equal(found.labels.marker, numbered.labels.marker)


def test_people_of_two_models_who_are_as_like_one_as_the_other_cannot_be_told_apart(passing):
    take, _ = passing
    model = open_model("gait15")
    asked = SeveralOptions(subjects=(Wearer("ann", model), Wearer("bob", replace(model, fingerprint="another"))))
    with pytest.raises(JobError, match="who is ann and bob cannot be told"):
        finished(label_several(take, asked, PointOptions("likelihood")))


def test_the_surer_keeps_what_two_claim():
    may = np.array([[True, True], [True, True], [True, False], [True, True]])
    certainty = np.array([[9.0, 9.0 - SHARING.lead], [5.0, 5.0], [0.0, 8.0], [0.0, 3.0]])
    assert shared_out(may, certainty).tolist() == [[True, False], [False, False], [True, False], [True, True]]


def test_who_is_who_is_the_likeliest_way_round():
    cost = np.array([[9.0, 1.0], [2.0, 6.0], [20.0, 20.0]])
    assert identified(cost, [0, 1]) == ([1, 0], 12.0)
    assert identified(np.array([[np.inf], [2.0]]), [0]) == ([1], np.inf)
    assert identified(np.array([[np.inf, np.inf]]).T[:, :1], [0])[1] == -np.inf
    alike = np.array([[5.0, 5.0, 1.0], [1.0, 1.0, 9.0], [2.0, 2.0, 8.0]])
    assert identified(alike, [0, 0, 2]) == ([1, 2, 0], 10.0), "in their order, and no tie between those who are alike"


def test_markers_of_all_are_called_after_their_subjects():
    model = open_model("gait15")
    worn = SetsWorn((Wearer("ann", model), Wearer("2", model)))
    assert (len(worn), worn.markers[0], worn.markers[15]) == (30, "ann:SACR", "2:SACR")
    assert worn.by_name["2:SACR"] == 15
    assert worn.name == "gait15"


def absent(whole: np.ndarray, first: int, after: int, elsewhere: float = 0.0) -> np.ndarray:
    """Somebody (T, M, 3) m who is not there in some frames, and so far aside (y, m) after them."""
    found = whole.copy()
    found[after:, :, 1] += elsewhere
    found[first:after] = np.nan
    return found


def shown(people: list[np.ndarray]) -> tuple[Points, np.ndarray]:
    """A take of people (T, 15, 3) m with a trajectory for each time that a marker is there; and whose marker it is."""
    columns, truth = [], []
    for index, whole in enumerate(people):
        for marker in range(whole.shape[1]):
            seen = np.flatnonzero(np.isfinite(whole[:, marker, 0]))
            for part in np.split(seen, np.flatnonzero(np.diff(seen) > 1) + 1):
                columns.append(np.full((len(whole), 3), np.nan))
                columns[-1][part] = whole[part, marker]
                truth.append(marker + whole.shape[1] * index)
    order = np.random.default_rng(3).permutation(len(columns))
    xyz = np.stack(columns, axis=1)[:, order]
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0005, np.nan)
    return Points(("",) * len(order), xyz, residual, RATE, 1), np.array(truth)[order]


@pytest.mark.parametrize(
    "people",
    [
        [person(1, 1, 0.0), absent(person(2, -1, 0.6), 30, 70, -2.5)],
        [absent(person(1, 1, 0.0), 35, 65, 0.8), absent(person(2, -1, 0.8), 35, 65, -0.8)],
    ],
    ids=["one leaves", "both leave, and come back in each other's lane"],
)
def test_who_comes_back_is_who_left(people):
    take, truth = shown(people)
    found = finished(label_several(take, SeveralOptions(open_model("gait15"), 2), PointOptions("likelihood")))
    right, wrong = matched(found.labels.marker, truth, take.present)
    assert wrong == 0
    assert right > 0.9 * take.present.sum()


def test_who_comes_back_and_may_be_either_is_asked():
    """Two of one build leave together: nothing tells which of them comes back where."""
    take, truth = shown([absent(person(1, 1, 0.0), 35, 65), absent(person(1, -1, 0.8), 35, 65)])
    found = finished(label_several(take, SeveralOptions(open_model("gait15"), 2), PointOptions("likelihood")))
    assert matched(found.labels.marker, truth, take.present)[1] == 0
    named = found.labels.named.any(axis=1)
    (asked,) = [one for one in found.suspects if "who may be 1 or 2" in one.words]
    assert not named[asked.first - 1 : asked.last].any(), "nobody has a name where it is asked who they are"
    assert asked.frames == 35 and named.sum() == 35


def test_a_presence_that_a_person_has_named_is_asked_no_more():
    there, tracklet = np.arange(10) >= 4, np.zeros((10, 3), int)
    tracklet[:, 1:], tracklet[:4, 2] = [1, 2], -1
    presence, labels = UnidentifiedPresence(there, np.array([False, True, True])), Labels.none(10, 3)
    assert presence.is_open(tracklet, labels)
    labels.marker[:, 0] = 0
    assert presence.is_open(tracklet, labels), "that is somebody else's"
    labels.marker[:, 1] = 1
    assert not presence.is_open(tracklet, labels)


def test_whose_a_presence_is_follows_from_who_is_there():
    there = np.zeros((90, 3), bool)
    there[:, 0] = there[:30, 1] = there[60:, 2] = True
    assert ways_of(there, 2) == [(1,)]
    there = np.zeros((90, 4), bool)
    there[:40, :2] = there[50:, 2:] = True
    assert ways_of(there, 2) == [(0, 1), (1, 0)]
    there[:, 3] = True
    assert ways_of(there, 2) == []


def test_presences_go_to_whoever_is_built_so():
    way, lead = likeliest([(0, 1), (1, 0)], np.array([[9.0, 2.0], [1.0, 7.0]]))
    assert (way, lead) == ((1, 0), 13.0)
    generator = np.random.default_rng(4)
    mean = generator.uniform(0.1, 1.5, (15, 15))
    markers, steady = open_model("gait15").markerset.markers, np.full((15, 15), 1e-4)
    own = PersonBuild(markers, mean, steady)
    assert own.cost(PersonBuild(markers, mean * 1.002, steady), 0.003) < 1
    assert own.cost(PersonBuild(markers, mean * 1.2, steady), 0.003) > 1
    assert own.cost(PersonBuild(markers[::-1], mean, steady), 0.003) == np.inf
    assert own.cost(PersonBuild(markers, np.full((15, 15), np.nan), steady), 0.003) == np.inf


@pytest.mark.parametrize("tables", [0, 3, 6])
def test_a_full_disk_is_told_and_is_not_that_nobody_is_there(passing, tables):
    """Wherever in the work a table more has no room."""
    left = tables

    def room(shape, kind):
        nonlocal left
        left -= 1
        if left < 0:
            raise JobError("there is no room; expected some")
        return np.empty(shape, kind)

    options = PointOptions("likelihood", room=room)
    with pytest.raises(JobError, match="there is no room"):
        finished(label_several(passing[0], SeveralOptions(open_model("gait15"), 2), options))


def test_of_whom_nobody_asked_for_nothing_is_to_be_looked_at():
    model = open_model("gait15")
    worn = SetsWorn((Wearer("ann", model), Wearer("?0", model, asked=False)))
    said = Verdict(Labels.none(2, 3), (Suspect(1, 2, "left and right may be exchanged", markers=("LKNE",)),))
    assert [one.markers for one in joined(worn, [said, said]).suspects] == [("ann:LKNE",)]
    assert worn.asked.markers == worn.markers[:15]


@pytest.mark.parametrize("count", [2, AUTO])
def test_two_who_stand_still_for_long_are_as_sure_as_for_a_moment(count):
    """Nobody learns more of a distance that nothing happens to."""
    poses = [person(seed, 1, 0.0)[:1] for seed in (1, 2)]
    poses = [one - one.mean(axis=1, keepdims=True) * [1, 1, 0] for one in poses]
    still = np.concatenate([poses[0], poses[1] + [0, 1.0, 0]], axis=1)
    xyz = still + np.random.default_rng(0).normal(0, 0.0003, (5000, 30, 3))
    take = Points(("",) * 30, xyz, np.full(xyz.shape[:2], 0.0005), 50.0, 1)
    found = finished(label_several(take, SeveralOptions(open_model("gait15"), count), PointOptions("likelihood")))
    right, wrong = matched(found.labels.marker, np.arange(30), take.present)
    assert (right, wrong) == (take.present.sum(), 0)
