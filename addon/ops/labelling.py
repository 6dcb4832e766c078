# SPDX-License-Identifier: GPL-3.0-or-later
"""The one button: names blobs or points, a little at a time, and shows the take when all of it is done."""

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import bpy

from ..core.cameras import Cameras
from ..core.errors import InputError
from ..core.markersets import MarkerSet
from ..core.occlusion import Occlusion
from ..core.pipeline import Options, label_take
from ..core.search import Hints
from ..core.takes import Blobs
from ..io.blobs import read_blobs
from ..props import chosen_markerset, frames_wanted, refresh_review, take_name
from ..scene import cameras as scene_cameras
from ..scene.occlusion import meshes_on, occlusion_of
from ..scene.take import Take, join_blobs, join_labelled, show_take
from .importing import cameras_at_hand
from .point_steps import label_point_steps, point_job_of
from .reporting import reports_trouble

CHUNK_FRAMES = 64  # a fraction of a second of work, so that the window answers in between
BUDGET = 0.1  # s of work between two looks at the keyboard
TICK = 0.02  # s


@dataclass(frozen=True, eq=False)
class Request:
    """Everything that a labelling needs, taken out of Blender before it begins."""

    name: str
    path: Path
    cameras: Cameras
    markerset: MarkerSet
    rate: float
    options: Options
    frames: tuple[int, int] | None
    occlusion: Occlusion | None


def request_of(context: bpy.types.Context) -> Request:
    """What the scene's settings ask for; InputError when something is missing."""
    settings = context.scene.mocap_autolabel
    if not settings.blobs_path:
        raise InputError("no blobs are chosen; expected a file of camera blobs")
    markerset = chosen_markerset(settings)
    hints = Hints(
        height=settings.height if settings.use_height else None, facing=settings.facing if settings.use_facing else None
    )
    return Request(
        take_name(settings),
        Path(bpy.path.abspath(settings.blobs_path)),
        scene_cameras.cameras_of(settings.cameras, context.scene),
        markerset,
        settings.rate,
        Options(hints=hints),
        frames_wanted(settings),
        _body_in_the_way(context, settings.body, markerset),
    )


def _body_in_the_way(context, armature: bpy.types.Object | None, markerset: MarkerSet) -> Occlusion | None:
    """The meshes on the skeleton that the user named; None for the marker set's own capsules."""
    if armature is None:
        return None
    return occlusion_of(context, armature, meshes_on(armature, context.scene), markerset)


def label_steps(request: Request) -> Generator[float, None, Take]:
    """Labels chunk by chunk, yielding how much is done (0 to 1), and returns the take. Touches nothing of Blender."""
    chunks: list[Blobs] = []
    fraction = 0.0

    def feed() -> Iterator[Blobs]:
        nonlocal fraction
        for part in read_blobs(request.path, request.cameras, request.frames, CHUNK_FRAMES):
            chunks.append(part.blobs)
            fraction = part.fraction
            yield part.blobs

    labelled = []
    steps = label_take(
        feed(), request.cameras, request.markerset, request.rate, request.options, occlusion=request.occlusion
    )
    for chunk in steps:
        labelled.append(chunk)
        yield fraction
    labels, motion, suspects = join_labelled(labelled)
    return Take(
        request.name,
        request.rate,
        request.cameras,
        request.markerset,
        join_blobs(chunks),
        labels,
        motion,
        suspects,
        str(request.path),
    )


def steps_of(context: bpy.types.Context) -> Generator[float, None, Take]:
    """The labelling that the scene's settings ask for, of blobs or of points; InputError when something is missing."""
    settings = context.scene.mocap_autolabel
    if settings.points_path:
        return label_point_steps(point_job_of(settings), take_name(settings))
    return label_steps(request_of(context))


class MOCAP_AUTOLABEL_OT_label(bpy.types.Operator):
    """Name every marker of the take, and show it on an armature with a body."""

    bl_idname = "mocap_autolabel.label"
    bl_label = "Label"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        settings = context.scene.mocap_autolabel
        if not settings.points_path:
            if not cameras_at_hand(context.scene):
                cls.poll_message_set("Import the calibration of the cameras first, or 3D points")
                return False
            if not settings.blobs_path:
                cls.poll_message_set("Import the blobs first, or 3D points")
                return False
        if context.mode != "OBJECT":
            cls.poll_message_set("Go to object mode first")
            return False
        return True

    @reports_trouble
    def execute(self, context):
        steps = steps_of(context)
        while True:
            try:
                next(steps)
            except StopIteration as done:
                return self._show(context, done.value)

    def invoke(self, context, event):
        return self.execute(context) if bpy.app.background else self._begin(context)

    @reports_trouble
    def _begin(self, context) -> set[str]:
        self._steps = steps_of(context)
        manager = context.window_manager
        self._timer = manager.event_timer_add(TICK, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        self._tell(context, 0.0)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC":
            self._end(context)
            self.report({"INFO"}, "Labelling was cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        return self._tick(context)

    @reports_trouble
    def _tick(self, context) -> set[str]:
        """Works for as long as the budget lasts."""
        running = False
        try:
            until = perf_counter() + BUDGET
            fraction = next(self._steps)
            while perf_counter() < until:
                fraction = next(self._steps)
            running = True
        except StopIteration as done:
            self._end(context)
            return self._show(context, done.value)
        finally:
            if not running:
                self._end(context)
        self._tell(context, fraction)
        return {"RUNNING_MODAL"}

    def cancel(self, context):
        self._end(context)

    def _show(self, context, take: Take) -> set[str]:
        settings = context.scene.mocap_autolabel
        settings.take = show_take(context, take, settings.keep_unnamed)
        refresh_review(context.window_manager, context.scene)
        named = int((take.labels.marker >= 0).sum())
        things = "blobs" if take.points is None else "points"
        self.report({"INFO"}, f"{named} of {len(take.blobs)} {things} named in {len(take.motion.frames)} frames")
        return {"FINISHED"}

    def _tell(self, context, fraction: float):
        context.window_manager.progress_update(round(100 * fraction))
        context.workspace.status_text_set(f"Labelling: {fraction:.0%} done. Esc cancels")

    def _end(self, context):
        """Gives back the timer, the progress and the status bar; once."""
        if self._timer is None:
            return
        self._steps.close()
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)
        self._timer = None


CLASSES = (MOCAP_AUTOLABEL_OT_label,)
