# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: thin, each one thing that a person does."""

from . import calibration, correcting, exporting, importing, labelling, markersets, quality, training, viewing

CLASSES = (
    *importing.CLASSES,
    *calibration.CLASSES,
    *markersets.CLASSES,
    *quality.CLASSES,
    *training.CLASSES,
    *labelling.CLASSES,
    *viewing.CLASSES,
    *correcting.CLASSES,
    *exporting.CLASSES,
)
