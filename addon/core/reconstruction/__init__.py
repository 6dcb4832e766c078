# SPDX-License-Identifier: GPL-3.0-or-later
"""Unnamed 3D points and their trajectories from unnamed blobs."""
