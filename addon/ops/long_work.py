# SPDX-License-Identifier: GPL-3.0-or-later
"""Long work of the window: done by a process of its own, with progress in sidebar and status bar, shown at the end.

The process goes through the same door as the command line, is kept for the session, and ends with Blender, however that
ends. What ends its work early is the operator Cancel alone: the cross beside the progress asks for it, and Esc over a
3D view, the editor that shows the progress. Esc anywhere else belongs to whatever is there. Blender ends operators as
another file is opened: one of the same kind takes the work up then, and what comes of it waits for its own file.
"""

from collections.abc import Iterator
from contextlib import ExitStack, suppress
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

import bpy
from bpy.props import StringProperty

from ..core.data.errors import InputError, UserError
from ..core.data.progress import finished
from ..io.scratch import scratch_folder
from ..scene.later import redraw, soon
from .base import Ours, once, operator, reports_trouble, unless
from .gestures import is_over

if TYPE_CHECKING:
    from ..cli.workers import Worker

LOOK_EVERY = 0.1  # s between two looks at what the process has said
TELL_EVERY = 0.25  # s between two words on how far it is: Blender draws the whole window again for each
TELLING_AFTER, TELLING_FROM = 3.0, 0.02  # s and share of the work from which on its end can be told
ASKED_FROM = 10.0  # s of work that is not given up unasked; paper: Miller 1968, people who wait longer turn away

# The process of this session, once something was asked of it, and what closes it with its folder.
_workers: "list[Worker]" = []
_kept = ExitStack()
_going_on: "list[LongWork]" = []  # one at most
# What goes on without an operator, or is done for a file that is not open: its kind, and what that had noted.
_left: "list[tuple[type[LongWork], dict[str, Any]]]" = []
_taken_up: list[dict[str, Any]] = []  # what an operator had noted that another one takes up at this moment

nothing_goes_on = unless(
    lambda context: not context.window_manager.mocap_autolabel.doing,
    "Something is going on already; wait for it, or cancel it",
)


class LongWork(Ours):
    """An operator whose `asked` gives work, a function of ours with all it is given, and which shows what comes of it.

    In the window it is done by a process of its own; without one it is done at once. Both `asked` and `_show`, which
    alone touches Blender, raise UserError where something is missing, so cancelling leaves nothing behind and undo is
    one step. `_said` makes a sentence of the work one for the window. Both may be another operator's than `asked` was,
    with what that noted and was told.
    """

    doing = "Working"
    of_scene = True  # whether what comes of it goes into the scene that it was asked for in, not into a file
    waits = True  # until that scene is seen, or else gives up
    _timer, _asked_for_it, _spent, _astray = None, False, 0.0, False
    _shown = float("-inf")

    @classmethod
    def lacks(cls, context) -> str:
        return "" if _taken_up else super().lacks(context)

    def work(self, context):
        asked = self.asked(context)
        try:
            found = finished(asked())
        except UserError as error:
            raise self._said(context, error) from error
        return self._show(context, found)

    def _said(self, _context, error: UserError) -> UserError:
        return error

    def invoke(self, context, event):
        return self.execute(context) if bpy.app.background else self._begin(context)

    def ask_for_file(self, context) -> set[str]:
        """Lets a person choose a file; in the window the work then goes on beside it."""
        self._asked_for_it = True
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        if _taken_up:
            for name, value in _taken_up.pop().items():
                with suppress(TypeError):  # of choices that another file does not have
                    setattr(self, name, value)
            return self._watch(context)
        beside = self._asked_for_it and not bpy.app.background
        return self._begin(context) if beside else super().execute(context)

    @reports_trouble
    def _begin(self, context) -> set[str]:
        going_on = context.window_manager.mocap_autolabel.doing.split(":")[0]
        if going_on := going_on or next((kind.doing for kind, noted in _left if noted["_found"] is None), ""):
            words = f"{going_on.lower()} goes on"
            raise InputError(f"{words}; expected it to come to its end first, or to be cancelled")
        self._worker, self._scene = hand_over(self.asked(context)), context.scene.session_uid
        self._began, self._found = perf_counter(), None
        self._file = self._scene_name = ""  # where it was asked for, once another file was opened
        return self._watch(context)

    def _watch(self, context) -> set[str]:
        manager = context.window_manager
        self._timer = manager.event_timer_add(LOOK_EVERY, window=context.window)
        manager.progress_begin(0, 100)
        self._shown = float("-inf")
        manager.mocap_autolabel.cancelled = False
        manager.modal_handler_add(self)
        _going_on.append(self)
        self._tell(context, self._worker.share)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        state = context.window_manager.mocap_autolabel
        if ends_work(context, event):
            bpy.ops.mocap_autolabel.cancel("INVOKE_DEFAULT")
            if not state.cancelled:
                return {"RUNNING_MODAL"}  # it asks
        if state.cancelled:
            self._end(context)
            if self._found is None:
                end_process()
            self.report({"INFO"}, f"{self.doing} was cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}  # meanwhile Blender can be used
        return self._tick(context)

    @reports_trouble
    def _tick(self, context) -> set[str]:
        """Looks for what came of the work, which is shown in the scene that it was asked for in, once that is seen.

        What is in a file needs no scene. What is for another file than the one that is open waits for it.
        """
        self._found = self._worker.look() if self._found is None else self._found
        if self._found is None:
            self._tell(context, self._worker.share)
            return {"RUNNING_MODAL"}
        asked = scene_of(vars(self))
        self._astray = asked is None
        windows = [] if asked == context.scene else context.window_manager.windows
        seen = asked == context.scene or next((window for window in windows if window.scene == asked), None)
        if self.of_scene and self.waits and asked is not None and not seen:
            self._tell(context, 1.0, f"done, to be shown in {asked.name}")
            return {"RUNNING_MODAL"}
        self._end(context)
        if self.of_scene and not self.waits and not seen:
            return {"CANCELLED"}
        if self.of_scene and asked is None and self._file not in ("", bpy.data.filepath):
            self._leave()
            self.report({"INFO"}, f"{self.doing} is done, to be shown once {bpy.path.basename(self._file)} is open")
            return {"CANCELLED"}
        if self.of_scene and asked is None:
            raise InputError(f"{self.doing.lower()} is done, but its scene is gone; expected that to stay")
        if asked in (None, context.scene):
            return self._told(context)
        with bpy.context.temp_override(**({"window": seen} if seen else {"scene": asked})):
            return self._told(bpy.context)

    def _told(self, context) -> set[str]:
        if isinstance(self._found, UserError):
            raise self._said(context, self._found)
        return self._show(context, self._found)

    def cancel(self, context):
        """Another file is opened, or the window is closed: whoever is there then takes the work up, once begun."""
        if self._timer is None:
            return  # Blender asks for a file still
        self._give_back(context)
        if scene := scene_of(vars(self)):
            self._file, self._scene_name = bpy.data.filepath, scene.name
        self._leave()
        take_up_soon()

    def _leave(self):
        told = {name: one for name, one in self.as_keywords().items() if isinstance(one, int | float | str)}
        _left.append((type(self), vars(self) | told))

    def _tell(self, context, fraction: float, words: str = ""):
        now = perf_counter()
        if now - self._shown < TELL_EVERY:
            return
        state = context.window_manager.mocap_autolabel
        self._shown, self._spent = now, self._spent if words else now - self._began  # what waits is not worked on
        left = f", {time_left(self._spent, fraction)} left" if time_left(self._spent, fraction) else ""
        words = words or f"{fraction:.0%}{left}"
        state.doing, state.share, state.spent = f"{self.doing}: {words}", fraction, self._spent
        context.window_manager.progress_update(round(100 * fraction))
        context.workspace.status_text_set(f"{state.doing}. Esc over a 3D view cancels")
        redraw("VIEW_3D", "UI")

    def _end(self, context):
        """Gives back the timer, the progress and the status bar; once."""
        if self._timer is not None:
            self._give_back(context)
            clear_status()

    def _give_back(self, context):
        """The same but for the status bar, at which Blender ends where it is that of a window that is being closed."""
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        context.window_manager.mocap_autolabel.doing = ""
        redraw("VIEW_3D", "UI")
        self._timer = None
        _going_on.clear()


def clear_status():
    """Lets the status bars be Blender's; each workspace that somebody went through keeps what it was told."""
    for workspace in bpy.data.workspaces:
        with bpy.context.temp_override(workspace=workspace):
            workspace.status_text_set(None)


def scene_of(noted: dict[str, Any]) -> bpy.types.Scene | None:
    """The scene that work was asked for in, also where its file was opened again; None where it is not there."""
    found = next((one for one in bpy.data.scenes if one.session_uid == noted["_scene"]), None)
    again = found is None and noted["_file"] == bpy.data.filepath != ""
    return bpy.data.scenes.get(noted["_scene_name"]) if again else found


def known_by(block: bpy.types.ID) -> set[int | str]:
    """What a block of data is known by: its number in this session, and its name where its file is opened again."""
    return {block.session_uid, block.name}


def take_up_soon():
    """Looks for work to take up once the file that is being opened is open."""
    if _left:
        soon(take_up, persistent=True)


def take_up() -> float | None:
    """Has an operator go on with work that lost its own, and show what is done for the file that is open; a timer."""
    manager = bpy.context.window_manager
    if manager.mocap_autolabel.doing:
        return LOOK_EVERY
    with bpy.context.temp_override(window=manager.windows[0]):  # a status bar of no window ends Blender
        clear_status()
        for kind, noted in tuple(_left):
            if kind.of_scene and not noted["_file"] and scene_of(noted) is None:
                _left.remove((kind, noted))
                end_process()
                why = "its file was never saved and another was opened" if noted["_scene_name"] else "its scene is gone"
                _pop_up(f"{kind.doing} was given up, as {why}")
        here = [one for one in _left if one[1]["_found"] is None or one[1]["_file"] == bpy.data.filepath]
        if not here:
            return None
        kind, noted = max(here, key=lambda one: one[1]["_found"] is not None)  # which takes no time
        _left.remove((kind, noted))
        _taken_up.append(noted)
        getattr(bpy.ops.mocap_autolabel, kind.bl_idname.partition(".")[2])("EXEC_DEFAULT")
    return LOOK_EVERY


def done_elsewhere() -> Iterator[tuple[str, str]]:
    """What is done for files that are not open: what it was, and the file."""
    return ((kind.doing, noted["_file"]) for kind, noted in _left if noted["_found"] is not None)


@operator(
    label="Give Up What Is Done",
    options={"INTERNAL"},
    file=once(StringProperty, "File", "The file that it is done for"),
)
def give_up_done(self, _context):
    """Throw away what is done for this file and not shown yet, as where the file was moved or deleted."""
    _left[:] = [one for one in _left if one[1]["_found"] is None or one[1]["_file"] != self.file]


def _pop_up(words: str):
    manager = bpy.context.window_manager
    manager.popup_menu(lambda menu, _: menu.layout.label(text=words), title="Mocap Autolabel", icon="INFO")


def hand_over(work: partial) -> "Worker":
    """Hands work to this session's process, which is started where there is none; JobError where that cannot be."""
    if not _workers or _workers[0].process.poll() is not None:
        from ..cli.workers import Worker  # nobody who starts Blender waits for it

        end_process()
        with ExitStack() as stack:
            worker = Worker(stack.enter_context(scratch_folder()))
            stack.callback(worker.close)
            _kept.push(stack.pop_all())
        _workers.append(worker)
    _workers[0].hand(work)
    return _workers[0]


def leave_work():
    """Gives up what goes on, of which Blender does not tell it when the extension ends, and ends the process."""
    _left.clear()
    for work in tuple(_going_on):
        work._end(bpy.context)
    end_process()


def end_process():
    """Ends the process of this session, as Blender or the extension ends, or as what it does is not wanted any more."""
    _workers.clear()
    _kept.close()


def ends_work(context: bpy.types.Context, event: bpy.types.Event) -> bool:
    """Whether an event is Esc meant for the work: pressed over a 3D view, and not to stop what plays."""
    if event.type != "ESC" or event.value != "PRESS" or event.is_repeat:
        return False  # Esc is let go after it has closed a menu, and repeated while it is held
    if any(window.screen.is_animation_playing for window in context.window_manager.windows):
        return False
    return any(area.type == "VIEW_3D" and is_over(area, event) for area in context.window.screen.areas)


def time_left(spent: float, fraction: float) -> str:
    """How long work goes on that took `spent` seconds for a fraction, such as "2 min"; empty where nobody can tell."""
    if spent < TELLING_AFTER or fraction < TELLING_FROM:
        return ""
    seconds = spent / fraction * (1 - fraction)
    return f"{max(round(seconds), 1)} s" if seconds < 90 else f"{round(seconds / 60)} min"


class MOCAP_AUTOLABEL_OT_cancel(Ours, bpy.types.Operator):
    """Stop what is going on; more than ten seconds of work are asked about before they are thrown away."""

    bl_options = {"INTERNAL"}

    def invoke(self, context, event):
        state = context.window_manager.mocap_autolabel
        if state.spent <= ASKED_FROM:
            return self.execute(context)
        return context.window_manager.invoke_confirm(
            self,
            event,
            title=f"Throw away {state.spent:.0f} s of work?",
            message=state.doing,
            confirm_text="Throw It Away",
        )

    def work(self, context):
        context.window_manager.mocap_autolabel.cancelled = True
