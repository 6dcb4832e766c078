# SPDX-License-Identifier: GPL-3.0-or-later
"""A walk that was followed frame by frame, for tests of what is done with labelled frames."""

from dataclasses import replace
from functools import cache

import numpy as np

from addon.core.blobs.search import Hints, find_subject
from addon.core.blobs.subject import Setup
from addon.core.blobs.swaps import swap_names
from addon.core.blobs.tracking import FrameResult, Track, follow
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import CaptureOptions
from addon.core.simulation.virtual import Act
from tests.core.scenes import RATE, act, built_in

RIG = ring_rig(8, radius=4.5, volume_radius=1.3)


@cache
def walk():
    """A walk of 1.2 s from standing, in `body26`."""
    return act(built_in("body26"), RIG, (Act(0.3), Act(0.9, stride=0.9)), seed=3, options=CaptureOptions(noise=0.3))


def followed():
    """The walk, its setup and views, and its frames by index as followed; the names are the caller's own."""
    scene = walk()
    setup, views, results = _followed()
    arrays = ("slot", "step", "owner", "partner", "conflicts")
    copied = [{name: getattr(result.naming, name).copy() for name in arrays} for result in results]
    copies = [replace(one, naming=replace(one.naming, **own)) for one, own in zip(results, copied, strict=True)]
    return scene, setup, views, dict(enumerate(copies))


def begun(scene, occlusion=None):
    """The setup of a scene, its views, who is found in the first of them, and a track that begins there."""
    setup, views = Setup.of(scene.cameras, scene.markerset, occlusion, rate=RATE), scene.views()
    found = find_subject(views[0], setup, Hints())
    track = Track.begin(found.subject, found.naming.meeting.points, found.expected.visible, setup.model)
    return setup, views, found, track


@cache
def _followed():
    scene = walk()
    setup, views, found, track = begun(scene)
    sure = np.ones(len(scene.markerset))
    results = [FrameResult(found.subject.bodies, found.naming, found.expected, found.confidence, sure)]
    for view in views[1:]:
        one = follow(track, view, setup)
        track = one.track
        results.append(FrameResult(track.subject.bodies, one.naming, one.expected, found.confidence, sure))
    return setup, views, results


def take_name(naming, marker: int):
    """Takes back the marker's name wherever it was given; returns the cameras and slots."""
    cameras = np.flatnonzero(naming.slot[:, marker] >= 0)
    slots = naming.slot[cameras, marker]
    naming.withdraw(cameras, np.full(len(cameras), marker))
    return cameras, slots


def wrong_names(scene, views, results):
    """(F,) how many blobs of each frame have a name that is not theirs."""
    frames = zip(views, results.values(), strict=True)
    return np.array([(~scene.given(view, result.naming)[1]).sum() for view, result in frames])


def exchange(scene, results, frames, *markers):
    """Hands the names of markers around, each the next one's, in some frames."""
    index = [scene.markerset.index(name) for name in markers]
    order = np.arange(len(scene.markerset))
    order[index] = np.roll(index, -1)
    for frame in frames:
        swap_names(results[frame].naming, order)
