# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo's take: a person who does not exist walks, turns and waves in a room that does not exist."""

from dataclasses import dataclass

import numpy as np

from ..core.body.bodies import BodyModel
from ..core.data.markersets import MarkerSet
from ..core.data.takes import Points
from ..core.geometry.cameras import Cameras
from ..core.papers.virtual_occlusions.occlusion import CapsuleOcclusion
from ..core.simulation.rigs import ring_rig
from ..core.simulation.simulate import CaptureOptions, PosedBody
from ..core.simulation.virtual import DEMO, draw_person, perform

MODEL = "body26"


# Where the demo plays; chosen so that it is quick and shows what the labelling can do.
STAGE_SEED = 7  # of person, walk, room and everything that is random
STAGE_CAMERAS, STAGE_SIZE_PX, STAGE_RADIUS_M = 8, (1280, 960), 3.6  # in a ring
STAGE_VOLUME_M = 1.3  # radius of what all of them see whole
STAGE_RATE = 60.0
# Everything that goes wrong in a good laboratory, and a little more of it.
TROUBLE = CaptureOptions(seed=STAGE_SEED, noise=0.4, dropout=0.01, reflections=2, flicker=0.3, marker_offset=0.005)


@dataclass(frozen=True, eq=False)
class Performance:
    """The virtual take before any camera sees it: the room's cameras, the true markers and the body."""

    cameras: Cameras
    take: Points
    body: PosedBody


def make_performance(markerset: MarkerSet) -> Performance:
    """The same room, person and walk every time."""
    generator = np.random.default_rng(STAGE_SEED)
    cameras = ring_rig(STAGE_CAMERAS, STAGE_SIZE_PX, STAGE_RADIUS_M, volume_radius=STAGE_VOLUME_M, generator=generator)
    model = BodyModel(markerset)
    bodies = perform(model, draw_person(markerset, generator), DEMO, STAGE_RATE, STAGE_SEED)
    posed = model.pose(bodies)
    body = PosedBody(
        CapsuleOcclusion(markerset), np.asarray(markerset.attachment), posed.rotations, posed.joints, bodies.scale
    )
    residual = np.zeros(posed.markers.shape[:2])
    return Performance(cameras, Points(markerset.markers, posed.markers, residual, STAGE_RATE, 1), body)
