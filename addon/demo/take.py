# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo's take: a person who does not exist walks, turns and waves in a room that does not exist."""

from dataclasses import dataclass

import numpy as np

from ..capturing import LabelledMarkers
from ..core.body.bodies import BodyModel
from ..core.data.markersets import MarkerSet
from ..core.geometry.cameras import Cameras
from ..core.papers.virtual_occlusions.occlusion import CapsuleOcclusion
from ..core.simulation.rigs import ring_rig
from ..core.simulation.simulate import CaptureOptions, PosedBody
from ..core.simulation.virtual import DEMO, draw_person, perform

MODEL = "body26"


@dataclass(frozen=True)
class StageOptions:
    """Where the demo plays; chosen so that it is quick and shows what the labelling can do.

    seed             of person, walk, room and everything that is random
    cameras          in a ring,
    size_px          of their images
    radius_m         of the ring
    volume_radius_m  of what all of them see whole
    rate             frames a second
    """

    seed: int = 7
    cameras: int = 8
    size_px: tuple[int, int] = (1280, 960)
    radius_m: float = 3.6
    volume_radius_m: float = 1.3
    rate: float = 60.0


STAGE = StageOptions()
# Everything that goes wrong in a good laboratory, and a little more of it.
TROUBLE = CaptureOptions(seed=STAGE.seed, noise=0.4, dropout=0.01, reflections=2, flicker=0.3, marker_offset=0.005)


@dataclass(frozen=True, eq=False)
class Performance:
    """The virtual take before any camera sees it: the room's cameras, the true markers and the body."""

    cameras: Cameras
    take: LabelledMarkers
    body: PosedBody


def make_performance(markerset: MarkerSet) -> Performance:
    """The same room, person and walk every time."""
    generator = np.random.default_rng(STAGE.seed)
    cameras = ring_rig(
        STAGE.cameras, STAGE.size_px, STAGE.radius_m, volume_radius=STAGE.volume_radius_m, generator=generator
    )
    model = BodyModel(markerset)
    bodies = perform(model, draw_person(markerset, generator), DEMO, STAGE.rate, STAGE.seed)
    posed = model.pose(bodies)
    body = PosedBody(
        CapsuleOcclusion(markerset), np.asarray(markerset.attachment), posed.rotations, posed.joints, bodies.scale
    )
    return Performance(cameras, LabelledMarkers(markerset.markers, posed.markers, 1), body)
