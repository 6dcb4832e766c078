# SPDX-License-Identifier: GPL-3.0-or-later
"""Models from a single labelled frame or of one person; and a person's body found where names say nothing."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.data.progress import finished
from addon.core.data.takes import Labels
from addon.core.geometry import rotations
from addon.core.points.likelihood import learn
from addon.core.points.likelihood.frames import LikelihoodNamer
from addon.core.points.whole_take.pairs import trained_pairs
from addon.core.posing.posing import fit_points
from addon.core.training import laying
from addon.core.training.imagining import IMAGINING
from addon.core.training.laying import laid_body, lying_beside
from addon.core.training.pipeline import TrainingOptions, person_in, train
from addon.core.training.poses import known_poses
from addon.core.training.takes import LabelledTake
from addon.core.training.transfer import without_markers
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from tests.core.training.test_transfer import leg

FRAME = 40


@pytest.fixture(scope="module")
def take():
    """Points (T, 26, 3) of the virtual person, who wears body26."""
    return make_performance(open_markerset("body26")).take.xyz


def named(index: int) -> str:
    return f"P{index:02d}"


@pytest.fixture(scope="module")
def trained(known, take):
    """What one frame teaches whose names nobody knows; its calibration is measured on fewer frames than usual."""
    names = tuple(map(named, range(take.shape[1])))
    shown = LabelledTake("one.c3d", "ann", names, take[FRAME : FRAME + 1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learn.LEARN, "max_frames", 100)
        return finished(train([shown], names, TrainingOptions("ann", search="none"), None, known))


def named_by(model, points: np.ndarray, target: float) -> tuple[np.ndarray, np.ndarray]:
    """(T, M) whether points (T, M, 3) m in another order have their own names, and whether so surely."""
    shuffled = np.random.default_rng(3).permutation(points.shape[1])
    labels = Labels.join(LikelihoodNamer(model.likelihood).name(points[:, shuffled], 100.0))
    return labels.marker == shuffled, labels.rate >= target


def test_one_frame_names_the_rest_of_the_take_and_the_model_says_what_it_rests_on(trained, take):
    right, sure = named_by(trained.model, take[::6], 0.999)
    assert right.mean() > 0.85
    assert sure.mean() > 0.4
    assert (sure & ~right).mean() < 0.005
    assert "laid into a frame" in trained.body
    assert trained.model.likelihood.subjects == 1
    assert trained.model.markerset.source["poses"].startswith("made up on the body of")
    assert any(doubt.startswith("learned from 1 frame of ann: its other poses are made up") for doubt in trained.doubts)
    assert [len(kept.points) for kept in trained.model.training_takes] == [1]


def unknown(names: Sequence[str]) -> list[str]:
    """Names that no set has, which say a side where the ones of `body26` do."""
    return [("Left " if name[0] == "L" else "Right " if name[0] == "R" else "") + f"_{name[1:]}" for name in names]


def test_a_body_is_laid_into_a_frame_without_known_names(known, take):
    body = next(one for one in known if one.name == "body26")
    poses, names = known_poses(body, known), unknown(body.markers)
    laid = laid_body(take[FRAME], [(body, poses)], list(map(named, range(26))))
    assert (laid.place == np.arange(26)).mean() > 0.9
    turn = rotations.quaternion_to_matrix(rotations.about_z(np.array([2.0])))[0]
    turned = laid_body(take[FRAME] @ turn.T + [3, -2, 0], [(body, poses)], names)
    assert (turned.place == np.arange(26)).mean() > 0.9
    knees = [body.markers.index(name) for name in ("LKNE", "RKNE")]
    across = [names[{knees[0]: knees[1], knees[1]: knees[0]}.get(at, at)] for at in range(26)]
    # A name that says right is no left knee, however near.
    assert (laid_body(take[FRAME], [(body, poses)], across).place[knees] == -1).all()
    exchanged = {"Left": "Right", "Right": "Left"}
    faced = [exchanged.get(side, side) + space + rest for side, space, rest in (name.partition(" ") for name in names)]
    faced_about = laid_body(take[FRAME], [(body, poses)], faced)
    assert faced_about is None or faced_about.off > 1.3 * turned.off
    scattered = np.random.default_rng(1).uniform(0, 1.7, (26, 3))
    assert laid_body(scattered, [(body, poses)], list(map(named, range(26)))) is None


def test_what_has_the_name_of_a_marker_is_that_one_and_no_other(known, take):
    body = next(one for one in known if one.name == "body26")
    names, knee, beside = unknown(body.markers), body.markers.index("LKNE"), body.markers.index("LANK")
    bodies = [(body, known_poses(body, known))]
    assert laid_body(take[FRAME], bodies, names).place[knee] == knee
    names[beside] = "LKNE"  # as an ankle would hardly be called, so neither is anything
    place = laid_body(take[FRAME], bodies, names).place
    assert place[knee] == place[beside] == -1


def test_what_is_called_alike_on_both_sides_is_alike(known, take):
    """A marker nearer to where a knee has one on the right, and far from it on the left, is no knee's."""
    body = next(one for one in known if one.name == "body26")
    # Letters may be large on one side only.
    names = [name.replace("Right", "right") for name in unknown(body.markers)]
    at, bodies = names.index("right _KNE"), [(body, known_poses(body, known))]
    place = laid_body(take[FRAME], bodies, names).place
    assert (place == np.arange(26)).mean() > 0.9
    model = BodyModel(body)
    knee = model.pose(fit_points(model, take[FRAME][None])).markers[0, at]
    off = take[FRAME].copy()
    off[at] += [0.0, 0.0, 0.05]
    cloud = np.concatenate([off, knee[None], off[names.index("Left _KNE")][None] + [0.0, 0.0, 0.3]])
    place = laid_body(cloud, bodies, [*names, "right _X", "Left _X"]).place
    assert (place[at], place[26]) == (at, -1)


def test_a_thigh_s_marker_beside_a_hand_is_no_hand_s(known, take, monkeypatch):
    body, frame = next(one for one in known if one.name == "body26"), take[260]
    model = BodyModel(body)
    joints = model.pose(fit_points(model, frame[None])).joints[0]
    names, found = unknown(body.markers), [not name.endswith(("WRA", "WRB", "FIN")) for name in body.markers]
    on_skin = []
    for side in "LR":
        hip, knee, hand = (joints[body.skeleton.segments.index(f"{one}.{side}")] for one in ("thigh", "shank", "hand"))
        along = np.clip((hand - hip) @ (knee - hip) / ((knee - hip) @ (knee - hip)), 0.2, 0.8)
        inside = hip + along * (knee - hip)
        on_skin.append(inside + 0.0765 * (hand - inside) / np.linalg.norm(hand - inside))
    cloud = np.concatenate([frame[found], on_skin])
    called = [*(name for name, one in zip(names, found, strict=True) if one), "Left _X", "Right _X"]
    monkeypatch.setattr(laying, "_parts", lambda whole: [np.arange(len(whole))])  # as if there was more on the arms
    laid = laid_body(cloud, [(body, known_poses(body, known))], called)
    assert (laid.place[-2:] == -1).all()


def test_what_lies_on_the_floor_beside_the_feet_is_no_marker(known, take):
    points, height = take[0], np.array([0.0, 0.0, 1.0])
    low = points[:, 2].min() * height
    ahead = points.mean(axis=0) * [1, 1, 0] + low + [[0.7, 0.0, 0.03], [-0.6, 0.2, 0.03]]
    held = ahead[:1] + 1.2 * height
    for call in (named, lambda index: open_markerset("body26").markers[index]):
        names = (*map(call, range(len(points))), "ball", "block", "stick")
        shown = np.concatenate([points, ahead, held])[None].repeat(3, 0)
        shown[:, 3] = np.nan
        take_of = LabelledTake("still", "she", names, shown)
        assert lying_beside([take_of], names, known) == ("ball", "block"), "what nobody saw lies nowhere"


@pytest.mark.parametrize("worn", ["arms and legs", "legs"])
def test_a_body_is_laid_into_markers_that_it_wears_less_of(known, take, worn):
    """Nobody's shoulders are its head, nor its hips its shoulders, where a set has nothing on the head or the arms."""
    bodies = [(one, known_poses(one, known)) for one in known if one.name == "body26"]
    lacking = ("FHD", "BHD") if "arms" in worn else ("FHD", "BHD", "ELB", "WRA", "WRB", "FIN")
    here = np.array([not name.endswith(lacking) for name in bodies[0][0].markers])
    laid = laid_body(np.where(here[:, None], take[FRAME], np.nan), bodies, list(map(named, range(26))))
    assert (laid.place == np.arange(26))[here].all()


def test_a_body_with_nothing_below_its_arms_is_laid_as_it_is(known, take):
    whole = next(one for one in known if one.name == "body26")
    lacking = ("FHD", "BHD", "ELB", "WRA", "WRB", "FIN")
    upper = np.flatnonzero([name.endswith(lacking) for name in whole.markers])
    body = without_markers(whole, upper)
    laid = laid_body(take[FRAME][upper], [(body, known_poses(body, known))], unknown(body.markers))
    assert (laid.place == np.arange(len(upper))).all()


def test_who_stood_still_moves_as_it_was_made_up(trained):
    """Distances that keep are those of who stood, to the millimetre, also in one frame; others vary as people move."""
    (shown,), body = trained.model.training_takes, open_markerset("body26").markers
    standing = shown.points + np.random.default_rng(4).normal(0, 5e-4, (60, *shown.points.shape[1:]))
    pairs = trained_pairs(replace(trained.model, training_takes=(replace(shown, points=standing),)))
    foot, feet = ((body.index(one), body.index(other)) for one, other in (("LHEE", "LTOE"), ("LHEE", "RHEE")))
    assert np.sqrt(pairs.within[foot]) < 0.002
    assert np.sqrt(pairs.within[feet]) > 0.05
    assert pairs.mean[foot] == pytest.approx(
        np.linalg.norm(shown.points[0, foot[0]] - shown.points[0, foot[1]]), abs=2e-3
    )
    of_one_frame = trained_pairs(trained.model)
    assert of_one_frame.mean[foot] == pytest.approx(pairs.mean[foot], abs=1e-3)
    assert np.sqrt(of_one_frame.within[foot]) < 0.002
    assert np.sqrt(of_one_frame.within[feet]) > 0.05


def test_one_person_who_moves_learns_of_others_too(known, take, monkeypatch):
    monkeypatch.setattr(learn.LEARN, "max_frames", 40)
    names = open_markerset("body26").markers
    on_skin = take[::6] + np.random.default_rng(6).normal(0, 0.008, take[::6].shape)
    shown = LabelledTake("walk.c3d", "ann", names, on_skin)
    found = finished(train([shown], names, TrainingOptions("ann", search="none"), None, known))
    assert found.model.markerset.source["others"].startswith(f"{IMAGINING.people} made up on the body of body26")
    assert found.model.likelihood.subjects == 1
    assert not any("made up" in doubt for doubt in found.doubts)


@pytest.mark.parametrize("frames", [1, 9])
def test_a_few_frames_of_what_is_no_person_name_it_bent(known, monkeypatch, frames):
    """A chain of ten markers that winds: no body fits, and neighbours keep their distances."""
    monkeypatch.setattr(learn.LEARN, "max_frames", 60)
    names, lengths = tuple(map(named, range(10))), 0.05 + 0.02 * (np.arange(10) % 4)
    angle = np.cumsum(0.25 * np.sin(np.linspace(0, 4, 60)[:, None] + np.arange(10)), axis=1)
    chain = np.cumsum(np.stack([lengths * np.cos(angle), lengths * np.sin(angle), 0.3 * angle * lengths], -1), axis=1)
    take = LabelledTake("one.c3d", "snake", names, chain[:frames])
    trained = finished(train([take], names, TrainingOptions("snake"), None, known))
    assert trained.model.markerset.source["poses"].endswith("by bending it between neighbours")
    right, sure = named_by(trained.model, chain, 0.99)
    assert right.mean() > 0.9
    assert (sure & ~right).mean() < 0.02


def test_markers_in_usual_places_are_known_without_their_names_and_what_is_no_person_is_none():
    body, actor = open_markerset("body26"), open_markerset("actor41")
    points = make_performance(body).take.xyz[::4]
    found = person_in([points], [f"M{number}" for number in range(26)], "ann", [actor, body])
    person, name = found
    assert name in ("actor41", "body26")
    given, expected = ([one.skeleton.segments[at] for at in one.attachment] for one in (person, body))
    same = [one == two for one, two in zip(given, expected, strict=True)]
    assert np.mean(same) > 0.8, list(zip(body.markers, given, expected, strict=True))
    sides = [(one[-2:], two[-2:]) for one, two in zip(given, expected, strict=True) if {one[-2], two[-2]} == {"."}]
    assert all(one == two for one, two in sides)
    chain = leg(80, size=2.0)  # as large as somebody, and nobody
    assert person_in([chain], [f"B{number}" for number in range(12)], "box", [actor]) is None
