# SPDX-License-Identifier: GPL-3.0-or-later
"""Names while somebody records: a process beside Blender reads a stream, and the window shows its latest frame.

Nothing of it is in the file until it ends: no keys, no step of undo. Then what was recorded is imported and labelled.
"""

import json
import time
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ..core.data.errors import UserError
from ..core.data.markersets import MarkerSet, Worn
from ..core.data.takes import PointRows
from ..core.data.wording import count_of
from ..core.points.motion import PosedFrames
from ..core.posing.character import Character, character_of
from ..core.posing.finer import finer
from ..io.markersets import AUTO_MODEL, open_markerset
from ..io.scratch import scratch_folder
from ..io.text import written
from ..props import SceneSettings, chosen_model, subjects_asked
from ..scene.armature import bone_tails, build_of, segment_sides
from ..scene.later import redraw
from ..scene.live_rig import MovedRig
from ..scene.take import Take
from .base import operator, reason_of, unless

if TYPE_CHECKING:
    from ..jobs.live import LiveJob

SHOWN_EVERY = 1 / 60  # s between two looks for a frame
WORDS_EVERY = 0.25  # s between two states in the sidebar


@dataclass(frozen=True, eq=False)
class LiveBody:
    """Who is posed on the latest frame."""

    # (J, 3) m of the bones at rest
    begins: np.ndarray
    ends: np.ndarray
    scale: np.ndarray  # (3,) m, which is of one subject
    # (J, 3) m and (J, 3, 3) of the segments
    joints: np.ndarray
    rotations: np.ndarray

    @classmethod
    def of(cls, worn: MarkerSet, parts: dict, before: "LiveBody | None") -> "LiveBody":
        """That of a line; the bones are those of the body `before` where it is the same subject's."""
        joints, rotations, scale = (np.array(parts[name], float) for name in ("joints", "rotations", "scale"))
        joints, rotations, scale = joints.reshape(-1, 3), rotations.reshape(-1, 3, 3), scale.reshape(3)
        if len(joints) != len(worn.skeleton) or len(rotations) != len(joints):
            raise ValueError("bones are missing")
        if before is not None and (before.scale == scale).all():
            return cls(before.begins, before.ends, scale, joints, rotations)
        build = build_of(worn, PosedFrames(np.zeros((1, 0, 3)), joints[None], rotations[None], scale[None]))
        return cls(build.joints, bone_tails(worn, build), scale, joints, rotations)

    @property
    def bones(self) -> np.ndarray:
        """(J, 2, 3) m where the bones begin and end."""
        ahead = self.rotations @ (self.ends - self.begins)[..., None]
        return np.stack([self.joints, self.joints + ahead[..., 0]], axis=1)


class LivePerformer:
    """One of those who are in a stream, as its latest frame shows them, and the rig that moves with them.

    name     by which their markers are called NAME:MARKER; empty for the only one
    worn     the marker set, with the joints that the body has
    sides    of its bones
    body     who is posed on the frame, None where too few markers are named
    trouble  why the rig cannot move
    """

    def __init__(self, name: str, worn: MarkerSet):
        self.name, self.worn, self.sides = name, worn, [*segment_sides(worn).values()]
        self.body: LiveBody | None = None
        self.trouble = ""
        self._rig: MovedRig | None = None
        self._begins: np.ndarray | None = None  # of the bones that the character is of
        self._character: Character
        self._moving = 0  # the number of the rig that is to move

    def choose(self, rig: bpy.types.Object | None):
        """Says which rig is to move; one that moved before is as it was."""
        number = 0 if rig is None else rig.session_uid
        if number != self._moving:
            self.leave_rig()
            self._moving = number

    def move(self, context: bpy.types.Context, rig: bpy.types.Object | None):
        """Moves the rig that was chosen as the body."""
        body = self.body
        if rig is None or body is None or self.trouble or rig.mode == "EDIT":
            return
        if not rig.visible_get(view_layer=context.view_layer):  # nobody can be asked how it moves
            return
        try:
            if self._begins is not body.begins:  # another subject's bones
                self._character = character_of(self.worn.skeleton.segments, body.begins, body.ends)
                self._begins = body.begins
            self._rig = self._rig or MovedRig(context.scene, rig, self._character)
            self._rig.move(rig, self._character, body.joints, body.rotations)
        except UserError as error:
            self.trouble = written(str(error))

    def leave_rig(self):
        """Puts the rig that moves back as it was; another try is due."""
        if self._rig is not None:
            self._rig.leave()
        self._rig, self.trouble = None, ""


class WatchedStream:
    """A stream that a process names, which ends with Blender or sooner; what was recorded until then is kept.

    performers  who may be in it
    markers     all that may be named, by `model`, the name or path of one
    names       the markers that are named in the latest frame
    named       (N, 3) m their points
    unnamed     (U, 3) m its other points
    frame       its number
    came        s since the epoch, when its last byte had come
    late        how many frames before were dropped
    words       the state for the sidebar
    """

    def __init__(self, job: "LiveJob", worn: Worn):
        """Starts it; JobError where there can be no process."""
        from ..cli.live import LATEST, RECORD, STOP, name_beside
        from ..cli.workers import Worker

        with ExitStack() as stack:
            folder = stack.enter_context(scratch_folder())
            self._worker = Worker(folder)
            stack.callback(self._worker.pipe.close)  # which it hears
            self._kept = stack.pop_all()
        self._worker.hand(partial(name_beside, job, folder))
        self._latest, self._record, self._stop = (folder / name for name in (LATEST, RECORD, STOP))
        self.out, self.model, self.words = job.out, job.model, "Connecting"
        self.performers = [LivePerformer(name, finer(one)) for name, one in worn.worn]
        self.markers = worn.markers
        self._told, self.frame, self.came, self.late = 0.0, -1, 0.0, 0
        self.names: list[str] = []
        self.named = self.unnamed = np.empty((0, 3))

    @property
    def recording(self) -> bool:
        return self._record.exists()

    def look(self) -> dict | UserError | None:
        """Takes in the latest frame where it is new; how the stream ended, None where it has not."""
        found, now = self._worker.look(), time.time()
        try:
            line = json.loads(self._latest.read_bytes().partition(b"\n")[0])
            places, unnamed = line["markers"], np.array(line["unnamed"], float).reshape(-1, 3)
            if line["frame"] == self.frame or not places.keys() <= set(self.markers):
                return found
            named = np.array([*places.values()], float).reshape(len(places), 3)
            parts = line.get("bodies", [None] * len(self.performers))
            bodies = [
                LiveBody.of(one.worn, own, one.body) if own else None
                for one, own in zip(self.performers, parts, strict=True)
            ]
            came, late = line["at"] - line["ms"] / 1000, int(line["late"])
            found_words = f"{len(places)} of {len(self.markers)} markers named, {len(unnamed)} points not"
            changed = f", {count_of(line['changed'], 'name')} changed" if line["changed"] else ""
            words = f"{found_words}{changed}; {1000 * (now - came):.0f} ms, {count_of(late, 'frame')} dropped"
            words = "; ".join([words, *(one.trouble for one in self.performers if one.trouble)])
        except (OSError, ValueError, KeyError, TypeError, AttributeError):  # none is there, or it is just being written
            return found
        self.frame, self.came, self.late = line["frame"], came, late
        self.names, self.named, self.unnamed = list(places), named, unnamed
        for one, body in zip(self.performers, bodies, strict=True):
            one.body = body
        self._move_rigs(bpy.context)
        redraw("VIEW_3D", "WINDOW")
        if now - self._told > WORDS_EVERY and not self._stop.exists():
            self._told, self.words = now, words
            redraw("VIEW_3D", "UI")
        return found

    def record(self):
        self._record.touch()

    def stop(self):
        self._stop.touch()
        self.words = "Stopping"

    def _move_rigs(self, context: bpy.types.Context):
        """Moves the chosen rigs as the bodies of the latest frame, each as one of them at most."""
        settings = context.scene.mocap_autolabel
        listed = settings.subjects.performers if settings.subjects.performing == "LISTED" else ()
        chosen = {"": settings.live.rig} | {row.name: row.rig for row in listed}
        rigs: list[bpy.types.Object | None] = []
        for one in self.performers:
            rig = chosen.get(one.name)
            rigs.append(None if rig in rigs else rig)
            one.choose(rigs[-1])
        for one, rig in zip(self.performers, rigs, strict=True):  # once nobody moves another's any more
            one.move(context, rig)

    def leave_rigs(self):
        """Puts the rigs that move back as they were."""
        for one in self.performers:
            one.leave_rig()

    def leave(self):
        """Lets it end, and forgets it."""
        with self._kept:
            self.leave_rigs()


# The stream that goes on, what became of the last one, and the latest recording with the markers that it was named by.
_going: list[WatchedStream] = []
_ended: list[str] = []
_recorded: list[tuple[str, tuple[str, ...]]] = []


def going_on() -> WatchedStream | None:
    """The stream that is being named; None where there is none."""
    return _going[0] if _going else None


def follow_live() -> float | None:
    """Shows the latest frame, and at the end makes a take of what was recorded; a timer."""
    if not _going:
        return None
    stream = _going[0]
    try:
        found = stream.look()
    except Exception:  # the program's fault: without this timer nothing else would end the stream
        leave_live()
        raise
    if found is None:
        return SHOWN_EVERY
    leave_live()
    _ended[:] = [written(str(found))] if isinstance(found, UserError) else []
    if stream.out is not None and stream.out.exists():
        _take_in(stream)
    redraw("VIEW_3D")
    return None


def rest_rig():
    """Puts the rigs that move back as they are in the file; the next frame moves them again."""
    for stream in _going:
        stream.leave_rigs()


def _take_in(stream: WatchedStream):
    """Imports what was recorded, and labels it as a whole in the background."""
    path = str(stream.out)
    _recorded[:] = [(written(path), stream.markers)]
    windows = bpy.context.window_manager.windows
    try:
        with bpy.context.temp_override(window=windows[0] if len(windows) else None):
            bpy.ops.mocap_autolabel.import_points(filepath=path)
            subjects = bpy.context.scene.mocap_autolabel.subjects
            if subjects.markerset == AUTO_MODEL:
                subjects.found = stream.model  # the set that it was named by
            bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
    except RuntimeError as error:  # what an operator of ours reports
        _ended.append(reason_of(error))


def leave_live():
    """Lets the stream that goes on end, as Blender or the extension ends or another file is opened."""
    while _going:
        _going.pop().leave()


def how_it_ended() -> str:
    """What there is to say of the last stream."""
    return ". ".join(_ended)


def changed_since_live(take: Take) -> str:
    """What labelling the recording as a whole changed of the names that it had live; empty for any other take."""
    names = take.markerset.markers
    if (take.source, names) not in _recorded or not isinstance(take.rows, PointRows):
        return ""
    live = take.rows.trajectory < len(names)  # the first columns of the recording
    changed = int((live & (take.labels.marker != take.rows.trajectory)).sum())
    words = f"{changed:,} of {int(live.sum()):,} names given live changed"
    _recorded.clear()  # labelled once more it is compared with the labelling before
    _ended.append(words)
    return f"; {words}"


def live_job(settings: SceneSettings) -> "LiveJob":
    """What the settings ask for; InputError where that is not clear, JobError where Blender may not go online."""
    from ..cli.live import refuse_offline
    from ..jobs.live import LiveJob

    refuse_offline()
    live = settings.live
    folder = Path(bpy.path.abspath(live.folder)) if live.folder else None
    out = folder / time.strftime("live_%Y-%m-%d_%H%M%S.c3d") if folder else None
    up = None if live.up == "AUTO" else live.up
    asked = subjects_asked(settings.subjects)
    if asked["model"] == AUTO_MODEL:
        asked = {"model": chosen_model(settings.subjects)}
    return LiveJob(live.source.strip(), out=out, up=up, **asked)


goes_on = unless(lambda _: _going, "Connect first")


@operator(
    unless(lambda _: not _going, "A stream is being named already"),
    unless(lambda context: context.scene.mocap_autolabel.live.source.strip(), "Say where the stream comes from"),
    options={"INTERNAL"},
)
def connect(_self, context):
    """Name what a capture program streams by the chosen marker set, and show it in the 3D views."""
    settings = context.scene.mocap_autolabel
    job = live_job(settings)
    _going.append(WatchedStream(job, job.worn if job.several else open_markerset(job.model)))
    _ended.clear()
    bpy.app.timers.register(follow_live, persistent=True)


@operator(
    goes_on,
    unless(lambda _: _going[0].out, "Choose the folder for recordings, then connect again"),
    unless(lambda _: not _going[0].recording, "It is being recorded"),
    options={"INTERNAL"},
)
def record(_self, _context):
    """Keep all frames from now on, as they come and with their names, until Stop Live makes them a take."""
    _going[0].record()


@operator(goes_on, options={"INTERNAL"})
def stop_live(_self, _context):
    """End the stream; what was recorded becomes a take, which is labelled as a whole in the background."""
    _going[0].stop()
