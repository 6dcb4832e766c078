# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole trajectories named by what they do together, for subjects whose rigid bodies nobody measured before.

Markers on one rigid body move as one, rigid bodies on one limb meet in joints, and a body is not its mirror image: that
says which rigid body is which even where it has another form, or sits elsewhere on the limb, than in training.
"""
