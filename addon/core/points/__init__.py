# SPDX-License-Identifier: GPL-3.0-or-later
"""Naming 3D points: each frame on its own, then trajectories and the whole take."""
