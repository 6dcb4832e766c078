# SPDX-License-Identifier: GPL-3.0-or-later
"""Following from frame to frame: the paper's future tracker, with two iterations a frame."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.blobs.search import Hints, find_subject
from addon.core.blobs.subject import Setup
from addon.core.blobs.tracking import FOLLOWING_STEPS, Track, difference, follow
from addon.core.body.bodies import BodyModel
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import CaptureOptions
from addon.core.simulation.virtual import Act
from tests.core.scenes import RATE, act, built_in
from tests.core.toybody import toy_markerset

RIG = ring_rig(6, radius=4.5, volume_radius=1.3)
ROOM = CaptureOptions(noise=0.4, reflections=1, flicker=0.1)
MODEL = BodyModel(toy_markerset())


@cache
def walk(name="gait15", noise=0.4):
    acts = [Act(0.2), Act(1.2, stride=0.9), Act(0.6, stride=0.4, turn=1.5)]
    return act(built_in(name), RIG, acts, seed=3, options=replace(ROOM, noise=noise))


def begun(scene):
    """The setup, the views and a track that was found in the first of them."""
    setup = Setup.of(RIG, scene.markerset, rate=RATE)
    views = scene.views()
    found = find_subject(views[0], setup, Hints())
    return setup, views, Track.begin(found.subject, found.naming.meeting.points, found.expected.visible, setup.model)


def right_names(scene, view, naming):
    """(named, rightly named) of one frame."""
    camera, marker = np.nonzero(naming.slot >= 0)
    rows = view.row[camera, naming.slot[camera, marker]]
    names = [scene.markerset.markers[m] in scene.truth[row].split("|") for m, row in zip(marker, rows, strict=True)]
    return len(names), sum(names)


def random_bodies(seed, count=3):
    generator = np.random.default_rng(seed)
    step = generator.normal(0, 0.3, (count, MODEL.parameters))
    return MODEL.rest(count, 1.7).moved(step), generator


@given(st.integers(0, 2**16))
def test_a_difference_is_the_step_that_leads_there(seed):
    bodies, generator = random_bodies(seed)
    step = generator.normal(0, 0.4, (3, MODEL.parameters))
    assert difference(bodies.moved(step), bodies) == pytest.approx(step, abs=1e-9)
    assert difference(bodies, bodies) == pytest.approx(np.zeros_like(step), abs=1e-12)


@pytest.mark.parametrize("name", ["gait15", "body26"])
def test_a_walk_is_followed_with_two_iterations_a_frame(name):
    """A34: at 60 frames a second from the previous pose: iterations a frame, lost-track rate, right names."""
    assert FOLLOWING_STEPS == 2
    scene = walk(name)
    setup, views, track = begun(scene)
    named = right = 0
    errors = []
    for index, view in enumerate(views[1:], 1):
        followed = follow(track, view, setup)
        track = followed.track
        assert not track.lost
        assert np.linalg.norm(track.subject.bodies.quaternion) == pytest.approx(1, abs=1e-12)
        given, good = right_names(scene, view, followed.naming)
        named, right = named + given, right + good
        errors.append(np.linalg.norm(followed.expected.points - scene.points[index], axis=1).mean())
    assert right / named > 0.9995
    assert right > 0.99 * (scene.truth[scene.blobs.frame > 0] != "").sum()
    assert np.mean(errors) < 0.006


@pytest.mark.parametrize("noise", [0.3, 1.2])
def test_it_learns_the_takes_noise(noise):
    scene = walk("gait15", noise)
    setup, views, track = begun(scene)
    for view in views[1:]:
        track = follow(track, view, setup).track
    assert track.subject.pixel == pytest.approx(noise, rel=0.35)
