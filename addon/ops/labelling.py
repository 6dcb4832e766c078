# SPDX-License-Identifier: GPL-3.0-or-later
"""The one button: names blobs or points, a little at a time, and shows the take when all of it is done."""

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..core.blobs.pipeline import Options, label_take
from ..core.blobs.search import Hints
from ..core.body.occlusion import Occlusion
from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.data.takes import Blobs
from ..core.geometry.cameras import Cameras
from ..core.review.odd_cameras import CameraCheck
from ..io.blobs import read_blobs
from ..io.names import written
from ..props import chosen_markerset, frames_wanted, refresh_review, take_name
from ..scene import cameras as scene_cameras
from ..scene.occlusion import meshes_on, occlusion_of
from ..scene.take import Take, join_blobs, join_labelled, show_take
from .importing import cameras_at_hand
from .point_steps import label_point_steps, point_job_of
from .stepping import WorksInSteps

CHUNK_FRAMES = 64  # a fraction of a second of work, so that the window answers in between


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

    labelled, check = [], CameraCheck(request.cameras)
    steps = label_take(
        feed(), request.cameras, request.markerset, request.rate, request.options, occlusion=request.occlusion
    )
    for chunk in steps:
        check.add(chunks[len(labelled)], chunk)
        labelled.append(chunk)
        yield fraction
    labels, motion, suspects = join_labelled(labelled)
    doubts = check.suspects()
    return Take(
        request.name,
        request.rate,
        request.cameras,
        request.markerset,
        join_blobs(chunks),
        labels,
        motion,
        (*doubts, *suspects),
        written(str(request.path)),
        doubts=tuple(doubt.reason for doubt in doubts),
    )


def steps_of(context: bpy.types.Context) -> Generator[float, None, Take]:
    """The labelling that the scene's settings ask for, of blobs or of points; InputError when something is missing."""
    settings = context.scene.mocap_autolabel
    if settings.points_path:
        return label_point_steps(point_job_of(settings), take_name(settings))
    return label_steps(request_of(context))


class MOCAP_AUTOLABEL_OT_label(WorksInSteps, bpy.types.Operator):
    """Name every marker of the take, and show it on an armature with a body."""

    bl_idname = "mocap_autolabel.label"
    bl_label = "Label"
    bl_options = {"REGISTER", "UNDO"}

    doing = "Labelling"

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

    def steps(self, context):
        """The labelling."""
        return steps_of(context)

    def _show(self, context, take: Take) -> set[str]:
        settings = context.scene.mocap_autolabel
        settings.take = show_take(context, take, settings.keep_unnamed)
        refresh_review(context.window_manager, context.scene)
        named = int((take.labels.marker >= 0).sum())
        things = "blobs" if take.points is None else "points"
        for words in take.doubts:
            self.report({"WARNING"}, words)
        self.report({"INFO"}, f"{named} of {len(take.blobs)} {things} named in {len(take.motion.frames)} frames")
        return {"FINISHED"}


CLASSES = (MOCAP_AUTOLABEL_OT_label,)
