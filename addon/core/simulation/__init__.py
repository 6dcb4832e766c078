# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras, people and captures that were never there."""
