# SPDX-License-Identifier: GPL-3.0-or-later
"""A hand that corrects a take with the tool Label in a real Blender's window, by pointer and keys."""

from collections.abc import Generator, Iterator

import bpy
import numpy as np
import stage
from stage import window


def walk(seen: dict) -> Iterator[float]:
    """Install, import, label; pick in every way, name, swap, unlabel and relabel, place, play."""
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.ops.mocap_autolabel.import_points(filepath=stage.TASK["points"])
    bpy.context.scene.mocap_autolabel.subjects.markerset = stage.TASK["markerset"]
    yield from stage.label()
    bpy.context.scene.frame_set(stage.TASK["frame"])
    stage.look_at_the_person()
    stage.set_tool()
    bpy.ops.ed.undo_push(message="Labelled")
    yield 1
    for part in (picking, naming, quick_labelling, graphing, placing, playing):
        yield from part(seen)


def picking(seen: dict) -> Iterator[float]:
    """Clicks, a box, a lasso."""
    left, right = stage.dot("LKNE"), stage.dot("RKNE")
    seen["knees"] = [trajectory("LKNE"), trajectory("RKNE")]
    yield from window.click(*left)
    seen["clicked"] = stage.picked()
    seen["selected"] = [item.name for item in bpy.context.selected_objects]
    yield from window.click(*right, shift=True)
    seen["with Shift"] = stage.picked()
    yield from window.screenshot("1-picked")
    yield from window.click(*left, shift=True)
    seen["with Shift again"] = stage.picked()
    yield from window.click(left[0] + 150, left[1])
    seen["beside"] = stage.picked()
    xs, ys = zip(left, right, strict=True)
    yield from window.drag((min(xs) - 25, min(ys) - 25), (max(xs) + 25, max(ys) + 25))
    seen["in a box"] = stage.picked()
    x, y = right
    yield from lasso([(x - 25, y - 25), (x + 25, y - 25), (x + 25, y + 25), (x - 25, y + 25), (x - 25, y - 15)])
    seen["in a lasso"] = stage.picked()


def naming(seen: dict) -> Iterator[float]:
    """Two exchanged, taken back; a pie, a typed name."""
    left, right = stage.dot("LKNE"), stage.dot("RKNE")
    yield from window.click(*left)
    yield from window.click(*right, shift=True)
    yield from window.press("E", *left)
    seen["swapped"] = stage.corrections()
    yield from stage.press_held("Z", left, ctrl=True)
    yield 1
    seen["undone"] = stage.corrections()
    seen["picked after undo"] = stage.picked()
    yield from window.click(*stage.dot("LANK"))
    yield from window.press("U", *left)
    seen["unlabelled"] = stage.corrections()
    yield from window.tap("L", *left)
    yield from window.screenshot("2-pie")
    yield from window.press("FOUR", *left)  # the pie's first piece
    seen["named by the pie"] = stage.corrections()
    yield from window.press("RET", *left)
    yield from window.screenshot("3-typed")
    yield from window.press("ESC", *left)
    seen["after Esc"] = stage.corrections()


def quick_labelling(seen: dict) -> Iterator[float]:
    """Three names taken away and given again, one after the other, with second thoughts."""
    places = {name: stage.dot(name) for name in ("LELB", "RELB", "LTOE")}
    seen["truth"] = {name: trajectory(name) for name in places}
    for place in places.values():
        yield from window.click(*place)
        yield from window.press("U", *place)
    begun = len(stage.corrections())
    aside = places["LELB"]
    yield from window.press("F", *aside)
    yield from window.screenshot("4-quick-label")
    first = yield from skip_to(places, aside)
    yield from window.click(*places.pop(first))
    seen["asked"] = [first, stage.asked().rstrip("?")]
    for key in ("BACK_SPACE", "SPACE"):
        yield from window.press(key, *aside)
        seen["asked"].append(stage.asked().rstrip("?"))
    second = yield from skip_to(places, aside)
    yield from window.click(*places.pop(second))
    seen["asked"].append(second)
    yield from window.press("ESC", *aside)
    seen["given"] = stage.corrections()[begun:]
    seen["quick label runs"] = stage.running()


def skip_to(wanted: dict[str, stage.Place], aside: stage.Place) -> Generator[float, None, str]:
    """Pass over the markers that are asked for until it is one of those wanted, and give that."""
    for _ in range(30):
        if stage.asked().rstrip("?") in wanted:
            break
        yield from window.press("SPACE", *aside)
    return stage.asked().rstrip("?")


def graphing(seen: dict) -> Iterator[float]:
    """The graph of a marker that has a gap, with the fill before it is kept."""
    stored, _ = stage.now()
    name = stored.names[np.isnan(stored.motion.markers[5:-5, :, 0]).any(axis=0).argmax()]
    bpy.ops.mocap_autolabel.jump(frame=stage.TASK["frame"], marker=name)
    bpy.ops.mocap_autolabel.show_graph()
    yield 1
    bpy.ops.mocap_autolabel.show_graph()  # there is one now, and it shows all of the marker
    bpy.context.scene.mocap_autolabel.filling.method = "pca"
    bpy.ops.mocap_autolabel.fill_gaps("INVOKE_DEFAULT", extent="MARKER", propose=True)
    yield from window.until(lambda: len(stage.state().proposed_fills))
    yield from window.screenshot("6-graph")
    area = window.area("GRAPH_EDITOR")
    seen["graph"] = [area.x, area.y, area.width, area.height]
    bpy.ops.mocap_autolabel.keep_fills()
    yield 0.5
    seen["kept"] = [len(stage.state().fills), len(stage.state().proposed_fills)]
    bpy.ops.mocap_autolabel.take_back_fills()
    with bpy.context.temp_override(area=area):
        bpy.ops.screen.area_close()
    yield 1


def placing(seen: dict) -> Iterator[float]:
    """A marker put where nothing was seen."""
    stored, _ = stage.now()
    hidden = np.isnan(stored.motion.markers[..., 0]) & np.isfinite(stored.motion.expected[..., 0])
    [frame, marker] = np.argwhere(hidden & np.isfinite(stored.motion.markers[..., 0]).any(axis=0))[0]
    stored.clock.go_to(bpy.context.scene, int(stored.motion.frames[frame]))
    stage.look_at_the_person()
    yield 1
    seen["gap"] = stored.names[marker]
    item = next(item for item in stage.settings().take.all_objects if item.get("mocap_marker") == seen["gap"])
    bpy.context.view_layer.objects.active = item
    for other in bpy.context.selected_objects:
        other.select_set(False)
    item.select_set(True)
    place = stage.in_window(stored.motion.expected[frame, marker])
    yield from window.press("P", *place)
    yield from window.click(*place)
    yield from window.screenshot("5-it-is-here")
    yield from window.press("RET", *place)
    seen["placed"] = [stage.corrections()[-1], [float(value) for value in item.matrix_world.translation]]


def playing(seen: dict) -> Iterator[float]:
    """Playback goes on with the tool."""
    before = bpy.context.scene.frame_current
    middle = window.region("WINDOW")
    place = middle.x + 200, middle.y + 200
    yield from window.press("SPACE", *place)
    yield 2
    yield from window.press("SPACE", *place)
    seen["played"] = bpy.context.scene.frame_current != before
    seen["tool"] = bpy.context.workspace.tools.from_space_view3d_mode("OBJECT").idname


def trajectory(marker: str) -> int:
    """The trajectory that is a marker now."""
    stored, index = stage.now()
    here = stage.module("scene.picking").dots_of(stored, index)
    return int(here.trajectory[here.marker == stored.names.index(marker)][0])


def lasso(path: list[stage.Place]) -> Iterator[float]:
    """Drag along a path with Ctrl held, which Blender has to see pressed before a drag counts as such."""
    stage.event("MOUSEMOVE", "NOTHING", path[0])
    yield 0.2
    stage.event("LEFT_CTRL", "PRESS", path[0], ctrl=True)
    stage.event("LEFTMOUSE", "PRESS", path[0], ctrl=True)
    for place in path[1:]:
        yield 0.3
        stage.event("MOUSEMOVE", "NOTHING", place, ctrl=True)
    yield 0.3
    stage.event("LEFTMOUSE", "RELEASE", path[-1], ctrl=True)
    stage.event("LEFT_CTRL", "RELEASE", path[-1])
    yield 0.5
