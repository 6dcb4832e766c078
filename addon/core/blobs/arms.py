# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways in which people hold their arms: starts of the fit, which does not turn an arm over on its own."""

from dataclasses import replace

import numpy as np

from ..body.bodies import Bodies, BodyModel

# Turns of the left upper arm and forearm about the model's axes (ahead, left, up), rad; the right arm is the mirror
# image. At rest arms hang at 40° from the body, so an arm is raised to the side, overhead or ahead, and an elbow is
# bent or folded.
HELD = 1.1 * np.array(
    [
        [[1, 0, 0], [0, 0, 0]],
        [[2, 0, 0], [0, 0, 0]],
        [[0, -1, 0], [0, 0, 0]],
        [[0, 0, 0], [0, -1, 0]],
        [[0, 0, 0], [0, -2, 0]],
    ]
)
_MIRRORED = np.array([-1.0, 1.0, -1.0])


def with_arms_held(bodies: Bodies, model: BodyModel) -> Bodies:
    """The bodies as they are, and each once more for every way to hold the arms; only as they are without arms."""
    names = model.markerset.skeleton.segments
    arms = [(f"upper_arm.{side}", f"forearm.{side}") for side in "LR"]
    if not all(part in names for arm in arms for part in arm):
        return bodies
    parts = [bodies]
    for held in HELD:
        bends = bodies.bends.copy()
        for arm, mirrored in zip(arms, (np.ones(3), _MIRRORED), strict=True):
            for part, turn in zip(arm, held, strict=True):
                bends[:, names.index(part)] = turn * mirrored
        parts.append(replace(bodies, bends=bends))
    return Bodies.join(parts)
