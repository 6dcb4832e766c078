# SPDX-License-Identifier: GPL-3.0-or-later
"""Mocap Autolabel: unlabelled optical motion capture in, named and animated markers out.

Nothing here imports `bpy`, so `addon.core` and `addon.io` work in any Python.
"""
