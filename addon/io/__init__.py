# SPDX-License-Identifier: GPL-3.0-or-later
"""File formats and nothing else: bytes to core types and back. No `bpy` anywhere."""
