# SPDX-License-Identifier: GPL-3.0-or-later
"""What our Blender data is called, and the custom properties that say what it is.

Blender renames whatever collides (`LASI.001`), so the true names live in custom properties.
"""

PREFIX = "Mocap: "
OWN_KEYS = "mocap_"  # what the names of all our custom properties begin with

MARKER = "mocap_marker"
CAMERA = "mocap_camera"
CAPSULE = "mocap_capsule"
MATERIAL = "mocap_material"  # of a capsule as it was made
TAKE = "mocap_take"
PERFORMER = "mocap_performer"
CAMERAS = "mocap_cameras"
MARKERSET = "mocap_markerset"
TAKE_ROOT = "mocap_root"  # on the empty that a take hangs on; False on the hidden one between it and the rest
EDITED = "mocap_edited_markerset"


def title(*words: str) -> str:
    """The name of one of our datablocks, e.g. `Mocap: walk markers`, short enough for Blender and always text."""
    return (PREFIX + " ".join(words)).encode("utf-8", "replace").decode()[:63]
