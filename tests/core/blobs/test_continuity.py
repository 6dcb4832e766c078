# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that jump to a neighbour while the markers move on smoothly."""

import numpy as np

from addon.core.blobs.continuity import renamed
from tests.core.blobs.followed import exchange, followed, take_name, wrong_names
from tests.core.scenes import RATE


def test_a_name_that_a_hidden_neighbour_lent_goes_back():
    """LWRA was hidden at first, and LFIN had its name."""
    scene, _, views, results = followed()
    for result in results[:14]:
        take_name(result.naming, scene.markerset.index("LWRA"))
    exchange(scene, results, range(14), "LWRA", "LFIN")
    assert wrong_names(scene, views, results).any()
    changes = renamed(results, RATE)
    assert [(first, last) for first, last, _ in changes] == [(0, 13)]
    assert {scene.markerset.markers[index] for index in changes[0][2]} == {"LWRA", "LFIN"}
    assert not wrong_names(scene, views, results).any()


def test_an_exchange_is_undone():
    scene, _, views, results = followed()
    exchange(scene, results, range(20, 40), "LANK", "LHEE", "LTOE")
    assert [(first, last) for first, last, _ in renamed(results, RATE)] == [(20, 39)]
    assert not wrong_names(scene, views, results).any()


def test_what_never_jumped_keeps_its_names():
    _, _, _, results = followed()
    before = [result.naming.slot.copy() for result in results]
    assert renamed(results, RATE) == []
    assert all(np.array_equal(slot, result.naming.slot) for slot, result in zip(before, results, strict=True))


def test_frames_without_anybody():
    assert renamed([None, None], RATE) == []
    _, _, _, results = followed()
    assert renamed([*results[:20], None, *results[21:]], RATE) == []
