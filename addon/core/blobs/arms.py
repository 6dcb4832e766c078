# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways in which people hold their arms: starts of the fit, which does not turn an arm over on its own."""

from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import Bodies, BodyModel


@dataclass(frozen=True)
class ArmOptions:
    """How arms are held that are tried: rotation vectors of the left upper arm and forearm against the rest pose, rad.

    Model axes are ahead, left and up; at rest arms hang away from the body, at 40°. The right arm is the mirror image.
    """

    held: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...] = (
        ((0.9, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, -1.3, 0.0), (0.0, 0.0, 0.0)),
        ((-0.2, 0.0, 0.0), (0.0, -1.3, 0.0)),
        ((0.0, -0.4, 0.0), (0.0, -2.2, 0.0)),
        ((2.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    )


ARMS = ArmOptions()
_MIRRORED = np.array([-1.0, 1.0, -1.0])


def with_arms_held(bodies: Bodies, model: BodyModel, options: ArmOptions = ARMS) -> Bodies:
    """The bodies as they are, and each once more for every way to hold the arms; only as they are without arms."""
    names = model.markerset.skeleton.segments
    arms = [(f"upper_arm.{side}", f"forearm.{side}") for side in "LR"]
    if not all(part in names for arm in arms for part in arm):
        return bodies
    parts = [bodies]
    for held in options.held:
        bends = bodies.bends.copy()
        for arm, mirrored in zip(arms, (np.ones(3), _MIRRORED), strict=True):
            for part, turn in zip(arm, held, strict=True):
                bends[:, names.index(part)] = np.array(turn) * mirrored
        parts.append(replace(bodies, bends=bends))
    return Bodies.join(parts)
