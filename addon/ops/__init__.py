# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: thin, each one thing that a person does."""

from . import exporting, importing, labelling, markersets, viewing

CLASSES = (*importing.CLASSES, *markersets.CLASSES, *labelling.CLASSES, *viewing.CLASSES, *exporting.CLASSES)
