# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: thin, each one thing that a person does."""

from . import correcting, exporting, importing, labelling, markersets, quality, reviewing, stepping, training, viewing

CLASSES = (
    *importing.CLASSES,
    *markersets.CLASSES,
    *quality.CLASSES,
    *training.CLASSES,
    *labelling.CLASSES,
    *stepping.CLASSES,
    *viewing.CLASSES,
    *correcting.CLASSES,
    *reviewing.CLASSES,
    *exporting.CLASSES,
)
