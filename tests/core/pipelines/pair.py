# SPDX-License-Identifier: GPL-3.0-or-later
"""People who walk side by side in gait15, as eight cameras see them."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from addon.core.data.progress import finished
from addon.core.data.takes import Blobs, LabelledChunk
from addon.core.pipelines.followed_together import SeveralBlobs
from addon.core.points.several.wearers import SeveralOptions
from addon.core.points.whole_take.pipeline import PointOptions
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import CaptureOptions
from tests.core.scenes import abreast, parts_of

FRAMES, RATE, CHUNK = 40, 50.0, 16
NAMED = PointOptions("likelihood")
CAMERAS = ring_rig(8, (1280, 1024), 4.0, 2.2, 1.4)


def shot_of(model, people: tuple[int, ...] = (1, 2), apart: float = 0.6) -> tuple[Blobs, np.ndarray]:
    """Blobs and truth of people so many m apart."""
    seen = abreast(model.markerset, people, FRAMES, RATE, apart, CAMERAS, CaptureOptions(seed=5))
    return seen.blobs, seen.truth


def truth_of(truth: np.ndarray, person: str) -> np.ndarray:
    """(N,) True for the blobs of a person."""
    return np.array([any(one.startswith(person) for one in text.split("|")) for text in truth])


def label(by, blobs: Blobs, asked: SeveralOptions, **options):
    """What a way of labelling makes of some of the blobs."""
    take = SeveralBlobs(lambda: parts_of(blobs, CHUNK), CAMERAS, asked, replace(NAMED, **options), RATE)
    return finished(by(take))


def names_of(found, chunks: Iterable[LabelledChunk]) -> np.ndarray:
    """(N,) the names of the blobs of a take."""
    return np.array([*found.worn.markers, ""], object)[np.concatenate([one.labels.marker for one in chunks])]
