# SPDX-License-Identifier: GPL-3.0-or-later
"""Several subjects in one take of points: who has which tracklet, and each subject's names."""
