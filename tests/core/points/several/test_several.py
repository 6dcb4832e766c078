# SPDX-License-Identifier: GPL-3.0-or-later
"""Two people in one take: whose tracklets are whose, how many there are, and their names from end to end."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.data.errors import JobError
from addon.core.data.lanes import LaneOptions
from addon.core.data.progress import finished
from addon.core.data.takes import Labels, Points
from addon.core.edits.kinds import AssignPoint, Edits
from addon.core.geometry.rotations import rotation_vector, turn_of
from addon.core.geometry.upright import turned
from addon.core.points.motion import motion_of
from addon.core.points.refusals import REFUSAL
from addon.core.points.several import affinity, bodies, pipeline
from addon.core.points.several.affinity import Affinity
from addon.core.points.several.identification import UnidentifiedPresence, doubt_contested, lacking, share
from addon.core.points.several.parting import NO_BODY, bodies_by_place, parted
from addon.core.points.several.pipeline import is_prop, label_several
from addon.core.points.several.together import FinerBodies
from addon.core.points.several.wearers import AUTO, SetsWorn, SeveralOptions, Wearer, kinds
from addon.core.points.whole_take.deciding import least_margin
from addon.core.points.whole_take.pipeline import PointOptions
from addon.core.points.whole_take.solution import Solution
from addon.core.points.whole_take.tracklets import tracklets_of
from addon.core.posing.finer import finer
from addon.core.simulation.virtual import Act, draw_person
from addon.core.training.pipeline import TrainingOptions, train
from addon.core.training.takes import LabelledTake
from addon.io.models import open_model
from tests.core.scenes import RATE, anonymous, in_pieces, walker
from tests.inputs.worn import with_fingers

FRAMES = 100
SURE = PointOptions("likelihood", 0.99)


@cache
def person(seed: int, way: int, lane: float) -> np.ndarray:
    """(T, 15, 3) m: a virtual person in gait15 who walks along x, or the other way, and is at x = 0 in the middle."""
    markers = walker("gait15", seed, [Act(FRAMES / RATE)])[:FRAMES]
    middle = markers.mean(axis=1) * [1, 1, 0]
    along = middle[-1] - middle[0]
    turn = -np.arctan2(along[1], along[0]) + (np.pi if way < 0 else 0)
    return turned(markers - middle[FRAMES // 2], np.full(FRAMES, turn)) + np.array([0, lane, 0])


def shown(people: list[np.ndarray]) -> tuple[Points, np.ndarray]:
    """A take of people (T, 15, 3) m with a trajectory for each time that a marker is there; and whose marker it is."""
    xyz, truth = in_pieces(np.concatenate(people, axis=1), np.random.default_rng(3))
    return anonymous(xyz), truth


@pytest.fixture(scope="module")
def passing() -> tuple[Points, np.ndarray]:
    """Two people who pass 0.6 m from each other, a few markers hidden as they do, shuffled; and whose which is."""
    people = [person(1, 1, 0.0).copy(), person(2, -1, 0.6).copy()]
    for index, whole in enumerate(people):
        whole[40:52, index::5] = np.nan
    return shown(people)


def labelled(take: Points, asked: SeveralOptions | int, **options):
    """The take labelled as that of so many people in gait15, or as is asked for."""
    asked = SeveralOptions(open_model("gait15"), asked) if isinstance(asked, int) else asked
    return finished(label_several(take, asked, PointOptions("likelihood", **options)))


def right_of(found, truth: np.ndarray, take: Points) -> float:
    """The part of the points with the right name, whichever of the two is called 1; 0 where one has a wrong name."""
    given, wanted = found.labels.marker, np.where(take.present, truth, -1)
    either = [np.where(given >= 0, (given + shift) % 30, -1) for shift in (0, 15)]
    return max((one == wanted)[take.present].mean() * (one == wanted)[one >= 0].all() for one in either)


@pytest.mark.parametrize("count", [2, AUTO])
def test_two_who_pass_each_other_are_named(passing, count):
    take, truth = passing
    found = labelled(take, count)
    assert [one.name for one in found.worn.subjects] == ["1", "2"]
    assert right_of(found, truth, take) > 0.95
    assert found.motion.part(slice(0, FRAMES)).markers.shape == (FRAMES, 30, 3)
    assert found.labels.marker[:, 0].max() < 15, "who is first in the file is 1"


def test_a_long_take_is_named_the_same_way_and_more_than_there_are_are_refused(passing, monkeypatch):
    take, _ = passing
    whole = labelled(take, AUTO)
    monkeypatch.setattr(bodies, "PACKING", LaneOptions(whole_cells=0))
    monkeypatch.setattr(affinity, "TRACKLETS_AT_ONCE", 40)
    parts = labelled(take, AUTO)
    for name in ("marker", "step", "confidence"):
        np.testing.assert_array_equal(getattr(parts.labels, name), getattr(whole.labels, name))
    with pytest.raises(JobError, match="fewer than 3 subjects who wear gait15; expected"):
        labelled(take, 3)


def test_whom_single_frames_are_not_sure_of_must_sit_as_the_set_has_them_once_all_is_shared_out(passing, monkeypatch):
    take, truth = passing
    monkeypatch.setattr(pipeline, "frames_are_sure", bodies.take_will_say)
    found = labelled(take, 2)
    assert right_of(found, truth, take) > 0.95
    shared = []
    monkeypatch.setattr(pipeline, "share", lambda *given: shared.append(given) or share(*given))
    monkeypatch.setattr(REFUSAL, "max_residual", 1e-3)
    with pytest.raises(JobError, match="fewer than 2 subjects"):
        labelled(take, 2)
    assert shared, "nobody is judged before"


def test_ghosts_are_offered_to_nobody_who_has_left():
    seen = np.array([[True, True, True, False], [False, False, False, False]])
    frames = SimpleNamespace(frame=np.array([[0, -1], [1, -1]]))
    np.testing.assert_array_equal(lacking(frames, seen), [[False, False, False, True], [False] * 4])


def sure_of_all(xyz: np.ndarray, parts: int = 1) -> bodies.NamedBody:
    """A body with markers at xyz (T, 15, 3) m in so many tracklets each, and a solution that is sure of all of them."""
    model, number = open_model("gait15"), np.arange(15 * parts)
    tracklet = np.repeat(number.reshape(parts, 15), len(xyz) // parts, axis=0)
    tracklets = tracklets_of(xyz, tracklet, Labels.none(*tracklet.shape), 15)
    marker = number % 15
    solution = Solution(tracklets, marker, marker, 0, np.full(len(number), 40.0), (), marker, ())
    return bodies.NamedBody(model, SimpleNamespace(take=anonymous(xyz)), solution)


def test_no_solution_is_surer_of_a_name_than_it_is_ahead_of_another_body_with_it():
    one, near, far = (sure_of_all(person(1, 1, lane)) for lane in (0.0, 0.02, 5.0))
    doubt_contested([one, near], replace(SURE, traced=True))
    assert (one.solution.margin == 40).all() and (near.solution.margin == 40).all(), "as cameras traced their points"
    doubt_contested([one, far], SURE)
    assert (one.solution.margin == 40).all()
    doubt_contested([one, near], SURE)
    assert (one.solution.margin < least_margin(0.99)).all()
    assert (near.solution.margin < least_margin(0.99)).all()
    person_said = sure_of_all(person(1, 1, 0.0))
    person_said.solution.tracklets.held[3] = 3
    doubt_contested([person_said, near], SURE)
    assert np.flatnonzero(person_said.solution.margin == 40).tolist() == [3]
    person_said, near = sure_of_all(person(1, 1, 0.0)), sure_of_all(person(1, 1, 0.02))
    person_said.solution.tracklets.held[:] = person_said.solution.marker
    doubt_contested([person_said, near], SURE)
    assert (near.solution.margin >= least_margin(0.99)).all(), "what a person named is not taken in exchange"


def test_what_nobody_contests_shows_how_a_body_is_built():
    """An ankle sits where another's may, and is known by where it sat before the other came beside."""
    one = person(1, 1, 0.0)
    beside = one + np.array([0.35, 0.0, 0.0])
    ankle = open_model("gait15").markerset.index("LANK")
    one[:, ankle] += [0.2, 0.0, 0.0]
    late = beside + np.where(np.arange(FRAMES)[:, None, None] < FRAMES // 2, [0.0, 5.0, 0.0], 0.0)
    for there, sure in ((beside, False), (late, True)):
        body = sure_of_all(one, 2)
        doubt_contested([body, sure_of_all(there, 2)], SURE)
        assert (body.solution.margin[15 + ankle] >= least_margin(0.99)) == sure


def test_people_of_two_models_who_are_as_like_one_as_the_other_cannot_be_told_apart(passing):
    take, _ = passing
    model = open_model("gait15")
    asked = SeveralOptions(subjects=(Wearer("ann", model), Wearer("bob", replace(model, fingerprint="another"))))
    with pytest.raises(JobError, match="who is ann and bob cannot be told"):
        labelled(take, asked)


def test_people_who_are_there_for_a_part_of_the_take_are_named(passing):
    take, truth = passing
    nobody = np.full((3 * FRAMES, *take.xyz.shape[1:]), np.nan)
    late = anonymous(np.concatenate([nobody, take.xyz]), take.rate)
    assert right_of(labelled(late, 2), truth, late) > 0.9


def test_who_wears_one_model_does_so_with_what_joints_the_body_has_beside_its():
    model = replace(open_model("body39"), fingerprint="")
    worn = SetsWorn((Wearer("ann", model), Wearer("bob", model))).finer
    assert worn.worn[0][1] is not model.markerset
    first, _ = worn.subjects
    assert kinds(worn.subjects) == (first, first)


def absent(whole: np.ndarray, first: int, after: int, elsewhere: float = 0.0) -> np.ndarray:
    """Somebody (T, M, 3) m who is not there in some frames, and so far aside (y, m) after them."""
    found = whole.copy()
    found[after:, :, 1] += elsewhere
    found[first:after] = np.nan
    return found


@pytest.mark.parametrize(
    "people",
    [
        [person(1, 1, 0.0), absent(person(2, -1, 0.6), 30, 70, -2.5)],
        [absent(person(1, 1, 0.0), 35, 65, 0.8), absent(person(2, -1, 0.8), 35, 65, -0.8)],
        [absent(person(1, 1, 0.0), 35, 65, 0.8), absent(absent(person(2, -1, 0.8), 35, 65, -0.8), 86, 96)],
    ],
    ids=[
        "one leaves",
        "both leave, and come back in each other's lane",
        "one of them again, and too shortly to compare",
    ],
)
def test_who_comes_back_is_who_left(people):
    take, truth = shown(people)
    found = labelled(take, 2)
    assert right_of(found, truth, take) > 0.9


def test_who_comes_back_and_may_be_either_is_asked():
    """Two of one build leave together: nothing tells which of them comes back where."""
    take, truth = shown([absent(person(1, 1, 0.0), 35, 65), absent(person(1, -1, 0.8), 35, 65)])
    found = labelled(take, 2)
    assert right_of(found, truth, take) > 0
    named = found.labels.named.any(axis=1)
    (asked,) = [one for one in found.suspects if "who may be 1 or 2" in one.words]
    assert not named[asked.first - 1 : asked.last].any(), "nobody has a name where it is asked who they are"
    assert asked.frames == 35 and named.sum() == 35

    there = take.present[~named].any(axis=0)
    shift = int((found.labels.marker - truth)[found.labels.named][0]) % 30
    point = int(np.flatnonzero(there)[0])
    answer = AssignPoint(point, found.worn.markers[(truth[point] + shift) % 30])
    answered = labelled(take, 2, edits=Edits((answer,)))
    assert right_of(answered, truth, take) > 0.95, "who the other is follows"
    assert not [one for one in answered.suspects if "who may be" in one.words]


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

    with pytest.raises(JobError, match="there is no room"):
        labelled(passing[0], 2, room=room)


@pytest.mark.parametrize("count", [2, AUTO])
def test_two_who_stand_still_for_long_are_as_sure_as_for_a_moment(count):
    poses = [person(seed, 1, 0.0)[:1] for seed in (1, 2)]
    poses = [one - one.mean(axis=1, keepdims=True) * [1, 1, 0] for one in poses]
    still = np.concatenate([poses[0], poses[1] + [0, 1.0, 0]], axis=1)
    xyz = still + np.random.default_rng(0).normal(0, 0.0003, (5000, 30, 3))
    take = anonymous(xyz, 50.0)
    found = labelled(take, count)
    assert right_of(found, np.arange(30), take) == 1


def test_a_presence_that_a_person_has_named_is_asked_no_more():
    there, tracklet = np.arange(10) >= 4, np.zeros((10, 3), int)
    tracklet[:, 1:], tracklet[:4, 2] = [1, 2], -1
    presence, labels = UnidentifiedPresence(there, np.array([False, True, True])), Labels.none(10, 3)
    assert presence.is_open(tracklet, labels)
    labels.marker[:, 0] = 0
    assert presence.is_open(tracklet, labels), "that is somebody else's"
    labels.marker[:, 1] = 1
    assert not presence.is_open(tracklet, labels)


NAMES = ("GRIP", "NECK", "LEFT", "TOP", "RIGHT")
FORM = np.array([[0.15, 0, 0], [0.35, 0, 0.02], [0.6, 0.11, 0], [0.68, 0, 0.01], [0.55, -0.13, 0.03]])


def swung(frames, seed, place):
    """(T, 5, 3) m, a racket that is turned about, held where `place` (T, 3) is."""
    turn = np.cumsum(np.random.default_rng(seed).normal(0, 0.05, (frames, 3)), axis=0)
    return place[:, None] + np.einsum("tij,mj->tmi", turn_of(turn), FORM)


@pytest.fixture(scope="module")
def racket():
    takes = [LabelledTake("racket", "racket", NAMES, swung(120, 0, np.tile([0.0, 0.0, 1.2], (120, 1))))]
    return finished(train(takes, NAMES, TrainingOptions("racket", search="none"))).model


def test_a_prop_in_the_hand_and_who_holds_it_are_named(racket):
    walker, model = person(1, 1, 0.0), open_model("gait15")
    assert is_prop(racket)
    assert not is_prop(model)
    held = swung(len(walker), 3, walker[:, 0] + [0.1, 0.3, 0.2])
    xyz = np.concatenate([walker, held], axis=1)
    order = np.random.default_rng(5).permutation(20)
    take = anonymous(xyz[:, order])
    found = labelled(take, SeveralOptions(subjects=(Wearer("racket", racket), Wearer("ann", model))))
    assert found.worn.markers[:6] == (*(f"racket:{name}" for name in NAMES), "ann:SACR")
    truth = np.broadcast_to(np.where(order >= 15, order - 15, order + 5), xyz.shape[:2])
    assert (found.labels.marker[found.labels.named] == truth[found.labels.named]).all()
    assert found.labels.named.mean() > 0.95


def test_a_prop_that_is_not_there_is_said(racket):
    walker = person(1, 1, 0.0)
    asked = SeveralOptions(subjects=(Wearer("ann", open_model("gait15")), Wearer("bat", racket)))
    with pytest.raises(JobError, match="shows no bat, or not often enough to know it by the form of racket; expected"):
        labelled(anonymous(walker), asked)


MARKERS = 26
THING = 4  # markers on it
ARM = {"ELB": 0.24, "WRA": 0.36, "WRB": 0.36, "FIN": 0.4}  # m that it is held out


def standing(apart: float, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (T, 2 MARKERS, 3) m of two who stand so far from each other; their tracklets, and on which each (N,) is.

    The hands that are next to each other are held out. Each marker is in pieces of a third to one second, with a sixth
    of a second between them.
    """
    generator = np.random.default_rng(5)
    markerset = open_model("body26").markerset
    model, frames, names = BodyModel(markerset), int(seconds * RATE), markerset.markers
    each = [model.pose(draw_person(markerset, generator)).markers[0] for _ in range(2)]
    each = [one - [*one[:, :2].mean(axis=0), 0.0] + [apart * index, 0.0, 0.0] for index, one in enumerate(each)]
    for own, side, out in zip(each, "LR", (1, -1), strict=True):
        for arm, far in ARM.items():
            own[names.index(side + arm), :2] = [apart * (own is each[1]) + out * far, 0.0]
    points = np.concatenate(each) + generator.normal(0, 0.001, (frames, 2 * MARKERS, 3))
    tracklet, whose = np.full(points.shape[:2], NO_BODY), []
    for marker in range(2 * MARKERS):
        begin = int(generator.integers(10))
        while begin < frames:
            end = begin + int(generator.integers(20, 60))
            tracklet[begin:end, marker] = len(whose)
            whose.append(marker // MARKERS)
            begin = end + 10
    return points, tracklet, np.array(whose)


def wrong(body: np.ndarray, truth: np.ndarray) -> int:
    """How many tracklets that are on a body (N,) are on the other one, whichever is called the first."""
    said = body != NO_BODY
    return int(min((body[said] != truth[said]).sum(), (body[said] != 1 - truth[said]).sum()))


def test_who_stands_still_beside_another_is_parted_by_the_place():
    points, tracklet, truth = standing(1.0, 60.0)
    found = parted(points, tracklet, Affinity.of(points, tracklet, RATE), 2, MARKERS)
    assert wrong(found.body, truth) < 0.1 * len(truth)


def test_whoever_sways_alike_is_on_one_body_however_near_another_is():
    """An elbow is the hand's, and not another's hand beside it."""
    places = np.array([[0.0, 0.0, 1.0], [0.3, 0.0, 1.2], [0.1, 0.0, 1.0]])
    seconds = np.arange(500) / RATE
    sway = 0.01 * np.sin(2 * np.pi * np.outer(seconds, [0.3, 0.3, 0.4]))
    points = places + sway[..., None] * [1.0, 0.0, 0.0]
    hold = Affinity.of(points, np.tile(np.arange(3), (500, 1)), RATE)
    assert hold.of_tracklet(0)[0].tolist() == [1, 2]
    still = Affinity.of(np.tile(places, (500, 1, 1)), np.tile(np.arange(3), (500, 1)), RATE)
    assert still.of_tracklet(0)[0].tolist() == [2, 1]


def by_place(points: np.ndarray, tracklet: np.ndarray, way: np.ndarray) -> np.ndarray:
    """On which body each tracklet is, of points (T, P, 3) m of two who go so far (T, 2, 2) m on the floor."""
    points[:, : 2 * MARKERS, :2] += np.repeat(way, MARKERS, axis=1)
    return bodies_by_place(points, tracklet, np.arange(0, len(points), 3), tracklet.max() + 1, 2)


def test_two_who_walk_side_by_side_are_followed():
    points, tracklet, truth = standing(1.0, 8.0)
    way = np.zeros((len(points), 2, 2))
    way[..., 0] = np.linspace(0, 6, len(points))[:, None]
    found = by_place(points, tracklet, way)
    assert wrong(found, truth) == 0
    assert (found != NO_BODY).mean() > 0.8


def test_what_is_left_where_somebody_went_away_does_not_become_them():
    """Four markers of a thing 1.6 m from the second body, which is nearer to the first one when it is back."""
    points, tracklet, truth = standing(1.5, 12.0)
    way = np.zeros((len(points), 2, 2))
    way[480:, 1, 0] = -0.9
    points[240:480, MARKERS:], tracklet[240:480, MARKERS:] = np.nan, NO_BODY
    thing = np.tile([2.9, 0.7, 0.5] + np.linspace(0, 0.1, THING)[:, None], (len(points), 1, 1))
    things = np.tile(len(truth) + np.arange(THING), (len(points), 1))
    found = by_place(np.concatenate([points, thing], axis=1), np.concatenate([tracklet, things], axis=1), way)
    assert (found[: len(truth)] != NO_BODY).sum() > 2 * MARKERS
    assert wrong(found[: len(truth)], truth) <= MARKERS


def test_bodies_that_come_chunk_by_chunk_get_the_joints_that_markers_show():
    worn = with_fingers(open_model("body39").markerset)
    markerset = finer(worn)
    model, segments = BodyModel(markerset), markerset.skeleton.segments
    bodies, index, hand = model.rest(60, 1.7), segments.index("index.L"), segments.index("hand.L")
    aside = np.cross(markerset.offsets[markerset.by_name["LIDX6"]], [1.0, 0, 0])
    bodies.bends[:, index] = np.outer(np.linspace(0, 0.8, 60), aside / np.linalg.norm(aside))
    truth = model.pose(bodies)
    labels = Labels.none(60, len(worn))
    motion = motion_of(truth.markers, np.zeros(truth.markers.shape[:2]), labels, worn, np.arange(60))
    motion.markers[::3, ::5] = np.nan
    for table in (motion.expected, motion.joints, motion.rotations, motion.scale):
        table[10:13] = np.nan
    parts = FinerBodies(worn, markerset)
    chunks = [{name: values[at] for name, values in vars(motion).items()} for at in np.split(np.arange(60), 3)]
    found = [parts.of(replace(motion, **chunk)) for chunk in chunks]
    names = "joints", "rotations", "scale", "expected"
    joints, turns, scale, expected = (np.concatenate([getattr(one, name) for one in found]) for name in names)
    there = np.isfinite(joints).all(axis=(1, 2))
    np.testing.assert_array_equal(np.flatnonzero(~there), [10, 11, 12])
    assert (scale[there] == scale[0]).all()
    assert np.linalg.norm(joints - truth.joints, axis=2)[there].max() < 0.03
    bent = np.linalg.norm(rotation_vector(turns[:, hand].swapaxes(1, 2) @ turns[:, index]), axis=1)
    np.testing.assert_allclose(bent[there] - bent[0], np.linspace(0, 0.8, 60)[there], atol=0.15)
    np.testing.assert_array_equal(expected, motion.expected)


def test_toes_without_markers_are_as_the_feet_and_all_else_stays_as_it_was_fitted():
    worn = open_model("gait15").markerset
    markerset, frames = finer(worn), 20
    markers = walker("gait15", 1, [Act(frames / RATE)])[:frames]
    motion = motion_of(markers, np.zeros(markers.shape[:2]), Labels.none(frames, 15), worn, np.arange(frames))
    found = FinerBodies(worn, markerset).of(motion)
    count, toes = len(worn.skeleton), [markerset.skeleton.segments.index(f"toes.{side}") for side in "LR"]
    feet = markerset.skeleton.parents[toes]
    np.testing.assert_array_equal(found.joints[:, :count], motion.joints)
    np.testing.assert_array_equal(found.rotations[:, toes], motion.rotations[:, feet])
    far = np.linalg.norm(found.joints[:, toes] - motion.joints[:, feet], axis=2) / motion.scale[:, :1]
    np.testing.assert_allclose(far, np.linalg.norm(markerset.skeleton.offsets[toes[0]]), atol=1e-4)
