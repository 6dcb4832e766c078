# SPDX-License-Identifier: GPL-3.0-or-later
"""Naming the blobs of calibrated cameras by a body that is fitted to them: the first paper, frame after frame."""
