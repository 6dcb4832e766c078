# SPDX-License-Identifier: GPL-3.0-or-later
"""A hand that names blobs through cameras with the tool Label in a real Blender's window, by pointer and keys."""

import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from stage import TASK, Place, asked, corrections, event, module, now, picked, play, set_tool, window

LOST = "RKNE"


def walk(seen: dict) -> Iterator[float]:
    """Install, import, label; lose a marker, name its blobs in two cameras, take that back, place it, label again."""
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.ops.mocap_autolabel.import_cameras(filepath=TASK["cameras"])
    bpy.ops.mocap_autolabel.import_blobs(filepath=TASK["blobs"])
    settings = bpy.context.scene.mocap_autolabel
    settings.subjects.markerset, settings.source.rate, settings.labelling.occlusion = (
        TASK["markerset"],
        60.0,
        "capsules",
    )
    yield from label()
    bpy.context.scene.frame_set(TASK["frame"])
    set_tool()
    bpy.ops.ed.undo_push(message="Labelled")
    seen["cameras"] = cameras_that_see(LOST)
    yield from losing(seen)
    yield from naming(seen)
    yield from picking(seen)
    yield from undoing(seen)
    yield from placing(seen, TASK["frame"] + 12)
    yield from labelling_again(seen, TASK["frame"])


def label() -> Iterator[float]:
    """Press the one button, and wait."""
    before = _rows_of_take()
    bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
    yield from window.until(lambda: _rows_of_take() not in (None, before))
    yield 1


def _rows_of_take() -> int | None:
    """Which table the rows of the take are in: labelling again makes another in the same collection."""
    take = bpy.context.scene.mocap_autolabel.take
    return None if take is None else take["mocap_blobs"].session_uid


def losing(seen: dict) -> Iterator[float]:
    """The marker's name is taken from all of its blobs."""
    look_through(seen["cameras"][0])
    yield 1
    item = empty(LOST)
    bpy.context.view_layer.objects.active = item
    for other in bpy.context.selected_objects:
        other.select_set(False)
    item.select_set(True)
    seen["truth"] = [float(value) for value in item.matrix_world.translation]
    seen["rows"] = {name: row_of(LOST, name) for name in seen["cameras"]}
    yield from window.press("U", *aside())
    seen["lost"] = [corrections(), place_of(LOST)]


def naming(seen: dict) -> Iterator[float]:
    """A blob named by the pie in one camera, and by Quick Label in another."""
    first, second = seen["cameras"][:2]
    place = dot(seen["rows"][first])
    yield from window.click(*place)
    seen["picked"] = picked()
    before = len(corrections())
    yield from window.tap("L", *place)
    yield from window.screenshot("1-pie")
    yield from window.press("FOUR", *place)  # the pie's first piece
    yield from window.until(lambda: len(corrections()) > before)
    seen["in one camera"] = [corrections()[-1], place_of(LOST)]
    bpy.context.scene.mocap_autolabel.scope = "FRAME"  # in other frames the first camera alone has it
    look_through(second)
    yield 1
    place = dot(seen["rows"][second])
    yield from window.press("F", *aside())
    seen["asked"] = asked()
    yield from window.screenshot("2-quick-label")
    named = len(corrections())
    yield from window.click(*place)
    yield from window.until(lambda: len(corrections()) > named)
    yield from window.press("ESC", *aside())
    seen["in two cameras"] = [corrections()[-1], place_of(LOST)]
    yield from window.screenshot("3-named")


def picking(seen: dict) -> Iterator[float]:
    """A blob more, a box, and beside all blobs."""
    other = next(row for row in rows_here() if row not in picked() and apart(row) > 30)
    yield from window.click(*dot(other), shift=True)
    seen["with Shift"] = [other, picked()]
    x, y = dot(other)
    yield from window.drag((x - 14, y - 14), (x + 14, y + 14))
    seen["in a box"] = picked()
    yield from window.click(*aside())
    seen["beside"] = picked()


def undoing(seen: dict) -> Iterator[float]:
    """One step back, and forth."""
    for key, shift in (("undone", False), ("redone", True)):
        for value in ("PRESS", "RELEASE"):
            event("Z", value, aside(), ctrl=True, shift=shift)
            yield 0.5
        yield 1
        seen[key] = [len(corrections()), place_of(LOST)]


def placing(seen: dict, frame: int) -> Iterator[float]:
    """In another frame the marker is put on the ray of its blob in one camera."""
    bpy.context.scene.frame_set(frame)
    camera = seen["cameras"][0]
    look_through(camera)
    yield 1
    row = track_now(seen["rows"][camera])
    place = dot(row)
    yield from window.press("P", *place)
    yield from window.click(*place)
    yield from window.screenshot("4-it-is-here")
    yield from window.press("RET", *place)
    stored, _ = now()
    origin, direction = module("scene.blob_dots").ray_of(stored, row)
    xyz = np.array(place_of(LOST))
    direction = direction / np.linalg.norm(direction)
    seen["off the ray"] = float(np.linalg.norm(np.cross(xyz - origin, direction)))
    seen["placed"] = [corrections()[-1], xyz.tolist(), expected(LOST)]


def labelling_again(seen: dict, frame: int) -> Iterator[float]:
    """What was said holds in what is labelled anew."""
    yield from label()
    bpy.context.scene.frame_set(frame)
    yield 1
    seen["labelled again"] = [len(corrections()), place_of(LOST)]
    yield from window.screenshot("5-again")


def empty(marker: str) -> bpy.types.Object:
    return next(one for one in bpy.context.scene.mocap_autolabel.take.all_objects if one.get("mocap_marker") == marker)


def place_of(marker: str) -> list[float] | None:
    """Where a marker is in the current frame; None where nothing says so."""
    stored, index = now()
    xyz = stored.motion.markers[index, stored.names.index(marker)]
    return [float(value) for value in xyz] if np.isfinite(xyz).all() else None


def expected(marker: str) -> list[float]:
    """Where the body has a marker in the current frame."""
    stored, index = now()
    return [float(value) for value in stored.motion.expected[index, stored.names.index(marker)]]


def cameras_that_see(marker: str) -> list[str]:
    """The cameras that have a blob of a marker now, and in the frames that come."""
    stored, index = now()
    found = []
    for camera, name in enumerate(stored.cameras.names):
        own = (stored.labels.marker == stored.names.index(marker)) & (stored.rows.camera == camera)
        if {index, index + 12} <= set(stored.rows.frame[own].tolist()):
            found.append(name)
    return found


def row_of(marker: str, camera: str) -> int:
    """The row of a marker's blob in a camera."""
    stored, index = now()
    rows = module("scene.blob_dots").rows_of_image(stored, index, stored.cameras.names.index(camera))
    return int(rows[stored.labels.marker[rows] == stored.names.index(marker)][0])


def track_now(row: int) -> int:
    """The row of a blob's track in the current frame."""
    stored, index = now()
    scene = bpy.context.scene
    tracks = module("scene.opened").opened.tracks(scene.mocap_autolabel.take, scene)
    return module("scene.blob_dots").rows_now(stored, tracks, [row], index)[0]


def dots_now():
    """The dots of the view, and where they are in its region."""
    stored, _ = now()
    return module("ops.picking").dots_in_view(bpy.context, stored, window.area())


def rows_here() -> list[int]:
    return dots_now()[0].trajectory.tolist()


def apart(row: int) -> float:
    """How far a dot is from the nearest other one, px."""
    dots, places = dots_now()
    off = np.hypot(*(places - places[dots.trajectory == row][0]).T)
    return float(np.sort(off)[1])


def dot(row: int) -> Place:
    """Where a blob's dot is in the window."""
    dots, places = dots_now()
    x, y = places[dots.trajectory == row][0]
    region = window.region("WINDOW")
    return round(region.x + x), round(region.y + y)


def aside() -> Place:
    """A place in the view that is beside all dots, toolbar and sidebar."""
    _, places = dots_now()
    region = window.region("WINDOW")
    for x in range(120, region.width - 350, 40):
        for y in range(120, region.height - 120, 40):
            if np.nanmin(np.hypot(*(places - (x, y)).T)) > 60:
                return region.x + x, region.y + y
    raise LookupError("dots are everywhere")


def look_through(camera: str):
    """Look through a camera, as its button does."""
    item = next(one for one in bpy.data.objects if one.type == "CAMERA" and one.get("mocap_camera") == camera)
    bpy.context.scene.camera = item
    window.area().spaces.active.region_3d.view_perspective = "CAMERA"


play(walk)
