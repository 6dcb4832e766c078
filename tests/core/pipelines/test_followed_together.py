# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs of two people named by their bodies: as well as by points, who is who in either way, and what a person said."""

from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.errors import ForceableError
from addon.core.data.progress import finished
from addon.core.data.takes import Blobs, LabelledChunk, Labels, Motion
from addon.core.edits.kinds import NO_EDITS, AssignBlob, Edit, Edits, Right, Swap
from addon.core.pipelines import followed_together
from addon.core.pipelines.blobs import with_edits
from addon.core.pipelines.followed_together import FollowedTogether
from addon.core.pipelines.several_through_points import SubjectsInImages, label_by_points, label_several_blobs
from addon.core.points import possible
from addon.core.points.several.parting import NO_BODY, along_the_line
from addon.core.points.several.wearers import AUTO, SeveralOptions, Wearer
from addon.core.points.whole_take.pipeline import PointOptions
from addon.io.tables import FileTable, Room
from tests.core.pipelines.pair import CAMERAS, CHUNK, FRAMES, NAMED, RATE, label, names_of, shot_of, truth_of
from tests.core.scenes import keep, parts_of


@pytest.fixture(scope="module")
def shot(model):
    return shot_of(model)


@pytest.fixture(scope="module")
def found(shot, model) -> FollowedTogether:
    found = labelled(shot[0], SeveralOptions(model, 2))
    assert isinstance(found, FollowedTogether)
    return found


@pytest.fixture(scope="module")
def names(shot, found) -> np.ndarray:
    """Of all blobs of the take."""
    return names_of(found, chunks_of(found, shot[0]))


def labelled(blobs: Blobs, asked: SeveralOptions, edits: Edits = NO_EDITS, by=label_several_blobs, **options):
    return label(by, blobs, asked, edits=edits, **options)


def chunks_of(found: FollowedTogether | SubjectsInImages, blobs: Blobs, edits: Edits = NO_EDITS) -> list[LabelledChunk]:
    """The chunks as they are handed out in the end."""
    work = found.chunks(part for part, _ in parts_of(blobs, CHUNK))
    few = [part for part, _ in parts_of(blobs, CHUNK)]
    return list(with_edits(few, work, edits, CAMERAS, found.worn) if edits else work)


def in_truth(names: np.ndarray, truth: np.ndarray, people: str) -> np.ndarray:
    """(N,) True for the names that are right, where 1 and 2 are those people."""
    own = [people["12".index(name[0])] + name[1:] if name else "?" for name in names]
    return np.array([name in text.split("|") for name, text in zip(own, truth, strict=True)])


def test_two_who_stay_are_named_without_the_points_of_all_frames_and_as_well(shot, model, found):
    blobs, truth = shot
    chunks, points = chunks_of(found, blobs), labelled(blobs, SeveralOptions(model, 2), by=label_by_points)
    names, by_points = names_of(found, chunks), names_of(points, chunks_of(points, blobs))
    right, given, there = in_truth(names, truth, "12"), names != "", truth != ""
    assert right[given].mean() > 0.998
    assert right[there].mean() > in_truth(by_points, truth, "12")[there].mean() - 0.003
    assert np.concatenate([one.motion.confidence for one in chunks]).min() > 0.9
    assert {one.markers[0][:2] for one in chunks[0].suspects if one.markers} <= {"1:", "2:"}


@pytest.mark.parametrize(
    ("people", "apart"), [((1, 2), 0.6), ((2, 1), 0.6), ((1, 2), -0.6), ((3, 4), 0.7), ((4, 3), 0.7), ((5, 6), -0.7)]
)
def test_both_ways_count_them_alike_by_where_they_stand(model, people, apart):
    blobs, truth = shot_of(model, people, apart)
    first = people if apart > 0 else people[::-1]
    for by, kind in ((label_several_blobs, FollowedTogether), (label_by_points, SubjectsInImages)):
        found = labelled(blobs, SeveralOptions(model, 2), by=by)
        names = names_of(found, chunks_of(found, blobs))
        assert isinstance(found, kind)
        assert in_truth(names, truth, "{}{}".format(*first))[names != ""].mean() > 0.99


def test_bodies_stand_along_a_line_in_the_first_frame_that_shows_most_of_each():
    """Two of three points each, of whom the second is not there at first and the places are exchanged later."""
    points, body = np.full((4, 6, 3), np.nan), np.full((4, 6), -1)
    for frame, (one, other) in enumerate([(0.0, np.nan), (2.0, 0.0), (2.0, 1.0), (0.0, 2.0)]):
        points[frame, :3, 0], points[frame, 3:, 0] = one, other
        points[frame, :, 1:] = 0.0
        body[frame, :3], body[frame, 3:] = 0, 1
    body[0, 3:] = -1
    body[1, 4:] = -1  # one point of three
    assert along_the_line(points, body, [3, 3]) == [1, 0]
    assert along_the_line(points[3:], body[3:], [3, 3]) == [0, 1]
    assert along_the_line(points[:2], body[:2], [3, 3]) is None
    half = np.array([[0, 0, NO_BODY, NO_BODY]])
    assert along_the_line(points[:1, :4], half, [4]) is None and along_the_line(points[:1, :4], half, [3]) == [0]
    level = np.array([[[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]])
    for turned in (level, level[..., [1, 0, 2]], level @ [[1, -1, 0], [1, 1, 0], [0, 0, 1]]):
        assert along_the_line(turned, np.array([[0, 1]]), [1, 1]) is not None
        assert along_the_line(turned, np.array([[0, 1]]), [1, 1]) != along_the_line(turned, np.array([[1, 0]]), [1, 1])


def trail_of(blobs: Blobs, names: np.ndarray, name: str, camera: int, frames: tuple[int, int], to: str) -> Edit:
    """The edit that a marker's blobs in one camera are another's in some frames."""
    own = np.flatnonzero((names == name) & (blobs.camera == camera))
    own = own[(blobs.frame[own] >= frames[0] - 1) & (blobs.frame[own] < frames[1])]
    trail = np.column_stack([blobs.frames[blobs.frame[own]], blobs.xy[own]])
    where = {"camera": CAMERAS.names[camera], "frame": int(trail[0, 0]), "x": trail[0, 1], "y": trail[0, 2]}
    return AssignBlob(marker=to, **where, frames=frames, trail=trail)


def test_an_edit_of_what_bodies_named_lands_on_that_person_and_bodies_hear_it(shot, model, names):
    blobs = shot[0]
    for person in "12":
        one, other = f"{person}:LKNE", f"{person}:LANK"
        edits = Edits((Swap((one, other), frames=(18, 24)),))
        again = labelled(blobs, SeveralOptions(model, 2), edits)
        assert isinstance(again, FollowedTogether)
        now = names_of(again, chunks_of(again, blobs, edits))
        inside = (blobs.frame >= 17) & (blobs.frame < 24)
        assert (now[inside & (names == one)] == other).all()
        assert (now[inside & (names == other)] == one).all()
        rest = ~(inside & np.isin(names, [one, other]))
        assert (now[rest] == names[rest]).mean() > 0.99
        assert not truth_of(now, "?").any()


def test_named_blobs_are_seeds_of_the_bodies(shot, model, found, names):
    """What is too far off to have a name is so named already where the edits are yet to be applied."""
    blobs = shot[0]
    camera = int(np.bincount(blobs.camera[names == "1:LTHI"]).argmax())
    own = (names == "1:LTHI") & (blobs.camera == camera) & (blobs.frame >= 19) & (blobs.frame < 30)
    off = replace(blobs, xy=blobs.xy + 6.0 * own[:, None])
    edit = trail_of(off, names, "1:LTHI", camera, (20, 30), "1:LTHI")
    first, *later = chunks_of(labelled(off, SeveralOptions(model, 2), Edits((edit,))), off)
    assert first.unedited is None
    marker = np.concatenate([one.labels.marker for one in (first, *later)])
    before = np.concatenate([first.labels.marker, *(one.unedited.marker for one in later)])
    assert own.sum() > 5
    assert (marker[own] == found.worn.by_name["1:LTHI"]).all()
    assert not (before[own] == found.worn.by_name["1:LTHI"]).any()
    assert (marker[~own] == before[~own]).mean() > 0.99


def test_where_bodies_do_not_go_with_edits_names_and_numbers_stay_as_they_were(shot, model, names):
    """Two who are each other in some frames by all of their markers: nobody gets there between two frames."""
    blobs = shot[0]
    markers = model.markerset.markers
    edits = Edits(tuple(Swap((f"1:{name}", f"2:{name}"), frames=(5, 12)) for name in markers))
    again = labelled(blobs, SeveralOptions(model, 2), edits)
    assert isinstance(again, FollowedTogether)
    now = names_of(again, chunks_of(again, blobs, edits))
    inside = (blobs.frame >= 4) & (blobs.frame < 12)
    exchanged = np.array(["21"["12".index(name[0])] + name[1:] if name else "" for name in names], object)
    assert (now[inside] == exchanged[inside]).all()
    assert (now[~inside] == names[~inside]).all()


def test_an_edit_of_who_enters_later_is_for_the_points(model):
    """Only the first chunk tells bodies how many there are."""
    blobs, truth = shot_of(model, (1, 2, 3), 0.7)
    late = np.array([any(one.startswith("3:") for one in text.split("|")) for text in truth])
    shown = keep(blobs, np.flatnonzero(~(late & (blobs.frame < CHUNK))))
    found = labelled(shown, SeveralOptions(model, AUTO), Edits((Right(marker="3:LKNE", frames=(30, 35)),)))
    assert isinstance(found, SubjectsInImages) and len(found.worn.subjects) == 3


def test_a_chunk_too_short_to_look_beside_a_frame_goes_by_that_frame_alone(shot, model, monkeypatch):
    own, looks = followed_together.SubjectsFollowed._sure_names, []

    def one_wrong(self, points, groups):
        found = own(self, points, groups)
        if looks:  # the last chunk
            row = np.flatnonzero(found[1] >= 0)[0]
            found[1][row] = (found[1][row] + 1) % self.markers
        looks.append(len(points))
        return found

    monkeypatch.setattr(followed_together.SubjectsFollowed, "_sure_names", one_wrong)
    ends = ((1, 36), (37, 40))
    asked = SeveralOptions(model, 2)
    take = followed_together.SeveralBlobs(
        lambda: ((shot[0].between(*e), e[1] / FRAMES) for e in ends), CAMERAS, asked, NAMED, RATE
    )
    assert isinstance(finished(followed_together.label_together(take)), FollowedTogether)
    assert len(looks) == len(ends)


def test_a_rate_that_cannot_be_is_refused_unless_it_is_forced(shot, model, monkeypatch):
    asked = SeveralOptions(model, 2)
    monkeypatch.setattr(possible.POSSIBLE, "gravities", 0.01)
    with pytest.raises(ForceableError, match="a rate that cannot be"):
        labelled(shot[0], asked)
    assert isinstance(labelled(shot[0], asked, force=True), FollowedTogether)


@pytest.mark.parametrize("case", ["leaves", "three", "ensemble", "target", "one", "two models", "two cameras", "slow"])
def test_points_name_what_bodies_cannot(shot, model, case):
    blobs, truth = shot
    count = {"three": 3, "one": 1}.get(case, 2)
    asked, rate = SeveralOptions(model, count), 10.0 if case == "slow" else RATE
    if case == "leaves":
        blobs = blobs.part(slice(0, FRAMES), ~truth_of(truth, "2") | (blobs.frame < 22))
    cameras = CAMERAS.select([0, 2] if case == "two cameras" else range(8))
    if case == "two cameras":
        some = np.isin(blobs.camera, [0, 2])
        blobs = replace(blobs.part(slice(0, FRAMES), some), camera=blobs.camera[some] // 2)
    if case == "two models":
        asked = SeveralOptions(subjects=(Wearer("ann", model), Wearer("bob", replace(model, fingerprint="another"))))
    named = {"ensemble": PointOptions("ensemble"), "target": PointOptions("likelihood", 0.99)}.get(case, NAMED)
    shares = []
    for step in label_several_blobs(
        followed_together.SeveralBlobs(lambda: parts_of(blobs, CHUNK), cameras, asked, named, rate)
    ):
        shares.append(step.fraction)
        if step.note.startswith("reconstruct"):
            break
    assert step.note.startswith("reconstruct")
    assert shares == sorted(shares)
    assert (len(shares) > 1) == (case == "leaves")


@pytest.mark.parametrize("case", ["auto", "by name"])
def test_bodies_find_out_how_many_there_are_and_take_names_in_their_order(shot, model, found, case):
    blobs = shot[0]
    asked = SeveralOptions(model, AUTO)
    if case == "by name":
        asked = SeveralOptions(subjects=(Wearer("ann", model), Wearer("bob", model)))
    again = labelled(blobs, asked)
    assert isinstance(again, FollowedTogether)
    assert [one.name for one in again.worn.subjects] == (["1", "2"] if case == "auto" else ["ann", "bob"])
    before, now = (np.concatenate([one.labels.marker for one in chunks_of(one, blobs)]) for one in (found, again))
    np.testing.assert_array_equal(now, before)


def test_progress_goes_from_nothing_to_all(shot, model):
    take = followed_together.SeveralBlobs(
        lambda: parts_of(shot[0], CHUNK), CAMERAS, SeveralOptions(model, 2), NAMED, RATE
    )
    steps = list(label_several_blobs(take))
    assert [step.fraction for step in steps] == [share for _, share in parts_of(shot[0], CHUNK)]


def test_a_chunk_in_a_room_is_what_it_was_and_not_held(shot, found):
    chunk = chunks_of(found, shot[0])[0]
    with ExitStack() as stack:
        kept = followed_together.ChunkInRoom.of(replace(chunk, unedited=chunk.labels), Room(stack, 0))
        assert all(isinstance(table, FileTable) for table in (kept.labels, kept.motion, kept.unedited))
        again = kept.read()
    for one, other in ((chunk.labels, again.labels), (chunk.labels, again.unedited), (chunk.motion, again.motion)):
        for name, before in vars(one).items():
            now = getattr(other, name)
            assert (now is None) == (before is None)
            if before is not None:
                np.testing.assert_allclose(now, before, rtol=0, atol=1e-5)
    gone = Motion(**{name: one[:0] for name, one in vars(chunk.motion).items()})
    nothing = replace(chunk, labels=Labels.none(0), motion=gone)
    assert len(followed_together.ChunkInRoom.of(nothing, Room(ExitStack(), 0)).read().labels.marker) == 0


def test_what_a_frame_beside_says_alike_is_no_error_of_one_frame_unless_both_sides_deny_it():
    slots, group, marker = np.array([[0, 0], [1, 1], [2, 2], [3, 3]]), np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    look, beside = (followed_together.LookedAt(at, slots, group, marker) for at in (0, 2))
    right, wrong = (np.array([owners] * 2) for owners in ([0, 1, 2, 3], [1, 0, 2, 3]))
    doubts = followed_together.Doubts([look], 2)
    doubts.begin(4)
    doubts.add(0, wrong)
    doubts.confirm(0, wrong, beside, right)
    assert not doubts.are_confirmed
    doubts.confirm(0, wrong, beside, wrong)
    assert doubts.are_confirmed
    doubts.begin(-1)
    doubts.add(0, wrong)
    doubts.confirm(0, wrong, beside, wrong)
    assert not doubts.are_confirmed
