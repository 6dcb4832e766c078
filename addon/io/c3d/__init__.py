# SPDX-License-Identifier: GPL-3.0-or-later
"""C3D files: every processor (Intel, DEC, MIPS), integers or reals, as one array; and the labelled take written.

Read here and not by a library, with reasons that were measured: py-c3d refuses sound files whose header and parameters
differ in a detail, counts first frames beyond 65535 wrongly and lets six kinds of exception escape from damaged ones;
ezc3d cannot read MIPS files, takes the byte of the cameras for the residual, and would need a compiled wheel for every
platform. Both serve as second opinion in tests.
The format: the C3D file format user guide, Motion Lab Systems, 2008.
"""
