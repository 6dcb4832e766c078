# SPDX-License-Identifier: GPL-3.0-or-later
"""Whose a blob may be, of several who are followed together."""

import numpy as np

from addon.core.blobs import sharing
from addon.core.blobs.subject import Setup
from addon.core.geometry.views import View
from addon.core.simulation.rigs import ring_rig


def test_a_blob_that_is_plainly_anothers_is_not_offered(model, monkeypatch):
    """Of markers 10 cm apart: what is on one, what is between both, and what is far from either but nearer to one."""
    cameras = ring_rig(3, (1280, 1024), 4.0, 2.2, 1.4)
    setup = Setup.of(cameras, model.markerset)
    own, other = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.1])
    blobs = np.array([own, (own + other) / 2, other, 1.9 * own - 0.9 * other])
    image = setup.sight.image(setup.sight.local(blobs[None])[0])
    view = View(image, np.ones(image.shape[:2], bool), np.arange(image[..., 0].size).reshape(image.shape[:2]))
    monkeypatch.setattr(sharing, "_led_to", lambda *_: np.array([own[None], other[None]]))
    first, second = sharing.shared(view, [None, None], setup, [None, None])
    assert first.real.tolist() == [[True, True, False, True]] * 3
    assert second.real.tolist() == [[False, True, True, False]] * 3
    assert (first.image[:, 2] == sharing.NOWHERE).all()
    np.testing.assert_array_equal(first.row, view.row)
    fixed = np.array([[2], [-1], [1]])  # by a person, the second one's in two cameras
    first, second = sharing.shared(view, [None, None], setup, [None, fixed])
    assert first.real.tolist() == [[True, True, False, True], [True, True, False, True], [True, False, False, True]]
    assert second.real.tolist() == [[False, True, True, False]] * 3
    first, second = sharing.shared(view, [None, None], setup, [fixed, None])
    assert first.real[:, 2].tolist() == [True, False, False]
    assert second.real[:, 1:3].tolist() == [[True, False], [True, True], [False, True]]
