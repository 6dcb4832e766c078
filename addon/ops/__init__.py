# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: thin, each one thing that a person does."""

from . import (
    correcting,
    exporting,
    filling,
    importing,
    labelling,
    markersets,
    quality,
    smoothing,
    timeline,
    training,
    viewing,
)

CLASSES = (
    *importing.CLASSES,
    *markersets.CLASSES,
    *quality.CLASSES,
    *training.CLASSES,
    *labelling.CLASSES,
    *viewing.CLASSES,
    *correcting.CLASSES,
    *filling.CLASSES,
    *smoothing.CLASSES,
    *timeline.CLASSES,
    *exporting.CLASSES,
)
