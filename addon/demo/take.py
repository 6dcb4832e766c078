# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo's take: a person who does not exist walks, turns and waves in a room that does not exist."""

from dataclasses import dataclass

import numpy as np

from ..capturing import Labelled
from ..core.body.bodies import BodyModel
from ..core.body.occlusion import CapsuleOcclusion
from ..core.data.markersets import MarkerSet
from ..core.geometry.cameras import Cameras
from ..core.simulation.rigs import ring_rig
from ..core.simulation.simulate import CaptureOptions, PosedBody
from ..core.simulation.virtual import DEMO, draw_person, perform

MODEL = "body26"
SEED = 7
CAMERAS = 8
SIZE = (1280, 960)
RADIUS = 3.6
ROOM = 1.3
RATE = 60.0
# Everything that goes wrong in a good laboratory, and a little more of it.
TROUBLE = CaptureOptions(seed=SEED, noise=0.4, dropout=0.01, reflections=2, flicker=0.3, marker_offset=0.005)


@dataclass(frozen=True, eq=False)
class Performance:
    """The virtual take before any camera sees it: the room's cameras, the true markers and the body."""

    cameras: Cameras
    take: Labelled
    body: PosedBody


def make_performance(markerset: MarkerSet) -> Performance:
    """The same room, person and walk every time."""
    generator = np.random.default_rng(SEED)
    cameras = ring_rig(CAMERAS, SIZE, RADIUS, volume_radius=ROOM, generator=generator)
    model = BodyModel(markerset)
    bodies = perform(model, draw_person(markerset, generator), DEMO, RATE, SEED)
    posed = model.pose(bodies)
    body = PosedBody(
        CapsuleOcclusion(markerset), np.asarray(markerset.attachment), posed.rotations, posed.joints, bodies.scale
    )
    return Performance(cameras, Labelled(markerset.markers, posed.markers, 1), body)
