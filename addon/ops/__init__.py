# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: thin, each one thing that a person does."""

from . import correcting, exporting, importing, label_tool, labelling, markersets, picking, quality, training, viewing

CLASSES = (
    *importing.CLASSES,
    *markersets.CLASSES,
    *quality.CLASSES,
    *training.CLASSES,
    *labelling.CLASSES,
    *viewing.CLASSES,
    *picking.CLASSES,
    *correcting.CLASSES,
    *label_tool.CLASSES,
    *exporting.CLASSES,
)
