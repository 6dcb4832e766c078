# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes and blobs read out of the file, kept at hand so that drawing a frame reads nothing twice."""

from dataclasses import dataclass, field

import bpy

from . import cameras as scene_cameras
from .preview import holds_points, read_points_preview, read_preview
from .take import Stored, stored_take


@dataclass
class Opened:
    """What is at hand, by the session's own number of the datablock that holds it."""

    stored: dict[int, Stored] = field(default_factory=dict)

    def take(self, collection: bpy.types.Collection, scene: bpy.types.Scene) -> Stored:
        """The take that `collection` holds."""
        key = collection.session_uid
        if key not in self.stored:
            self.stored[key] = stored_take(collection, scene)
        return self.stored[key]

    def preview(self, mesh: bpy.types.Mesh, cameras: bpy.types.Collection | None, scene: bpy.types.Scene) -> Stored:
        """The unlabelled points that `mesh` holds, or its blobs as seen by `cameras`."""
        key = mesh.session_uid
        if key not in self.stored:
            if holds_points(mesh):
                self.stored[key] = read_points_preview(mesh)
            else:
                self.stored[key] = read_preview(mesh, scene_cameras.cameras_of(cameras, scene))
        return self.stored[key]

    def forget(self):
        """Lets go of everything: another file was loaded, something was undone, or the extension ends."""
        self.stored.clear()


opened = Opened()
