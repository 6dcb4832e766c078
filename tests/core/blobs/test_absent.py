# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker of the set that nobody put on: its neighbours' blobs are theirs."""

import numpy as np

from addon.core.blobs.absent import absent_markers
from addon.core.blobs.pipeline import label_take
from addon.core.data.takes import EXCLUSIVE
from addon.core.papers.virtual_occlusions.labelling import hand_over
from tests.core.blobs.followed import RIG, followed, take_name, walk, wrong_names
from tests.core.scenes import RATE, keep


def test_who_wears_all_markers_lacks_none():
    _, _, _, results = followed()
    assert not len(absent_markers(results))
    assert not len(absent_markers(results[:10]))


def test_a_marker_that_was_not_put_on_has_no_name():
    scene = walk()
    kept = np.array(["RFHD" not in text.split("|") for text in scene.truth])
    (chunk,) = label_take([keep(scene.blobs, np.flatnonzero(kept))], RIG, scene.markerset, RATE)
    names, truth = scene.names(chunk.labels.marker), scene.truth[kept]
    assert "RFHD" not in names
    heads = [index for index, text in enumerate(truth) if "HD" in text]
    assert np.mean([names[index] in truth[index].split("|") for index in heads]) > 0.99


def test_blobs_on_a_neighbours_point_are_the_neighbours():
    scene, _, views, results = followed()
    naming = results[40].naming
    missing, other = (scene.markerset.index(name) for name in ("RFHD", "RBHD"))
    take_name(naming, missing)
    lent = naming.slot[:, other].copy()
    cameras = np.flatnonzero(lent >= 0)[:1]
    naming.withdraw(cameras, np.full(1, other))
    naming.give(cameras, np.full(1, missing), lent[cameras], EXCLUSIVE)
    hand_over(naming, cameras, np.full(1, missing))
    assert (naming.slot[:, missing] < 0).all()
    assert np.array_equal(naming.slot[:, other], lent)
    assert not wrong_names(scene, views[40:41], results[40:41]).any()
