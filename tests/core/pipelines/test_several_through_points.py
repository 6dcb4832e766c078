# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs of two people: named by their points, taken back where images say otherwise, told where one was asked."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.blobs.pipeline import label_take
from addon.core.data.errors import InputError, JobError
from addon.core.data.progress import finished
from addon.core.data.takes import Blobs, Suspect
from addon.core.edits.kinds import NO_EDITS, AssignBlob, Edits, Place, Swap
from addon.core.pipelines.blobs import with_edits
from addon.core.pipelines.fitted_subjects import FollowedSubjects
from addon.core.pipelines.followed_together import SeveralBlobs
from addon.core.pipelines.others import OtherSubjects, refuse_two
from addon.core.pipelines.several_through_points import PointsOfBlobs, SubjectsInImages, label_by_points
from addon.core.points.models import Model
from addon.core.points.refusals import SubjectsError
from addon.core.points.several.identification import IDENTIFICATION
from addon.core.points.several.wearers import SeveralOptions, Wearer
from addon.core.review.suspects import EITHER_WAY
from addon.core.simulation.simulate import CaptureOptions
from tests.core.pipelines.pair import CAMERAS, CHUNK, FRAMES, NAMED, RATE, label, names_of, shot_of, truth_of
from tests.core.scenes import abreast, cut, parts_of

PAIR = "LTIB", "LANK"


@pytest.fixture(scope="module")
def shot(model):
    return shot_of(model)


def named(found: SubjectsInImages, blobs: Blobs) -> tuple[np.ndarray, list]:
    chunks = list(found.chunks(part for part, _ in parts_of(blobs, CHUNK)))
    return names_of(found, chunks), chunks


def swapped(truth: np.ndarray) -> np.ndarray:
    return np.array(["|".join("21"["12".index(one[0])] + one[1:] for one in text.split("|") if one) for text in truth])


@pytest.fixture(scope="module")
def found(shot, model) -> SubjectsInImages:
    return label(label_by_points, shot[0], SeveralOptions(model, 2))


@pytest.fixture(scope="module")
def labelled(shot, found):
    blobs, truth = shot
    names, chunks = named(found, blobs)
    name, text = next((name, text) for name, text in zip(names, truth, strict=True) if name and text)
    return names, chunks, truth if text[0] == name[0] else swapped(truth)


def test_one_asked_for_among_two_has_her_names_alone_and_the_other_is_in_the_way(shot, model, monkeypatch):
    blobs, truth = shot
    monkeypatch.setattr(IDENTIFICATION, "lead", -1.0)  # the set's model knows neither
    asked = SeveralOptions(subjects=(Wearer("ann", model),))
    found = label(label_by_points, blobs, asked)
    assert len(found.labelled.worn.subjects) == len(found.bodies) == 2
    assert found.worn.markers == tuple(f"ann:{name}" for name in model.markerset.markers)
    names, chunks = named(found, blobs)
    people = [np.array([f"{one}:{name[4:]}" if name else "" for name in names], object) for one in "12"]
    shares = [np.mean([one in text.split("|") for one, text in zip(own, truth, strict=True) if one]) for own in people]
    assert max(shares) > 0.998  # ann is one of them in all of the take
    hers = truth_of(truth, "12"[int(np.argmax(shares))])
    assert (names != "").sum() > 0.9 * hers.sum()
    assert chunks[0].motion.markers.shape == (16, 15, 3)
    assert chunks[0].motion.joints.shape[1] == found.labelled.motion.part(slice(0, 1)).joints.shape[1] // 2
    own = np.isfinite(chunks[0].motion.markers).all(axis=2)
    assert own.mean() > 0.9
    assert not any(one.markers and not set(one.markers) <= set(found.worn.markers) for one in found.labelled.suspects)


def test_as_many_as_are_asked_for_have_names_and_others_are_in_the_way(shot, model):
    found = label(label_by_points, shot[0], SeveralOptions(model, 1))
    assert len(found.labelled.worn.subjects) == len(found.bodies) == 2
    names, chunks = named(found, shot[0])
    assert set(names) == {"", *found.worn.markers} == {"", *(f"1:{name}" for name in model.markerset.markers)}
    assert chunks[0].motion.markers.shape == (16, 15, 3)


def test_where_one_asked_for_is_not_there_nobody_is_found(shot, model, monkeypatch):
    blobs, truth = shot
    monkeypatch.setattr(IDENTIFICATION, "lead", -1.0)
    asked = SeveralOptions(subjects=(Wearer("ann", model),))
    names, _ = named(label(label_by_points, blobs, asked), blobs)
    hers = max("12", key=lambda one: ((names != "") & truth_of(truth, one)).sum())
    kept = ~(truth_of(truth, hers) & (blobs.frame >= 22))
    few = blobs.part(slice(0, FRAMES), kept)
    found = label(label_by_points, few, asked)
    assert len(found.labelled.worn.subjects) == 2
    _, chunks = named(found, few)
    confidence = np.concatenate([chunk.motion.confidence for chunk in chunks])
    assert (confidence[:20] > 0).all()
    assert (confidence[-15:] == 0).all()


def test_a_marker_that_one_camera_alone_sees_is_named(shot, model):
    blobs, truth = shot
    lost = (truth == "1:LKNE") & (blobs.frame >= 10) & (blobs.frame < 30)
    camera = np.bincount(blobs.camera[lost]).argmax()
    kept = ~lost | (blobs.camera == camera)
    few, truth = blobs.part(slice(0, FRAMES), kept), truth[kept]
    again = label(label_by_points, few, SeveralOptions(model, 2))
    names, _ = named(again, few)
    other = (names != truth).sum() > (names != swapped(truth)).sum()
    expected = "2:LKNE" if other else "1:LKNE"
    own = (truth == "1:LKNE") & (few.frame >= 10) & (few.frame < 30)
    assert own.sum() > 10
    assert (names[own] == expected).mean() > 0.9
    assert set(names[own]) <= {expected, ""}


def test_a_body_that_explains_its_blobs_is_trusted_before_the_names_of_points(shot, found, labelled):
    """Where a quarter of a subject's names are wrong all the time, as where points exchanged two limbs."""
    blobs, before = parts_of(shot[0], CHUNK)[0][0], labelled[1][0].labels
    marker = before.marker.copy()
    for one, other in (("1:LKNE", "1:LANK"), ("1:RKNE", "1:RANK")):
        pair = [found.worn.markers.index(name) for name in (one, other)]
        for name, wrong in (pair, pair[::-1]):
            marker[before.marker == name] = wrong
    fitted = FollowedSubjects.of(found.labelled.worn, CAMERAS, RATE, found.bodies)
    after, _ = fitted.read(blobs, replace(before, marker=marker))
    assert (marker != before.marker).mean() > 0.1
    assert (after.marker[before.named] == before.marker[before.named]).mean() > 0.99


def test_a_point_has_the_name_that_a_person_gave_one_of_its_blobs(shot, model, found, labelled):
    """Also a wrong one, which the images then contradict; and the program's own name is kept below it."""
    blobs = shot[0]
    own = np.flatnonzero(labelled[0] == "1:LTHI")
    camera = np.bincount(blobs.camera[own]).argmax()
    rows = own[blobs.camera[own] == camera]
    trail = np.column_stack([blobs.frames[blobs.frame[rows]], blobs.xy[rows]])
    where = {"camera": CAMERAS.names[camera], "frame": int(trail[0, 0]), "x": trail[0, 1], "y": trail[0, 2]}
    edits = Edits((AssignBlob(marker="2:LTHI", **where, frames=(1, FRAMES), trail=trail),))
    again = label(label_by_points, blobs, SeveralOptions(model, 2), edits=edits)
    names = again.worn.by_name
    before, now = found.labelled.labels.marker, again.labelled.labels.marker
    point = (before == names["1:LTHI"]) & (now == names["2:LTHI"])
    assert point.any(axis=1).mean() > 0.8
    assert (now[(before != now) & ~point] != names["2:LTHI"]).all()
    assert np.array_equal(again.labelled.unedited.marker[point], before[point])
    _, chunks = named(again, blobs)
    unedited = np.concatenate([chunk.unedited.marker for chunk in chunks])
    assert (unedited[own] == names["1:LTHI"]).mean() > 0.95


def other_way_round(model: Model) -> Model:
    """The model with the two of PAIR in each other's place on the body, and not in points."""
    own, order = model.markerset, np.arange(len(model.markerset))
    order[[own.by_name[name] for name in PAIR]] = [own.by_name[name] for name in PAIR[::-1]]
    return replace(model, markerset=replace(own, offsets=own.offsets[order], attachment=own.attachment[order]))


def in_one_chunk(blobs: Blobs, model: Model, edits: Edits = NO_EDITS) -> tuple[np.ndarray, tuple[Suspect, ...]]:
    """The names of blobs of two in one chunk, and what is asked: which of a pair is which, and who somebody is."""
    asked = SeveralOptions(model, 2)
    take = SeveralBlobs(lambda: [(blobs, 1.0)], CAMERAS, asked, replace(NAMED, edits=edits), RATE)
    found = finished(label_by_points(take))
    chunks = list(with_edits([blobs], found.chunks([blobs]), edits, CAMERAS, found.worn))
    questions = EITHER_WAY, "who may be"
    return names_of(found, chunks), tuple(one for one in chunks[0].suspects if any(map(one.words.count, questions)))


def test_of_names_that_points_bear_out_nothing_is_worked_out(shot, model, labelled, monkeypatch):
    monkeypatch.delattr("addon.core.pipelines.asked_in_space.name_frames")
    names, asked = in_one_chunk(shot[0], model)
    assert asked == ()
    assert (names == labelled[2]).mean() > 0.9


@pytest.mark.parametrize("answered", ["1:LTIB", "2:LANK"])
def test_names_that_the_points_of_somebody_have_otherwise_are_asked_about_and_answered(shot, model, labelled, answered):
    blobs, (_, _, truth) = shot[0], labelled
    worn = other_way_round(model)
    names, asked = in_one_chunk(blobs, worn)
    pairs = [{f"{who}:{name}" for name in PAIR} for who in "12"]
    assert [set(one.markers) for one in asked] == pairs
    assert asked[0].words.startswith("1: LTIB and LANK may be")
    of_pairs = np.isin(truth, [*pairs[0], *pairs[1]])
    assert set(names[of_pairs]) == {""}
    assert (names[~of_pairs] == truth[~of_pairs]).mean() > 0.9
    row = np.flatnonzero((truth == answered) & (blobs.frame == 20))[0]
    said = AssignBlob(CAMERAS.names[blobs.camera[row]], int(blobs.frames[20]), *blobs.xy[row].tolist(), answered)
    names, asked = in_one_chunk(blobs, worn, Edits([said]))
    own, others = pairs if answered[0] == "1" else pairs[::-1]
    assert [set(one.markers) for one in asked] == [others]
    mine = np.isin(truth, list(own))
    assert (names[mine] == truth[mine]).all()
    assert set(names[np.isin(truth, list(others))]) == {""}


def test_of_two_that_points_do_not_tell_apart_nothing_is_asked_where_bodies_name_them(shot, found):
    """Whoever is not there yet is not asked about, either."""
    pairs = [("1:LKNE", "1:LANK"), ("1:one", "1:other"), ("3:LKNE", "3:LANK")]
    doubts = tuple(Suspect(1, FRAMES, f"{number} {EITHER_WAY}", markers=pair) for number, pair in enumerate(pairs))
    asked = replace(found, labelled=replace(found.labelled, suspects=doubts))
    _, chunks = named(asked, shot[0])
    assert [one.words[0] for chunk in chunks for one in chunk.suspects] == ["1"]


@pytest.fixture(scope="module")
def twins(model):
    """Blobs and truth of two of one build who are both away in some frames."""
    seen = abreast(model.markerset, (1, 1), 3 * FRAMES, RATE, 0.6, CAMERAS, CaptureOptions(seed=5))
    there = (seen.blobs.frame < 40) | (seen.blobs.frame >= 60)
    return seen.blobs.part(slice(0, 3 * FRAMES), there), seen.truth[there]


def test_bodies_name_nobody_of_whom_points_cannot_tell_who_it_is(twins, model):
    names, suspects = in_one_chunk(twins[0], model)
    (asked,) = [one for one in suspects if "who may be 1 or 2" in one.words]
    number = twins[0].frames[twins[0].frame]
    inside = (number >= asked.first) & (number <= asked.last)
    assert not names[inside].any()
    assert (names[~inside] != "").mean() > 0.8


def test_an_edit_of_somebody_who_is_not_there_is_told_by_its_own_number(shot, model):
    blobs = shot[0]
    row = int(np.flatnonzero(blobs.frame == 9)[0])
    where = {"camera": CAMERAS.names[blobs.camera[row]], "frame": 10, "x": blobs.xy[row, 0], "y": blobs.xy[row, 1]}
    edits = Edits((Place("1:LKNE", 10, (0.0, 0.0, 1.0)), AssignBlob(marker="3:LKNE", **where)))
    with pytest.raises(InputError, match="edit 2 names '3:LKNE'"):
        label(label_by_points, blobs, SeveralOptions(model), edits=edits)


def test_a_blob_that_is_off_its_point_has_no_name(shot, found, labelled):
    blobs = shot[0]
    names = labelled[0]
    row = int(np.flatnonzero((names != "") & (blobs.frame == 20))[7])
    xy = blobs.xy.copy()
    xy[row] += [2.5, 2.5]
    again, _ = named(found, replace(blobs, xy=xy))
    assert again[row] == ""
    assert (again == names).mean() > 0.99


def test_what_no_two_cameras_see_is_told(shot):
    blobs = shot[0]
    nothing = blobs.part(slice(0, FRAMES), blobs.camera == 0)
    points = PointsOfBlobs(CAMERAS, RATE)
    points.add(nothing.between(1, 8))
    with pytest.raises(JobError, match="no markers that two cameras see"):
        points.take()


def test_bodies_follow_who_is_said_to_be_the_other(shot, found, labelled):
    """Exchanged marker by marker in some frames, they have each other's bodies in these, and nothing jumps."""
    _, chunks, _ = labelled
    blobs = shot[0]
    markers = [name.partition(":")[2] for name in found.worn.markers[:15]]
    edits = Edits(tuple(Swap((f"1:{name}", f"2:{name}"), frames=(5, 12)) for name in markers))
    few = [part for part, _ in parts_of(blobs, CHUNK)]
    [again, *_] = with_edits(few, iter(chunks), edits, CAMERAS, found.worn)
    frames, joints = slice(4, 12), chunks[0].motion.joints.shape[1] // 2
    before, after = chunks[0].motion, again.motion
    np.testing.assert_array_equal(after.joints[frames, :joints], before.joints[frames, joints:])
    np.testing.assert_array_equal(after.scale[frames, 3:], before.scale[frames, :3])
    for rest in (slice(0, 4), slice(12, 16)):
        np.testing.assert_array_equal(after.rotations[rest], before.rotations[rest])
    away = np.linalg.norm(after.markers - after.expected, axis=2)
    assert np.nanmax(away) < 0.15
    assert again.motion.expected.shape == before.expected.shape


QUIET = CaptureOptions(seed=3)


def blobs_of(model, people: tuple[int, ...], options: CaptureOptions = QUIET) -> Blobs:
    """What cameras see of people, by their seeds, who walk side by side, 0.8 m apart."""
    return abreast(model.markerset, people, FRAMES, RATE, 0.8, CAMERAS, options).blobs


def looked_at(blobs: Blobs, model) -> OtherSubjects:
    """A take that was labelled as one subject's, and looked at."""
    others = OtherSubjects(CAMERAS, model)
    parts = cut(blobs, CHUNK)
    for part, chunk in zip(parts, label_take(parts, CAMERAS, model.markerset, RATE), strict=True):
        others.add(part, chunk)
    return others


def test_two_are_told_before_any_of_the_take_is_named(model):
    parts = cut(blobs_of(model, (1, 2)), CHUNK)
    with pytest.raises(SubjectsError, match=r"two subjects or more that wear gait15"):
        refuse_two(parts[0], lambda: parts, CAMERAS, model)


@pytest.mark.parametrize(("reflections", "read"), [(2, 0), (30, 1)])
def test_a_take_of_one_is_not_and_its_rest_is_read_only_where_it_is_crowded(model, reflections, read):
    parts, begun = cut(blobs_of(model, (1,), replace(QUIET, reflections=reflections)), CHUNK), []

    def reading():
        begun.append(1)
        return iter(parts)

    refuse_two(parts[0], reading, CAMERAS, model)
    assert len(begun) <= read


def test_who_leaves_soon_is_not_told_before(model):
    both, alone = blobs_of(model, (1, 2)), blobs_of(model, (1,))
    early = Blobs.join([both.between(1, 10), alone.between(11, FRAMES)])
    parts = cut(early, CHUNK)
    refuse_two(parts[0], lambda: parts, CAMERAS, model)


@pytest.mark.parametrize("reflections", [2, 30])
def test_one_among_ghosts_is_not(model, reflections):
    others = looked_at(blobs_of(model, (1,), replace(QUIET, reflections=reflections)), model)
    assert bool([one for one in others.kept if one is not None]) == (reflections == 30)
    others.refuse()


def test_who_is_beside_for_a_moment_is_not(model):
    both, alone = blobs_of(model, (1, 2)), blobs_of(model, (1,))
    late = Blobs.join([alone.between(1, 30), both.between(31, FRAMES)])
    others = looked_at(late, model)
    assert any(one is not None for one in others.kept)
    others.refuse()
