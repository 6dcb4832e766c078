# SPDX-License-Identifier: GPL-3.0-or-later
"""Long work in Blender: a little at a time, with progress in sidebar and status bar, all shown at the end.

What ends it early is the operator Cancel alone: the cross beside the progress asks for it, and Esc over a 3D view, the
editor that shows the progress. Esc anywhere else belongs to whatever is there.
"""

from collections.abc import Generator
from time import perf_counter
from typing import Any

import bpy

from ..core.data.background import drained, in_background
from ..core.data.errors import InputError
from ..core.data.progress import Progress, finished
from ..scene.redrawing import redraw
from .base import Ours, reports_trouble, unless
from .gestures import is_over

BUDGET = 0.1  # s of work between two looks at the keyboard
TICK = 0.02  # s
TELL_EVERY = 0.25  # s between two words on how far it is: Blender draws the whole window again for each
TELLING_AFTER, TELLING_FROM = 3.0, 0.02  # s and share of the work from which on its end can be told
ASKED_FROM = 10.0  # s of work that is not given up unasked; paper: Miller 1968, people who wait longer turn away


nothing_goes_on = unless(
    lambda context: not context.window_manager.mocap_autolabel.doing,
    "Something is going on already; wait for it, or cancel it",
)


class WorksInSteps(Ours):
    """An operator whose `steps` yields how much is done (0 to 1) and returns what `_show` puts into the scene.

    Either raises UserError where something is missing. What is done may also be told as `Progress`.
    Nothing of Blender is touched before `_show`, so that cancelling leaves nothing behind and undo is one step.
    """

    doing = "Working"
    _timer, _asked_for_it = None, False
    _shown = float("-inf")

    def work(self, context):
        return self._show(context, finished(self.steps(context)))

    def invoke(self, context, event):
        return self.execute(context) if bpy.app.background else self._begin(context)

    def ask_for_file(self, context) -> set[str]:
        """Lets a person choose a file; in the window the work then goes on beside it."""
        self._asked_for_it = True
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        beside = self._asked_for_it and not bpy.app.background
        return self._begin(context) if beside else super().execute(context)

    @reports_trouble
    def _begin(self, context) -> set[str]:
        manager = context.window_manager
        if manager.mocap_autolabel.doing:
            words = f"{manager.mocap_autolabel.doing.split(':')[0].lower()} goes on"
            raise InputError(f"{words}; expected it to come to its end first, or to be cancelled")
        self._steps = self.steps(context)
        self._timer = manager.event_timer_add(TICK, window=context.window)
        manager.progress_begin(0, 100)
        self._began, self._shown = perf_counter(), float("-inf")
        manager.mocap_autolabel.cancelled, manager.mocap_autolabel.spent = False, 0.0
        manager.modal_handler_add(self)
        self._tell(context, 0.0)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        state = context.window_manager.mocap_autolabel
        if ends_work(context, event):
            bpy.ops.mocap_autolabel.cancel("INVOKE_DEFAULT")
            if not state.cancelled:
                return {"RUNNING_MODAL"}  # it asks
        if state.cancelled:
            self._end(context)
            self.report({"INFO"}, f"{self.doing} was cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}  # meanwhile Blender can be used
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
        self._tell(context, fraction.fraction if isinstance(fraction, Progress) else fraction)
        return {"RUNNING_MODAL"}

    def cancel(self, context):
        self._end(context)

    def _tell(self, context, fraction: float):
        now = perf_counter()
        if now - self._shown < TELL_EVERY:
            return
        self._shown, spent = now, now - self._began
        left = f", {time_left(spent, fraction)} left" if time_left(spent, fraction) else ""
        state = context.window_manager.mocap_autolabel
        state.doing, state.share, state.spent = f"{self.doing}: {fraction:.0%}{left}", fraction, spent
        context.window_manager.progress_update(round(100 * fraction))
        context.workspace.status_text_set(f"{state.doing}. Esc over a 3D view cancels")
        redraw("VIEW_3D", "UI")

    def _end(self, context):
        """Gives back the timer, the progress and the status bar; once."""
        if self._timer is None:
            return
        self._steps.close()
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)
        context.window_manager.mocap_autolabel.doing = ""
        redraw("VIEW_3D", "UI")
        self._timer = None


def beside(job: Generator) -> Generator[float, None, Any]:
    """A job, done beside the window: it touches nothing of Blender. Yields how much is done (0 to 1)."""
    return in_background(lambda tell: drained(job, tell))


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
    """Stop what is going on; nothing of it stays, so more than ten seconds of work are asked about."""

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
