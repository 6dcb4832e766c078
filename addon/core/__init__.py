# SPDX-License-Identifier: GPL-3.0-or-later
"""The labelling itself, on plain arrays: no Blender, no files, no printing.

World: metres, right-handed, z up. Time is axis 0, then camera, then marker; missing is NaN.
"""
