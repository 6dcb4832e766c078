# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers named by a body that is fitted to the blobs of cameras (A. Cuevas, J. Rodriguez-Navarro and A. Susín).

Read in this order: `cloud` (points from blobs), `placement` (section 3), `cost` (equation 7), `fit` (nine parameters by
Levenberg-Marquardt), `occlusion` (section 4) and `labelling` (section 5, algorithm 1).
"""
