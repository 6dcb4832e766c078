# SPDX-License-Identifier: GPL-3.0-or-later
"""What goes in and comes out: blobs, points, labels, motion, marker sets, models, errors."""
