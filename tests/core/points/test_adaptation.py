# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes of people in other plates than the model's: named by what the take itself tells, and doubts are said."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.takes import BY_LIKELIHOOD, BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Verdict
from addon.core.points.adaptation import adapt, borne_out
from addon.core.points.likelihood.model import Likelihood
from addon.core.points.models import Model, TrainingTake
from addon.core.points.rigid_bodies.model import learn_rigid_bodies
from addon.core.points.tracklets import cut
from tests.core.points.rigid_bodies.plated import NAMES, RATE, body, walk
from tests.core.toybody import toy_markerset

FIRST_FRAME = 100


@pytest.fixture(scope="module")
def model():
    takes = np.concatenate([walk(body()), walk(body(), 1)])
    likelihood = Likelihood(NAMES, None, None, None, 1, learn_rigid_bodies([takes], 0.5))
    markerset = replace(toy_markerset(), markers=NAMES)
    return Model(markerset, likelihood, training_takes=(TrainingTake("somebody", ("take",), len(takes), takes),))


def adapted_to(model, points):
    return adapt(model, points, cut(points, RATE), RATE)


def named_by(marker: np.ndarray) -> Verdict:
    """What frames and votes may have said: these markers (T, P), for sure."""
    named = marker != NO_MARKER
    return Verdict(Labels(marker, np.where(named, BY_LIKELIHOOD, 0), named * 1.0))


@pytest.fixture(scope="module")
def other(model):
    points = walk(body(2, limb=0.06, form=0.006, place=0.015), 12)
    return points, adapted_to(model, points)


def right_of(points: np.ndarray) -> np.ndarray:
    return np.broadcast_to(np.arange(points.shape[1]), points.shape[:2])


def test_the_subject_of_the_training_needs_nothing_else(model):
    points = walk(body(), 5)
    adaptation = adapted_to(model, points)
    assert adaptation.model is model
    assert not adaptation.other_layout
    assert (borne_out(named_by(right_of(points)), adaptation, FIRST_FRAME).labels.marker == right_of(points)).all()


def test_somebody_else_is_named_with_plates_of_their_own_and_the_report_begins_with_it(model, other):
    points, adaptation = other
    assert adaptation.other_layout
    assert adaptation.model.likelihood.rigid_bodies is adaptation.recognition.rigid_bodies
    assert model.likelihood.rigid_bodies is not adaptation.recognition.rigid_bodies
    decided = borne_out(named_by(right_of(points)), adaptation, FIRST_FRAME)
    assert decided.suspects[0].reason.startswith("the rigid bodies are not those of the training")
    assert (decided.suspects[0].first, decided.suspects[0].last) == (FIRST_FRAME, FIRST_FRAME + len(points) - 1)
    unnamed = {NAMES[index] for index in np.flatnonzero((decided.labels.marker == NO_MARKER).all(axis=0))}
    (missing,) = [s.reason for s in decided.suspects if s.reason.startswith("not found for sure")]
    assert unnamed == set(missing.split(": ")[1].split())


def test_a_name_that_the_motion_contradicts_is_taken_back_and_said(other):
    points, adaptation = other
    marker = right_of(points).copy()
    sure = np.flatnonzero((adaptation.recognition.marker == right_of(points)).all(axis=0))
    one, two = sure[0], sure[5]
    marker[20:60, [one, two]] = marker[20:60, [two, one]]
    decided = borne_out(named_by(marker), adaptation, FIRST_FRAME)
    assert (decided.labels.marker[20:60, [one, two]] == NO_MARKER).all()
    assert (decided.labels.marker[:20, one] == one).all()
    words = f"trajectory {one} moves as {NAMES[one]} and looks like {NAMES[two]}, so it stays unnamed"
    assert [(s.first, s.last) for s in decided.suspects if s.reason == words] == [(FIRST_FRAME + 20, FIRST_FRAME + 59)]


def test_what_only_motion_tells_is_named_by_it(other):
    points, adaptation = other
    decided = borne_out(named_by(np.full(points.shape[:2], NO_MARKER)), adaptation, FIRST_FRAME)
    named = decided.labels.marker != NO_MARKER
    assert named.mean() > 0.7
    assert (decided.labels.marker == right_of(points))[named].all()
    assert (decided.labels.step == np.where(named, BY_TRAJECTORY, NO_STEP)).all()
    assert (decided.labels.confidence[named] > 0.9).all()


def test_models_that_cannot_tell_are_left_as_they_are_and_forms_alone_are_said_to_tell(model):
    points = walk(body(), 5)[:50]
    forgetful = replace(model, training_takes=())
    bare = replace(model, likelihood=None)
    skin = replace(model, likelihood=replace(model.likelihood, rigid_bodies=None))
    for given in (forgetful, bare, skin):
        adaptation = adapted_to(given, points)
        assert adaptation.model is given
        assert adaptation.recognition is None
        assert borne_out(named_by(right_of(points)), adaptation, 0).suspects == ()
    points = walk(body(), 5, liveliness=0.003)
    adaptation = adapted_to(model, points)
    assert adaptation.model is model
    decided = borne_out(named_by(right_of(points)), adaptation, FIRST_FRAME)
    assert (decided.labels.marker == right_of(points)).all()
    assert any("rest on the rigid bodies' forms alone" in suspect.reason for suspect in decided.suspects)
