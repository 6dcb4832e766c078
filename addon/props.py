# SPDX-License-Identifier: GPL-3.0-or-later
"""What the sidebar remembers: the choices of a scene, saved with it, and the tables of a review, worked out again."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import wraps
from pathlib import Path
from zlib import crc32

import bpy
import numpy as np
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from .core.data.errors import InputError
from .core.data.physical import HEIGHTS_M
from .core.edits.kinds import counted_on, words_of
from .core.filling.kept import KeptFill, resting_on
from .core.geometry.camera_up import AXIS_NAMES
from .core.points.several.wearers import AUTO, MAX_SUBJECTS, NAME_RULE, as_compared, is_subject_name
from .io.markersets import AUTO_MODEL, SUFFIX, builtin_markersets, open_markerset
from .io.model_history import own_models
from .io.text import written
from .prefs import markerset_folder
from .scene.armature import SCALE
from .scene.clock import TakeClock
from .scene.later import redraw, soon
from .scene.naming import CAMERAS
from .scene.opened import opened
from .scene.performers import Colour, homes, set_colour, usual_colour
from .scene.preview import hide_preview
from .scene.relabelled import kept_changes
from .scene.retargeting import is_rig
from .scene.rig_preview import follow_rigs_soon
from .scene.take import SOURCE, is_take
from .scene.timing import OWN_FIRST, RATE, give_time, keep_clock, kept_clock
from .scene.trouble import is_quick, marker_rows, trouble_of

OWN_FILE = "FILE"
USUAL_MARKERSET = "body26"
LATER = 0.4  # s after which the trouble of a long take is worked out: edits that follow each other do not wait for it
SCOPES = (
    ("FRAME", "This Frame", "In the current frame"),
    ("ON", "From Here On", "From the current frame to the last"),
    ("BACK", "Back to the Start", "From the first frame to the current one"),
    ("WHOLE", "Whole Trajectory", "In all frames of the take"),
    ("RANGE", "Selected Range", "In the scene's preview range"),
)


def keeps_items(items: Callable[..., Iterable[tuple]]) -> Callable[..., list[tuple]]:
    """Wraps the items of an enumeration: Blender keeps no reference to their texts, which must outlive the drawing."""
    kept: list[tuple] = []

    @wraps(items)
    def run(self, context) -> list[tuple]:
        kept[:] = items(self, context or bpy.context)  # a menu that sets the value of a button brings no context
        return kept

    return run


@keeps_items
def _markerset_items(_self, _context) -> list[tuple[str, str, str, str, int]]:
    own = own_models(markerset_folder())
    items = [(AUTO_MODEL, "Automatic", "The one of these that the take shows")]
    items += [(name, name, f"Built-in marker set {name}") for name in builtin_markersets()]
    items += [(str(path), path.name.removesuffix(SUFFIX), f"Your own marker set, {path}") for path in own]
    items.append((OWN_FILE, "From a File…", "A marker set file that you choose"))
    return [(*item, "NONE", _item_number(item[0])) for item in items]


def _item_number(name: str) -> int:
    """What a file keeps of a choice: of the name, not of its place in a list that gets longer."""
    return crc32(name.encode("utf-8", "surrogateescape")) >> 1


def _take_changed(self, context):
    state = context.window_manager.mocap_autolabel
    state.picked.clear()
    state.left_gaps.clear()
    state.timeline_scroll, state.timeline_unfolded = 0.0, False
    hide_preview(self.source.preview, self.take is not None)
    if self.take is not None:
        self.display.stage = "REVIEW"
        self.take.hide_viewport = False  # one of another marker set may have hidden it
    know_markerset(self, context.scene)
    refresh_review(context.window_manager, context.scene)


def _colour_changed(self, context):
    take = context.scene.mocap_autolabel.take
    if is_take(take):
        set_colour(take, self.name, tuple(self.colour))


def _rate_changed(self, context):
    preview = self.preview
    if preview is not None and OWN_FIRST in preview and preview[RATE] != self.rate:
        ends = np.array([self.first_frame, self.last_frame])
        clock = kept_clock(preview, self.first_frame)
        keep_clock(preview, give_time(context.scene, self.rate, ends, clock), self.rate, ends)


def _timeline_changed(_self, _context):
    redraw("DOPESHEET_EDITOR")


def chosen_row():
    """Which row of a list is chosen; Blender shows the words over every row."""
    return IntProperty(name="Row", description="Choose this row")


class TrainingTakeRow(bpy.types.PropertyGroup):
    """A labelled take to learn from."""

    path: StringProperty(name="File", description="The file of the labelled take", subtype="FILE_PATH")
    subject: StringProperty(name="Subject", description="Who wears the markers; takes of one subject have one name")
    markers: IntProperty(name="Markers", description="Number of named markers")
    up: StringProperty(name="Up", description="The axis that points up in the file, empty for what it says or tells")
    rate: FloatProperty(name="Rate", description="Frames a second where the file says none; 0 where it does")
    kept: BoolProperty(
        name="Keep for Checking",
        description="Learn nothing from this take, whose names were looked at: whenever the marker set is trained on, "
        "it is labelled again by the marker set as it was and as it is then",
    )


class WearsMarkers:
    """Who wears markers of a set."""

    markerset: EnumProperty(
        name="Marker Set",
        description="Which markers are worn; a set learned from somebody's own take tells them from others",
        items=_markerset_items,
        default=_item_number(AUTO_MODEL),
    )
    markerset_path: StringProperty(name="File", description="A *.markerset.json file", subtype="FILE_PATH")


def live_rig():
    """A property: whose motion a stream gives to an armature of the user's."""
    return PointerProperty(
        name="Rig",
        description="Your own armature that moves as the body does while the stream goes on, and then is as it was",
        type=bpy.types.Object,
        poll=lambda _, item: is_rig(item),
    )


class PerformerRow(WearsMarkers, bpy.types.PropertyGroup):
    """Somebody who is asked for by `name`, which their markers are called by."""

    colour: FloatVectorProperty(
        name="Colour",
        description="What the performer's body, figure and dots are drawn in",
        subtype="COLOR_GAMMA",
        size=3,
        min=0.0,
        max=1.0,
        default=usual_colour(0),
        update=_colour_changed,
    )
    rig: live_rig()


class SourceSettings(bpy.types.PropertyGroup):
    """What is to be labelled: blobs with their cameras, or 3D points."""

    cameras: PointerProperty(
        name="Cameras",
        description="The calibrated cameras that recorded the take",
        type=bpy.types.Collection,
        poll=lambda _, collection: CAMERAS in collection,
    )
    blobs_path: StringProperty(name="Blobs", description="The file of the blobs", subtype="FILE_PATH")
    points_path: StringProperty(
        name="3D Points", description="The file of the 3D points, where there is one", subtype="FILE_PATH"
    )
    up: StringProperty(
        name="Up", description="The axis that points up in the file of the 3D points, empty for what it says or tells"
    )
    up_found: StringProperty(name="Up", description="The axis of the file that was taken to point up", default="Z")
    mirror: BoolProperty(
        name="Mirror", description="Reverse an axis of the 3D points, as those of their file are left-handed"
    )
    forced: BoolProperty(name="Regardless", description="Whether names are wanted whatever is wrong with the take")
    preview: PointerProperty(type=bpy.types.Mesh)
    at_1: BoolProperty(name="Start with the Scene", description="Whether the take begins at the scene's first frame")
    first_frame: IntProperty(name="First", description="First frame of the take")
    last_frame: IntProperty(name="Last", description="Last frame of the take")
    blob_count: IntProperty(name="Blobs", description="Number of blobs or points")
    trajectories: IntProperty(name="Trajectories", description="Number of trajectories of 3D points")
    named: IntProperty(name="Named", description="Number of trajectories that have a name in the file of the 3D points")
    rate: FloatProperty(
        name="Rate",
        description="Frames a second of the recording",
        default=100.0,
        min=1.0,
        max=10000.0,
        precision=2,
        update=_rate_changed,
    )


class SubjectSettings(WearsMarkers, bpy.types.PropertyGroup):
    """Who is in the take, and what they wear."""

    performing: EnumProperty(
        name="How Many",
        description="How many performers a take is of",
        items=(
            ("ONE", "One", "One, who needs no name"),
            ("SO_MANY", "So Many", "So many who wear the marker set; they are called 1, 2 and so on"),
            ("AUTO", "Automatic", "As many who wear the marker set as there are; they are called 1, 2 and so on"),
            ("LISTED", "By Name", "Those in the list, each with a name and a marker set of their own"),
        ),
    )
    performer_count: IntProperty(
        name="Performers", description="How many wear the marker set", default=2, min=2, max=MAX_SUBJECTS
    )
    performers: CollectionProperty(type=PerformerRow)
    performer_index: chosen_row()
    found: StringProperty(name="Found", description="The marker set that Automatic found in the take; empty for none")


class TrainingSettings(bpy.types.PropertyGroup):
    """What a marker set is learned from."""

    takes: CollectionProperty(type=TrainingTakeRow)
    take_index: chosen_row()
    trained_name: StringProperty(name="Name", description="What to call the marker set that is learned", default="mine")
    train_on: BoolProperty(
        name="Train On",
        description="Go on from what the chosen marker set has learned before, and keep that; off makes a new one",
    )


class LabellingSettings(bpy.types.PropertyGroup):
    """How the take is labelled."""

    use_range: BoolProperty(name="Frames", description="Label only these")
    range_first: IntProperty(name="From", description="First frame to label")
    range_last: IntProperty(name="To", description="Last frame to label")
    use_height: BoolProperty(name="Height", description="Tell how tall the subject is; found by itself if you do not")
    height: FloatProperty(
        name="Height",
        description="The subject's height",
        default=1.75,
        min=HEIGHTS_M[0],
        max=HEIGHTS_M[1],
        subtype="DISTANCE",
        unit="LENGTH",
    )
    use_facing: BoolProperty(name="Facing", description="Tell which way the subject faces; found by itself if not")
    facing: FloatProperty(
        name="Facing",
        description="Direction the subject faces at first, counter-clockwise from world X seen from above",
        min=-2 * math.pi,
        max=2 * math.pi,
        subtype="ANGLE",
    )
    method: EnumProperty(
        name="Method",
        description="How names are found",
        items=(
            ("auto", "Automatic", "The best that the take and the marker set allow"),
            ("fit", "Body", "Fit the marker set's body to blobs, frame after frame"),
            ("ensemble", "Partial Solvers", "An ensemble of partial solvers, each frame of points on its own"),
            ("likelihood", "Likelihood", "How likely it is that points are markers, each frame on its own"),
        ),
    )
    target: FloatProperty(
        name="Sure",
        description="The part of the names that must be right; what is less sure by distances in space stays unnamed. "
        "Ghosts, another lab's markers or few people to learn from leave more wrong than is asked for",
        default=0.999,
        min=0.5,
        max=0.999999,
        precision=4,
        subtype="FACTOR",
    )
    occlusion: EnumProperty(
        name="Body in the Way",
        description="What asks whether the body hides a marker from a camera",
        items=(
            ("bvh", "Meshes", "Cast rays at meshes: those of the marker set's capsules, or your own character's"),
            ("capsules", "Capsules", "The marker set's capsules, in closed form"),
        ),
    )
    body: PointerProperty(
        name="Own Meshes",
        description="Let the meshes on this skeleton be the body in the way, such as your own character's; "
        "empty for those of the marker set's capsules",
        type=bpy.types.Object,
        poll=lambda _, item: item.type == "ARMATURE" and SCALE in item,
    )


class FolderSettings(bpy.types.PropertyGroup):
    """What Label Folder labels, and how."""

    path: StringProperty(
        name="Takes", description="The folder of the takes that Label Folder labels", subtype="DIR_PATH"
    )
    out: StringProperty(name="Results", description="The folder that Label Folder writes into", subtype="DIR_PATH")
    watch: BoolProperty(
        name="Watch", description="Go on with takes that still arrive in the folder, until it is stopped"
    )
    overwrite: BoolProperty(
        name="Overwrite",
        description="Replace results that were made of other files, by other settings or by another version",
    )
    jobs: IntProperty(
        name="Side by Side", description="Takes that are labelled at once, a core each", default=1, min=1, max=256
    )


class LiveSettings(bpy.types.PropertyGroup):
    """What is named while it is recorded."""

    source: StringProperty(
        name="Source",
        description="Where the stream comes from: qtm://HOST (Qualisys), natnet://HOST (OptiTrack) or vicon://HOST",
    )
    up: EnumProperty(
        name="Up",
        description="The axis that points up in the sender's world",
        items=[("AUTO", "As the Sender Says", "Y of Motive, which does not say")]
        + [(axis, axis.upper(), f"{axis.upper()} points up") for axis in AXIS_NAMES],
    )
    folder: StringProperty(
        name="Recordings", description="The folder that Record writes into, empty to watch only", subtype="DIR_PATH"
    )
    rig: live_rig()


class FillingSettings(bpy.types.PropertyGroup):
    """How gaps are filled and markers smoothed."""

    method: EnumProperty(
        name="Method",
        description="What gaps are filled by",
        items=(
            ("auto", "Automatic", "Learned, or the first of the others that is sure enough where it does not do"),
            ("regression", "Learned", "A regression on the neighbours, learned from the take"),
            ("rigid", "Rigid", "The body that the nearest markers make"),
            ("pattern", "Pattern", "The path of the neighbour that moves most alike"),
            ("pca", "PCA", "The principal components of the take"),
            ("body", "Body", "The chosen marker set's body, fitted to the markers that are there"),
            ("spline", "Spline", "A smooth curve between the ends, for short gaps"),
        ),
    )
    use_longest: BoolProperty(name="Longest", description="Leave gaps that are longer")
    longest: IntProperty(name="Longest", description="Frames of the longest gap that is filled", default=100, min=1)
    propose: BoolProperty(
        name="Preview", description="Show the fills dashed, in the view and the Graph Editor, before any is kept"
    )
    cutoff: FloatProperty(
        name="Cut-Off",
        description="What is faster is taken from the markers: 6 Hz is usual for walking, 10 to 20 Hz for sports",
        default=6.0,
        min=0.1,
        soft_max=50.0,
        precision=1,
    )


class DisplaySettings(bpy.types.PropertyGroup):
    """What is drawn over the views."""

    show_overlay: BoolProperty(
        name="Overlay", description="Draw blobs, the body's markers and links over the view", default=True
    )
    show_figure: BoolProperty(
        name="Figure",
        description="Draw a stick figure in the colours of the body's sides, and rings where markers are missing",
        default=True,
    )
    show_trails: BoolProperty(
        name="Trails", description="Draw where the selected markers were and will be, a second either way", default=True
    )
    show_names: BoolProperty(name="Names", description="Write the markers' names beside them", default=True)
    show_timeline: BoolProperty(
        name="Trajectories",
        description="Show every trajectory of the take as a row, over the channels of the Dope Sheet",
        update=_timeline_changed,
    )
    show_links: BoolProperty(
        name="Links", description="Through a camera, link each blob to where the body expects its marker", default=True
    )
    show_rays: BoolProperty(
        name="Rays",
        description="Draw the rays of all blobs of the frame, and the points in which they meet, named or not",
    )
    stage: EnumProperty(
        name="Stage",
        description="What the sidebar is for, once a take is labelled",
        items=(
            ("REVIEW", "Review", "Look at what may be wrong, and mend it"),
            ("USE", "Use It", "Move a rig by the take, and export it"),
        ),
    )


class SceneSettings(bpy.types.PropertyGroup):
    """The choices of one scene, by panel: `Scene.mocap_autolabel`."""

    source: PointerProperty(type=SourceSettings)
    subjects: PointerProperty(type=SubjectSettings)
    training: PointerProperty(type=TrainingSettings)
    labelling: PointerProperty(type=LabellingSettings)
    folder: PointerProperty(type=FolderSettings)
    live: PointerProperty(type=LiveSettings)
    filling: PointerProperty(type=FillingSettings)
    display: PointerProperty(type=DisplaySettings)
    take: PointerProperty(
        name="Take",
        description="The labelled take to review and export",
        type=bpy.types.Collection,
        poll=lambda _, collection: is_take(collection),
        update=_take_changed,
    )
    scope: EnumProperty(
        name="Frames", description="The frames in which the tool Label corrects names", items=SCOPES, default="WHOLE"
    )
    bone_names: EnumProperty(
        name="Bone Names",
        description="What the bones of the character are called, so that the rig that is to move finds them",
        items=(
            ("HUMANIK", "Mixamo, HumanIK", "Hips, Spine, LeftArm, LeftUpLeg: what most retargeting knows"),
            ("UNREAL", "Unreal", "pelvis, spine_01, upperarm_l, thigh_l: as Unreal's mannequin has them"),
            ("RIGIFY", "Rigify", "spine, upper_arm.L, thigh.L: as the human that comes with Blender has them"),
        ),
    )


class RigBoneRow(bpy.types.PropertyGroup):
    """The bone of a rig for a part of the body, by whose name the row is called."""

    bone: StringProperty(
        name="Bone",
        description="The bone of the rig that moves as this part of the body; or none",
        override={"LIBRARY_OVERRIDABLE"},
        update=follow_rigs_soon,
    )


@keeps_items
def _performer_items(_settings, context) -> list[tuple[str, str, str]]:
    take = context.scene.mocap_autolabel.take
    names = list(homes(take)) if is_take(take) else []
    return [(name, name, f"The motion of {name}") for name in names or ["-"]]


class RigSettings(bpy.types.PropertyGroup):
    """How the motion of takes comes onto a rig: `Object.mocap_autolabel`."""

    bones: CollectionProperty(type=RigBoneRow, override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"})
    performer: EnumProperty(
        name="Performer", description="Whose motion the rig gets", items=_performer_items, update=follow_rigs_soon
    )
    keep_feet: BoolProperty(
        name="Keep Feet",
        description="Bend the legs so that feet do not slide while they are planted",
        default=True,
        update=follow_rigs_soon,
    )
    keep_hands: BoolProperty(
        name="Keep Hands",
        description="Bend the arms so that hands are where the body's are, in a room as much larger as the rig's legs",
        update=follow_rigs_soon,
    )


class MarkerRow(bpy.types.PropertyGroup):
    """One marker in the review: the part of the frames in which it was found, its gaps, its mean residual in mm."""

    labelled: FloatProperty()
    gaps: IntProperty()
    longest_gap: IntProperty()
    first_gap: FloatProperty()
    residual: FloatProperty()


class TroubleRow(bpy.types.PropertyGroup):
    """One thing that is the matter with the take, as `core.review.trouble.Trouble`; `name` is what it is about."""

    kind: StringProperty()
    first: FloatProperty()
    last: FloatProperty()
    reason: StringProperty()
    stake: FloatProperty()
    answered: BoolProperty()


class ChangeRow(bpy.types.PropertyGroup):
    """One change that labelling again made; `name` is the marker."""

    first: FloatProperty()
    words: StringProperty()


class CorrectionRow(bpy.types.PropertyGroup):
    """One edit, called by what it says; `idle` is why it changes nothing, if so."""

    idle: StringProperty()


class GapRow(bpy.types.PropertyGroup):
    """A gap of a marker, called by that: filled, with the error to expect in mm, -1 if not known; or why it is not."""

    first: FloatProperty()
    last: FloatProperty()
    method: StringProperty()
    expected: FloatProperty()
    rests_on: StringProperty()
    reason: StringProperty()


class FolderTakeRow(bpy.types.PropertyGroup):
    """A take of a folder that is labelled in the background, as `io.batch.TakeRow`; `named` is -1 without any rows."""

    state: StringProperty()
    reason: StringProperty()
    measured: BoolProperty()
    trouble: IntProperty()
    stake: IntProperty()
    named: FloatProperty()
    on_body: IntProperty()
    found: FloatProperty()


class PickedPoint(bpy.types.PropertyGroup):
    """What is picked in the 3D view: the number of a trajectory, or a blob's row."""

    point: IntProperty()


class ReviewState(bpy.types.PropertyGroup):
    """The tables of the active take: `WindowManager.mocap_autolabel`; filled by `refresh_review`, never saved."""

    of_scene: IntProperty()  # whose take the tables are of, by its number in the session
    markers: CollectionProperty(type=MarkerRow)
    marker_index: chosen_row()
    corrections: CollectionProperty(type=CorrectionRow)
    correction_index: chosen_row()
    doubts: CollectionProperty(type=bpy.types.PropertyGroup)
    differences: CollectionProperty(type=bpy.types.PropertyGroup)
    candidate: StringProperty(name="Candidate", description="A marker set that waits to be adopted; empty for none")
    fills: CollectionProperty(type=GapRow)
    fill_index: chosen_row()
    proposed_fills: CollectionProperty(type=GapRow)
    proposed_fill_index: chosen_row()
    left_gaps: CollectionProperty(type=GapRow)
    left_gap_index: chosen_row()
    timeline_scroll: FloatProperty(
        name="Scroll", description="Rows of the trajectory timeline above the first that is seen", min=0.0
    )
    timeline_unfolded: BoolProperty(
        name="Short Ones Too",
        description="Give trajectories without a name that are shorter than a second a row each in the timeline",
        update=_timeline_changed,
    )
    doing: StringProperty(name="Doing", description="What is going on, and how long it will; empty where nothing is")
    share: FloatProperty(name="Done", description="How much of it is done", subtype="FACTOR", min=0.0, max=1.0)
    spent: FloatProperty(name="Spent", description="Seconds of work that would be lost by cancelling", min=0.0)
    about: StringProperty(name="About", description="The file that is refused, unsure, likely or crowded")
    crowded: StringProperty(name="Crowded", description="The marker set that more performers wear than are asked for")
    refused: StringProperty(name="Refused", description="Why nothing was named that can be named regardless")
    unsure: StringProperty(name="Unsure", description="Why Automatic found no marker set")
    likely: CollectionProperty(type=bpy.types.PropertyGroup)
    unfolded: BoolProperty(name="What Was Opened", description="Show what was opened, and how it is labelled")
    listed: EnumProperty(
        name="Listed",
        description="What of the take is listed",
        items=(
            ("TROUBLES", "To Look at", "What may be wrong, the worst first"),
            ("MARKERS", "Markers", "Every marker with its gaps and residual, the one that was found least first"),
            ("CORRECTIONS", "Corrections", "What a person said of the labels"),
            ("FILLS", "Gaps and Fills", "What gaps were filled with, and those that are left"),
            ("CHANGES", "Changes", "What labelling again changed"),
        ),
    )
    cancelled: BoolProperty(name="Cancel", description="Whether what is going on is to stop")
    folder_doing: StringProperty(name="Doing", description="How far Label Folder is; empty where it does not go on")
    folder_share: FloatProperty(name="Done", description="How much of it is done", subtype="FACTOR", min=0.0, max=1.0)
    folder_trouble: StringProperty(name="Trouble", description="Why Label Folder ended before its time")
    folder_results: StringProperty(name="Results", description="The folder that the listed takes lie in")
    folder_takes: CollectionProperty(type=FolderTakeRow)
    folder_take_index: chosen_row()
    changes: CollectionProperty(type=ChangeRow)
    change_index: chosen_row()
    troubles: CollectionProperty(type=TroubleRow)
    trouble_index: chosen_row()
    trouble_shown: StringProperty()
    trouble_followed: IntProperty(default=-1)  # the line that was chosen because something was picked, -1 for none
    trouble_left: IntProperty()  # the line that was chosen before
    trouble_done: EnumProperty(
        name="Answered",
        description="Whether what is answered is listed",
        items=(
            ("OPEN", "Open", "What nobody has answered yet"),
            ("DONE", "Done", "What was looked at and is right"),
            ("ALL", "Both", "What is open and what is done"),
        ),
    )
    picked: CollectionProperty(type=PickedPoint)
    picked_with: StringProperty()


def found_here(asked: SubjectSettings | PerformerRow) -> str:
    """The name or path of the marker set that Automatic found, where it is at hand: a file may name one that is not."""
    found = getattr(asked, "found", "")
    return found if not found.endswith(SUFFIX) or Path(found).is_file() else ""


def chosen_model(asked: SubjectSettings | PerformerRow) -> str:
    """The name or path of the marker set that is chosen for all, or for a performer; InputError without one."""
    if asked.markerset == AUTO_MODEL:
        if found := found_here(asked):
            return found
        raise InputError("Automatic finds what a take of one performer shows; expected a marker set from the list")
    if asked.markerset not in (OWN_FILE, ""):
        return asked.markerset
    if not asked.markerset:
        raise InputError("the marker set that was chosen is gone; expected one of those in the list")
    if not asked.markerset_path:
        raise InputError("no marker set is chosen; expected a *.markerset.json file")
    return bpy.path.abspath(asked.markerset_path)


def subjects_asked(subjects: SubjectSettings, model: str = "") -> dict:
    """Who is asked for, as fields of a job: `model`, `subjects` and `wearers`; InputError where that is not clear.

    A `model` is worn in place of the one that is chosen for all.
    """
    if subjects.performing != "LISTED":
        count = {"ONE": 1, "AUTO": AUTO}.get(subjects.performing, subjects.performer_count)
        if not model and subjects.markerset == AUTO_MODEL and count == 1:
            return anybody()
        return {"model": model or chosen_model(subjects), "subjects": count, "wearers": ()}
    rows = subjects.performers
    if not len(rows):
        raise InputError("nobody is in the list of performers; expected those who are asked for")
    if len(rows) > MAX_SUBJECTS:
        raise InputError(f"{len(rows)} performers are in the list; expected up to {MAX_SUBJECTS}")
    for row in rows:
        if not is_subject_name(row.name):
            raise InputError(f"{row.name[:60]!r} is no name of a performer; {NAME_RULE}")
    if len({as_compared(row.name) for row in rows}) < len(rows):
        raise InputError("two performers have the same name; expected a name for each")
    wearers = tuple((row.name, chosen_model(row)) for row in rows)
    return {"model": wearers[0][1], "subjects": 1, "wearers": wearers}


def anybody() -> dict:
    """The same for one who wears any of the marker sets that are known."""
    own = markerset_folder()
    return {"model": AUTO_MODEL, "own": own if own.is_dir() else None, "subjects": 1, "wearers": ()}


def row_of(subjects: SubjectSettings, name: str) -> SubjectSettings | PerformerRow:
    """Where the marker set of a performer is chosen: in the list, where the name is there, else for all."""
    listed = subjects.performers if subjects.performing == "LISTED" else ()
    return next((row for row in listed if row.name == name), subjects)


def colours_asked(subjects: SubjectSettings) -> dict[str, Colour]:
    """The colours of those who are asked for by name."""
    return {row.name: tuple(row.colour) for row in subjects.performers} if subjects.performing == "LISTED" else {}


def chosen_markerset(asked: SubjectSettings | PerformerRow):
    """The marker set that is chosen for all, or for a performer; InputError when there is none."""
    return open_markerset(chosen_model(asked))


def know_markerset(settings: SceneSettings, scene: bpy.types.Scene):
    """Notes what the active take was labelled by, where that is at hand and nothing is found, as found.

    Not where another take is opened.
    """
    if found_here(settings.subjects) or not is_take(settings.take):
        return
    if opened_file(settings.source) not in ("", settings.take[SOURCE]):
        return
    model, *others = {one.model for one in opened.take(settings.take, scene).performers}
    own = markerset_folder() / f"{model}{SUFFIX}"
    if not others and (model in builtin_markersets() or own.is_file()):
        settings.subjects.found = model if model in builtin_markersets() else str(own)


def wears_own(asked: SubjectSettings) -> bool:
    """Whether the marker set that is chosen, or that Automatic found, is one of the user's own."""
    chosen = found_here(asked) if asked.markerset == AUTO_MODEL else asked.markerset
    return chosen == OWN_FILE or chosen.endswith(SUFFIX)


def own_model(asked: SubjectSettings) -> str | None:
    """The path of the chosen marker set, where it is one of the user's own."""
    return chosen_model(asked) if wears_own(asked) else None


def choose_own(asked: SubjectSettings | PerformerRow, path: Path):
    """Makes a marker set file the chosen one, by its place in the list where it is in there."""
    listed = path.parent == markerset_folder() and path.exists()
    asked.markerset, asked.markerset_path = str(path) if listed else OWN_FILE, str(path)


def choose_model(asked: SubjectSettings | PerformerRow, model: str):
    """Makes a model the chosen one: a built-in one by its name, another by its path."""
    if model in builtin_markersets():
        asked.markerset = model
    else:
        choose_own(asked, Path(model))


def frames_wanted(labelling: LabellingSettings) -> tuple[int, int] | None:
    """First and last frame to label, None for all; InputError when there are none."""
    if not labelling.use_range:
        return None
    if labelling.range_last < labelling.range_first:
        words = f"frames {labelling.range_first} to {labelling.range_last} are none"
        raise InputError(f"{words}; expected the first before the last")
    return labelling.range_first, labelling.range_last


def opened_file(source: SourceSettings) -> str:
    """The file that is opened, as takes tell theirs; empty for none."""
    path = source.points_path or source.blobs_path
    return written(str(Path(bpy.path.abspath(path)))) if path else ""


def forget_told(state: "ReviewState", file: str):
    """Has the sidebar know of a file, and no more what it knew of another."""
    state.about, state.crowded, state.refused, state.unsure = file, "", "", ""
    state.likely.clear()


def is_opened(settings: SceneSettings) -> bool:
    """Whether the active take, which there is, is what was made of the opened file."""
    return opened_file(settings.source) == settings.take[SOURCE] != ""


def take_name(source: SourceSettings) -> str:
    """What the take is called: its file, without what says that it holds blobs."""
    name = Path(source.points_path or source.blobs_path).stem
    return written(name.removesuffix(".blobs").removesuffix("_blobs") or name)


def as_typed(number: float) -> float:
    """A setting as somebody typed it: of 0.999 and 59.94 Blender keeps 32 bits, which are other numbers in 64."""
    return float(str(np.float32(number)))


def scene_of_lists() -> bpy.types.Scene:
    """The scene whose take the tables are of where a window shows it, for a timer: to that the first window is all."""
    windows, number = bpy.context.window_manager.windows, bpy.context.window_manager.mocap_autolabel.of_scene
    return next((window.scene for window in windows if window.scene.session_uid == number), bpy.context.scene)


def refresh_review(manager: bpy.types.WindowManager, scene: bpy.types.Scene):
    """Fills the tables of the review from the scene's active take, or empties them; frames are Blender's."""
    state, collection = manager.mocap_autolabel, scene.mocap_autolabel.take
    if state.of_scene != scene.session_uid:  # a long list of trouble comes a moment later
        state.troubles.clear()
        state.left_gaps.clear()
    state.of_scene = scene.session_uid
    for editor in ("DOPESHEET_EDITOR", "GRAPH_EDITOR"):
        redraw(editor)
    if not is_take(collection):
        lists = state.markers, state.corrections, state.fills, state.proposed_fills, state.changes, state.troubles
        for rows in lists:
            rows.clear()
        return
    stored = opened.take(collection, scene)
    clock = stored.clock
    list_rows(state, "markers", "name labelled gaps longest_gap first_gap residual", marker_rows(stored))
    if is_quick(stored):
        list_trouble()
    else:
        soon(list_trouble, LATER)
    # In the frames that Blender counts, as the row beside it.
    changes = [(one, clock.whole(one.first), clock.whole(one.last)) for one in kept_changes(collection)]
    changed = [(one.marker, clock.shown(one.first), replace(one, first=a, last=b).words) for one, a, b in changes]
    list_rows(state, "changes", "name first words", changed)
    edits = zip(stored.edits, stored.outcomes, strict=True)
    rows = [(words_of(edit, clock.whole), counted_on(outcome.reason, clock.whole)) for edit, outcome in edits]
    list_rows(state, "corrections", "name idle", rows)
    list_fills(state, "fills", stored.fills, stored.unfit, clock)
    proposed = opened.proposed_of(collection, scene)
    list_fills(state, "proposed_fills", proposed, [""] * len(proposed), clock)


def list_fills(state: "ReviewState", listed: str, fills: Sequence[KeptFill], reasons: Sequence[str], clock: TakeClock):
    """Makes a list hold fills, and why each does not go with the take; frames are then Blender's."""
    rows = [
        (
            fill.marker,
            clock.shown(fill.first),
            clock.shown(fill.last),
            fill.method,
            why,
            resting_on(fill.ends),
            1000 * fill.expected if math.isfinite(fill.expected) else -1,
        )
        for fill, why in zip(fills, reasons, strict=True)
    ]
    list_rows(state, listed, "name first last method reason rests_on expected", rows)


def list_rows(state: "ReviewState", listed: str, names: str, values: Iterable[Sequence]):
    """Makes a list of the sidebar hold these rows: the values of the properties that are named.

    A row that is as it was stays chosen, wherever it is now; else the one in its place is. So do those that were.
    """
    rows, asked, stem = getattr(state, listed), names.split(), listed.removesuffix("s")
    noted = [name for name in map(f"{stem}_{{}}".format, ("index", "followed", "left")) if hasattr(state, name)]
    before = [[getattr(row, name) for name in asked] for row in rows]
    rows.clear()
    for row in values:
        item = rows.add()
        for name, value in zip(asked, row, strict=True):
            setattr(item, name, value)
    now = [[getattr(row, name) for name in asked] for row in rows]
    for name in noted:
        at = getattr(state, name)
        same = 0 <= at < len(before) and before[at] in now and before.count(before[at]) == 1
        setattr(state, name, now.index(before[at]) if same else min(at, max(len(rows) - 1, 0)))


def list_trouble():
    """Fills the list of what is the matter with the take that the tables are of; of a long one a moment later."""
    scene, state = scene_of_lists(), bpy.context.window_manager.mocap_autolabel
    collection = scene.mocap_autolabel.take
    if not is_take(collection):
        state.troubles.clear()
        return
    clock = opened.take(collection, scene).clock
    found = trouble_of(collection, scene)
    when = [(counted_on(one.reason, clock.whole), clock.shown(one.first), clock.shown(one.last)) for one in found]
    what = [(one.about, one.kind, one.stake, one.answered) for one in found]
    rows = [(*one, *other) for one, other in zip(when, what, strict=True)]
    list_rows(state, "troubles", "reason first last name kind stake answered", rows)
    redraw("VIEW_3D")
