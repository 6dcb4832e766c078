# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's body found in takes whose marker names say nothing; what is no person stays what it is."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.progress import finished
from addon.core.geometry import rotations
from addon.core.points.likelihood import learn
from addon.core.training import pipeline
from addon.core.training.people import person_in
from addon.core.training.pipeline import TrainingOptions, train
from addon.core.training.takes import LabelledTake
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from addon.io.models import likelihood_document

FRAMES = 100


@pytest.fixture(scope="module")
def known():
    return [open_markerset(name) for name in ("actor41",)]


def test_markers_in_usual_places_are_known_without_their_names_and_what_is_no_person_is_none(known):
    body = open_markerset("body26")
    points = make_performance(body).take.xyz[::4]
    found = person_in([points], [f"M{number}" for number in range(26)], "ann", [*known, body])
    assert found is not None
    person, name = found
    assert name in ("actor41", "body26")
    expected = [body.skeleton.segments[one] for one in body.attachment]
    given = [person.skeleton.segments[one] for one in person.attachment]
    same = [one == two for one, two in zip(given, expected, strict=True)]
    assert np.mean(same) > 0.8, list(zip(body.markers, given, expected, strict=True))
    sides = [(one[-2:], two[-2:]) for one, two in zip(given, expected, strict=True) if {one[-2], two[-2]} == {"."}]
    assert all(one == two for one, two in sides)
    # A chain of three boxes that swing: as large as a child, and nobody.
    rng, time = np.random.default_rng(2), np.linspace(0, 6, 80)
    box = rng.uniform(-0.15, 0.15, (6, 3))
    parts, place = [], np.zeros((len(time), 3))
    for link in range(3):
        turn = rotations.exponential(np.column_stack([np.sin(time + link), 0.5 * np.cos(2 * time), 0 * time]))[0]
        parts.append(place[:, None] + np.einsum("fij,mj->fmi", turn, np.add(box, [0, 0, 0.25])))
        place = place + turn @ np.array([0, 0, 0.5])
    points = np.concatenate(parts, axis=1)
    names = [f"B{number}" for number in range(18)]
    assert person_in([points], names, "box", known[:1]) is None


def test_points_are_named_the_same_however_the_subject_is_drawn(known, monkeypatch):
    body = open_markerset("body26")
    points = make_performance(body).take.xyz[::6]
    names = tuple(f"M{number}" for number in range(len(body)))
    take = LabelledTake("walk.c3d", "ann", names, points)
    monkeypatch.setattr(learn, "LEARN", replace(learn.LEARN, max_frames=40))
    drawn = replace(body, name="ann", markers=names, aliases={})
    models = []
    for person in (None, (drawn, "body26")):
        monkeypatch.setattr(pipeline, "person_in", lambda *_, person=person: person)
        models.append(finished(train([take], names, TrainingOptions("ann", search="none"), None, known)))
    groups, whole = models
    assert whole.model.markerset.skeleton.segments == body.skeleton.segments
    assert whole.body == "the body of body26, by how the markers move"
    assert any(doubt.startswith("no person's body was found") for doubt in groups.doubts)
    assert not any(doubt.startswith("no person's body was found") for doubt in whole.doubts)
    assert likelihood_document(groups.model.likelihood) == likelihood_document(whole.model.likelihood)
