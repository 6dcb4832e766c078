# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set of one's own from labelled takes: the takes are gathered in a list, then learned from."""

import glob
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np
from bpy.props import CollectionProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..core.data.errors import InputError
from ..core.data.wording import count_of
from ..core.review.answering import doubtful_samples
from ..core.review.suspects import find_suspects
from ..core.training.takes import learnable
from ..io.markersets import SUFFIX
from ..io.points import read_points
from ..io.text import written
from ..prefs import markerset_folder, taught_by
from ..props import ReviewState, SceneSettings, choose_own, chosen_markerset, chosen_model, own_model
from ..scene.stored import Stored
from .base import Need, Ours, lacks_one_performer, lacks_take, operator, remove_chosen, taken, unless
from .importing import POINTS, ReadsPoints
from .long_work import LongWork

if TYPE_CHECKING:
    from ..jobs.train import TrainJob
    from ..jobs.training_takes import TakeFile


class MOCAP_AUTOLABEL_OT_add_training_takes(ReadsPoints, Ours, ImportHelper, bpy.types.Operator):
    """Choose labelled takes to learn from, C3D, TRC, TSV, QTM, Motive or Vicon CSV; one is enough to begin."""

    bl_label = "Add Labelled Takes"

    filter_glob: StringProperty(default=POINTS, options={"HIDDEN"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})

    def work(self, context):
        takes = context.scene.mocap_autolabel.training.takes
        named = [Path(self.directory, file.name) for file in self.files if file.name]
        paths = [path for path in named or [Path(self.filepath)] if str(path) not in {row.path for row in takes}]
        counts = {}
        for path in paths:
            known = {"up": self.known_up, "rate": self.rate or None}
            counts[path] = sum(bool(name) for name in read_points(path, **known).names)
            if not counts[path]:
                raise InputError("has no named markers; expected a labelled take", path)
        for path, count in counts.items():
            row = takes.add()
            row.name, row.path, row.markers, row.subject = path.name, str(path), count, path.resolve().parent.name
            row.up, row.rate = self.known_up or "", self.rate
        self.report({"INFO"}, f"{count_of(len(takes), 'take')} to learn from")


@operator(
    unless(lambda context: len(context.scene.mocap_autolabel.training.takes), "No take is in the list"),
    label="Remove Take from the List",
)
def remove_training_take(_self, context):
    """Learn without the take that is chosen in the list."""
    remove_chosen(context.scene.mocap_autolabel.training, "takes")


class Trains(LongWork):
    """What the trainings share: the marker set is chosen, and what is doubted of its takes is said.

    They differ in `job`, which says what to learn, and where to; UserError where nothing can be.
    """

    differs_in, doing, of_scene = "job", "Training", False

    def asked(self, context):
        """The training, with who teaches the model for its history."""
        from ..jobs.models import system_user
        from ..jobs.train import train_file  # with all that can be learned, which nobody who starts waits for

        job = replace(self.job(context, context.scene.mocap_autolabel), by=taught_by() or system_user())
        return partial(train_file, job)

    def _show(self, context, result: dict):
        settings, state = context.scene.mocap_autolabel, context.window_manager.mocap_autolabel
        if not self._astray:  # what another file uses is left alone
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
        again = f", {count_of(len(result['replaced']), 'corrected take')} replaced" if result["replaced"] else ""
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


@operator(
    unless(lambda context: context.window_manager.mocap_autolabel.candidate, "Train a marker set on first"),
    label="Adopt All the Same",
    options={"REGISTER"},
)
def adopt_model(self, context):
    """Use the marker set that was trained on although known takes are named worse; the former one is kept beside it."""
    from ..jobs.models import adopt

    state = context.window_manager.mocap_autolabel
    out = adopt(Path(state.candidate))
    state.candidate = ""
    state.differences.clear()
    choose_own(context.scene.mocap_autolabel.subjects, out)
    self.report({"INFO"}, f"{out.name.removesuffix(SUFFIX)} is the one that was trained on")


@operator(
    unless(
        lambda context: any(not row.kept for row in context.scene.mocap_autolabel.training.takes),
        "Add labelled takes first",
    ),
    of=Trains,
)
def train(_self, _context, settings) -> "TrainJob":
    """Learn a marker set of your own from the labelled takes, save it and choose it."""
    from ..jobs.training_takes import KnownBetter

    rows = {Path(bpy.path.abspath(row.path)): row for row in settings.training.takes}
    learned = {path: row for path, row in rows.items() if not row.kept}
    base = own_model(settings.subjects) if settings.training.train_on else None
    return replace(
        _new_job(settings, base),
        takes=tuple(learned),
        search=None,
        subjects=tuple((row.subject, glob.escape(path.as_posix())) for path, row in learned.items() if row.subject),
        known={path: KnownBetter(row.up or None, row.rate or None) for path, row in rows.items()},
        kept=tuple(path for path, row in rows.items() if row.kept),
    )


@operator(
    unless(
        lambda context: (source := context.scene.mocap_autolabel.source).points_path and source.named,
        "Open a take of 3D points whose file names them",
    ),
    of=Trains,
    label="Learn Its Markers",
)
def learn_file(_self, _context, settings) -> "TrainJob":
    """Learn a marker set of your own from the names in the file that is open, save it and choose it."""
    from ..jobs.training_takes import KnownBetter

    source = settings.source
    path = Path(bpy.path.abspath(source.points_path))
    known = {path: KnownBetter(source.up or None, source.rate)}
    return replace(_new_job(settings, name=path.stem), takes=(path,), known=known)


def _needs_take(first: str) -> tuple[Need, ...]:
    """What a training on the active take needs; `first` is what to do with a take once there is one."""
    return lambda context: (words := lacks_take(context)) and f"{words}, and {first}", lacks_one_performer


@operator(*_needs_take("put the names of one frame right"), of=Trains, label="Learn from This Frame")
def learn_frame(_self, context, settings) -> "TrainJob":
    """Learn a marker set of your own from the names in this frame: look first whether all of them are right."""
    stored, frame = taken(context), context.scene.frame_float
    index = stored.index_here(frame)
    named = np.flatnonzero(np.isfinite(stored.motion.markers[index, :, 0]))
    if not len(named):
        raise InputError(f"no marker is named in frame {frame:g}; expected one in which all are named and right")
    names = tuple(stored.names[marker] for marker in named)
    shown = _take_file(stored, names, stored.motion.markers[index : index + 1, named])
    return replace(_new_job(settings), shown=(shown,))


@operator(*_needs_take("correct it"), of=Trains, label="Learn from This Take")
def learn_take(_self, context, settings) -> "TrainJob":
    """Learn from all of this take: names that you gave or answered, and those that nothing is asked about."""
    # An own marker set goes on from what it knows, else a new one is made. All markers of the take's set stay in it.
    # What was filled or placed was not measured, and what is doubtful and nobody looked at may be wrong.
    from ..jobs.training_takes import refuse_doubtful

    stored = taken(context)
    motion, names, base = stored.unfilled, stored.names, own_model(settings.subjects)
    measured = np.where((motion.residual == 0)[..., None], np.nan, motion.markers)
    doubts, words = (find_suspects(motion, names, stored.rate), stored.suspects), stored.words
    asked = doubtful_samples(stored.rows, stored.labels, motion.frames, *doubts, names, stored.edits, words)
    learned, unsure = learnable(measured, asked, names)
    refuse_doubtful(learned)
    if set(names) != set(chosen_markerset(settings.subjects).markers):
        raise InputError("the chosen marker set is not the take's; expected the one that it was labelled by")
    shown, body = _take_file(stored, names, learned, unsure), chosen_model(settings.subjects)
    return replace(_new_job(settings, base), markers=names, shown=(shown,), body=body)


def _take_file(stored: Stored, names: tuple[str, ...], xyz: np.ndarray, doubts: Sequence[str] = ()) -> "TakeFile":
    """Places of some markers of a take, (F, M, 3) m, as a labelled take of its file."""
    from ..jobs.training_takes import TakeFile

    source = Path(bpy.path.abspath(stored.source)) if stored.source else Path(stored.name)
    subject = written(source.resolve().parent.name) or "subject"
    return TakeFile(written(source.name), subject, names, xyz, doubts, source)


def _new_job(settings: SceneSettings, base: str | None = None, name: str = "") -> "TrainJob":
    """A job that trains `base` on, or makes a marker set that is not there yet; InputError where it is, or is no name.

    It is called as the settings say, or `name`.

    It finds no partial solvers, which no automatic choice of a method uses and which would take minutes of waiting.
    """
    from ..jobs.train import TrainJob

    if base:
        return TrainJob((), Path(base), search="none", base=base, overwrite=True)
    name = name or settings.training.trained_name.strip()
    if not name or Path(name).name != name:
        raise InputError(f"{name!r} is no name for a marker set; expected one such as ours")
    out = markerset_folder(create=True) / (name + SUFFIX)
    if out.exists():
        raise InputError("is there already; expected another name, or that marker set chosen and trained on", out)
    return TrainJob((), out, name=name, search="none")
