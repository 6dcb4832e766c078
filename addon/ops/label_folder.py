# SPDX-License-Identifier: GPL-3.0-or-later
"""Label Folder: the command line's batch in a process of its own, followed by its table while Blender is used."""

import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import bpy
from bpy.props import IntProperty

from ..core.data.errors import InputError, UserError
from ..core.geometry.cameras import Cameras
from ..core.points.several.wearers import AUTO
from ..io.batch import FAILING, TakeRow, read_table
from ..io.cameras import write_cameras
from ..io.scratch import naming_scratch, scratch_folder
from ..io.text import written
from ..jobs.pages import SUMMARY_TABLE
from ..props import SceneSettings, as_typed, list_rows, subjects_asked
from ..scene import cameras as scene_cameras
from ..scene.later import redraw
from .base import Ours, operator, unless
from .importing import cameras_at_hand
from .labelling import in_sidebar

FOLLOWED_EVERY = 0.5  # s between two looks at what the process wrote


class FolderBatch:
    """A folder that is labelled by a process of its own; it ends with Blender, however that ends.

    goes_on  whether its process has work
    rows     what became of the takes so far, the worst first
    trouble  why it ended before its time, None where it did not
    """

    def __init__(self, line: list[str], table: Path, cameras: Cameras | None):
        """Starts it with a command line, to which the `cameras` are added; JobError where there can be no process."""
        from ..cli import main
        from ..cli.workers import Worker

        self.table, self.stopping, self.goes_on = table, False, True
        self.rows: list[TakeRow] = []
        self.trouble: UserError | None = None
        self._seen: int | None = None
        with ExitStack() as stack:
            scratch = stack.enter_context(scratch_folder())
            if cameras is not None:
                with naming_scratch(scratch):
                    write_cameras(scratch / "cameras.toml", cameras)
                line = [line[0], f"--cameras={scratch / 'cameras.toml'}", *line[1:]]
            self._worker = Worker(scratch)
            stack.callback(self._worker.close)
            self._kept = stack.pop_all()
        self._worker.hand(partial(main, line))

    def look(self):
        """Takes in what is new."""
        answer = self._worker.look()
        try:
            changed = self.table.stat().st_mtime_ns
            if changed != self._seen:
                self.rows, self._seen = read_table(self.table), changed
        except (OSError, UserError):  # not there yet
            pass
        if answer is None:
            return
        self.leave()
        if isinstance(answer, UserError) and not self.stopping and not any(row.state == FAILING for row in self.rows):
            self.trouble = answer

    def stop(self):
        """Lets it end, which it does in a moment; nothing half-written stays."""
        self.stopping = True
        self._worker.close()

    def leave(self):
        """Lets it end and forgets it."""
        self.goes_on = False
        self._kept.close()


# The one that goes on, or the last one: what Blender opens meanwhile does not end it.
_latest: list[FolderBatch] = []


def going_on() -> FolderBatch | None:
    """The folder that is being labelled; None where there is none."""
    return next((batch for batch in _latest if batch.goes_on), None)


def folder_line(settings: SceneSettings) -> tuple[list[str], Path, bool]:
    """The command line that the settings ask for, the table that it keeps, and whether blobs can be labelled.

    Raises InputError where something is missing.
    """
    source, out = (Path(bpy.path.abspath(path)) for path in (settings.folder.path, settings.folder.out))
    if not source.is_dir():
        raise InputError("is no folder; expected one with takes", source)
    asked, blobs = subjects_asked(settings.subjects), cameras_at_hand(bpy.context.scene)
    table = out / SUMMARY_TABLE
    labelling, folder = settings.labelling, settings.folder
    line = ["label", f"--out={out}", *(f"--subject={name}={worn}" for name, worn in asked["wearers"])]
    line += [] if asked["wearers"] else [f"--model={asked['model']}"]
    line += [f"--models={asked['own']}"] if asked.get("own") else []
    if many := {1: "", AUTO: "auto"}.get(asked["subjects"], asked["subjects"]):
        line.append(f"--subjects={many}")
    line += ["--watch", "--resume", "--summary", "--html", "--blend", f"--method={labelling.method}"]
    line += [f"--target={as_typed(labelling.target)}", f"--jobs={folder.jobs}"]
    line += [] if folder.watch else ["--idle=0"]
    line += ["--overwrite"] if folder.overwrite else []
    line += [f"--occlusion={labelling.occlusion}", f"--rate={as_typed(settings.source.rate)}"] if blobs else []
    return [*line, "--", str(source)], table, blobs


def follow() -> float | None:
    """Brings the sidebar up to date while a batch goes on; a timer."""
    batch = going_on()
    if batch is None:
        return None
    batch.look()
    show_batch()
    return FOLLOWED_EVERY if batch.goes_on else None


def show_batch():
    """Puts what became of the takes into the sidebar's list; a file that was opened has emptied it."""
    if not _latest:
        return
    state, batch = bpy.context.window_manager.mocap_autolabel, _latest[0]
    failed = sum(row.state == FAILING for row in batch.rows)
    done = sum(row.measured or row.state == FAILING for row in batch.rows)
    words = f"{done} of {len(batch.rows)} takes" if batch.rows else "Looking for takes"
    words += f", {failed} failed" if failed else ""
    words = "Stopping" if batch.stopping else words
    state.folder_doing, state.folder_share = (words, done / max(len(batch.rows), 1)) if batch.goes_on else ("", 0.0)
    state.folder_trouble = "" if batch.trouble is None else written(str(batch.trouble))
    state.folder_results = str(batch.table.parent)
    # The take that is chosen stays so, wherever it goes.
    names = [row.name for row in state.folder_takes]
    chosen = names[state.folder_take_index] if state.folder_take_index < len(names) else ""
    columns = "name state reason stake measured trouble on_body named found"
    list_rows(state, "folder_takes", columns, map(_row, batch.rows))
    names = [row.name for row in state.folder_takes]
    state.folder_take_index = names.index(chosen) if chosen in names else 0
    redraw("VIEW_3D", "UI")


def _row(row: TakeRow) -> tuple:
    """What the list shows of a take."""
    reason = in_sidebar(written(row.reason), ask="by How Many")
    counts = row.measured, row.trouble, row.on_body, -1.0 if row.named is None else row.named, row.found
    return written(row.take), row.state, reason, round(row.at_stake), *counts


def leave_batch():
    """Ends what goes on, as Blender or the extension ends."""
    while _latest:
        _latest.pop().leave()


@operator(
    unless(lambda _: not going_on(), "Another folder is being labelled"),
    unless(lambda context: context.scene.mocap_autolabel.folder.path, "Choose the folder of the takes first"),
    unless(lambda context: context.scene.mocap_autolabel.folder.out, "Choose the folder for the results first"),
)
def label_folder(_self, context):
    """Label the takes of a folder in the background, but for those that are done already; go on working meanwhile."""
    settings, scene = context.scene.mocap_autolabel, context.scene
    line, table, blobs = folder_line(settings)
    cameras = scene_cameras.cameras_of(settings.source.cameras, scene) if blobs else None
    _latest[:] = [FolderBatch(line, table, cameras)]
    if not bpy.app.background:
        show_batch()
        # A take may be opened meanwhile.
        bpy.app.timers.register(follow, first_interval=FOLLOWED_EVERY, persistent=True)
        return
    while follow() is not None:
        time.sleep(FOLLOWED_EVERY)
    if _latest[0].trouble:
        raise _latest[0].trouble


@operator(label="Stop Label Folder", options={"INTERNAL"})
def stop_folder(_self, _context):
    """Stop labelling the folder; takes that are done stay, and Label Folder goes on from there."""
    if batch := going_on():
        batch.stop()


class OfFolderTake(Ours):
    """An operator on a take of the list, that opens a file beside the table."""

    bl_options = {"INTERNAL"}

    index: IntProperty(name="Take", description="Which row of the list", options={"HIDDEN", "SKIP_SAVE"})

    def found(self, context, ending: str) -> str:
        state = context.window_manager.mocap_autolabel
        if not 0 <= self.index < len(state.folder_takes):
            raise InputError("no take is chosen; expected one of the list")
        path = Path(state.folder_results, state.folder_takes[self.index].name + ending)
        if not path.is_file():
            raise InputError("is not there; expected a take that Label Folder labelled", path)
        return str(path)


@operator(of=OfFolderTake, label="Open Labelled")
def open_folder_take(self, context):
    """Open the labelled take in the place of this file, which is asked about where it has changes."""
    path = self.found(context, ".blend")
    if bpy.app.background:
        bpy.ops.wm.open_mainfile(filepath=path)
    else:
        bpy.ops.wm.open_mainfile("INVOKE_DEFAULT", filepath=path, display_file_selector=False)


@operator(of=OfFolderTake, label="Open Page")
def open_folder_page(self, context):
    """Show the take's page in the browser."""
    bpy.ops.wm.path_open(filepath=self.found(context, ".report.html"))
