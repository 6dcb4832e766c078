# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's way through the trouble of a take, walked in a real Blender's window by pointer and keys."""

import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

from stage import TASK, play, settings, state, window

LABEL = "mocap_autolabel.label"
NEXT, MEND, ACCEPT = (f"mocap_autolabel.{name}" for name in ("next_trouble", "mend_trouble", "accept_trouble"))
LOST = "LKNE"
FROM_RIGHT = 50  # px from the sidebar's right end to the middle of the cross beside the progress


def walk(seen: dict) -> Iterator[float]:
    """Import, label, cancel by the button, label, lose a knee, find it in the list, name it by a button, undo."""
    listed = lambda: [one.reason for one in state().troubles]  # noqa: E731
    bpy.data.batch_remove(list(bpy.data.objects))
    yield from window.open_tab("Mocap")
    bpy.ops.mocap_autolabel.import_points(filepath=TASK["points"])
    settings().subjects.markerset = "body26"
    bpy.ops.ed.undo_push(message="Imported")
    yield from window.screenshot("1-imported")

    places = yield from window.all_buttons()
    with window.held():
        yield from window.click(*places[LABEL])
        yield from window.until(lambda: state().doing)
        seen["doing"] = state().doing
        sidebar = window.region("UI")
        yield from window.click(sidebar.x + sidebar.width - FROM_RIGHT, places[LABEL][1])
        yield from window.until(lambda: not state().doing)
    seen["after Cancel"] = {"running": bool(state().doing), "take": settings().take is not None}

    with window.held():
        bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
        yield from window.screenshot("2-labelling")
    yield from window.until(lambda: settings().take is not None and not state().doing)
    view = window.area().spaces.active.region_3d
    for item in settings().take.all_objects:
        item.select_set(item.get("mocap_marker") == LOST)
    before = listed()
    bpy.ops.mocap_autolabel.unlabel(scope="WHOLE")
    bpy.ops.ed.undo_push(message="Lost")
    yield from window.until(lambda: listed() != before)
    state().trouble_marker = LOST
    view.view_location, view.view_distance, turn = (9, 9, 9), 30, list(view.view_rotation)
    places = yield from window.scroll_to(NEXT)
    seen["buttons"] = sorted(places)
    yield from window.click(*places[NEXT])
    yield from window.until(lambda: state().trouble_shown)
    seen["view"] = {"place": list(view.view_location), "turn": [turn, list(view.view_rotation)]}
    row = state().troubles[state().trouble_index]
    reason = row.reason
    seen["shown"] = {"name": row.name, "reason": reason, "frame": bpy.context.scene.frame_current}
    yield from window.screenshot("3-trouble")
    places = yield from window.scroll_to(MEND)
    yield from window.click(*places[MEND])
    yield from window.until(lambda: reason not in listed())
    seen["left after mending"] = listed()
    yield from window.screenshot("4-mended")
    bpy.ops.ed.undo()
    yield from window.until(lambda: reason in listed())
    seen["back after undo"] = listed()
    places = yield from window.scroll_to(ACCEPT)
    yield from window.click(*places[ACCEPT])
    yield from window.until(lambda: any(one.answered for one in state().troubles))
    seen["answered"] = sum(one.answered for one in state().troubles)
    state().trouble_done, state().trouble_marker = "DONE", ""
    yield from window.screenshot("5-done")


play(walk)
