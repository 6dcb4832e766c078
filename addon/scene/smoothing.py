# SPDX-License-Identifier: GPL-3.0-or-later
"""The cut-off by which a take is smoothed, kept with it; the markers follow from it whenever the take is read."""

from dataclasses import replace

import bpy

from ..core.filling.smoothing import smoothed
from .stored import Stored

CUTOFF = "mocap_smoothing"


def keep_cutoff(collection: bpy.types.Collection, cutoff: float | None):
    """Keeps the cut-off, Hz, with the take that `collection` holds; None for none."""
    if cutoff is not None:
        collection[CUTOFF] = float(cutoff)
    elif CUTOFF in collection:
        del collection[CUTOFF]


def kept_cutoff(collection: bpy.types.Collection) -> float | None:
    """The cut-off, Hz, by which a take is smoothed; None where it is not."""
    value = collection.get(CUTOFF)
    return None if value is None else float(value)


def smoothed_in(stored: Stored, cutoff: float) -> Stored:
    """A take, its fills in it, as it is when it is smoothed; InputError where its rate has no room for the cut-off."""
    motion = replace(stored.motion, markers=smoothed(stored.motion.markers, stored.rate, cutoff))
    return replace(stored, measured=stored.unfilled, motion=motion, cutoff=cutoff)
