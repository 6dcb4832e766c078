# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes from end to end: blobs by a fitted body, by the points that they make or by both; and points."""
