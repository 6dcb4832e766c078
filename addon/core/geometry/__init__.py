# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras, rotations and rigid bodies: what holds for any points in space."""
