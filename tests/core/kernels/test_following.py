# SPDX-License-Identifier: GPL-3.0-or-later
"""Following a subject in C against NumPy: the same names, bodies and tracks, frame by frame."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.blobs import confidence
from addon.core.blobs.confidence import CONFIDENCE
from addon.core.blobs.image_tracklets import link_blobs
from addon.core.blobs.search import Hints, find_subject
from addon.core.blobs.subject import Setup
from addon.core.blobs.tracking import Track, followed_by_library, followed_by_numpy
from addon.core.body.bodies import Bodies
from addon.core.geometry.views import View
from addon.core.papers.virtual_occlusions.labelling import named_by_numpy
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import CaptureOptions
from addon.core.simulation.virtual import Act
from tests.core.scenes import RATE, act, built_in
from tests.core.toybody import toy_markerset

from .conftest import numpy_everywhere
from .test_bodies import both, refused, same
from .test_frames import RULES, SEEDS, scene

RIG = ring_rig(4, radius=4.5, volume_radius=1.3)
ROOM = CaptureOptions(noise=0.4, reflections=2, flicker=0.2)


class Nothing:
    """A volume that hides no marker, and is not of capsules."""

    def hidden(self, rotations, joints, scale, markers, centres):
        return np.zeros((len(markers), len(centres), markers.shape[1]), bool)


def begun(name: str, occlusion=None):
    """A setup, the views of a walk and a track that begins with its first frame."""
    markerset = toy_markerset() if name == "toy" else built_in(name)
    walk = act(markerset, RIG, [Act(0.4, stride=0.9)], seed=4, options=ROOM)
    setup, views = Setup.of(RIG, markerset, occlusion, rate=RATE), walk.views()
    found = find_subject(views[0], setup, Hints())
    points, visible = found.naming.meeting.points, found.expected.visible
    return setup, views, Track.begin(found.subject, points, visible, setup.model)


def numbers_of(followed) -> list[np.ndarray]:
    track, naming = followed.track, followed.naming
    bodies = [getattr(track.subject.bodies, name) for name in Bodies.__dataclass_fields__]
    learned = [track.subject.own_sd, np.array(track.subject.pixel), track.velocity, track.lag]
    seen = [naming.meeting.points, naming.meeting.residual, naming.meeting.miss, naming.reprojection]
    measured = [getattr(naming.frame, name) for name in ("image", "slope", "depth", "metres", "nll")]
    return [*bodies, *learned, *seen, *measured, followed.expected.points, followed.expected.covariance]


def compare(track, view, setup, fixed=None):
    """The next frame by the library, found to be the same as by NumPy."""
    one = followed_by_library(track, view, setup, fixed)
    with numpy_everywhere():
        other = followed_by_numpy(track, view, setup, fixed)
        same(numbers_of(one), numbers_of(other))
    for name in ("slot", "step", "owner", "partner", "conflicts"):
        assert (getattr(one.naming, name) == getattr(other.naming, name)).all(), name
    assert one.track.lost == other.track.lost
    assert (one.expected.visible == other.expected.visible).all()
    return one


@pytest.mark.parametrize(
    ("name", "occlusion"), [("toy", None), ("gait15", None), ("gait15", Nothing()), ("body26", None)]
)
def test_frames_are_followed_the_same(name, occlusion):
    setup, views, track = begun(name, occlusion)
    for view in views[1:12]:
        track = compare(track, view, setup).track
    assert not track.lost


def test_what_a_person_named_a_frame_without_blobs_and_one_with_many_more_are_followed_the_same():
    setup, views, track = begun("gait15")
    fixed = np.full((len(RIG), setup.model.marker_count), -1)
    for camera in range(len(RIG)):
        fixed[camera, camera] = np.flatnonzero(views[1].real[camera])[-1]
    followed = compare(track, views[1], setup, fixed)
    assert (followed.naming.slot[fixed >= 0] == fixed[fixed >= 0]).all()
    assert (followed.naming.frame.fixed == fixed).all()
    setup, views, track = begun("gait15")
    view = views[1]
    nothing = replace(view, image=view.image * 0 + 1e6, real=view.real & False)
    crowd = replace(view, **{name: np.repeat(getattr(view, name), 3, axis=1) for name in ("image", "real", "row")})
    for seen in (nothing, crowd, view):
        followed = compare(track, seen, setup)
    assert compare(track, nothing, setup).track.lost and not followed.track.lost


def test_what_does_not_fit_is_refused():
    setup, views, track = begun("toy")
    far = np.full((len(RIG), setup.model.marker_count), views[1].real.shape[1])
    refused(
        lambda: followed_by_library(track, views[1], setup, far),
        lambda: followed_by_library(track, views[1], setup, far[1:]),
        lambda: followed_by_library(replace(track, lag=track.lag[1:]), views[1], setup, None),
        lambda: followed_by_library(replace(track, visible=track.visible.T), views[1], setup, None),
        lambda: followed_by_library(track, replace(views[1], real=views[1].real[1:]), setup, None),
    )


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.sampled_from([2, 3, 8]), st.sampled_from([1, 2, 9, 20]), st.integers(0, 4))
def test_confidences_are_the_same(seed, cameras, markers, ghosts):
    _, sight, view, expected = scene(seed, cameras, markers, ghosts)
    naming = named_by_numpy(view, sight, expected, RULES, None, step1_only=False)
    same(
        [confidence.named_confidences.kernel(naming, CONFIDENCE)],
        [confidence.named_confidences.reference(naming, CONFIDENCE)],
    )


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.sampled_from([1, 3]), st.sampled_from([1, 4, 12]), st.sampled_from([1, 3, 14]))
def test_blobs_go_on_the_same(seed, cameras, earlier, blobs):
    generator = np.random.default_rng(seed)
    places = [generator.uniform(-0.05, 0.05, (cameras, count, 2)) for count in (earlier, blobs)]
    some = min(earlier, blobs)
    places[1][:, :some] = places[0][:, :some] + generator.normal(0, 0.004, (cameras, some, 2))
    real = [generator.random(part.shape[:2]) < 0.8 for part in places]
    before, view = (View(part, there, there - 1) for part, there in zip(places, real, strict=True))
    speed = np.where(generator.random((cameras, earlier, 1)) < 0.3, np.nan, generator.normal(0, 0.004, places[0].shape))
    depth = generator.uniform(2, 5, cameras)
    both(link_blobs, before, view, speed, depth, (0.015, 0.06), (2.0, 0.003))


def test_a_frame_whose_fit_cannot_be_solved_is_left_to_numpy():
    setup, views, track = begun("toy")
    bodies = track.subject.bodies
    nowhere = replace(bodies, translation=bodies.translation * np.nan)
    lost = replace(track, subject=replace(track.subject, bodies=nowhere))
    assert followed_by_library(lost, views[1], setup, None) is None
