# SPDX-License-Identifier: GPL-3.0-or-later
"""Esc pressed everywhere in a real Blender's window while a take is labelled, which only some of them may end."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

from stage import TASK, play, state, window

MUCH = 10.5  # s of work, of which it is asked


def walk(seen: dict) -> Iterator[float]:
    """Esc in another editor, in a menu, to stop what plays; asked, and said no to; and yes; unasked."""
    yield from window.open_tab("Mocap")
    bpy.ops.mocap_autolabel.import_points(filepath=TASK["points"])
    labelling = importlib.import_module("bl_ext.user_default.mocap_autolabel.addon.ops.labelling")
    labelling.label_steps = endless
    view, other = window.region("WINDOW"), window.area("DOPESHEET_EDITOR")
    here, there = (view.x + 300, view.y + 300), (other.x + 300, other.y + 20)

    bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
    yield from window.until(lambda: state().doing)
    yield from window.press("ESC", *there)
    seen["in another editor"] = bool(state().doing)

    window.point(*here)
    yield 0.5
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.wm.call_menu(name="VIEW3D_MT_add")
    yield from window.screenshot("1-menu")
    yield from window.press("ESC", *here)
    seen["in a menu"] = bool(state().doing)

    bpy.ops.screen.animation_play()
    yield 0.5
    playing = lambda: bpy.context.window_manager.windows[0].screen.is_animation_playing  # noqa: E731
    seen["plays"] = playing()
    yield from window.press("ESC", *here)
    yield 0.5
    seen["to stop what plays"] = [playing(), bool(state().doing)]

    yield from window.until(lambda: state().spent > MUCH)
    yield from window.press("ESC", *here)
    yield from window.screenshot("2-asked")
    seen["asked"] = bool(state().doing)
    yield from window.press("ESC", *here)
    before = state().spent
    yield from window.until(lambda: state().spent > before + 1)
    seen["said no"] = [bool(state().doing), state().spent > before + 1]
    yield from window.press("ESC", *here)
    yield from window.press("RET", *here)
    yield from window.until(lambda: not state().doing)
    seen["said yes"] = bool(state().doing)

    bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
    yield from window.until(lambda: state().doing)
    yield from window.press("ESC", *here)
    yield from window.until(lambda: not state().doing)
    seen["little work"] = bool(state().doing)


def endless(*job) -> Iterator[float]:
    """Work that goes on until it is ended, on any machine."""
    while True:
        yield 0.4


play(walk)
