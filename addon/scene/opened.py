# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes and blobs read out of the file, kept at hand so that drawing a frame reads nothing twice."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np

from ..core.data.takes import PointRows
from ..core.edits.blob_tracks import BlobTracks
from ..core.edits.kinds import Edits
from ..core.filling.kept import KeptFill, fills_beside
from ..core.filling.smoothing import smoothed
from . import cameras as scene_cameras
from .corrections import Correcting, kept_edits, kept_text, text_of
from .fills import FillsInTake, fills_text, kept_cutoff, kept_fills
from .preview import holds_points, read_points_preview, read_preview
from .stored import Stored
from .take import KEPT_BODY, POSE, ROWS, unedited_take, with_kept_body
from .timing import SHIFT, kept_clock


@dataclass
class Opened:
    """What is at hand, by the session's own number of the datablock that holds it: of a take the table of its rows."""

    # takes as the program labelled them, and what waits to be labelled
    stored: dict[int, Stored] = field(default_factory=dict)
    # which poses those have: others, after an undo as well, are other poses
    bodies: dict[int, str] = field(default_factory=dict)
    # takes with their edits, beside the text of these and the take without: another text, after an undo as well, is
    # another take
    edited: dict[int, tuple[str, Stored, Stored]] = field(default_factory=dict)
    # takes with their fills, and smoothed, beside the text and cut-off of these and the take that they are in
    final: dict[int, tuple[tuple[str | None, float | None], Stored, Stored]] = field(default_factory=dict)
    # what puts the fills of each take in, beside their text
    filling: dict[int, tuple[str | None, FillsInTake]] = field(default_factory=dict)
    following: dict[int, Correcting] = field(default_factory=dict)  # what works the edits of each take out
    # rows of trajectories that were asked for, beside those of the whole take
    trajectories: dict[int, tuple[PointRows, np.ndarray]] = field(default_factory=dict)
    # the fills of each take that are looked at before they are kept
    proposed: dict[int, tuple[KeptFill, ...]] = field(default_factory=dict)
    # what was worked out of the take that was asked for last, which is the first of it, by what it is
    looked_at: dict[str, tuple[Stored | None, Any]] = field(default_factory=dict)

    def take(self, collection: bpy.types.Collection, scene: bpy.types.Scene, edits: Edits | None = None) -> Stored:
        """The take that `collection` holds, as its edits, or others, and its fills and smoothing have it.

        The body follows by `reposing`.
        """
        key, stored = _number_of(collection), self.unedited(collection, scene)
        text = kept_text(collection) if edits is None else text_of(edits)
        if text is not None:
            kept = self.edited.get(key)
            if kept is None or kept[0] != text or kept[1] is not stored:
                after = self._correcting(key, stored).apply(stored, kept_edits(collection) if edits is None else edits)
                kept = self.edited[key] = text, stored, after
            stored = kept[2]
        return self._final(collection, stored)

    def _final(self, collection: bpy.types.Collection, stored: Stored) -> Stored:
        """A take with its edits as it is with its fills, and then smoothed; InputError for a rate too low for that."""
        key, written = _number_of(collection), (fills_text(collection), kept_cutoff(collection))
        if written == (None, None):
            return stored
        kept = self.final.get(key)
        if kept is None or kept[0] != written or kept[1] is not stored:
            if key not in self.filling or self.filling[key][0] != written[0]:
                self.filling[key] = written[0], FillsInTake(kept_fills(collection))
            after = self.filling[key][1].put(stored)
            if written[1] is not None:
                motion = replace(after.motion, markers=smoothed(after.motion.markers, after.rate, written[1]))
                after = replace(after, measured=after.unfilled, motion=motion, cutoff=written[1])
            kept = self.final[key] = written, stored, after
        return kept[2]

    def unedited(self, collection: bpy.types.Collection, scene: bpy.types.Scene) -> Stored:
        """The take that `collection` holds, as the program labelled it."""
        key, body = _number_of(collection), collection[POSE].get(KEPT_BODY, "")
        if key not in self.stored:
            self.stored[key] = unedited_take(collection, scene)
        elif body != self.bodies[key]:
            self.stored[key] = with_kept_body(collection, self.stored[key])
        self.bodies[key] = body
        self._set_clock(key, collection)
        return self.stored[key]

    def _set_clock(self, key: int, block: bpy.types.ID):
        """Has what is at hand play by the clock that the file has of it by now."""
        stored = self.stored[key]
        clock = kept_clock(block, stored.clock.first)
        if clock != stored.clock and SHIFT in block:
            self.stored[key] = replace(stored, clock=clock)

    def propose(self, collection: bpy.types.Collection, fills: Iterable[KeptFill]):
        """Lets fills of a take be looked at, in place of those before."""
        self.proposed[_number_of(collection)] = tuple(fills)

    def drop_proposed(self, collection: bpy.types.Collection, fills: Sequence[KeptFill]):
        """Lets go of the fills of a take that are looked at and meet some of these, which may be their own."""
        key = _number_of(collection)
        self.proposed[key] = tuple(fills_beside(self.proposed.get(key, ()), fills))

    def proposed_of(self, collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[KeptFill, ...]:
        """The fills of a take that are looked at; none once other labels are in their place.

        Those that are kept are not among them, and are again once that is undone.
        """
        proposed = self.proposed.get(_number_of(collection), ())
        kept = {_words_of(fill) for fill in self.take(collection, scene).fills} if proposed else ()
        return tuple(fill for fill in proposed if _words_of(fill) not in kept)

    def rows_of(self, stored: Stored, point: int) -> np.ndarray:
        """The rows of a trajectory of a take of points, in the order of the frames."""
        found = self.trajectories.get(point)
        if found is None or found[0] is not stored.rows:
            found = self.trajectories[point] = stored.rows, np.flatnonzero(stored.rows.trajectory == point)
        return found[1]

    def tracks(self, collection: bpy.types.Collection, scene: bpy.types.Scene) -> BlobTracks:
        """The tracks of the blobs of a take of blobs."""
        return self._correcting(_number_of(collection), self.unedited(collection, scene)).tracks

    def _correcting(self, key: int, stored: Stored) -> Correcting:
        """What works the edits of a take out; stored has the labels that the program gave."""
        if key not in self.following:
            self.following[key] = Correcting(stored)
        return self.following[key]

    def preview(self, mesh: bpy.types.Mesh, cameras: bpy.types.Collection | None, scene: bpy.types.Scene) -> Stored:
        """The unlabelled points that `mesh` holds, or its blobs as seen by `cameras`."""
        key = mesh.session_uid
        if key not in self.stored:
            if holds_points(mesh):
                self.stored[key] = read_points_preview(mesh)
            else:
                self.stored[key] = read_preview(mesh, scene_cameras.cameras_of(cameras, scene))
        self._set_clock(key, mesh)
        return self.stored[key]

    def forget(self):
        """Lets go of everything: another file was loaded, or the extension ends."""
        self.forget_read()
        self.proposed.clear()

    def forget_read(self):
        """Lets go of all that the file has, too: another take is in the place of one."""
        for name, kept in vars(self).items():
            if name != "proposed":
                kept.clear()


def _words_of(fill: KeptFill) -> tuple:
    """What tells a fill from others, which the file keeps."""
    return fill.marker, fill.first, fill.last, fill.method, f"{fill.expected:.6g}"


def _number_of(collection: bpy.types.Collection) -> int:
    """Other labels have another table, though they may be in the same collection."""
    return collection[ROWS].session_uid


opened = Opened()
