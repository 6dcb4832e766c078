# SPDX-License-Identifier: GPL-3.0-or-later
"""Opens a long take in a Blender that has no extension, plays it, saves it elsewhere and opens it from there.

Run by Blender: arguments after `--` are the file, where to save it again, the file for what was seen, and frames.
"""

import json
import sys
from pathlib import Path

import bpy

SOURCE, AGAIN, SEEN, *FRAMES = sys.argv[sys.argv.index("--") + 1 :]


def places() -> list[dict]:
    """Where each marker and each bone's head is in the frames."""
    found = []
    for frame in map(int, FRAMES):
        bpy.context.scene.frame_set(frame)
        markers = {
            one["mocap_marker"]: one.matrix_world.translation[:] for one in bpy.data.objects if "mocap_marker" in one
        }
        bones = {
            bone.name: bone.head[:] for one in bpy.data.objects if one.type == "ARMATURE" for bone in one.pose.bones
        }
        found.append({"markers": markers, "bones": bones})
    return found


seen = []
for path, then in ((SOURCE, AGAIN), (AGAIN, None)):
    bpy.ops.wm.open_mainfile(filepath=path)
    seen.append(places())
    if then:
        bpy.ops.wm.save_as_mainfile(filepath=then)
Path(SEEN).write_text(
    json.dumps({"opened": seen[0], "again": seen[1], "extension": hasattr(bpy.types.Scene, "mocap_autolabel")})
)
