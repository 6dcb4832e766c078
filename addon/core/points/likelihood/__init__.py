# SPDX-License-Identifier: GPL-3.0-or-later
"""Naming clouds of anonymous 3D points frame by frame, by likelihood: learned from labelled takes of any marker set."""
