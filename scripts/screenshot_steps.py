# SPDX-License-Identifier: GPL-3.0-or-later
"""What screenshots.py does inside Blender's window: a person's way through the sidebar, with a picture at each step."""

import importlib
import json
import math
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler, Vector

sys.path.insert(0, str(Path(__file__).resolve().parent))

import window

OUT = Path(os.environ["MOCAP_OUT"])
SEEN_BY_FIRST = "RELB"  # in the frame that is shown
OPEN = "mocap_autolabel.import_take"
TO_ADVANCED, TO_MARKER_SET = 90, 358  # px below the button Open Take, where nothing is open


def steps() -> Iterator[float]:
    """From an empty scene to a reviewed take."""
    task = json.loads((OUT / "task.json").read_text(encoding="utf-8"))
    bpy.ops.extensions.package_install_files(filepath=task["zip"], repo="user_default", enable_on_install=True)
    bpy.data.batch_remove(list(bpy.data.objects))
    yield from window.open_tab("Mocap")
    yield from window.screenshot("sidebar")

    bpy.ops.mocap_autolabel.import_cameras(filepath=task["cameras"])
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.mocap_autolabel.find_blobs("INVOKE_DEFAULT")
    yield from window.browse(task["movies"], picture="blobs-from-pictures")
    settings, state = bpy.context.scene.mocap_autolabel, bpy.context.window_manager.mocap_autolabel
    yield from window.until(lambda: settings.source.blobs_path and not state.doing)
    settings.source.rate = 60
    bpy.ops.mocap_autolabel.import_take(filepath=task["blobs"])
    yield from window.until(lambda: settings.subjects.found)
    yield from window.look_through_first()
    yield from window.screenshot("blobs-through-camera")
    settings.display.show_rays = True
    bpy.context.scene.frame_set(bpy.context.scene.frame_start + 100)
    look_at((-0.6, -0.3, 0.9), distance=6.5)
    yield from window.screenshot("rays")
    settings.display.show_rays = False
    yield from window.look_through_first()

    yield from label()
    bpy.context.scene.frame_set(bpy.context.scene.frame_start + 100)
    yield 1
    yield from window.screenshot("through-camera")
    yield from name_blob()
    body = next(item for item in settings.take.all_objects if item.type == "ARMATURE")
    middle = body.matrix_world @ (sum((Vector(corner) for corner in body.bound_box), Vector()) / 8)
    look_at((middle.x, middle.y, 1.0), distance=6.5)
    yield from window.screenshot("labelled")

    bpy.ops.mocap_autolabel.clear()
    bpy.data.batch_remove(list(settings.source.cameras.all_objects))
    bpy.ops.mocap_autolabel.import_take(filepath=task["points"])
    yield from window.until(lambda: settings.subjects.found)
    bpy.context.scene.frame_set(bpy.context.scene.frame_start + 100)
    look_at((middle.x, middle.y, 1.0), distance=3.2)
    yield from window.screenshot("points")
    yield from label()
    bpy.context.scene.frame_set(bpy.context.scene.frame_start + 100)
    yield from window.screenshot("points-labelled")
    bpy.ops.mocap_autolabel.next_trouble(back=False)
    bpy.context.scene.frame_set(bpy.context.scene.frame_start + 100)
    look_at((middle.x, middle.y, 1.0), distance=3.2)
    yield from window.screenshot("review")
    yield from character(middle)
    yield from correct()
    yield from preview_fill()
    yield from fill_and_correct()
    yield from window.grow("DOPESHEET_EDITOR", 330)
    yield from window.screenshot("timeline")
    settings.display.show_timeline = False
    yield from window.grow("DOPESHEET_EDITOR", -330)

    settings = bpy.context.scene.mocap_autolabel
    bpy.ops.mocap_autolabel.clear()
    yield from performers(task)
    yield from folder_of_takes(task)
    settings.subjects.markerset, settings.folder.path = "body26", ""
    bpy.context.window_manager.mocap_autolabel.folder_takes.clear()
    bpy.ops.mocap_autolabel.edit_markerset()
    places = yield from window.all_buttons()
    for below in (TO_ADVANCED, TO_MARKER_SET):
        yield from window.click(places[OPEN][0], places[OPEN][1] - below)
        yield 1
    look_at((0, 0, 0.9), distance=3.2)
    yield from window.screenshot("marker-set")

    bpy.data.batch_remove([*laid_out().all_objects, laid_out()])
    settings.subjects.markerset = "gait15"
    bpy.ops.mocap_autolabel.edit_markerset()
    look_at((0, 0, 0.45), distance=1.7)
    yield from judge()
    yield from window.screenshot("placement-quality")
    (OUT / "done").touch()


def label() -> Iterator[float]:
    """Press the button and wait for the take."""
    bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
    yield from window.until(lambda: bpy.context.scene.mocap_autolabel.take is not None)


def character(middle: Vector) -> Iterator[float]:
    """Add the character, at rest beside the one that moves, with the names of its bones."""
    settings = bpy.context.scene.mocap_autolabel
    settings.display.show_overlay = False
    for rest, aside in ((False, 0.0), (True, 1.6)):
        bpy.ops.mocap_autolabel.add_character()
        added = next(item for item in bpy.data.objects if "mocap_character" in item and not item.show_in_front)
        added.show_in_front, added.data.show_names = True, rest
        added.data.display_type = "OCTAHEDRAL"
        if rest:
            added.data.pose_position = "REST"
            added.location = (middle.x + aside, middle.y, 0.0)
    look_at((middle.x + 1.15, middle.y, 1.0), distance=4.6, about=15)
    settings.display.stage = "USE"
    yield from window.screenshot("character")
    settings.display.stage = "REVIEW"
    bpy.data.batch_remove([item for item in bpy.data.objects if "mocap_character" in item])
    settings.display.show_overlay = True
    look_at((middle.x, middle.y, 1.0), distance=3.2)


def performers(task: dict) -> Iterator[float]:
    """Ask for two by name, each in a marker set of their own, and label them."""
    settings = bpy.context.scene.mocap_autolabel
    bpy.ops.mocap_autolabel.import_points(filepath=task["duet"])
    bpy.context.window_manager.mocap_autolabel.unfolded = True
    settings.subjects.performing, before = "LISTED", settings.subjects.markerset
    prefs = importlib.import_module("bl_ext.user_default.mocap_autolabel.addon.prefs")
    for own in task["people"]:
        settings.subjects.markerset = str(shutil.copy(own, prefs.markerset_folder(create=True)))
        bpy.ops.mocap_autolabel.add_performer()
    settings.subjects.markerset = before
    yield from label()
    scene = bpy.context.scene
    scene.frame_set(scene.frame_start + 100)
    people = [item for item in settings.take.all_objects if item.type == "ARMATURE"]
    middle = sum((item.pose.bones[0].head for item in people), Vector()) / len(people)
    look_at((middle.x, middle.y, 0.9), distance=4.4)
    yield from window.screenshot("performers")
    bpy.ops.mocap_autolabel.clear()
    settings.subjects.performing = "ONE"
    settings.subjects.performers.clear()


def folder_of_takes(task: dict) -> Iterator[float]:
    """Label the takes of a folder, of which one holds nothing, and show the list of them."""
    settings, state = bpy.context.scene.mocap_autolabel, bpy.context.window_manager.mocap_autolabel
    bpy.ops.mocap_autolabel.import_cameras(filepath=task["cameras"])
    settings.folder.out, settings.folder.watch = str(OUT / "labelled"), True
    bpy.ops.mocap_autolabel.import_take(directory=task["takes"])
    bpy.ops.mocap_autolabel.label_folder("INVOKE_DEFAULT")
    ended = ("failed", "labelled")
    yield from window.until(lambda: len(state.folder_takes) == 3 and all(r.state in ended for r in state.folder_takes))
    state.folder_take_index = 1
    window.point(400, 300)  # off the buttons, which would tell what they are for
    yield 1
    yield from window.screenshot("label-folder")
    bpy.ops.mocap_autolabel.stop_folder()
    yield from window.until(lambda: not state.folder_doing)
    bpy.data.batch_remove(list(settings.source.cameras.all_objects))


def preview_fill() -> Iterator[float]:
    """Show what a marker's gap would be filled with, in the Graph Editor."""
    state = bpy.context.window_manager.mocap_autolabel
    row = next(row for row in state.markers if row.gaps and row.labelled > 0.5)  # the table may be of before
    bpy.ops.mocap_autolabel.jump(frame=row.first_gap, marker=row.name)
    bpy.ops.mocap_autolabel.show_graph()
    yield 1
    state.listed, bpy.context.scene.mocap_autolabel.filling.propose = "FILLS", True
    bpy.ops.mocap_autolabel.fill_gaps("INVOKE_DEFAULT", extent="MARKER", propose=True)
    yield from window.until(lambda: len(state.proposed_fills))
    gap = state.proposed_fills[0]
    importlib.import_module("bl_ext.user_default.mocap_autolabel.addon.ops.viewing").fit_graphs(
        bpy.context, gap.first - 30, gap.last + 30
    )
    yield from window.screenshot("fill-preview")
    bpy.ops.mocap_autolabel.discard_fills()
    state.listed, bpy.context.scene.mocap_autolabel.filling.propose = "TROUBLES", False
    with bpy.context.temp_override(area=window.area("GRAPH_EDITOR")):
        bpy.ops.screen.area_close()
    yield 1


def fill_and_correct() -> Iterator[float]:
    """Fill half of the gaps, correct a name in a range of frames, and show the trajectories in the Dope Sheet."""
    scene = bpy.context.scene
    names = [item["mocap_marker"] for item in scene.mocap_autolabel.take.all_objects if "mocap_marker" in item]
    for item in scene.mocap_autolabel.take.all_objects:
        if item.get("mocap_marker") in names[::2]:
            item.select_set(True)
    bpy.ops.mocap_autolabel.fill_gaps("INVOKE_DEFAULT", extent="MARKER")
    yield from window.until(lambda: len(bpy.context.window_manager.mocap_autolabel.fills))
    first = scene.frame_start
    bpy.ops.mocap_autolabel.timeline_pick(marker="LKNE", first=first + 60, last=first + 110)
    bpy.ops.mocap_autolabel.timeline_pick(marker="RKNE", first=first + 60, last=first + 110, extend=True)
    bpy.ops.mocap_autolabel.swap_markers(scope="RANGE")
    bpy.ops.mocap_autolabel.timeline_pick(marker="LKNE", first=first + 100, last=first + 100)
    scene.use_preview_range = False
    bpy.ops.mocap_autolabel.show_timeline()
    bpy.context.window_manager.mocap_autolabel.timeline_scroll = 11.0
    yield 1


def correct() -> Iterator[float]:
    """Pick with the tool Label, open its pie, and let it ask for markers whose names were taken away."""
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.wm.tool_set_by_id(name="mocap_autolabel.label_tool")
    for name, held in (("LKNE", {}), ("RKNE", {"shift": True})):
        yield from window.click(*dot_of(name), **held)
    yield from window.screenshot("label-picked")
    for name in ("RELB", "LKNE"):
        place = dot_of(name)
        yield from window.click(*place)
        yield from window.press("U", *place)
    yield from window.tap("L", *place)
    yield from window.screenshot("label-pie")
    yield from window.press("ESC", *place)
    yield from window.press("F", *place)
    yield from window.screenshot("label-quick")
    yield from window.press("ESC", *place)
    bpy.ops.mocap_autolabel.clear_corrections()


def name_blob() -> Iterator[float]:
    """Through a camera take a blob's name away, and open the pie of what it may be."""
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.wm.tool_set_by_id(name="mocap_autolabel.label_tool")
    place = dot_of(SEEN_BY_FIRST)
    yield from window.click(*place)
    yield from window.press("U", *place)
    yield from window.tap("L", *place)
    yield from window.screenshot("label-blob")
    yield from window.press("ESC", *place)
    bpy.ops.mocap_autolabel.clear_corrections()
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")


def dot_of(marker: str) -> tuple[int, int]:
    """Where a marker's empty, on its dot, is in the window."""
    item = next(
        item for item in bpy.context.scene.mocap_autolabel.take.all_objects if item.get("mocap_marker") == marker
    )
    region = window.region("WINDOW")
    view = window.area().spaces.active.region_3d
    x, y = location_3d_to_region_2d(region, view, item.matrix_world.translation)
    return int(region.x + x), int(region.y + y)


def judge() -> Iterator[float]:
    """Press the button and wait for the report."""
    bpy.ops.mocap_autolabel.judge_markers("INVOKE_DEFAULT")
    yield from window.until(lambda: "mocap_quality" in laid_out())


def laid_out() -> bpy.types.Collection:
    """The marker set that is laid out."""
    return next(one for one in bpy.context.scene.collection.children if "mocap_edited_markerset" in one)


def look_at(place: tuple[float, float, float], distance: float, about: float = 65.0) -> None:
    """Turn the 3D view to a place, from a little above, by degrees about the vertical from where -y is in front."""
    view = window.area().spaces.active.region_3d
    view.view_perspective = "PERSP"
    view.view_location = place
    view.view_rotation = Euler((math.radians(72), 0, math.radians(about))).to_quaternion()
    view.view_distance = distance


window.play(steps())
