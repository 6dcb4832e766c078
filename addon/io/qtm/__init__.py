# SPDX-License-Identifier: GPL-3.0-or-later
"""Qualisys captures as the capture program saves them, `.qtm`: blobs of all cameras, calibration, and 3D points.

No description of the format is published. How the file is laid out was worked out from one recording, whose blobs,
points and calibration are known otherwise; most of it the file says itself (`layout`). Whatever is laid out in another
way is refused, or left out, by name. The container: MS-CFB, read by olefile; the packing: LZO1X, by lzallright.
"""
