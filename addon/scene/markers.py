# SPDX-License-Identifier: GPL-3.0-or-later
"""The markers of a take: one named empty a marker, keyed where it was seen, gaps left unkeyed."""

import bpy
import numpy as np

from ..core.data.takes import Motion
from . import animation, naming

DISPLAY_SIZE = 0.012


def add_marker(collection: bpy.types.Collection, name: str, size: float = DISPLAY_SIZE) -> bpy.types.Object:
    """Adds the empty of one marker, `size` m, at the world's origin."""
    empty = bpy.data.objects.new(name, None)
    empty.empty_display_type, empty.empty_display_size = "SPHERE", size
    empty[naming.MARKER] = name
    collection.objects.link(empty)
    return empty


def show_marker(
    empty: bpy.types.Object,
    action: bpy.types.Action | None,
    motion: Motion,
    index: int,
    frames: np.ndarray,
    filled: np.ndarray | None = None,
    before: tuple[np.ndarray, np.ndarray | None] | None = None,
):
    """Keys the empty of marker `index` where it was seen, at Blender's `frames` (F,), in the place of former keys.

    One that was never seen has no keys, stands where the body would carry it at first, and is hidden: standing still in
    the moving body it would look like a wrong name.
    Keys of samples that were filled, `filled` (F,), are of Blender's type for what a tool made up.
    `action` is where an empty without keys gets them; None for one of its own. It is quicker to tell where the empty is
    keyed `before` (F, 3), and which of that was filled (F,).
    """
    seen = motion.markers[:, index]
    unseen = not np.isfinite(seen).any()
    places = motion.expected[:, index] if unseen else seen
    there = np.isfinite(places).all(axis=1)
    empty.location = places[there.argmax()] if there.any() else np.zeros(3)
    if empty.hide_viewport != unseen or empty.hide_render != unseen:  # Blender orders its whole scene again for these
        empty.hide_viewport = empty.hide_render = unseen
    bag = animation.channels(empty, action)
    if before is None or not animation.move(bag, "location", frames, before, (seen, filled)):
        animation.clear(bag, "location")
        animation.key(bag, "location", frames, seen, empty[naming.MARKER], filled)


def marker_empties(collection: bpy.types.Collection) -> dict[str, bpy.types.Object]:
    """The empties of a take by marker; of one that was duplicated the first."""
    return {item[naming.MARKER]: item for item in list(collection.all_objects)[::-1] if naming.MARKER in item}
