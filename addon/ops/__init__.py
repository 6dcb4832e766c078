# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: thin, each one thing that a person does."""

from . import (
    correcting,
    exporting,
    filling,
    html_report,
    importing,
    labelling,
    markersets,
    quality,
    reviewing,
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
    *timeline.CLASSES,
    *reviewing.CLASSES,
    *exporting.CLASSES,
    *html_report.CLASSES,
)
