# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes and blobs read out of the file, kept at hand so that drawing a frame reads nothing twice."""

from dataclasses import dataclass, field

import bpy

from ..core.edits.kinds import Edits
from . import cameras as scene_cameras
from .corrections import edited, kept_edits, kept_text, text_of
from .fills import filled_in, fills_text, kept_fills
from .preview import holds_points, read_points_preview, read_preview
from .stored import Stored
from .take import unedited_take


@dataclass
class Opened:
    """What is at hand, by the session's own number of the datablock that holds it.

    stored  takes as the program labelled them, and what waits to be labelled
    edited  takes with their edits, beside the text of these: another text, after an undo as well, is another take
    filled  takes with their fills, beside the text of these and the take that they are in
    """

    stored: dict[int, Stored] = field(default_factory=dict)
    edited: dict[int, tuple[str, Stored]] = field(default_factory=dict)
    filled: dict[int, tuple[str, Stored, Stored]] = field(default_factory=dict)

    def take(self, collection: bpy.types.Collection, scene: bpy.types.Scene) -> Stored:
        """The take that `collection` holds, as its edits and fills have it."""
        return self._with_fills(collection, self._as_edited(collection, scene))

    def _as_edited(self, collection: bpy.types.Collection, scene: bpy.types.Scene) -> Stored:
        text = kept_text(collection)
        if text is None:
            return self.unedited(collection, scene)
        kept = self.edited.get(collection.session_uid)
        if kept is not None and kept[0] == text:
            return kept[1]
        return self._edited(collection, scene, kept_edits(collection), text)

    def take_with(self, collection: bpy.types.Collection, scene: bpy.types.Scene, edits: Edits) -> Stored:
        """The take that `collection` holds as it is with `edits`, and with its fills."""
        return self._with_fills(collection, self._edited(collection, scene, edits, text_of(edits)))

    def _edited(self, collection: bpy.types.Collection, scene: bpy.types.Scene, edits: Edits, text: str) -> Stored:
        after = edited(self.unedited(collection, scene), edits)
        self.edited[collection.session_uid] = (text, after)
        return after

    def _with_fills(self, collection: bpy.types.Collection, stored: Stored) -> Stored:
        text = fills_text(collection)
        if text is None:
            return stored
        kept = self.filled.get(collection.session_uid)
        if kept is not None and kept[0] == text and kept[1] is stored:
            return kept[2]
        after = filled_in(stored, kept_fills(collection))
        self.filled[collection.session_uid] = (text, stored, after)
        return after

    def unedited(self, collection: bpy.types.Collection, scene: bpy.types.Scene) -> Stored:
        """The take that `collection` holds, as the program labelled it."""
        key = collection.session_uid
        if key not in self.stored:
            self.stored[key] = unedited_take(collection, scene)
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
        self.edited.clear()
        self.filled.clear()


opened = Opened()
