# SPDX-License-Identifier: GPL-3.0-or-later
"""What is the matter with the take of a scene, worked out once for what it is at the moment."""

import bpy
import numpy as np

from ..core.review.camera_blobs import CameraFinding
from ..core.review.take_trouble import MarkerSight, TakeTrouble
from ..core.review.trouble import Trouble
from .corrections import kept_text
from .opened import opened
from .review import forget_reviews
from .stored import Stored, changed_between

QUICK = 20_000  # frames times markers that are looked at in some 0.04 s, measured: 0.17 s for 92,000 on a busy machine
# The take that was looked at last, and what was found: a panel and its buttons ask for the same.
_last: list[tuple[Stored, tuple[Trouble, ...], list[CameraFinding]]] = []
# Where its markers are seen, of which an edit changes some.
_sight: list[tuple[Stored, MarkerSight]] = []


def trouble_of(collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[Trouble, ...]:
    """All trouble of a take, the worst first; frames are the source's."""
    stored = opened.take(collection, scene)
    if not _last or _last[0][0] is not stored:
        _last[:] = [(stored, *_looked_at(stored, collection, scene))]
    return _last[0][1]


def known_trouble(collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[Trouble, ...] | None:
    """The same where it is worked out already; None where it is not: drawing waits for nothing."""
    return _last[0][1] if _last and _last[0][0] is opened.take(collection, scene) else None


def known_cameras(collection: bpy.types.Collection, scene: bpy.types.Scene) -> list[CameraFinding]:
    """What becomes of each camera's blobs, the camera with the largest part without a name first; none if not known."""
    known = _last and _last[0][0] is opened.take(collection, scene)
    return sorted(_last[0][2], key=lambda one: -np.nan_to_num(one.unnamed_share)) if known else []


def is_quick(stored: Stored) -> bool:
    """Whether the trouble of a take is worked out while a person does not notice."""
    return stored.motion.residual.size <= QUICK


def forget_trouble():
    """Lets go of what was found: another file was loaded, or the extension ends."""
    _last.clear()
    _sight.clear()
    forget_reviews()


def _sight_of(stored: Stored) -> MarkerSight:
    """Where the markers of a take are seen: of one that was edited since, only what that changed is looked at again."""
    same_body = bool(_sight) and _sight[0][0].motion.expected is stored.motion.expected
    changed = changed_between(_sight[0][0], stored) if same_body else None
    if changed is None:
        sight = MarkerSight.of(stored.motion)
    else:
        sight = _sight[0][1]
        sight.look_again(stored.motion, changed)
    _sight[:] = [(stored, sight)]
    return sight


def _looked_at(stored: Stored, collection: bpy.types.Collection, scene: bpy.types.Scene):
    """The trouble and the cameras of a take."""
    if not len(stored.motion.frames):
        return (), []
    looking = TakeTrouble(stored.names, stored.rate, stored.edits, stored.cameras, stored.words)
    looking.add(stored.rows, stored.labels, stored.motion, _sight_of(stored))
    answered = ()
    if kept_text(collection) is not None:
        left = {(one.words, one.trajectory) for one in stored.suspects}
        all_of_it = opened.unedited(collection, scene).suspects
        answered = tuple(one for one in all_of_it if (one.words, one.trajectory) not in left)
    return looking.found(stored.suspects, answered), looking.by_camera.figures()
