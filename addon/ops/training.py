# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set of one's own from labelled takes: the takes are gathered in a list, then learned from."""

import glob
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import bpy
import numpy as np
from bpy.props import CollectionProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..core.data.errors import InputError
from ..core.data.takes import Points
from ..core.data.wording import count_of
from ..core.review.doubtful import doubtful_samples
from ..core.training.looked_at import learnable
from ..io.markersets import SUFFIX
from ..io.points import read_points, write_c3d
from ..io.text import written
from ..prefs import markerset_folder, taught_by
from ..props import ReviewState, SceneSettings, choose_own, chosen_markerset, chosen_model, own_model
from ..scene.stored import Stored
from .base import Ours, lacks_one_performer, lacks_take, remove_chosen, taken
from .importing import POINTS, ReadsPoints
from .stepping import WorksInSteps, beside

if TYPE_CHECKING:  # with all that can be learned, which nobody who starts waits for
    from ..jobs.train import TrainJob
    from ..jobs.training_takes import TakeFile


class MOCAP_AUTOLABEL_OT_add_training_takes(ReadsPoints, Ours, ImportHelper, bpy.types.Operator):
    """Choose labelled takes to learn from, C3D, TRC, Motive CSV or Qualisys QTM; one is enough to begin with."""

    bl_label = "Add Labelled Takes"

    filter_glob: StringProperty(default=POINTS, options={"HIDDEN"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})

    def work(self, context):
        takes = context.scene.mocap_autolabel.training.takes
        named = [Path(self.directory, file.name) for file in self.files if file.name]
        paths = [path for path in named or [Path(self.filepath)] if str(path) not in {row.path for row in takes}]
        counts = {path: _named_markers(path, self.known_up, self.rate or None) for path in paths}
        for path, count in counts.items():
            row = takes.add()
            row.name, row.path, row.markers, row.subject = path.name, str(path), count, path.resolve().parent.name
            row.up, row.rate = self.known_up or "", self.rate
        self.report({"INFO"}, f"{count_of(len(takes), 'take')} to learn from")


def _named_markers(path: Path, up: str | None, rate: float | None) -> int:
    count = sum(bool(name) for name in read_points(path, up=up, rate=rate).names)
    if not count:
        raise InputError("has no named markers; expected a labelled take", path)
    return count


class MOCAP_AUTOLABEL_OT_remove_training_take(Ours, bpy.types.Operator):
    """Learn without the take that is chosen in the list."""

    bl_label = "Remove Take from the List"

    @classmethod
    def lacks(cls, context):
        return "" if len(context.scene.mocap_autolabel.training.takes) else "No take is in the list"

    def work(self, context):
        remove_chosen(context.scene.mocap_autolabel.training, "takes")


class Trains(WorksInSteps):
    """What the trainings share: the marker set is chosen, and what is doubted of its takes is said."""

    doing = "Training"

    def _show(self, context, result: dict):
        settings, state = context.scene.mocap_autolabel, context.window_manager.mocap_autolabel
        choose_own(settings.subjects, Path(result["out"]))
        state.doubts.clear()
        for doubt in result["doubts"]:
            state.doubts.add().name = doubt
        show_differences(state, result)
        if state.candidate:
            words = f"{result['model']} is as it was: known takes are named worse. Look at it, and adopt it or not"
            self.report({"WARNING"}, words)
            return
        segments = len(result["body"]["segments"])
        again = f", {len(result['replaced'])} corrected takes replaced" if result["replaced"] else ""
        self.report({"INFO"}, f"{result['model']}: {len(result['markers'])} markers on {segments} segments{again}")


def show_differences(state: ReviewState, report: dict):
    """Fills the list of what training on changed in known takes; a model that waits to be adopted is remembered."""
    state.differences.clear()
    state.candidate = report["written"] if report["not_adopted_for"] else ""
    if not report["check"]:
        return
    from ..core.evaluation.comparing import difference_lines

    worse = dict.fromkeys([*report["check"]["worse"], *report["not_adopted_for"]])
    for words in [*difference_lines(report["check"]), *(f"Worse: {one}" for one in worse)]:
        state.differences.add().name = words


class MOCAP_AUTOLABEL_OT_adopt_model(Ours, bpy.types.Operator):
    """Use the marker set that was trained on although known takes are named worse; the former one is kept beside it."""

    bl_label = "Adopt All the Same"
    bl_options = {"REGISTER"}

    @classmethod
    def lacks(cls, context):
        return "" if context.window_manager.mocap_autolabel.candidate else "Train a marker set on first"

    def work(self, context):
        from ..jobs.models import adopt

        state = context.window_manager.mocap_autolabel
        out = adopt(Path(state.candidate))
        state.candidate = ""
        state.differences.clear()
        choose_own(context.scene.mocap_autolabel.subjects, out)
        self.report({"INFO"}, f"{out.name.removesuffix(SUFFIX)} is the one that was trained on")


class MOCAP_AUTOLABEL_OT_train(Trains, bpy.types.Operator):
    """Learn a marker set of your own from the labelled takes, save it and choose it."""

    bl_label = "Train"

    @classmethod
    def lacks(cls, context):
        takes = context.scene.mocap_autolabel.training.takes
        return "" if any(not row.kept for row in takes) else "Add labelled takes first"

    def steps(self, context):
        """The training."""
        return train_steps(context.scene.mocap_autolabel)


class MOCAP_AUTOLABEL_OT_learn_frame(Trains, bpy.types.Operator):
    """Learn a marker set of your own from the names in this frame: look first whether all of them are right."""

    bl_label = "Learn from This Frame"

    @classmethod
    def lacks(cls, context):
        words = lacks_take(context)
        return f"{words}, and put the names of one frame right" if words else lacks_one_performer(context)

    def steps(self, context):
        """The training."""
        scene = context.scene
        stored = taken(context)
        return learn_steps(scene.mocap_autolabel, named_in_frame(stored, scene.frame_current), stored.name)


class MOCAP_AUTOLABEL_OT_learn_take(Trains, bpy.types.Operator):
    """Learn from all of this take: names that you gave or answered, and those that nothing is asked about."""

    bl_label = "Learn from This Take"

    @classmethod
    def lacks(cls, context):
        words = lacks_take(context)
        return f"{words}, and correct it" if words else lacks_one_performer(context)

    def steps(self, context):
        """The training."""
        scene = context.scene
        stored = taken(context)
        return learn_take_steps(scene.mocap_autolabel, looked_at_of(stored))


def looked_at_of(stored: Stored) -> "TakeFile":
    """What of a take is worth learning, as a take of its file; InputError where that is nothing.

    What was filled or placed was not measured, and what is doubtful and nobody looked at may be wrong.
    """
    from ..jobs.training_takes import TakeFile, refuse_doubtful

    motion = stored.unfilled
    measured = np.where((motion.residual == 0)[..., None], np.nan, motion.markers)
    asked = doubtful_samples(
        stored.rows, stored.labels, motion, stored.suspects, stored.names, stored.rate, stored.edits, stored.words
    )
    learned = learnable(measured, asked, stored.names)
    refuse_doubtful(learned.xyz)
    source = Path(bpy.path.abspath(stored.source)) if stored.source else Path(stored.name)
    subject = written(source.resolve().parent.name) or "subject"
    return TakeFile(written(source.name), subject, stored.names, learned.xyz, learned.doubts, source)


def learn_take_steps(settings: SceneSettings, take: "TakeFile") -> Generator[float, None, dict]:
    """Trains on what was looked at of a take: an own marker set on from what it knows, else a new one.

    All markers of the take's set stay in it.
    """
    from ..jobs.train import TrainJob

    base, body = own_model(settings.subjects), chosen_model(settings.subjects)
    if set(take.names) != set(chosen_markerset(settings.subjects).markers):
        raise InputError("the chosen marker set is not the take's; expected the one that it was labelled by")
    name, out = (None, Path(base)) if base else _new_model(settings)
    job = TrainJob((), out, take.names, name, search="none", base=base, overwrite=bool(base), shown=(take,), body=body)
    return _trained(replace(job, by=_teacher()))


def named_in_frame(stored: Stored, frame: int) -> Points:
    """The named markers of a take in one of Blender's frames; InputError where there are none."""
    motion = stored.motion
    index = stored.source_frame(frame) - int(motion.frames[0])
    named = np.flatnonzero(np.isfinite(motion.markers[index, :, 0]))
    if not len(named):
        raise InputError(f"no marker is named in frame {frame}; expected one in which all are named and right")
    part = slice(index, index + 1), named
    names = tuple(stored.names[marker] for marker in named)
    return Points(names, motion.markers[part], motion.residual[part], stored.rate, int(motion.frames[index]))


def learn_steps(settings: SceneSettings, frame: Points, take: str) -> Generator[float, None, dict]:
    """Trains on one labelled frame of a take, as `train_steps` does on the takes in the list."""
    from ..jobs.train import TrainJob

    name, out = _new_model(settings)
    with TemporaryDirectory(prefix="mocap-autolabel-") as folder:
        # The model keeps the name of what it has learned from, and a take's name need not be one for files.
        path = Path(folder) / ("".join(letter if letter.isalnum() else "_" for letter in take) + ".c3d")
        write_c3d(path, frame)
        # Partial solvers, which no automatic choice of a method uses, would take minutes of waiting.
        job = TrainJob(takes=(path,), out=out, name=name, search="none", passing=True, by=_teacher())
        return (yield from _trained(job))


def train_steps(settings: SceneSettings) -> Generator[float, None, dict]:
    """Trains as the settings say, yielding how much is done (0 to 1); returns the report. InputError if they cannot."""
    from ..jobs.train import TrainJob  # with all that can be learned, which nobody who starts waits for
    from ..jobs.training_takes import KnownBetter

    base = own_model(settings.subjects) if settings.training.train_on else None
    name, out = (None, Path(base)) if base else _new_model(settings)
    rows = {Path(bpy.path.abspath(row.path)): row for row in settings.training.takes}
    learned = {path: row for path, row in rows.items() if not row.kept}
    known = {path: KnownBetter(row.up or None, row.rate or None) for path, row in rows.items()}
    job = TrainJob(
        takes=tuple(learned),
        out=out,
        name=name,
        subjects=tuple((row.subject, glob.escape(path.as_posix())) for path, row in learned.items() if row.subject),
        base=base,
        overwrite=bool(base),
        known=known,
        kept=tuple(path for path, row in rows.items() if row.kept),
        by=_teacher(),
    )
    return _trained(job)


def _teacher() -> str:
    """Who teaches the model, for its history."""
    from ..jobs.models import system_user

    return taught_by() or system_user()


def _trained(job: "TrainJob") -> Generator[float, None, dict]:
    """The training beside the window; returns its report."""
    from ..jobs.train import train_file

    return beside(train_file(job))


def _new_model(settings: SceneSettings) -> tuple[str, Path]:
    """The name of a marker set that is not there yet, and its file; InputError where it is, or is no name."""
    name = settings.training.trained_name.strip()
    if not name or Path(name).name != name:
        raise InputError(f"{name!r} is no name for a marker set; expected one such as ours")
    out = markerset_folder(create=True) / (name + SUFFIX)
    if out.exists():
        raise InputError("is there already; expected another name, or that marker set chosen and trained on", out)
    return name, out
