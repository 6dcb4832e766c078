# SPDX-License-Identifier: GPL-3.0-or-later
"""Armature and body of the active take follow its labels: the frame that is seen at once, the rest a moment later."""

from collections.abc import Generator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from time import perf_counter

import bpy

from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.data.progress import finished
from ..core.points.motion import posed_again
from ..core.points.several.wearers import MAX_SUBJECTS
from ..core.posing.finer import finer
from ..io.markersets import SUFFIX, builtin_markersets, markerset_file, read_markerset
from ..prefs import markerset_folder
from ..props import chosen_model, refresh_review, row_of, scene_of_lists
from ..scene.clock import refresh_frame
from ..scene.later import never, redraw, soon
from ..scene.opened import opened
from ..scene.performers import Performer
from ..scene.reposing import is_out_of_date, lacks_to_repose, put_body, show_posed_frame
from ..scene.rig_preview import follow_rigs
from ..scene.stored import Stored
from ..scene.take import is_take

BUDGET, TICK = 0.1, 0.02  # s of work between two looks at the keyboard, and until the next

# What poses the active take again: the take, by the session's number of its collection and the digests of its labels,
# and the work.
_going_on: list[tuple[tuple[int, bytes], Generator[None, None, None]]] = []


def sets_of(context: bpy.types.Context, stored: Stored) -> list[MarkerSet | None]:
    """The marker sets that a take was labelled by, one for each performer; None where one is not at hand."""
    return [_set_of(context, stored, performer) for performer in stored.performers]


def _set_of(context: bpy.types.Context, stored: Stored, performer: Performer) -> MarkerSet | None:
    """The one that is chosen, where it is the performer's, else the built-in one or the user's own of that name.

    With as many joints as the take's body has.
    """
    paths = [markerset_folder() / (performer.model + SUFFIX)]
    if performer.model in builtin_markersets():
        paths.insert(0, markerset_file(performer.model))
    with suppress(InputError):
        paths.insert(0, markerset_file(chosen_model(row_of(context.scene.mocap_autolabel.subjects, performer.name))))
    markers = tuple(performer.own_name(name) for name in stored.names[performer.marker_rows])
    for path in paths:
        with suppress(InputError):
            found = _read(path, path.stat().st_mtime_ns) if path.is_file() else None
            for one in (finer(found), found) if found is not None and found.markers == markers else ():
                if len(one.skeleton) == performer.joints[1]:
                    return one
    return None


@lru_cache(maxsize=MAX_SUBJECTS)
def _read(path: Path, _changed: int) -> MarkerSet:
    """A marker set, read once for each time that its file changed."""
    return read_markerset(path)


def _reposing(context: bpy.types.Context, collection: bpy.types.Collection) -> Generator[None, None, None]:
    """Poses the take again; the first step puts the body of the current frame there."""
    scene, stored = context.scene, opened.take(collection, context.scene)
    markersets = sets_of(context, stored)
    frames, markers = stored.clock.shown(stored.motion.frames), stored.unfilled.markers
    here = int(abs(frames - scene.frame_float).argmin())
    works = []
    for performer, markerset in zip(stored.performers, markersets, strict=True):
        work = posed_again(markers[:, performer.marker_rows], markerset, here)
        show_posed_frame(collection, performer, markerset, float(frames[here]), next(work))
        works.append(work)
    refresh_frame(scene)
    yield
    bodies = [None] * len(works)
    for number, work in enumerate(works):
        bodies[number] = yield from work
    yield from put_body(context, collection, stored, markersets, bodies)
    refresh_frame(scene)


def is_behind(context: bpy.types.Context) -> bool:
    """Whether armature and body of the active take are not what its labels make."""
    collection = context.scene.mocap_autolabel.take
    return is_take(collection) and is_out_of_date(collection, opened.take(collection, context.scene))


def words_behind(context: bpy.types.Context) -> str:
    """That armature and body of the active take are out of date, and what to do about it; empty where they are not.

    Whoever shows that sees to it that it is mended, where it can be.
    """
    if not is_behind(context):
        return ""
    lacking = _lacking(context)
    if not lacking and not bpy.app.background:
        follow_soon()
    return f"The body is out of date: {lacking or 'it follows in a moment'}"


def _lacking(context: bpy.types.Context) -> str:
    """What has to be done before the body can follow; empty where nothing has."""
    collection = context.scene.mocap_autolabel.take
    stored = opened.take(collection, context.scene)
    for performer, markerset in zip(stored.performers, sets_of(context, stored), strict=True):
        if markerset is None:
            return f"choose marker set {performer.model}, or label again"
    return lacks_to_repose(context, collection)


def follow_soon(seen: bool = False):
    """Lets the body follow the labels: beside the window, without one at once.

    With `seen` the body of the current frame is there before anything is drawn: no redraw is waited for.
    """
    if bpy.app.background and is_behind(bpy.context) and not _lacking(bpy.context):
        follow_now(bpy.context)
    if seen:
        _follow()
    soon(_follow)


def follow_now(context: bpy.types.Context):
    """Makes the body that of the labels before anything else is done with it; InputError where it cannot be."""
    if not is_behind(context):
        return
    if lacking := _lacking(context):
        raise InputError(f"the body is older than the last correction; expected you to {lacking} first")
    _going_on.clear()
    finished(_reposing(context, context.scene.mocap_autolabel.take))


def forget_reposing():
    """Lets go of what is going on: another file or step takes its objects away, or the extension ends."""
    _going_on.clear()
    never(_follow)


def _follow() -> float | None:
    """Works for as long as the budget lasts; what is going on of a take that is another by now is left."""
    context, until = bpy.context, perf_counter() + BUDGET
    if not is_behind(context) or _lacking(context):
        _going_on.clear()
        follow_rigs()
        redraw("VIEW_3D")
        return None
    collection = context.scene.mocap_autolabel.take
    key = collection.session_uid, opened.take(collection, context.scene).label_digests.tobytes()
    if not _going_on or _going_on[0][0] != key:
        _going_on[:] = [(key, _reposing(context, collection))]
    for _ in _going_on[0][1]:
        if perf_counter() > until:
            return TICK
    _going_on.clear()
    refresh_review(context.window_manager, scene_of_lists())
    return TICK
