# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes and blobs read out of the file, kept at hand so that drawing a frame reads nothing twice."""

from dataclasses import dataclass, field

import bpy
import numpy as np

from ..core.data.takes import PointRows
from ..core.edits.following import Following
from ..core.edits.kinds import Edits
from . import cameras as scene_cameras
from .corrections import edited, following_of, kept_edits, kept_text, text_of
from .preview import holds_points, read_points_preview, read_preview
from .stored import Stored
from .take import unedited_take


@dataclass
class Opened:
    """What is at hand, by the session's own number of the datablock that holds it.

    stored  takes as the program labelled them, and what waits to be labelled
    edited  takes with their edits, beside the text of these: another text, after an undo as well, is another take
    following  what works the edits of each take out
    trajectories  rows of trajectories that were asked for, beside those of the whole take
    """

    stored: dict[int, Stored] = field(default_factory=dict)
    edited: dict[int, tuple[str, Stored]] = field(default_factory=dict)

    following: dict[int, Following] = field(default_factory=dict)
    trajectories: dict[int, tuple[PointRows, np.ndarray]] = field(default_factory=dict)

    def take(self, collection: bpy.types.Collection, scene: bpy.types.Scene) -> Stored:
        """The take that `collection` holds, as its edits have it."""
        text = kept_text(collection)
        if text is None:
            return self._unedited(collection, scene)
        kept = self.edited.get(collection.session_uid)
        if kept is not None and kept[0] == text:
            return kept[1]
        return self.take_with(collection, scene, kept_edits(collection), text)

    def take_with(
        self, collection: bpy.types.Collection, scene: bpy.types.Scene, edits: Edits, text: str | None = None
    ) -> Stored:
        """The take that `collection` holds as it is with `edits`, whose text is `text`."""
        key, before = collection.session_uid, self._unedited(collection, scene)
        if key not in self.following:
            self.following[key] = following_of(before)
        after = edited(before, edits, self.following[key])
        self.edited[collection.session_uid] = (text_of(edits) if text is None else text, after)
        return after

    def _unedited(self, collection: bpy.types.Collection, scene: bpy.types.Scene) -> Stored:
        key = collection.session_uid
        if key not in self.stored:
            self.stored[key] = unedited_take(collection, scene)
        return self.stored[key]

    def rows_of(self, stored: Stored, point: int) -> np.ndarray:
        """The rows of a trajectory of a take of points, in the order of the frames."""
        found = self.trajectories.get(point)
        if found is None or found[0] is not stored.rows:
            found = self.trajectories[point] = stored.rows, np.flatnonzero(stored.rows.trajectory == point)
        return found[1]

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
        self.following.clear()
        self.trajectories.clear()


opened = Opened()
