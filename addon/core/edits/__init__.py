# SPDX-License-Identifier: GPL-3.0-or-later
"""Corrections as data: what a person says of a labelled take, as a list that is applied in order."""
