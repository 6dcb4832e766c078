# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: thin, each one thing that a person does."""

from . import (
    calibration,
    character,
    correcting,
    exporting,
    filling,
    html_report,
    importing,
    label_tool,
    labelling,
    markersets,
    picking,
    quality,
    reviewing,
    smoothing,
    stepping,
    timeline,
    training,
    viewing,
)

CLASSES = (
    *importing.CLASSES,
    *calibration.CLASSES,
    *markersets.CLASSES,
    *quality.CLASSES,
    *training.CLASSES,
    *labelling.CLASSES,
    *stepping.CLASSES,
    *viewing.CLASSES,
    *picking.CLASSES,
    *correcting.CLASSES,
    *filling.CLASSES,
    *smoothing.CLASSES,
    *timeline.CLASSES,
    *reviewing.CLASSES,
    *label_tool.CLASSES,
    *exporting.CLASSES,
    *character.CLASSES,
    *html_report.CLASSES,
)
