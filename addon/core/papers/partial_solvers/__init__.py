# SPDX-License-Identifier: GPL-3.0-or-later
"""Ensembles of partial solvers: anonymous 3D points named frame by frame (J. L. Jiménez Bascones et al. 2019).

Read in this order: `features` (what is measured), `boosting` (what is learned), `solver` (how a labelling is found),
`assess` and `survey` (how well), `search` (which solvers), `training` (all of it), `frames` (the use).
"""
