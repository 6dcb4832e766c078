# SPDX-License-Identifier: GPL-3.0-or-later
"""What is worn on plates: recognised by how a whole take moves, also of others, whose takes then name themselves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from addon.core.data.progress import finished
from addon.core.data.takes import BY_LIKELIHOOD, BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Points, Verdict
from addon.core.points.likelihood.model import Likelihood
from addon.core.points.models import USUAL_TARGET, Model, TrainingTake
from addon.core.points.refusals import SubjectsError
from addon.core.points.rigid_bodies.clusters import NO_CLUSTER, find_clusters, sampled
from addon.core.points.rigid_bodies.model import learn_rigid_bodies
from addon.core.points.rigid_bodies.structure import learn_structure
from addon.core.points.several.bodies import BodyNaming, Crowd, frames_are_sure
from addon.core.points.tracklets import cut
from addon.core.points.whole_take.pipeline import PointOptions, decided_of, name_frames, without_deleted
from addon.core.points.whole_take.recognition import Recognition, recognise
from addon.io.points import read_points
from tests.core.points.rigid_bodies.plated import NAMES, RATE, SEGMENTS, body, walk
from tests.core.toybody import toy_markerset

RADIUS = 0.5
OTHER = {"limb": 0.06, "form": 0.006, "place": 0.015}
ALL = np.arange(len(NAMES))


@pytest.fixture(scope="module")
def model():
    takes = np.concatenate([walk(body()), walk(body(), 1)])
    likelihood = Likelihood(NAMES, None, None, None, 1, learn_rigid_bodies([takes], RADIUS))
    markerset = replace(toy_markerset(), markers=NAMES)
    return Model(markerset, likelihood, training_takes=(TrainingTake("somebody", ("take",), len(takes), takes),))


def seen_in(model, points: np.ndarray) -> Recognition:
    return recognise(model.structure, model.rigid_bodies, points, cut(points, RATE), RATE)


def plates_right(person, columns: np.ndarray) -> list[bool | None]:
    """Of every plate whether its group is its own markers', None where it has none; columns (P,) are their markers.

    And no point has a wrong name.
    """
    assert ((person.marker == NO_MARKER) | (person.marker == columns)).all()
    found = []
    for group in person.cluster:
        if group == NO_CLUSTER:
            found.append(None)
            continue
        tracklets = [tracklet for own in person.clusters[group].tracklets for tracklet in own]
        markers = columns[np.unique(np.nonzero(np.isin(person.tracklet, tracklets))[1])]
        found.append(len({NAMES[marker][:-1] for marker in markers if marker >= 0}) == 1 and (markers >= 0).all())
    return found


def test_what_moves_as_one_is_a_group_whatever_trajectories_it_is_cut_into():
    points = walk(body())
    behind = points[:, ::3].copy()
    behind[:170] = points[150:, ::3] = np.nan
    points = np.concatenate([points, behind], axis=1)
    groups = find_clusters(sampled(points, cut(points, RATE), RATE))
    assert sorted(len(group.form) for group in groups) == [4] * len(SEGMENTS)
    # The tracklets before and behind a gap are one marker's.
    assert sum(len(tracklets) == 2 for group in groups for tracklets in group.tracklets) == sum(ALL[:44] % 3 == 0)


def test_the_very_plates_of_the_training_are_known_as_such(model):
    person = seen_in(model, walk(body(), 5))
    assert person.known is True
    assert plates_right(person, ALL) == [True] * len(SEGMENTS)


@pytest.mark.parametrize("seed", range(1, 4))
def test_other_people_in_other_plates_are_recognised_side_by_side(model, seed):
    person = seen_in(model, walk(body(seed, **OTHER), 10 + seed))
    assert person.known is False
    assert plates_right(person, ALL) == [True] * len(SEGMENTS)
    assert person.sure.sum() >= 36
    assert {NAMES[marker] for marker in person.single[person.single != NO_MARKER]} == {"LHAND", "RHAND"}


def test_a_plate_that_is_not_there_is_not_taken_for_another_nor_for_what_stands_about(model):
    points = walk(body(3, **OTHER), 13)
    gone = [index for index, name in enumerate(NAMES) if name.startswith("LSH")]
    points[:, gone] = np.nan
    person = seen_in(model, points)
    found = plates_right(person, ALL)
    assert found.count(None) == 1
    assert found.count(False) == 0
    points = walk(body(1, **OTHER), 11)
    table = np.array([[2.0, 2, 0.7], [2.3, 2, 0.7], [2.1, 2.2, 0.7]])
    table = table + np.random.default_rng(0).normal(0, 0.0003, (len(points), 3, 3))
    person = seen_in(model, np.concatenate([points, table], axis=1))
    columns = np.append(ALL, [-1] * 3)
    assert plates_right(person, columns) == [True] * len(SEGMENTS)


def test_a_thing_in_the_hand_is_no_plate_and_of_somebody_who_hardly_moves_nothing_is_sure(model):
    points = walk(body(1, **OTHER), 11)
    own = [NAMES.index(f"RUA{corner}") for corner in "1234"]
    middle = points[:, own].mean(axis=1, keepdims=True)
    along = points[:, own[0], None] - points[:, own[2], None]
    away = np.cross(points[:, own[1], None] - middle, along)
    tool = middle - 2.5 * along + (points[:, own] - middle) * 1.2 + away * 8
    tool = tool + 0.02 * np.sin(np.arange(len(points)) / 15)[:, None, None]
    person = seen_in(model, np.concatenate([points, tool], axis=1))
    columns = np.append(ALL, [-1] * 4)
    assert False not in plates_right(person, columns)
    person = seen_in(model, walk(body(3, **OTHER), 3, liveliness=0.003))
    assert person.known is None
    assert ((person.marker == NO_MARKER) | (person.marker == ALL)).all()


@pytest.mark.parametrize("columns", [0, 1, 3])
def test_next_to_nothing_is_nothing(model, columns):
    person = seen_in(model, walk(body(), 5)[:, :columns])
    assert person.known is None
    assert not person.sure.any()


@pytest.fixture(scope="module")
def recorded(shared_data):
    """The folder of recorded people, and what two labelled takes of a set on plates teach: names, structure, plates."""
    folder = shared_data / "people"
    takes = [read_points(folder / "clouthier" / f"{name}.c3d") for name in ("KneeltoProne01", "PronetoRun01")]
    labelled = np.concatenate([take.xyz for take in takes])
    rigid_bodies = learn_rigid_bodies([labelled], float(np.sqrt(np.nanmean(np.nanvar(labelled, axis=1).sum(axis=1)))))
    return folder, takes[0].names, (learn_structure(rigid_bodies, [labelled]), rigid_bodies)


def test_a_raw_take_of_other_plates_is_named_as_anatomy_has_it(recorded):
    folder, names, learned = recorded
    raw = read_points(folder / "clouthier" / "S09_KneeltoRun02.c3d")
    person = recognise(*learned, raw.xyz, cut(raw.xyz, raw.rate), raw.rate)
    assert person.known is False
    assert (person.cluster != NO_CLUSTER).sum() == 13
    placed = np.full((len(raw.xyz), len(names), 3), np.nan)
    frame, column = np.nonzero(person.marker != NO_MARKER)
    placed[frame, person.marker[frame, column]] = raw.xyz[frame, column]
    assert np.isfinite(placed[..., 0]).any(axis=0).sum() >= 55
    middle = {part: middle_of(placed, names, part) for part in ("LB", "PV", *(s + p for s in "LR" for p in LIMBS))}
    step = middle["PV"][20:] - middle["PV"][:-20]
    runs = np.linalg.norm(step[:, :2], axis=1) > 1.5 * 20 / raw.rate  # m/s
    for lower, upper in (
        ("PV", "LB"),
        *((s + low, high if high == "PV" else s + high) for s in "LR" for low, high in ABOVE),
    ):
        assert np.nanmean((middle[upper] - middle[lower])[:-20][runs, 2]) > 0, (upper, lower)
    left = step[runs][:, [1, 0]] * [-1, 1]
    for limb in LIMBS:
        aside = (middle["L" + limb] - middle["R" + limb])[:-20][runs, :2]
        assert np.nanmean((aside * left).sum(axis=1)) > 0, limb


LIMBS, ABOVE = ("UA", "FA", "TH", "SH", "FT"), (("TH", "PV"), ("SH", "TH"), ("FT", "SH"))


def middle_of(placed: np.ndarray, names, part: str) -> np.ndarray:
    """(T, 3) m of the markers whose names begin so, as far as there are any."""
    own = placed[:, [index for index, name in enumerate(names) if name.startswith(part)]]
    seen = np.isfinite(own[..., 0]).sum(axis=1)[:, None]
    return np.where(seen > 0, np.nansum(own, axis=1) / np.maximum(seen, 1), np.nan)


@pytest.mark.parametrize("take", ["mcgill/HC031A/HC031A01.c3d", "tennis/kinematics_tennis_serve.c3d"])
def test_people_in_another_marker_set_are_nobody_whose_plates_it_could_learn(recorded, take):
    folder, _, learned = recorded
    other = read_points(folder / take)
    assert recognise(*learned, other.xyz, cut(other.xyz, other.rate), other.rate).known is None


FRAMES = 100


def things(count: int, markers: int, seed: int = 0) -> np.ndarray:
    """Rigid things that tumble about, each on its own: (T, count * markers, 3) m."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0, 1, FRAMES)[:, None]
    parts = []
    for _ in range(count):
        form = rng.normal(0, 0.06, (markers, 3))
        turn = Rotation.from_rotvec(time * rng.normal(0, 2, 3)).as_matrix()
        way = rng.normal(0, 0.5, 3) + (time * rng.normal(0, 1, 3))[:, None]
        parts.append(np.einsum("fij,nj->fni", turn, form) + way)
    return np.concatenate(parts, axis=1) + rng.normal(0, 0.0004, (FRAMES, count * markers, 3))


def test_rigid_things_that_move_against_each_other_are_plates_and_who_stands_still_is_no_prop():
    rigid_bodies = learn_rigid_bodies([things(3, 4)], RADIUS)
    assert sorted(group.tolist() for group in rigid_bodies.members) == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11]]
    rigid_bodies = learn_rigid_bodies([things(1, 5)], RADIUS)
    assert [group.tolist() for group in rigid_bodies.members] == [[0, 1, 2, 3, 4]]
    rng = np.random.default_rng(1)
    still = rng.normal(0, 0.4, (15, 3)) + rng.normal(0, 0.001, (FRAMES, 1, 3)) + rng.normal(0, 0.0005, (FRAMES, 15, 3))
    assert learn_rigid_bodies([still], RADIUS) is None


@pytest.mark.parametrize("takes", [["KneeltoProne01"], ["PronetoRun01"], ["KneeltoProne01", "PronetoRun01"]])
def test_a_recorded_set_on_plates_is_one_whatever_takes_teach_it(shared_data, takes):
    recorded = [read_points(shared_data / "people" / "clouthier" / f"{name}.c3d").xyz for name in takes]
    rigid_bodies = learn_rigid_bodies([np.concatenate(recorded)], RADIUS)
    assert rigid_bodies is not None and len(rigid_bodies.members) == 13


@pytest.mark.parametrize("take", ["HC038A/HC038A11", "HC044A/HC044A15", "HC030A/HC030A05"])
def test_a_recorded_walk_in_markers_on_the_skin_is_no_set_on_plates(shared_data, take):
    points = read_points(shared_data / "people" / "mcgill" / f"{take}.c3d").xyz
    assert learn_rigid_bodies([points[:, np.isfinite(points[..., 0]).mean(axis=0) > 0.5]], RADIUS) is None


FIRST_FRAME = 100


@pytest.fixture(scope="module")
def other(model):
    points = walk(body(2, **OTHER), 12)
    return points, seen_in(model, points)


def right_of(points: np.ndarray) -> np.ndarray:
    return np.broadcast_to(np.arange(points.shape[1]), points.shape[:2])


def test_of_the_subject_of_the_training_there_is_nothing_to_say(model):
    points = walk(body(), 5)
    labels = Labels(right_of(points), np.full(points.shape[:2], BY_LIKELIHOOD), np.ones(points.shape[:2]))
    assert seen_in(model, points).suspects(Verdict(labels), NAMES, FIRST_FRAME) == ()


def test_somebody_else_is_named_by_motion_alone_and_the_report_begins_with_it(other):
    points, seen = other
    labels = seen.labels
    assert labels.named.mean() > 0.7
    assert (labels.marker == right_of(points))[labels.named].all()
    assert (labels.step == np.where(labels.named, BY_TRAJECTORY, NO_STEP)).all()
    assert (labels.confidence[labels.named] > 0.9).all()
    first, missing = seen.suspects(Verdict(labels), NAMES, FIRST_FRAME)
    assert first.reason.startswith("the rigid bodies are not those of the training")
    assert (first.first, first.last) == (FIRST_FRAME, FIRST_FRAME + len(points) - 1)
    unnamed = {NAMES[index] for index in np.flatnonzero((labels.marker == NO_MARKER).all(axis=0))}
    assert missing.reason.startswith("not found for sure")
    assert unnamed == set(missing.reason.split(": ")[1].split())


LIKELY = PointOptions("likelihood")


def taken(points: np.ndarray) -> Points:
    names = tuple(map(str, range(points.shape[1])))
    return Points(names, points, np.full(points.shape[:2], np.nan), RATE, FIRST_FRAME)


def test_a_take_of_somebody_else_has_the_names_of_its_motion_and_those_that_a_person_gives(model, other):
    points, seen = other
    frames = finished(name_frames(taken(points), cut(points, RATE), model, LIKELY))
    assert frames.by_motion
    marker = seen.labels.marker
    unnamed = int(np.flatnonzero((marker == NO_MARKER).all(axis=0))[0])
    ruled = Labels(marker.copy(), seen.labels.step.copy(), seen.labels.confidence.copy(), seen.labels.rate)
    ruled.marker[:, unnamed], ruled.confidence[:, unnamed] = 0, 1.0
    decided = decided_of(frames, ruled, frames.tracklet, None, USUAL_TARGET).labels
    assert (decided.marker[:, unnamed] == 0).all()
    assert ((decided.marker == 0).sum(axis=1) == 1).all()
    deleted = np.zeros(marker.shape, bool)
    deleted[5, unnamed] = True
    assert (finished(without_deleted(frames, deleted)).marker == marker).all()


def test_somebody_else_among_several_is_named_by_motion_too(model, other):
    points, seen = other
    tracklet = cut(points, RATE)
    every = np.ones(tracklet.max() + 1, bool)
    naming = BodyNaming(Crowd(taken(points), tracklet, LIKELY), every, model, frames_are_sure)
    naming.begin()
    assert (finished(naming.named()).frames.labels.marker == seen.labels.marker).all()


def test_two_of_whom_one_is_named_by_motion_are_said_to_be_two_unless_forced(model, other):
    points, _ = other
    still = points[:1] + np.array([0, 6, 0]) + np.random.default_rng(0).normal(0, 0.0003, points.shape)
    both = np.concatenate([points, still], axis=1)
    assert seen_in(model, both).by_motion
    with pytest.raises(SubjectsError, match="shows two subjects"):
        finished(name_frames(taken(both), cut(both, RATE), model, LIKELY))
    forced = replace(LIKELY, force=True)
    assert finished(name_frames(taken(both), cut(both, RATE), model, forced)).by_motion


def test_forms_alone_are_said_to_tell_where_motion_does_not_and_some_models_know_no_structure(model):
    forgetful = replace(model, training_takes=())
    bare = replace(model, likelihood=None)
    skin = replace(model, likelihood=replace(model.likelihood, rigid_bodies=None))
    assert [given.structure for given in (forgetful, bare, skin)] == [None] * 3
    seen = seen_in(model, walk(body(), 5, liveliness=0.003))
    (said,) = seen.suspects(Verdict(seen.labels), NAMES, FIRST_FRAME)
    assert "rest on the rigid bodies' forms alone" in said.reason
