# SPDX-License-Identifier: GPL-3.0-or-later
"""The bones of a character: a T-pose at rest, and in every pose where the body has its joints."""

import numpy as np

from addon.core.geometry import rotations
from addon.core.posing.character import character_of
from addon.io.markersets import open_markerset

HEIGHT = 1.7


def at_rest(markerset):
    """Segments' names, joints (J, 3) m and far ends (J, 3) m of a body at rest."""
    joints = markerset.skeleton.rest_joints * HEIGHT
    ends = joints + np.array([0, 0, 0.15])
    for index, name in enumerate(markerset.skeleton.segments):
        if name.startswith(("hand", "foot")):
            ends[index] = joints[index] + (np.array([0, 0, -0.1]) if name.startswith("hand") else [0.15, 0, -0.03])
    return markerset.skeleton.segments, joints, ends


def test_a_lower_body_has_hips_and_legs():
    character = character_of(*at_rest(open_markerset("gait15")))
    assert character.names[0] == "hips"
    assert {name.partition(".")[0] for name in character.names[1:]} == {"thigh", "shank", "foot", "toes"}


def test_who_was_not_found_is_nowhere():
    markerset = open_markerset("actor41")
    character, count = character_of(*at_rest(markerset)), len(markerset.skeleton)
    turns = rotations.exponential(np.full((1, count, 3), np.nan))[0]
    heads, _ = character.posed(np.full((1, count, 3), np.nan), turns)
    assert np.isnan(heads).all()
