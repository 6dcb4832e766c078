# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set of one's own from labelled takes: the takes are gathered in a list, then learned from."""

import glob
from collections.abc import Generator
from pathlib import Path

import bpy
from bpy.props import CollectionProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..core.data.background import drained, in_background
from ..core.data.errors import InputError
from ..io.markersets import SUFFIX
from ..io.points import read_points
from ..prefs import markerset_folder
from ..props import SceneSettings, choose_own, own_model
from .importing import POINTS, ReadsPoints
from .reporting import reports_trouble
from .stepping import WorksInSteps


class MOCAP_AUTOLABEL_OT_add_lessons(ReadsPoints, bpy.types.Operator, ImportHelper):
    """Choose labelled takes to learn from, C3D, TRC or Motive CSV; one is enough to begin with."""

    bl_idname = "mocap_autolabel.add_lessons"
    bl_label = "Add Labelled Takes"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default=POINTS, options={"HIDDEN"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})

    @reports_trouble
    def execute(self, context):
        lessons = context.scene.mocap_autolabel.lessons
        named = [Path(self.directory, file.name) for file in self.files if file.name]
        paths = [path for path in named or [Path(self.filepath)] if str(path) not in {row.path for row in lessons}]
        counts = {path: _named_markers(path, self.known_up, self.rate or None) for path in paths}
        for path, count in counts.items():
            row = lessons.add()
            row.name, row.path, row.markers, row.subject = path.name, str(path), count, path.resolve().parent.name
            row.up, row.rate = self.known_up or "", self.rate
        self.report({"INFO"}, f"{len(lessons)} takes to learn from")
        return {"FINISHED"}


def _named_markers(path: Path, up: str | None, rate: float | None) -> int:
    count = sum(bool(name) for name in read_points(path, up=up, rate=rate).names)
    if not count:
        raise InputError("has no named markers; expected a labelled take", path)
    return count


class MOCAP_AUTOLABEL_OT_remove_lesson(bpy.types.Operator):
    """Learn without the take that is chosen in the list."""

    bl_idname = "mocap_autolabel.remove_lesson"
    bl_label = "Remove Take from the List"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        settings = context.scene.mocap_autolabel
        return settings.lesson_index < len(settings.lessons)

    def execute(self, context):
        settings = context.scene.mocap_autolabel
        settings.lessons.remove(settings.lesson_index)
        settings.lesson_index = max(min(settings.lesson_index, len(settings.lessons) - 1), 0)
        return {"FINISHED"}


class MOCAP_AUTOLABEL_OT_train(WorksInSteps, bpy.types.Operator):
    """Learn a marker set of your own from the labelled takes, save it and choose it."""

    bl_idname = "mocap_autolabel.train"
    bl_label = "Train"
    bl_options = {"REGISTER", "UNDO"}

    doing = "Training"

    @classmethod
    def poll(cls, context):
        if len(context.scene.mocap_autolabel.lessons):
            return True
        cls.poll_message_set("Add labelled takes first")
        return False

    def steps(self, context):
        """The training."""
        return train_steps(context.scene.mocap_autolabel)

    def _show(self, context, result: dict) -> set[str]:
        settings, doubts = context.scene.mocap_autolabel, context.window_manager.mocap_autolabel.doubts
        choose_own(settings, Path(result["out"]))
        doubts.clear()
        for doubt in result["doubts"]:
            doubts.add().name = doubt
        segments = len(result["body"]["segments"])
        again = f", {len(result['replaced'])} corrected takes replaced" if result["replaced"] else ""
        self.report({"INFO"}, f"{result['model']}: {len(result['markers'])} markers on {segments} segments{again}")
        return {"FINISHED"}


def train_steps(settings: SceneSettings) -> Generator[float, None, dict]:
    """Trains as the settings say, yielding how much is done (0 to 1); returns the report. InputError if they cannot."""
    from ..jobs.train import TrainJob, train_file  # with all that can be learned, which nobody who starts waits for
    from ..jobs.training_takes import KnownBetter

    base = own_model(settings) if settings.train_on else None
    name = settings.trained_name.strip()
    if not name or Path(name).name != name:
        raise InputError(f"{name!r} is no name for a marker set; expected one such as ours")
    out = Path(base) if base else markerset_folder(create=True) / (name + SUFFIX)
    if out.exists() and not base:
        raise InputError("is there already; expected another name, or that marker set chosen and trained on", out)
    takes = {Path(bpy.path.abspath(row.path)): row.subject for row in settings.lessons}
    known = {
        Path(bpy.path.abspath(row.path)): KnownBetter(row.up or None, row.rate or None) for row in settings.lessons
    }
    job = TrainJob(
        takes=tuple(takes),
        out=out,
        name=None if base else name,
        subjects=tuple((subject, glob.escape(path.as_posix())) for path, subject in takes.items() if subject),
        base=base,
        overwrite=bool(base),
        known=known,
    )
    return in_background(lambda tell: drained(train_file(job), tell))


CLASSES = (MOCAP_AUTOLABEL_OT_add_lessons, MOCAP_AUTOLABEL_OT_remove_lesson, MOCAP_AUTOLABEL_OT_train)
