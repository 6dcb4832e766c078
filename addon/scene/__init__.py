# SPDX-License-Identifier: GPL-3.0-or-later
"""Core types to Blender data and back: cameras, armature, body, keyed markers, and occlusion on real meshes.

Everything that must outlive a session is kept in datablocks and custom properties of the file, so it works with the
extension registered or not, in the `bpy` package as in Blender.
"""
