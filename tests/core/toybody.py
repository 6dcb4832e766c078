# SPDX-License-Identifier: GPL-3.0-or-later
"""A small made-up person for tests: thirteen segments, eighteen markers, a capsule each, no recorded numbers."""

import numpy as np

from addon.core.data.markersets import Capsules, MarkerSet, Skeleton, Spread

SEGMENTS = (
    # name, parent, joint in the parent's axes, capsule start, capsule end, radius; all heights
    ("pelvis", None, (0, 0, 0.53), (0, -0.05, 0.0), (0, 0.05, 0.0), 0.075),
    ("thorax", "pelvis", (0, 0, 0.08), (0, 0, 0.0), (0, 0, 0.20), 0.08),
    ("head", "thorax", (0, 0, 0.28), (0, 0, 0.03), (0, 0, 0.07), 0.05),
    ("upper_arm.L", "thorax", (0, 0.11, 0.22), (0, 0, 0), (0, 0, -0.17), 0.028),
    ("forearm.L", "upper_arm.L", (0, 0, -0.17), (0, 0, 0), (0, 0, -0.15), 0.022),
    ("upper_arm.R", "thorax", (0, -0.11, 0.22), (0, 0, 0), (0, 0, -0.17), 0.028),
    ("forearm.R", "upper_arm.R", (0, 0, -0.17), (0, 0, 0), (0, 0, -0.15), 0.022),
    ("thigh.L", "pelvis", (0, 0.05, -0.02), (0, 0, 0), (0, 0, -0.24), 0.045),
    ("shank.L", "thigh.L", (0, 0, -0.24), (0, 0, 0), (0, 0, -0.23), 0.032),
    ("foot.L", "shank.L", (0, 0, -0.23), (-0.02, 0, -0.025), (0.09, 0, -0.028), 0.014),
    ("thigh.R", "pelvis", (0, -0.05, -0.02), (0, 0, 0), (0, 0, -0.24), 0.045),
    ("shank.R", "thigh.R", (0, 0, -0.24), (0, 0, 0), (0, 0, -0.23), 0.032),
    ("foot.R", "shank.R", (0, 0, -0.23), (-0.02, 0, -0.025), (0.09, 0, -0.028), 0.014),
)
MARKERS = (
    ("SACR", "pelvis", (-0.08, 0, 0.02)),
    ("LASI", "pelvis", (0.07, 0.06, 0.03)),
    ("RASI", "pelvis", (0.07, -0.06, 0.03)),
    ("CLAV", "thorax", (0.085, 0, 0.12)),
    ("C7", "thorax", (-0.085, 0, 0.15)),
    ("LFHD", "head", (0.04, 0.03, 0.07)),
    ("RBHD", "head", (-0.045, -0.03, 0.07)),
    ("LELB", "upper_arm.L", (0, 0.03, -0.17)),
    ("RELB", "upper_arm.R", (0, -0.03, -0.17)),
    ("LWRA", "forearm.L", (0.02, 0.015, -0.15)),
    ("RWRA", "forearm.R", (0.02, -0.015, -0.15)),
    ("LTHI", "thigh.L", (0.01, 0.05, -0.12)),
    ("LKNE", "thigh.L", (0, 0.047, -0.24)),
    ("RKNE", "thigh.R", (0, -0.047, -0.24)),
    ("LANK", "shank.L", (0, 0.035, -0.23)),
    ("RANK", "shank.R", (0, -0.035, -0.23)),
    ("LTOE", "foot.L", (0.09, 0.01, -0.005)),
    ("RTOE", "foot.R", (0.09, -0.01, -0.005)),
)


def toy_markerset() -> MarkerSet:
    """The made-up person as a marker set, with a spread of one mode (longer legs) and small bends."""
    names = tuple(row[0] for row in SEGMENTS)
    parents = np.array([-1 if row[1] is None else names.index(row[1]) for row in SEGMENTS])
    joint, start, end, radius = (np.array([row[column] for row in SEGMENTS], dtype=float) for column in (2, 3, 4, 5))
    modes = np.zeros((1, len(SEGMENTS) + len(MARKERS), 3))
    modes[0, [names.index("shank.L"), names.index("shank.R")], 2] = -0.01
    bends = np.full(3 * len(SEGMENTS), 0.05**2)
    bends[:3] = 0
    deviations = np.full(len(MARKERS), 0.004)
    return MarkerSet(
        name="toy",
        description="a made-up person for tests",
        markers=tuple(row[0] for row in MARKERS),
        aliases={"sternum": "CLAV"},
        skeleton=Skeleton(names, parents, joint),
        attachment=np.array([names.index(row[1]) for row in MARKERS]),
        offsets=np.array([row[2] for row in MARKERS], dtype=float),
        capsules=Capsules(np.arange(len(names)), start, end, radius),
        spread=Spread(1.7, 0.1, modes, deviations, np.zeros((len(names), 3)), np.diag(bends)),
        source={"note": "made up"},
    )
