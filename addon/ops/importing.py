# SPDX-License-Identifier: GPL-3.0-or-later
"""Open Take: whatever a take comes in, blobs and a calibration, 3D points, pictures or a folder, chosen or dropped."""

from contextlib import nullcontext, suppress
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..core.data.errors import InputError
from ..core.data.takes import Blobs, evenly_spread
from ..core.data.wording import count_of, listed, words_of_frames
from ..core.geometry.camera_up import AXIS_NAMES
from ..core.geometry.cameras import Cameras
from ..io.arrivals import TAKE_ENDINGS, Arrivals
from ..io.blobs import check_header, read_blobs
from ..io.cameras import calibration_files, read_cameras
from ..io.edits import edits_beside
from ..io.markersets import AUTO_MODEL, SUFFIX, open_markerset
from ..io.points import holds_points, read_points
from ..io.qtm.capture import USE_BLOBS, held_in, is_qtm
from ..jobs.job import blob_rate, capture_notes
from ..props import choose_own, forget_told, opened_file, refresh_review
from ..scene import cameras as scene_cameras
from ..scene.clock import TakeClock, fps_of, plays_at
from ..scene.later import soon
from ..scene.opened import opened
from ..scene.preview import remove_preview, show_points, store_preview
from ..scene.roots import in_world
from ..scene.take import is_take
from ..scene.timing import OWN_FIRST, follow_rate, give_time, is_free, kept_clock, set_time
from .base import Ours, once, operator, reason_of, unless
from .viewing import MAX_PLACES, fit_timelines, open_sidebar, show_take_whole

BLOBS, POINTS = "*.csv;*.qtm", "*.c3d;*.trc;*.tsv;*.csv;*.qtm"
UP_ITEMS = [("AUTO", "As the File Says", "Or, where it does not say, as what is in it tells")] + [
    (axis, axis.upper(), f"{axis.upper()} points up in the file") for axis in AXIS_NAMES
]
CALIBRATIONS = ".toml;.xcp;.txt;.xml;.qca;.qtm;.mcal;.yml;.yaml;.cal;.rad;.blend"
USE_ITEMS = [
    ("AUTO", "Blobs if They Can Be Used", "The blobs where their cameras are calibrated, else the 3D points"),
    ("blobs", "Blobs", "What the cameras saw"),
    ("points", "3D Points", "What the capture program made of it; its names are not looked at"),
]


LOOK_AGAIN = 1.0  # s, after which is asked again whether what goes on is done
NEEDS_CAMERA = unless(
    lambda context: any(item.type == "CAMERA" for item in context.scene.objects), "This scene has no cameras"
)


AT_1 = once(BoolProperty, "Start with the Scene", "Begin at the scene's first frame, and not at the number in the file")


class ImportsFile(Ours, ImportHelper):
    """What the imports share: a file that was dropped, or named by a script, is read at once; else one is asked for.

    They differ in `take_in`, which makes a file part of the scene and says what is in it; UserError if it cannot.
    """

    differs_in = "take_in"

    filepath: once(StringProperty, "File", "The file to read", subtype="FILE_PATH")

    def invoke(self, context, event):
        if self.properties.is_property_set("filepath"):
            return self.execute(context)
        return ImportHelper.invoke(self, context, event)

    def work(self, context):
        self.report({"INFO"}, self.take_in(context, Path(self.filepath)))


@operator(
    of=ImportsFile,
    label="Import Calibration",
    filter_glob=StringProperty(default=CALIBRATIONS.replace(".", "*."), options={"HIDDEN"}, maxlen=255),
    up=once(EnumProperty, "Up", "The axis that points up in the calibration", items=UP_ITEMS),
)
def import_cameras(self, context, path: Path) -> str:
    """Read a camera calibration and add its cameras to the scene."""
    return take_cameras(context, path, None if self.up == "AUTO" else self.up)


def take_cameras(context: bpy.types.Context, path: Path, up: str | None = None) -> str:
    """Makes a calibration's cameras the scene's and says which; InputError where it cannot be used."""
    cameras = read_cameras(path, read_blend=scene_cameras.cameras_of_blend, up=up)
    context.scene.mocap_autolabel.source.cameras = scene_cameras.find_or_add_cameras(context.scene, cameras)
    return "; ".join([f"{count_of(len(cameras), 'camera')}: {', '.join(cameras.names)}", *cameras.remarks])


@operator(NEEDS_CAMERA, label="Use the Scene's Cameras")
def use_cameras(self, context):
    """Take the cameras of this scene as they stand for the ones that recorded the take."""
    collection = scene_cameras.adopt_cameras(context.scene)
    context.scene.mocap_autolabel.source.cameras = collection
    self.report({"INFO"}, count_of(len(collection.objects), "camera"))


@operator(of=ImportsFile, filter_glob=StringProperty(default=BLOBS, options={"HIDDEN"}))
def import_blobs(_self, context, path: Path) -> str:
    """Choose the file of the blobs to label, and look at them through the cameras, which a .qtm brings itself."""
    if holds_points(path, USE_BLOBS if is_qtm(path) else None):
        raise InputError("holds 3D points; expected blobs, or Open Take", path)
    return take_blobs(context, path)


class ReadsPoints:
    """What is asked of whoever reads 3D points: what is known of them better than from their file."""

    at_1: AT_1
    up: once(EnumProperty, "Up", "The axis that points up in the 3D points", items=UP_ITEMS)
    rate: once(
        FloatProperty,
        "Rate",
        "Frames a second of 3D points whose file says none; 0 where it does",
        min=0.0,
        max=100_000.0,
    )

    mirror: once(
        BoolProperty,
        "Mirror",
        "Reverse an axis of 3D points whose axes are left-handed: left and right are exchanged in them",
    )

    @property
    def known_up(self) -> str | None:
        """The axis that was chosen, None for what the file says or tells."""
        return None if self.up == UP_ITEMS[0][0] else self.up


class MOCAP_AUTOLABEL_OT_import_points(ReadsPoints, ImportsFile, bpy.types.Operator):
    """Choose a take of 3D points to label, C3D, TRC, Motive or Vicon CSV, Qualisys TSV or QTM. Needs no cameras."""

    bl_label = "Import 3D Points"
    filter_glob: StringProperty(default=POINTS, options={"HIDDEN"})

    def take_in(self, context, path: Path) -> str:
        return take_points(context, path, self.known_up, self.rate, self.mirror, self.at_1)


class MOCAP_AUTOLABEL_OT_import_take(ReadsPoints, ImportsFile, bpy.types.Operator):
    """Open a take: 3D points, or blobs or pictures with the calibration of their cameras; or a folder of takes."""

    bl_label = "Open Take"
    directory: StringProperty(subtype="DIR_PATH", options={"SKIP_SAVE", "HIDDEN"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE", "HIDDEN"})
    use: once(EnumProperty, "Use", "What to label of a .qtm that holds both", items=USE_ITEMS)

    def draw(self, context):
        """What can be said of the file that is chosen, which hardly ever has to be."""
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(self, "at_1")
        layout.label(text="Only where the file is wrong:")
        for name in ("up", "rate", "mirror", *(("use",) if is_qtm(Path(self.filepath)) else ())):
            layout.prop(self, name)

    def work(self, context):
        folder = Path(bpy.path.abspath(self.directory))
        chosen = [folder / item.name for item in self.files if item.name]
        chosen = chosen or [Path(bpy.path.abspath(self.filepath or self.directory))]
        whole = len(chosen) == 1 and chosen[0].is_dir()
        of: dict[str, list[Path]] = {}
        for path in _inside(chosen[0]) if whole else chosen:
            of.setdefault(_kind_of(path), []).append(path)
        takes = of.get(IS_TAKE, ())
        if len(takes) > 1 and not whole:
            raise InputError(f"{len(takes)} takes are chosen; expected one, or their folder", takes[1])
        said, calibrated = _take_beside(context, of, whole)
        points = False
        if not (said or takes or IS_PICTURES in of):
            raise InputError(f"holds no take; {KNOWN}", chosen[0])
        if len(takes) > 1:
            said.append(_take_folder(context, chosen[0], len(takes)))
            points = calibrated and not any(is_qtm(path) or not holds_points(path) for path in takes)
        elif takes:
            said.append(self.take_in(context, takes[0]))
            points = bool(context.scene.mocap_autolabel.source.points_path)
        if calibrated and points:
            said.append("the calibration is not looked at for 3D points")
        self.report({"INFO"}, "; ".join(said))
        open_sidebar(context)
        if len(takes) == 1:
            look_who_is_there(context)
        return self._find_blobs(context, of[IS_PICTURES]) if IS_PICTURES in of and not takes else {"FINISHED"}

    def _find_blobs(self, context, pictures: list[Path]) -> set[str]:
        """Has blobs found in pictures, or in those of a folder, which goes on for a while."""
        if not cameras_at_hand(context.scene):
            words = "holds pictures, which need the calibration of their cameras; expected that to be chosen with them"
            raise InputError(words, pictures[0])
        inside = len(pictures) == 1 and pictures[0].is_dir()
        where, files = pictures[0] if inside else pictures[0].parent, [] if inside else pictures
        given = {"directory": str(where), "files": [{"name": path.name} for path in files], "at_1": self.at_1}
        try:
            bpy.ops.mocap_autolabel.find_blobs("INVOKE_DEFAULT", **given)
        except RuntimeError as error:
            self.report({"ERROR"}, reason_of(error))
            return {"CANCELLED"}
        return {"FINISHED"}

    def take_in(self, context, path: Path) -> str:
        if holds_points(path, self.use if is_qtm(path) and self.use != USE_ITEMS[0][0] else None):
            return take_points(context, path, self.known_up, self.rate, self.mirror, self.at_1)
        return take_blobs(context, path, self.at_1)


IS_TAKE, IS_CALIBRATION, IS_MARKERSET, IS_PICTURES = "take", "calibration", "marker set", "pictures"
KNOWN = "expected 3D points, blobs, a calibration, a marker set, pictures of calibrated cameras, or a folder of them"


def _kind_of(path: Path) -> str:
    """What a file is; InputError where it is none of these."""
    suffix = path.suffix.lower()
    if path.name.endswith(SUFFIX):
        return IS_MARKERSET
    if suffix in TAKE_ENDINGS:
        return IS_TAKE
    if suffix in CALIBRATIONS.split(";"):
        return IS_CALIBRATION
    if path.is_dir() or suffix in (*bpy.path.extensions_movie, *bpy.path.extensions_image):
        return IS_PICTURES
    raise InputError(f"is of a kind that is not known ({suffix or 'no suffix'}); {KNOWN}", path)


def _inside(folder: Path) -> list[Path]:
    """What a folder is opened for: its takes, itself where it holds pictures, and what may be its calibration."""
    found, inside = Arrivals([folder], settled_s=0.0).look(0.0), sorted(folder.iterdir())
    if not found and any(path.is_dir() or path.suffix.lower() in bpy.path.extensions_movie for path in inside):
        found = [folder]
    endings = {*CALIBRATIONS.split(";")} - {*TAKE_ENDINGS, ".blend"}
    return [*found, *(path for path in inside if path.suffix.lower() in endings)]


def _take_beside(context: bpy.types.Context, of: dict[str, list[Path]], whole: bool) -> tuple[list[str], bool]:
    """Takes in the marker set and the calibration that were chosen; gives what is in them, and whether that was read.

    Of a `whole` folder that is the first that is a calibration.
    """
    said, read = [], set()
    for path in of.get(IS_MARKERSET, ()):
        said.append(f"{path.name}: {count_of(len(open_markerset(path)), 'marker')}")
        choose_own(context.scene.mocap_autolabel.subjects, path)
    for path in of.get(IS_CALIBRATION, ()):
        if path in read:  # one may be in several files
            continue
        with suppress(InputError) if whole else nullcontext():
            said.append(take_cameras(context, path))
            read.update(calibration_files(path))
            if whole:
                break
    return said, bool(read)


def _take_folder(context: bpy.types.Context, folder: Path, count: int) -> str:
    """Makes a folder of several takes the one that Label Folder labels."""
    own = context.scene.mocap_autolabel.folder
    forget_take(context)
    same = not own.path or Path(bpy.path.abspath(own.path)) == folder
    own.path, own.out = str(folder), own.out if own.out and same else str(folder / "labelled")
    return f"{count_of(count, 'take')} in {folder.name}"


def look_who_is_there(context: bpy.types.Context):
    """Has the marker set of the take found, in the window and where none was chosen; a script labels at once."""
    subjects, find = context.scene.mocap_autolabel.subjects, bpy.ops.mocap_autolabel.find_markerset
    if bpy.app.background or subjects.markerset != AUTO_MODEL or subjects.performing == "LISTED":
        return
    if context.window_manager.mocap_autolabel.doing:
        _waiting[:] = [context.scene.session_uid]
        soon(look_when_free, LOOK_AGAIN)
    elif find.poll():
        with suppress(RuntimeError):  # Label says the same
            find("INVOKE_DEFAULT")


_waiting: list[int] = []  # the scene in which a take was opened while something went on


def look_when_free() -> float | None:
    """Looks at what was opened while something went on, once that is done; Label may have looked meanwhile; a timer."""
    manager = bpy.context.window_manager
    if manager.mocap_autolabel.doing:
        return LOOK_AGAIN
    window = next((window for window in manager.windows if window.scene.session_uid in _waiting), None)
    if window is not None:
        settings = window.scene.mocap_autolabel
        if opened_file(settings.source) and not settings.subjects.found:
            with bpy.context.temp_override(window=window):
                look_who_is_there(bpy.context)
    return None


def take_blobs(context: bpy.types.Context, path: Path, at_1: bool = False) -> str:
    """Makes a file of blobs the scene's take and says what is in it; InputError where it cannot be used.

    `at_1`, the take begins with the scene.
    """
    scene, source = context.scene, context.scene.mocap_autolabel.source
    cameras, own = _cameras_for(scene, path)
    blobs = Blobs.join(part.blobs for part in read_blobs(path, cameras))
    _check_frames(blobs.frames, path)
    forget_take(context)
    if own:
        source.cameras = scene_cameras.find_or_add_cameras(scene, cameras)
    source.rate = blob_rate(path, None) or source.rate
    kept, clock = _set_frames(context, blobs.frames, at_1)
    source.preview = store_preview(scene, path.stem, blobs, cameras, source.rate, clock)
    source.blobs_path, source.blob_count = str(path), len(blobs)
    fit_timelines(context)
    summary = f"{count_of(len(blobs), 'blob')} in {count_of(len(blobs.frames), 'frame')}"
    return "; ".join([summary, *kept, *(cameras.remarks if own else ()), *capture_notes(path, False, cameras)])


def _cameras_for(scene: bpy.types.Scene, path: Path) -> tuple[Cameras, bool]:
    """The cameras that a file of blobs is looked at through, and whether they are its own; InputError for none.

    Those of the scene count where they are the file's: somebody may have refined them.
    """
    chosen = scene_cameras.cameras_of(scene.mocap_autolabel.source.cameras, scene) if cameras_at_hand(scene) else None
    if is_qtm(path):
        own = held_in(path).calibrated
        if chosen is None or (own and not set(own) <= set(chosen.names)):
            return read_cameras(path), True
    if chosen is None:
        check_header(path)
        words = "holds blobs, which need the calibration of their cameras"
        raise InputError(f"{words}; expected both to be opened at once, or that first", path)
    return chosen, False


def take_points(
    context: bpy.types.Context,
    path: Path,
    up: str | None = None,
    rate: float = 0.0,
    mirror: bool = False,
    at_1: bool = False,
) -> str:
    """Makes a file of 3D points the scene's take and says what is in it; InputError where it cannot be used.

    `up` is the axis that points up in it where the user knows, `rate` is used where the file says none;
    `mirror` reverses an axis of one whose axes are left-handed; `at_1`, the take begins with the scene.
    """
    source, take = context.scene.mocap_autolabel.source, read_points(path, up=up, rate=rate or None, mirror=mirror)
    frames = take.first_frame + np.arange(len(take.xyz))
    _check_frames(frames, path)
    forget_take(context)
    source.rate = take.rate
    kept, clock = _set_frames(context, frames, at_1)
    source.preview = show_points(context.scene, path.stem, take, clock)
    source.points_path, source.blob_count = str(path), len(source.preview.vertices)
    source.up, source.up_found, source.mirror = up or "", take.up.removeprefix("+"), mirror
    source.trajectories, source.named = len(take.names), sum(map(bool, take.names))
    some = take.xyz[evenly_spread(len(take.xyz), MAX_PLACES)].reshape(-1, 3)
    show_take_whole(context, in_world(source.preview, some))
    edits = edits_beside(path)
    more = [] if edits is None else [f"{edits.name} beside it will be applied"]
    summary = f"{count_of(source.trajectories, 'trajectory')} in {count_of(len(take.xyz), 'frame')}"
    return "; ".join([summary, *kept, *take.notes, *more, *capture_notes(path, True)])


def forget_take(context: bpy.types.Context):
    """Makes room for another take; one that is labelled stays in the scene."""
    settings = context.scene.mocap_autolabel
    settings.take = None
    if settings.source.preview is not None:
        preview, settings.source.preview = settings.source.preview, None
        remove_preview(preview)
        opened.forget_read()
    settings.source.blobs_path = settings.source.points_path = ""
    settings.source.forced = False
    forget_found(context)
    refresh_review(context.window_manager, context.scene)


@operator(unless(lambda context: opened_file(context.scene.mocap_autolabel.source), "No take is open"))
def close_take(_self, context):
    """Close the take that is open; its file, its cameras and what is labelled stay."""
    forget_take(context)


def forget_found(context: bpy.types.Context):
    """Forgets what Automatic found, of another take or as the file was read otherwise."""
    settings = context.scene.mocap_autolabel
    settings.subjects.found = ""
    forget_told(context.window_manager.mocap_autolabel, opened_file(settings.source))


def _check_frames(frames: np.ndarray, path: Path):
    """Raises InputError where a frame is past Blender's whole numbers, before what is open gives way to the file."""
    whole = np.iinfo(np.int32)
    if frames[0] < whole.min:
        raise InputError(f"begins at frame {frames[0]}; expected frame numbers from {whole.min} on", path)
    if frames[-1] > whole.max:
        raise InputError(f"goes on to frame {frames[-1]}; expected frame numbers up to {whole.max}", path)


def _set_frames(context: bpy.types.Context, frames: np.ndarray, at_1: bool) -> tuple[list[str], TakeClock]:
    """Notes the frames of the take and has the scene play them; what there is to say where it does not, and when."""
    scene, words = context.scene, []
    source, labelling = scene.mocap_autolabel.source, scene.mocap_autolabel.labelling
    source.first_frame, source.last_frame, source.at_1 = int(frames[0]), int(frames[-1]), at_1
    labelling.range_first, labelling.range_last = source.first_frame, source.last_frame
    begin = 1 if is_free(scene) else scene.frame_start
    clock = give_time(scene, source.rate, frames, TakeClock.of(frames, begin if at_1 else None))
    if not plays_at(scene, source.rate):
        how = "the take is mapped to them" if clock.step != 1 else "the take plays frame by frame"
        words.append(f"the scene keeps its {fps_of(scene):g} frames a second, and {how}")
    first, last = clock.whole(source.first_frame), clock.whole(source.last_frame)
    if last < scene.frame_start or scene.frame_end < first:
        words.append(
            f"it is at {words_of_frames(first, last)}, and the scene keeps its own, from {scene.frame_start} on"
        )
    return words, clock


def clock_of(source: bpy.types.PropertyGroup) -> TakeClock:
    """When the take plays that is opened: as it is shown, else from which of the scene's frames on."""
    if source.preview is not None and OWN_FIRST in source.preview:
        return kept_clock(source.preview, source.first_frame)
    return TakeClock.of(np.array([source.first_frame, source.last_frame]), 1 if source.at_1 else None)


@operator(label="Play as the Take")
def play_as_take(self, context):
    """Give the scene the take's rate, so that each frame is one of the take; what you animated keeps its frames."""
    scene, settings = context.scene, context.scene.mocap_autolabel
    if is_take(settings.take):
        stored = opened.take(settings.take, scene)
        rate, frames = stored.rate, stored.motion.frames + stored.clock.shift
    else:
        rate, ends = settings.source.rate, [settings.source.first_frame, settings.source.last_frame]
        frames = np.array(ends) + clock_of(settings.source).shift
    tell_left(self, context, set_time(scene, rate, frames))


class MOCAP_AUTOLABEL_OT_follow_rate(Ours, bpy.types.Operator):
    """Let takes, and rigs and characters that move by them, play at their own speed at the rate that the scene has."""

    bl_label = "Follow the Scene's Rate"

    def work(self, context):
        tell_left(self, context, follow_rate(context.scene))


def tell_left(operator: bpy.types.Operator, context: bpy.types.Context, left: list[str]):
    """Says what did not follow another rate, and fills the lists, whose frames are others now."""
    refresh_review(context.window_manager, context.scene)
    if left:
        operator.report({"WARNING"}, f"The old rate is kept by {listed(left)}: keys were changed, linked or too near")


class MOCAP_AUTOLABEL_FH_take(bpy.types.FileHandler):
    """Drop a take, its calibration or both into the 3D view; what a `.csv` holds is told from its first line."""

    bl_label = "Mocap: take to label"
    bl_import_operator = "mocap_autolabel.import_take"
    bl_file_extensions = ".csv;.c3d;.trc;.tsv;" + CALIBRATIONS.removesuffix(";.blend")

    @classmethod
    def poll_drop(cls, context):
        return context.area is not None and context.area.type == "VIEW_3D"


def cameras_at_hand(scene: bpy.types.Scene) -> bool:
    """True when the scene's settings name cameras that are still there."""
    collection = scene.mocap_autolabel.source.cameras
    return collection is not None and any(item.type == "CAMERA" for item in collection.all_objects)


lacks_cameras = unless(lambda context: cameras_at_hand(context.scene), "Open the calibration of the cameras first")
