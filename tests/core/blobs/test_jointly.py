# SPDX-License-Identifier: GPL-3.0-or-later
"""All names of one frame at once, and arms held otherwise than people of the set hold them."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.blobs.jointly import hypotheses_of, name_jointly
from addon.core.blobs.search import HELD, Hints, find_subject, with_arms_held
from addon.core.blobs.subject import Setup
from addon.core.body.bodies import BodyModel
from addon.core.geometry.views import Sight
from addon.core.papers.virtual_occlusions.labelling import Expectation, Frame, Rules
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import CaptureOptions
from tests.core.scenes import built_in, film, person_of

RIG = ring_rig(4, generator=np.random.default_rng(5))
ROOM = CaptureOptions(noise=0.5, reflections=2, flicker=0.5)


def standing(arms=None, moved=(), seed=4, options=ROOM):
    """Somebody in `body26`, the arms held in one of the ways `HELD`, with markers worn (name, offset m) elsewhere."""
    markerset = built_in("body26")
    model = BodyModel(markerset)
    person = person_of(markerset, seed, 1.75)
    if arms is not None:
        person = with_arms_held(person, model).pick([1 + arms])
    own = person.own.copy()
    for name, offset in moved:
        own[0, markerset.index(name)] += np.array(offset) / 1.75
    return film(markerset, RIG, replace(person, own=own), replace(options, seed=seed))


def wrong_in(scene, naming):
    """Blobs with a name that is not theirs, and blobs of markers without one."""
    view = scene.views()[0]
    row, right = scene.given(view, naming)
    return (~right).sum(), (scene.truth[np.setdiff1d(view.row[view.real], row)] != "").sum()


def frame_of(scene, sd=0.015):
    model = BodyModel(scene.markerset)
    points = model.pose(replace(scene.bodies, own=0 * scene.bodies.own)).markers[0]
    sight = Sight(RIG)
    inside = sight.inside(sight.image(sight.local(points[None])))[0]
    expected = Expectation(points, np.tile(sd**2 * np.eye(3), (len(points), 1, 1)), inside)
    return Frame(scene.views()[0], sight, expected, Rules(pixel=0.5))


def test_a_marker_worn_elsewhere_is_named_and_said_to_be():
    scene = standing(moved=[("LWRB", (0.0, 0.0, -0.11))])
    naming, elsewhere = name_jointly(frame_of(scene))
    marker = scene.markerset.index("LWRB")
    named = [scene.truth[scene.views()[0].row[c, k]] for c, k in enumerate(naming.slot[:, marker]) if k >= 0]
    assert len(named) >= 2 and all("LWRB" in one.split("|") for one in named)
    assert elsewhere[marker]


def test_every_marker_and_every_blob_is_used_once():
    scene = standing()
    frame = frame_of(scene)
    naming, _ = name_jointly(frame)
    for camera, slots in enumerate(naming.slot):
        used = slots[slots >= 0]
        assert len(np.unique(used)) == len(used)
        assert (naming.owner[camera, used] == np.flatnonzero(slots >= 0)).all()
    found = hypotheses_of(frame)
    assert (found.gain > 0).all() and ((found.slot >= 0).sum(axis=1) >= 1).all()


@pytest.mark.parametrize("arms", np.flatnonzero(~HELD[:, 1].any(axis=1)).tolist())
def test_stretched_arms_are_found_wherever_they_point(arms):
    scene = standing(arms, seed=arms)
    found = find_subject(scene.views()[0], Setup.of(RIG, scene.markerset), Hints(), alone=True)
    wrong, missed = wrong_in(scene, found.naming)
    assert wrong <= 1 and missed <= 2


def test_bodies_without_arms_stay_as_they_are():
    model = BodyModel(built_in("gait15"))
    assert len(with_arms_held(model.rest(3, 1.7), model)) == 3
    whole = BodyModel(built_in("body26"))
    assert len(with_arms_held(whole.rest(3, 1.7), whole)) == 3 * (1 + len(HELD))


def test_of_many_cameras_neighbours_do_not_crowd_out_a_marker():
    cameras, markerset = ring_rig(20, generator=np.random.default_rng(5)), built_in("gait15")
    scene = film(markerset, cameras, person_of(markerset, 2, 1.75), replace(ROOM, reflections=0, seed=2))
    found = find_subject(scene.views()[0], Setup.of(cameras, markerset), Hints(), alone=True)
    assert wrong_in(scene, found.naming) == (0, 0)
