# SPDX-License-Identifier: GPL-3.0-or-later
"""The one button: names blobs or points by the command line's own job, and shows the take when all of it is done."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ..core.data.errors import ForceableError, InputError, UserError
from ..core.data.takes import Blobs
from ..core.data.wording import count_of
from ..core.edits.kinds import Edits
from ..core.geometry.cameras import NO_CAMERAS
from ..core.pipelines.known_sets import HOW_TO_CHOOSE, HOW_TO_FIND, HOW_TO_TURN
from ..core.points.possible import HOW_TO_MIRROR
from ..core.points.refusals import HOW_TO_ASK
from ..core.points.several.wearers import AUTO
from ..core.review.changes import Change, summary_of_changes
from ..io.markersets import AUTO_MODEL, open_markerset
from ..io.qtm.capture import USE_BLOBS, USE_POINTS
from ..io.text import written
from ..jobs import LabelJob, Labelled, label_to_show, worn_to_show
from ..jobs.job import occlusion_here
from ..props import (
    ReviewState,
    SceneSettings,
    anybody,
    as_typed,
    choose_model,
    chosen_model,
    colours_asked,
    forget_told,
    found_here,
    frames_wanted,
    is_opened,
    opened_file,
    refresh_review,
    subjects_asked,
    take_name,
)
from ..scene import cameras as scene_cameras
from ..scene.corrections import kept_edits
from ..scene.occlusion import meshes_on, occlusion_of
from ..scene.ownership import persons_in
from ..scene.performers import usual_colour
from ..scene.relabelled import kept_changes, show_again
from ..scene.roots import in_world
from ..scene.take import Take, is_take
from .base import lacks_object_mode, once, takes_of_file
from .filling import fills_kept, kept_before
from .importing import UP_ITEMS, cameras_at_hand, clock_of, forget_found, look_who_is_there
from .live import changed_since_live
from .long_work import LongWork, nothing_goes_on
from .reposing import follow_soon
from .viewing import fit_timelines, show_take_whole

ASK_HERE = "by Label All Performers, or by How Many"
MIRROR_HERE = "by Mirror in the options of Open Take"
CHOOSE_HERE, FIND_HERE = "under Marker Set, as", "under Marker Set, or one that is trained under Advanced › Marker Set"
TURN_HERE = "by Up, under Take, as"


def job_of(context: bpy.types.Context, asked: dict | None = None, worn: str = "") -> LabelJob:
    """What the scene's settings ask for, of blobs or of points; InputError when something is missing.

    Who is `asked` for may be otherwise than by the settings, as by `subjects_asked`, and the marker set that is `worn`.
    """
    settings = context.scene.mocap_autolabel
    given, labelling, own = settings.source, settings.labelling, settings.labelling.body if asked is None else None
    asked = asked or subjects_asked(settings.subjects, worn)
    if asked["model"] == AUTO_MODEL and (found := found_here(settings.subjects)):
        asked |= {"model": found, "own": None}
    points = bool(given.points_path)
    if not points and not given.blobs_path:
        raise InputError("no blobs are chosen; expected a file of camera blobs")
    source = Path(bpy.path.abspath(given.points_path or given.blobs_path))
    # The meshes on the skeleton that the user named, else those of the marker sets' capsules, as of several.
    body = None
    if own is not None and not points and labelling.occlusion == "bvh" and settings.subjects.performing == "ONE":
        markerset = open_markerset(worn or chosen_model(settings.subjects))
        body = occlusion_of(context, own, meshes_on(own, context.scene), markerset)
    return LabelJob(
        source=source,
        cameras=None if points else scene_cameras.cameras_of(given.cameras, context.scene),
        **asked,
        out=Path(),
        frames=frames_wanted(labelling),
        method=labelling.method,
        target=as_typed(labelling.target),
        up=given.up or None if points else None,
        mirror=points and given.mirror,
        use=USE_POINTS if points else USE_BLOBS,
        rate=as_typed(given.rate),
        height=labelling.height if labelling.use_height else None,
        facing=labelling.facing if labelling.use_facing else None,
        occlusion=occlusion_here(labelling.occlusion),  # Blender's own, whichever door the process goes through
        body=body,
        edits=edits_so_far(context.scene, source),
        keep=True,
        shown=True,
        force=given.forced,
    )


def choose_job(settings: SceneSettings, job: LabelJob, ends: tuple[int, int]):
    """The other way round: makes a scene's choices those of a job on a part of a take of frames `ends`, first and last.

    What it labels, who is asked for, and how names are found; nothing of the take has been counted.
    """
    source, subjects, labelling, file = settings.source, settings.subjects, settings.labelling, str(job.source)
    source.points_path, source.blobs_path = (file, "") if job.use == USE_POINTS else ("", file)
    source.up, source.up_found = job.up or "", UP_ITEMS[0][1]
    source.blob_count = source.trajectories = source.named = 0
    source.mirror, source.forced, source.rate = job.mirror, job.force, job.rate or source.rate
    source.first_frame, source.last_frame, source.at_1 = *ends, False
    labelling.use_range, (labelling.range_first, labelling.range_last) = True, job.frames
    labelling.method, labelling.target, labelling.occlusion = job.method, job.target, job.casts
    for name, value in (("height", job.height), ("facing", job.facing)):
        setattr(labelling, f"use_{name}", value is not None)
        if value is not None:
            setattr(labelling, name, value)
    choose_model(subjects, job.model)
    subjects.performing = "LISTED" if job.wearers else {1: "ONE", AUTO: "AUTO"}.get(job.subjects, "SO_MANY")
    if subjects.performing == "SO_MANY":
        subjects.performer_count = job.subjects
    if job.wearers:
        subjects.performers.clear()
    for number, (name, model) in enumerate(job.wearers):
        row = subjects.performers.add()
        row.name, row.colour = name, usual_colour(number)
        choose_model(row, model)


def edits_so_far(scene: bpy.types.Scene, source: Path) -> Edits | None:
    """What was said of the same points or blobs when they were labelled before; None where nobody said anything."""
    same = takes_of_file(scene, written(str(source)))
    return next((edits for edits in map(kept_edits, same) if edits is not None), None)


def lacks_input(context: bpy.types.Context) -> str:
    """What to import before anything can be labelled; else nothing."""
    source = context.scene.mocap_autolabel.source
    if source.points_path:
        return ""
    if not cameras_at_hand(context.scene):
        return "Open the calibration of the cameras first, or 3D points"
    return "" if source.blobs_path else "Open the blobs first, or 3D points"


def in_sidebar(words: str, ask: str = ASK_HERE) -> str:
    """A sentence of the command line with the sidebar's words for what can be done; `ask` is how to ask for several."""
    words = words.replace(HOW_TO_ASK, ask).replace(HOW_TO_MIRROR, MIRROR_HERE).replace(HOW_TO_FIND, FIND_HERE)
    return words.replace(HOW_TO_TURN, TURN_HERE).replace(HOW_TO_CHOOSE, CHOOSE_HERE)


class LabelsTake(LongWork):
    """Operators that label by their `_job`, and show the take as the scene's settings have it, under their `_name`.

    `_clock` says from which frame on, None for as `show_take` has it.
    """

    doing, needs = "Labelling", (lacks_object_mode, nothing_goes_on)

    def _said(self, _context, error: UserError) -> UserError:
        """What it is refused for, with the button's words for what can be done about it."""
        return type(error)(in_sidebar(error.message), error.file or self._job.source, error.line)

    def _show(self, context, found: tuple[Labelled, tuple[Change, ...] | None]):
        job, (labelled, _) = self._job, found
        doubts = tuple(labelled.report.get("camera_doubts", ()))
        # An empty list that was given stays one: what lies beside the take was taken back in the scene.
        edits = labelled.edits if labelled.edits or job.edits is not None else None
        given = self._name, labelled.report["rate"], job.cameras or NO_CAMERAS, labelled.worn, labelled.chunks
        kept = {"doubts": doubts, "edits": edits, "lab": labelled.lab, "clock": self._clock}
        take = Take.of(*given, written(str(job.source)), **kept)
        if context.mode != "OBJECT":  # where the user went meanwhile
            bpy.ops.object.mode_set(mode="OBJECT")
        settings = context.scene.mocap_autolabel
        take = replace(take, **kept_before(context.scene, take.source), colours=colours_asked(settings.subjects))
        again = is_take(settings.take) and is_opened(settings)
        settings.take = show_again(context, take, whole=job.frames is None)
        if not again:  # what was opened meanwhile is seen
            context.window_manager.mocap_autolabel.unfolded = not is_opened(settings)
        follow_soon()  # frames around those that were labelled may have been corrected a moment before
        refresh_review(context.window_manager, context.scene)
        if isinstance(take.rows, Blobs):
            show_take_whole(context, in_world(settings.take, take.motion.markers.reshape(-1, 3)))
        else:
            fit_timelines(context)
        for words in take.doubts or ():
            self.report({"WARNING"}, words)
        things = "blobs" if isinstance(take.rows, Blobs) else "points"
        named, frames = int(take.labels.named.sum()), len(take.motion.frames)
        words = f"{named} of {len(take.rows)} {things} named in {count_of(frames, 'frame')}"
        words += f"; {count_of(len(take.edits), 'correction')} kept" if take.edits else ""
        words += fills_kept(context) + changed_since_live(take)
        yours, changed = persons_in(settings.take), summary_of_changes(kept_changes(settings.take))
        words += f"; kept in {settings.take.name}: {yours}" if yours else ""
        self.report({"INFO"}, words + (f"; compared with before {changed}" if changed else ""))


class MOCAP_AUTOLABEL_OT_label(LabelsTake, bpy.types.Operator):
    """Name every marker of the take, and show it on an armature with a body."""

    force: once(
        BoolProperty,
        "Regardless",
        "Name markers although something of the take cannot be as it is, for as long as it is this take",
    )

    everybody: BoolProperty(
        name="All Performers",
        description="As many who wear the marker set as there are, whoever was asked for",
        options={"HIDDEN", "SKIP_SAVE"},
    )

    markerset: once(StringProperty, "Marker Set", "The one that was worn, where Automatic asks; empty for the chosen")

    needs = (lacks_input, *LabelsTake.needs)

    def asked(self, context) -> partial:
        """The labelling; what the take is refused for stays beside the button where something can be done about it."""
        settings, state = context.scene.mocap_autolabel, context.window_manager.mocap_autolabel
        subjects, before = settings.subjects, settings.subjects.performing
        subjects.performing = "AUTO" if self.everybody else before
        settings.source.forced |= self.force
        if self.everybody and subjects.markerset == AUTO_MODEL and state.about == opened_file(settings.source):
            subjects.found = found_here(subjects) or state.crowded  # that it was found may have been undone
        state.refused = state.unsure = ""
        try:
            self._job, self._name = job_of(context, worn=self.markerset), take_name(settings.source)
            self._clock = clock_of(settings.source)
        except InputError:
            subjects.performing = before  # so the button for all of them stays
            raise
        return partial(label_to_show, self._job)

    def _show(self, context, found):
        LabelsTake._show(self, context, found)
        if self.markerset:
            choose_model(context.scene.mocap_autolabel.subjects, self.markerset)

    def _said(self, context, error: UserError) -> UserError:
        """The sidebar knows why a take is refused."""
        error, file = LabelsTake._said(self, context, error), written(str(self._job.source))
        if file != opened_file(context.scene.mocap_autolabel.source):
            return error  # another take was opened meanwhile
        state = told_of(context)
        if isinstance(error, ForceableError):
            state.refused = error.message
        elif self._job.model == AUTO_MODEL:
            state.unsure = error.message
        if ASK_HERE in error.message and self._job.model == AUTO_MODEL:
            look_who_is_there(context)  # all can be asked for once it is known what they wear
        elif ASK_HERE in error.message:
            state.crowded = self._job.model
        return error


class MOCAP_AUTOLABEL_OT_find_markerset(LabelsTake, bpy.types.Operator):
    """Find out which of the marker sets that are known the take shows, and whether two performers are in it."""

    bl_options = {"INTERNAL", "UNDO"}  # a step of its own, so undoing the next one keeps what was found
    doing, waits = "Looking who is there", False
    needs = (lacks_input, nothing_goes_on)

    def asked(self, context) -> partial:
        forget_found(context)
        self._source = _read_as(context)
        self._job = job_of(context, anybody())
        return partial(worn_to_show, self._job)

    def _show(self, context, found: tuple[list[str], bool, bool, UserError | None]):
        state, (models, sure, several, trouble) = told_of(context), found
        if _read_as(context) != self._source:
            look_who_is_there(context)  # another take was opened meanwhile
            return
        state.unsure = "" if trouble is None else self._said(context, trouble).message
        if sure:
            context.scene.mocap_autolabel.subjects.found = models[0]
            state.crowded = models[0] if several else ""
            return
        for model in models:
            state.likely.add().name = model


def told_of(context: bpy.types.Context) -> ReviewState:
    """What the sidebar knows of the take that is opened; what was of another, before an undo, is forgotten."""
    state, file = context.window_manager.mocap_autolabel, opened_file(context.scene.mocap_autolabel.source)
    if state.about != file:
        forget_told(state, file)
    return state


def _read_as(context: bpy.types.Context) -> tuple[str, str, str, bool]:
    """What is opened, and how it was read."""
    source = context.scene.mocap_autolabel.source
    return source.points_path, source.blobs_path, source.up, source.mirror
