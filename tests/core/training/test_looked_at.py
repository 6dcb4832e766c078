# SPDX-License-Identifier: GPL-3.0-or-later
"""What nobody looked at and is doubtful is not learned, and that is said; so are markers that are hardly there."""

import numpy as np

from addon.core.training.looked_at import learnable

NAMES = ("LHEE", "RHEE", "LTOE", "RTOE")


def test_doubtful_samples_are_left_out_and_said():
    xyz = np.ones((100, 4, 3))
    xyz[:10, 0] = np.nan
    doubtful = np.zeros((100, 4), bool)
    doubtful[:20, 0] = True
    doubtful[50:52, 1] = True
    learned = learnable(xyz, doubtful, NAMES)
    assert np.isnan(learned.xyz[:20, 0]).all() and np.isfinite(learned.xyz[20:, 0]).all()
    assert np.isnan(learned.xyz[50:52, 1]).all()
    [said] = learned.doubts
    assert said.startswith("LHEE, RHEE: 12 doubtful frames that nobody looked at were not learned; correct them or")
    assert np.isfinite(xyz[10:, 0]).all(), "the take is not touched"


def test_markers_that_are_never_or_hardly_there_are_said():
    xyz = np.ones((1000, 4, 3))
    xyz[:, 0] = np.nan
    xyz[5:, 1] = np.nan
    doubtful = np.zeros((1000, 4), bool)
    doubtful[:, 2] = True
    told = learnable(xyz, doubtful, NAMES).doubts
    assert told[0].startswith("LTOE: 1000 doubtful frames")
    assert told[1] == "LHEE, LTOE: found in no frame that could be learned, so what was known before stays"
    assert told[2] == "RHEE (5): found in hardly any frames that could be learned, so little is new of them"


def test_a_take_without_doubts_is_learned_whole():
    xyz = np.random.default_rng(0).normal(size=(30, 4, 3))
    learned = learnable(xyz, np.zeros((30, 4), bool), NAMES)
    np.testing.assert_array_equal(learned.xyz, xyz)
    assert learned.doubts == ()
