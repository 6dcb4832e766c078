# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's body found in takes whose marker names say nothing; what is no person stays what it is."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.body.sides import other_side
from addon.core.data.progress import finished
from addon.core.data.takes import evenly_spread
from addon.core.geometry import rotations
from addon.core.points.likelihood import learn
from addon.core.posing.posing import fit_points
from addon.core.training import pipeline
from addon.core.training.people import FoundPerson, person_in
from addon.core.training.pipeline import TrainingOptions, train
from addon.core.training.poses import known_poses, posed_bodies
from addon.core.training.takes import LabelledTake
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from addon.io.models import likelihood_document

FRAMES = 100
# A plate of four markers on each of these segments, heights off the middle of its bone.
PLATE = np.array([[0.02, 0.03, 0.03], [0.03, -0.02, 0.03], [0.02, 0.03, -0.03], [0.03, -0.03, -0.02]])
PLATES = ("pelvis", "thorax", "head", *(f"{name}.{side}" for side in "LR" for name in
          ("upper_arm", "forearm", "thigh", "shank", "foot")))  # fmt: skip


@pytest.fixture(scope="module")
def known():
    return [open_markerset(name) for name in ("actor41",)]


def middle_of(body, name):
    """Where a plate sits on a segment: in the middle of what the body has there."""
    own = np.flatnonzero(body.attachment == body.skeleton.segments.index(name))
    return body.offsets[own].mean(axis=0) * [0.5, 0.5, 0.8]


@pytest.fixture(scope="module")
def plated(known):
    """Who wears plates, of what markers nobody knows the names, in the poses of recorded people; and the truth.

    Points (T, M, 3) m, (M,) segments of the markers and joints (T, J, 3) m.
    """
    body = known[0]
    carrier = np.repeat([body.skeleton.segments.index(name) for name in PLATES], len(PLATE))
    offsets = np.concatenate([middle_of(body, name) + PLATE for name in PLATES])
    count, joints = len(offsets), len(body.skeleton)
    worn = replace(
        body,
        markers=tuple(f"M{number}" for number in range(count)),
        aliases={},
        attachment=carrier,
        offsets=offsets,
        spread=replace(body.spread, modes=np.zeros((0, joints + count, 3)), marker_sd=np.full(count, 0.01)),
    )
    model = BodyModel(worn)
    poses = known_poses(body, known)
    poses = poses[evenly_spread(len(poses), FRAMES)]
    bodies = posed_bodies(model, poses, 1.75)
    turn = rotations.about_z(np.linspace(0, 3, len(poses)))
    bodies = replace(bodies, quaternion=rotations.quaternion_product(turn, bodies.quaternion))
    posed = model.pose(bodies)
    skin = 0.003 * np.random.default_rng(1).standard_normal(posed.markers.shape)
    return worn, posed.markers + skin, posed.joints


def test_plates_of_unknown_names_are_read_as_limbs_of_their_side(plated, known):
    """Seen in a mirror, left is right: only how people bend says which is which."""
    worn, points, joints = plated
    mirror = np.array([1.0, -1, 1])
    person = finished(person_in([points * mirror], worn.markers, "ann", known))
    names = list(person.markerset.skeleton.segments)
    assert [other_side(names[one]) for one in person.markerset.attachment] == [names[one] for one in worn.attachment]
    assert names[0] == "pelvis"
    assert (person.markerset.skeleton.parents[1:] >= 0).all()
    model = BodyModel(person.markerset)
    some = evenly_spread(len(points), 30)
    posed = model.pose(fit_points(model, points[some] * mirror)).joints[:, [names.index(other_side(n)) for n in names]]
    away = np.median(np.linalg.norm(posed * mirror - joints[some], axis=2), axis=0)
    bare = [index for index, name in enumerate(names) if name.startswith("hand")]  # no marker shows the wrist
    assert np.delete(away, bare).max() < 0.045


def test_markers_in_usual_places_are_known_without_their_names(known):
    body = open_markerset("body26")
    points = make_performance(body).take.xyz[::4]
    person = finished(person_in([points], [f"M{number}" for number in range(26)], "ann", [*known, body]))
    expected = [body.skeleton.segments[one] for one in body.attachment]
    given = [person.markerset.skeleton.segments[one] for one in person.markerset.attachment]
    same = [one == two for one, two in zip(given, expected, strict=True)]
    assert np.mean(same) > 0.8, list(zip(body.markers, given, expected, strict=True))
    sides = [(one[-2:], two[-2:]) for one, two in zip(given, expected, strict=True) if {one[-2], two[-2]} == {"."}]
    assert all(one == two for one, two in sides)


def test_what_is_no_person_has_no_person(known):
    """A chain of three boxes that swing: as large as a child, and nobody."""
    rng, time = np.random.default_rng(2), np.linspace(0, 6, 80)
    box = rng.uniform(-0.15, 0.15, (6, 3))
    parts, place = [], np.zeros((len(time), 3))
    for link in range(3):
        turn = rotations.exponential(np.column_stack([np.sin(time + link), 0.5 * np.cos(2 * time), 0 * time]))[0]
        parts.append(place[:, None] + np.einsum("fij,mj->fmi", turn, np.add(box, [0, 0, 0.25])))
        place = place + turn @ np.array([0, 0, 0.5])
    points = np.concatenate(parts, axis=1)
    shares: list[float] = []
    names = [f"B{number}" for number in range(18)]
    assert finished(person_in([points], names, "box", known[:1]), shares.append) is None
    assert shares == sorted(shares)
    assert shares[0] == 0 < shares[-1] <= 1


def found_at_once(person, *_):
    """Stands for the search for a person."""
    yield 1.0
    return person


def test_points_are_named_the_same_however_the_subject_is_drawn(known, monkeypatch):
    body = open_markerset("body26")
    points = make_performance(body).take.xyz[::6]
    names = tuple(f"M{number}" for number in range(len(body)))
    take = LabelledTake("walk.c3d", "ann", names, points)
    monkeypatch.setattr(learn, "LEARN", replace(learn.LEARN, max_frames=40))
    drawn = replace(body, name="ann", markers=names, aliases={})
    models = []
    for person in (None, FoundPerson(drawn, "body26", np.zeros(len(body)), 0.0)):
        monkeypatch.setattr(pipeline, "person_in", partial(found_at_once, person))
        models.append(finished(train([take], names, TrainingOptions("ann", search="none"), None, known)))
    groups, whole = models
    assert whole.model.markerset.skeleton.segments == body.skeleton.segments
    assert whole.body == "the body of body26, by how the markers move"
    assert any(doubt.startswith("no person's body was found") for doubt in groups.doubts)
    assert not any(doubt.startswith("no person's body was found") for doubt in whole.doubts)
    assert likelihood_document(groups.model.likelihood) == likelihood_document(whole.model.likelihood)
