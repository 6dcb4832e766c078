# SPDX-License-Identifier: GPL-3.0-or-later
"""Second thoughts on a frame: neighbours that changed names get them back, strangers to the body lose theirs."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from addon.core.blobs.search import Hints, find_subject, settle
from addon.core.blobs.subject import Setup, refit
from addon.core.blobs.swaps import swap_names, withdraw_unexpected, without_own
from addon.core.body.prior import Prior
from addon.core.data.takes import EXCLUSIVE
from addon.core.papers.virtual_occlusions.labelling import Frame, Naming
from addon.core.simulation.rigs import paper_rig, ring_rig
from tests.core.papers.virtual_occlusions.test_labelling import consistent
from tests.core.scenes import FLAWLESS, built_in, stand

RIG = paper_rig()
RING = ring_rig(8)


@cache
def case(name="body26", seed=2, rig=RIG):
    """A scene of a standing person, its setup, and the subject as found in it."""
    scene = stand(built_in(name), rig, seed, facing=0.8, options=FLAWLESS)
    setup = Setup.of(rig, scene.markerset)
    return scene, setup, find_subject(scene.views()[0], setup, Hints())


def true_naming(scene, found):
    """Every blob named as it really is."""
    view, names = scene.views()[0], list(scene.markerset.markers)
    naming = Naming.empty(Frame(view, found.naming.frame.sight, found.expected, found.naming.frame.rules))
    for camera, slot in np.argwhere(view.real):
        marker = names.index(scene.truth[view.row[camera, slot]].split("|")[0])
        naming.give(np.array([camera]), np.array([marker]), np.array([slot]), EXCLUSIVE)
    return naming


def fitted(scene, setup, found, naming):
    subject = without_own(found.subject, setup)
    prior = Prior(setup.model, upright_sd=0.35)
    subject, state = refit(naming, subject, setup, 4, prior)
    return subject, state, prior


def order_of(scene, *pairs):
    """The exchange of pairs of markers, "A-B" each."""
    order = np.arange(len(scene.markerset))
    for pair in pairs:
        first, second = (scene.markerset.index(name) for name in pair.split("-"))
        order[first], order[second] = second, first
    return order


LEGS, APART = ("LKNE-RKNE", "LANK-RANK", "LHEE-RHEE", "LTOE-RTOE"), ("LFHD-RFHD", "LWRA-LFIN", "RWRA-RFIN")


@pytest.mark.parametrize("names", [("LFHD-RFHD",), ("LWRA-LFIN",), ("LANK-LHEE",), LEGS, APART])
def test_swapped_neighbours_get_their_names_back(names):
    """And no doubt is left of them."""
    scene, setup, found = case()
    naming = true_naming(scene, found)
    right = naming.slot.copy()
    swap_names(naming, order_of(scene, *names))
    subject, state, prior = fitted(scene, setup, found, naming)
    swaps = settle(naming, subject, state, setup, prior)
    assert np.array_equal(consistent(naming).slot, right)
    assert swaps.loss.min() >= 0, (swaps.orders[swaps.loss < 0], swaps.loss.min())


def test_neighbours_of_a_marker_that_was_never_put_on_get_their_names_back():
    """One of the head's four is not there; another has its name, and a single blob of a third is named as that one."""
    scene, setup, found = case(rig=RING)
    naming = true_naming(scene, found)
    absent, beside, behind = (scene.markerset.index(name) for name in ("RFHD", "LFHD", "LBHD"))
    view = naming.frame.view
    camera = np.flatnonzero(naming.slot[:, absent] >= 0)
    gone = view.real.copy()
    gone[camera, naming.slot[camera, absent]] = False
    naming.withdraw(camera, np.full(len(camera), absent))
    view = replace(view, real=gone)
    right = naming.slot.copy()
    swap_names(naming, order_of(scene, "LFHD-RFHD"))
    cameras = np.flatnonzero((naming.slot[:, behind] >= 0) & (naming.slot[:, beside] < 0))
    camera = cameras[:1]
    assert len(cameras) >= 3  # so that two are left, which fix the point
    slot = naming.slot[camera, behind]
    naming.withdraw(camera, np.array([behind]))
    naming.give(camera, np.array([beside]), slot, EXCLUSIVE)
    subject, state, prior = fitted(scene, setup, found, naming)
    settle(naming, subject, state, setup, prior)
    right[camera, behind] = -1
    assert np.array_equal(consistent(naming).slot[:, [absent, beside, behind]], right[:, [absent, beside, behind]])


@pytest.mark.parametrize("far", [0.12, 0.3])
def test_a_name_that_the_body_would_not_expect_is_withdrawn(far):
    """A28: two ghosts that happen to meet far from where the rest of the body has the marker keep no name."""
    scene, setup, found = case("gait15")
    naming = true_naming(scene, found)
    marker = scene.markerset.index("LKNE")
    camera = np.flatnonzero(naming.slot[:, marker] >= 0)
    naming.withdraw(camera, np.full(len(camera), marker))
    # Two blobs in space where nobody is: images of one point in two cameras, put in place of the real ones.
    ghost = RIG.normalised(scene.points[0, marker] + far * np.array([0.6, 0.8, 0]))
    image = naming.frame.view.image.copy()
    pair = camera[:2]
    slots = np.array([np.flatnonzero(naming.owner[c] < 0)[0] for c in pair])
    image[pair, slots] = ghost[pair]
    view = replace(naming.frame.view, image=image)
    haunted = Naming.empty(Frame(view, setup.sight, found.expected, naming.frame.rules))
    c, m = np.nonzero(naming.slot >= 0)
    haunted.give(c, m, naming.slot[c, m], EXCLUSIVE)
    haunted.give(pair, np.full(2, marker), slots, EXCLUSIVE)
    assert haunted.meeting.residual[marker] < 1e-6
    prior = Prior(setup.model, upright_sd=0.35)
    subject, state = refit(haunted, without_own(found.subject, setup), setup, 4, prior)
    withdraw_unexpected(haunted, state, subject, setup)
    assert (consistent(haunted).slot[:, marker] == -1).all()
    kept = (haunted.slot >= 0).sum() / (naming.slot >= 0).sum()
    assert kept > 0.9
