# SPDX-License-Identifier: GPL-3.0-or-later
"""What is the matter with the take of a scene, worked out once for what it is at the moment."""

import bpy

from ..core.review.trouble import TakeTrouble, Trouble
from .corrections import kept_text
from .opened import opened
from .stored import Stored

# The take that was looked at last, and what was found: a panel and its buttons ask for the same.
_last: list[tuple[Stored, tuple[Trouble, ...]]] = []


def trouble_of(collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[Trouble, ...]:
    """All trouble of a take, the worst first; frames are the source's."""
    stored = opened.take(collection, scene)
    if not _last or _last[0][0] is not stored:
        _last[:] = [(stored, _looked_at(stored, collection, scene))]
    return _last[0][1]


def forget_trouble():
    """Lets go of what was found: another file was loaded, or the extension ends."""
    _last.clear()


def _looked_at(stored: Stored, collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[Trouble, ...]:
    if not len(stored.motion.frames):
        return ()
    looking = TakeTrouble(stored.names, stored.rate, stored.edits, stored.cameras)
    looking.add(stored.rows, stored.labels, stored.motion)
    answered = ()
    if kept_text(collection) is not None:
        left = {(one.words, one.trajectory) for one in stored.suspects}
        all_of_it = opened.unedited(collection, scene).suspects
        answered = tuple(one for one in all_of_it if (one.words, one.trajectory) not in left)
    return looking.found(stored.suspects, answered)
