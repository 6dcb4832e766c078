# SPDX-License-Identifier: GPL-3.0-or-later
"""One frame of a labelled take as a picture: the room, the body and its named markers, and what two cameras saw."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..blendfile import unbroken
from ..core.data.markersets import MarkerSet
from ..core.data.takes import EXCLUSIVE, NO_MARKER, STEPS
from ..core.geometry.cameras import Cameras
from . import room
from .room import Body
from .sheet import Sheet, words_width

PICTURE_STEPS = {"exclusive": (0.25, 0.85, 0.77), "conflict": (0.93, 0.36, 0.83), "remaining": (1.0, 0.72, 0.28)}


@dataclass(frozen=True)
class PictureOptions:
    """The picture's size, view and colours.

    width, height        px
    lens_mm              on a sensor of 36 mm
    eye_distance_m       from the subject to where the view is taken,
    eye_above_m          which is so much above
    look_height_m        the height looked at: above a person's middle, to leave room for cameras under the title
    min_panel_share      of a camera's image that its panel shows, which is cut to the subject
    panels_px            where the panels of the cameras begin; the room has what is left of it
    """

    width: int = 1280
    height: int = 720
    lens_mm: float = 29.0
    eye_distance_m: float = 4.5
    eye_above_m: float = 0.9
    look_height_m: float = 1.25
    min_panel_share: float = 0.3
    panels_px: int = 850
    paper: tuple = (0.045, 0.055, 0.075)
    ink: tuple = (0.93, 0.95, 0.98)
    dim: tuple = (0.56, 0.61, 0.7)
    unnamed: tuple = (0.5, 0.53, 0.6)
    trunk: tuple = (0.98, 0.83, 0.42)
    left_arm: tuple = (0.36, 0.8, 0.98)
    right_arm: tuple = (1.0, 0.55, 0.66)
    left_leg: tuple = (0.5, 0.66, 1.0)
    right_leg: tuple = (1.0, 0.62, 0.36)


PICTURE = PictureOptions()


@dataclass(frozen=True, eq=False)
class Shot:
    """What the picture shows of one frame.

    markers (M, 3) m, NaN where not seen; facing (rad) where the subject looks; camera (N,), xy (N, 2) px, marker (N,)
    and step (N,) are the frame's labelled blobs as in `core.takes`
    """

    cameras: Cameras
    markerset: MarkerSet
    body: Body
    markers: np.ndarray
    facing: float
    camera: np.ndarray
    xy: np.ndarray
    marker: np.ndarray
    step: np.ndarray


def draw(shot: Shot, title: str, subtitle: str, path: Path):
    """Renders the picture of `shot` with its title to `path`, a PNG. Needs bpy; leaves no data behind in it."""
    import bpy

    before = {
        kind: set(getattr(bpy.data, kind))
        for kind in ("objects", "meshes", "curves", "materials", "cameras", "lights", "worlds")
    }
    scene = room.empty_scene(PICTURE.width, PICTURE.height)
    try:
        compose(scene, shot, title, subtitle)
        scene.render.filepath = str(Path(path).resolve())
        with unbroken():
            bpy.ops.render.render(write_still=True, scene=scene.name)
    finally:
        bpy.data.scenes.remove(scene)
        for kind, kept in before.items():
            bpy.data.batch_remove(set(getattr(bpy.data, kind)) - kept)


def compose(scene, shot: Shot, title: str, subtitle: str):
    """Builds the whole picture in `scene`."""
    colours = limb_colours(shot.markerset)
    middle = np.nanmean(shot.markers, axis=0)
    centre = shot.cameras.centres.mean(axis=0)
    room.add_floor(scene, centre[:2], 9.0)
    room.add_cameras(scene, shot.cameras)
    room.add_body(scene, shot.body)
    room.add_markers(scene, shot.markers, colours)
    aim(scene, shot, middle)
    sheet = Sheet(scene, PICTURE.width, PICTURE.height)
    name_markers(sheet, shot, colours, to_pixels(scene, shot.markers))
    name_cameras(sheet, shot.cameras, to_pixels(scene, shot.cameras.centres))
    sheet.box(PICTURE.panels_px - 14, 0, PICTURE.width - PICTURE.panels_px + 14, PICTURE.height, PICTURE.paper, 4)
    left, width = PICTURE.panels_px, PICTURE.width - PICTURE.panels_px - 14
    height = 318
    for row, index in enumerate(two_cameras(shot)):
        draw_panel(sheet, shot, index, left, 34 + row * (height + 24), width, height - 14)
    draw_legend(sheet, left, PICTURE.height - 12)
    sheet.text(26, 42, title, 25, PICTURE.ink)
    sheet.text(26, 66, subtitle, 14.5, PICTURE.dim)
    sheet.build()


def limb_colours(markerset: MarkerSet) -> list:
    """A colour for each marker by the limb that carries it: trunk and head, either arm, either leg."""
    joints = markerset.skeleton.rest_joints
    central = np.abs(joints[:, 1]) < 0.02
    colours = []
    for segment in markerset.attachment:
        if central[segment]:
            colours.append(PICTURE.trunk)
            continue
        top = segment
        while not central[markerset.skeleton.parents[top]]:
            top = markerset.skeleton.parents[top]
        leg = joints[top, 2] < joints[0, 2] + 0.1
        left = joints[top, 1] > 0
        colours.append(
            (PICTURE.left_leg if left else PICTURE.right_leg)
            if leg
            else (PICTURE.left_arm if left else PICTURE.right_arm)
        )
    return colours


def aim(scene, shot: Shot, middle: np.ndarray):
    """Looks at the subject from in front and a little to the side, from the gap between two cameras."""
    ahead = shot.facing + np.radians(np.array([-58, -50, -42, -34, 34, 42, 50, 58]))
    bearing = np.arctan2(*(shot.cameras.centres - middle)[:, 1::-1].T)
    nearest = np.abs((ahead[:, None] - bearing + np.pi) % (2 * np.pi) - np.pi).min(axis=1)
    angle = ahead[np.argmax(nearest)]
    target = np.array([middle[0], middle[1], PICTURE.look_height_m])
    away = PICTURE.eye_distance_m
    eye = target + np.array([away * np.cos(angle), away * np.sin(angle), PICTURE.eye_above_m])
    room.look_at(
        scene, eye, target, PICTURE.lens_mm, ((PICTURE.width - PICTURE.panels_px + 14) / 2 / PICTURE.width, 0.0)
    )


def to_pixels(scene, points: np.ndarray) -> np.ndarray:
    """(N, 2) px where the render camera sees world points (N, 3) m; NaN behind it."""
    from mathutils import Matrix

    view, lens = scene.camera, scene.camera.data
    world = np.array(Matrix.LocRotScale(view.location, view.rotation_euler, None).inverted())
    local = points @ world[:3, :3].T + world[:3, 3]
    depth = np.where(local[:, 2] < -0.05, -local[:, 2], np.nan)
    scale = lens.lens / lens.sensor_width * PICTURE.width
    return np.stack(
        [
            local[:, 0] / depth * scale + PICTURE.width / 2 - lens.shift_x * PICTURE.width,
            PICTURE.height / 2 - local[:, 1] / depth * scale + lens.shift_y * PICTURE.width,
        ],
        axis=1,
    )


def name_markers(sheet: Sheet, shot: Shot, colours: list, pixels: np.ndarray):
    """The markers' names in a column on either side of the body, each with a line to its marker."""
    seen = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    order = seen[np.argsort(pixels[seen, 0])]
    half = (len(order) + 1) // 2
    left_edge, right_edge = pixels[seen, 0].min() - 74, pixels[seen, 0].max() + 74
    for column, edge, align, way in ((order[:half], left_edge, "RIGHT", 1), (order[half:], right_edge, "LEFT", -1)):
        column = column[np.argsort(pixels[column, 1])]
        for marker, height in zip(column, spread_out(pixels[column, 1], 19.5, 100, PICTURE.height - 40), strict=True):
            colour = colours[marker]
            sheet.text(edge - way * 6, height + 5, shot.markerset.markers[marker], 15, colour, align=align)
            knee = (edge + way * 20, height)
            sheet.line((edge, height), knee, 1.1, (*colour, 0.75), 2)
            sheet.line(knee, pixels[marker], 1.1, (*colour, 0.45), 2)


def spread_out(heights: np.ndarray, gap: float, top: float, bottom: float) -> np.ndarray:
    """Heights (N,) in ascending order, moved to at least `gap` while staying near and within the two ends."""
    placed = np.array(heights, dtype=float)
    for _ in range(200):
        push = np.maximum(gap - np.diff(placed), 0) / 2
        if not push.any():
            break
        placed[:-1] -= push
        placed[1:] += push
        placed = np.clip(placed, top, bottom)
    return placed


def name_cameras(sheet: Sheet, cameras: Cameras, pixels: np.ndarray):
    """Each camera's name above it, where it is in the picture."""
    for name, (x, y) in zip(cameras.names, pixels, strict=True):
        if np.isfinite(x) and 30 < x < PICTURE.panels_px - 40 and 90 < y < PICTURE.height - 10:
            half = words_width(name, 13) / 2
            sheet.box(x - half - 4, y - 34, 2 * half + 8, 17, (*PICTURE.paper, 0.8), 1)
            sheet.text(x, y - 21, name, 13, room.ROOM_LOOK.camera, 2, "CENTER")


def two_cameras(shot: Shot) -> list[int]:
    """The camera with the most to show, and of those that look from elsewhere the one with the next most.

    A blob that was in conflict or remained shows more than one that was clear.
    """
    count = len(shot.cameras)
    worth = np.where(shot.marker == NO_MARKER, 0.0, np.where(shot.step == EXCLUSIVE, 1.0, 5.0))
    worth = np.bincount(shot.camera, worth, minlength=count)
    first = int(np.argmax(worth))
    look = shot.cameras.rotation[:, 2]
    worth[look @ look[first] > 0.5] = -1
    worth[first] = -1
    return [first, int(np.argmax(worth))] if count > 1 else [first]


def draw_panel(sheet: Sheet, shot: Shot, index: int, left: float, top: float, width: float, height: float):
    """What one camera saw: the body's outline, the blobs in the colour of their step, and their names."""
    camera = shot.cameras.select([index])
    shapes = outlines(camera, shot.body)
    mine = shot.camera == index
    first, last = window(np.vstack(shapes or [shot.xy[mine]]), shot.cameras.size[index], width / height)
    scale = width / (last - first)[0]
    corner = np.array([left, top])
    sheet.box(left, top, width, height, (0.085, 0.1, 0.13), 5)
    named = mine & (shot.marker != NO_MARKER)
    sheet.text(left + 1, top - 8, shot.cameras.names[index], 14.5, PICTURE.ink)
    counts = f"{np.count_nonzero(named)} of {np.count_nonzero(mine)} blobs named"
    sheet.text(left + width, top - 8, counts, 13, PICTURE.dim, align="RIGHT")
    for outline in shapes:
        clipped = clip(outline, first, last)
        if len(clipped) > 2:
            sheet.polygon(corner + (clipped - first) * scale, (0.15, 0.18, 0.235), 6)
    mine &= ((shot.xy >= first) & (shot.xy <= last)).all(axis=1)
    spots = corner + (shot.xy - first) * scale
    taken = [box_around(spot, 3.5) for spot in spots[mine]]
    bounds = (left, top, left + width, top + height)
    for blob in np.flatnonzero(mine):
        if shot.marker[blob] == NO_MARKER:
            sheet.ring(spots[blob], 3.4, 1.2, PICTURE.unnamed, 7)
            continue
        colour = PICTURE_STEPS[STEPS[shot.step[blob]]]
        sheet.disc(spots[blob], 3.2, colour, 8)
        name = shot.markerset.markers[shot.marker[blob]]
        place = free_place(spots[blob], words_width(name, 11), taken, bounds)
        if place is not None:
            taken.append(place)
            sheet.text(place[0], place[3] - 2, name, 11, colour)


def outlines(camera: Cameras, body: Body) -> list[np.ndarray]:
    """The outline (N, 2) px of every capsule as one camera sees it, from the balls at its ends."""
    found = []
    depth_axis = camera.rotation[0, 2]
    focal = camera.focal[0]
    for start, end, radius in zip(body.start, body.end, body.radius, strict=True):
        steps = np.linspace(start, end, 6)
        depth = steps @ depth_axis + camera.translation[0, 2]
        if (depth < 0.2).any():
            continue
        pixels = camera.project(steps)[0]
        turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        rim = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        cloud = (pixels[:, None] + (focal * radius / depth)[:, None, None] * rim).reshape(-1, 2)
        if np.isfinite(cloud).all():
            found.append(hull(cloud))
    return found


def hull(points: np.ndarray) -> np.ndarray:
    """The convex hull of points (N, 2), corners in order (Andrew's monotone chain)."""
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]

    def half(row):
        chain: list[np.ndarray] = []
        for point in row:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0:
                chain.pop()
            chain.append(point)
        return chain[:-1]

    return np.array(half(ordered) + half(ordered[::-1]))


def window(points: np.ndarray, size: np.ndarray, shape: float) -> tuple[np.ndarray, np.ndarray]:
    """First and last corner px of the part of an image that holds the points, `shape` times as wide as it is high."""
    low, high = np.clip(points.min(axis=0), 0, size), np.clip(points.max(axis=0), 0, size)
    reach = 1.2 * (high - low)
    height = np.clip(max(reach[1], reach[0] / shape), PICTURE.min_panel_share * size[1], size[1])
    middle = (low + high) / 2
    half = np.array([height * shape, height]) / 2
    return middle - half, middle + half


def clip(polygon: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """The part (N, 2) of a convex polygon between two corners of an image (Sutherland and Hodgman)."""
    for axis, sign, limit in ((0, 1, first[0]), (0, -1, -last[0]), (1, 1, first[1]), (1, -1, -last[1])):
        kept = []
        for point, following in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            inside, next_inside = sign * point[axis] - limit, sign * following[axis] - limit
            if inside >= 0:
                kept.append(point)
            if inside * next_inside < 0:
                kept.append(point + (following - point) * inside / (inside - next_inside))
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def box_around(spot: np.ndarray, reach: float) -> tuple[float, float, float, float]:
    """left, top, right, bottom of a square about a spot."""
    return spot[0] - reach, spot[1] - reach, spot[0] + reach, spot[1] + reach


def free_place(spot, width: float, taken: list, bounds):
    """The first place about `spot` where a name of `width` px covers nothing in `taken`; None when there is none."""
    x, y = spot
    for left, top in ((x + 5, y - 6), (x - 5 - width, y - 6), (x - width / 2, y - 17), (x - width / 2, y + 5)):
        place = (left, top, left + width, top + 12)
        inside = place[0] >= bounds[0] and place[1] >= bounds[1] and place[2] <= bounds[2] and place[3] <= bounds[3]
        if inside and not any(_overlap(place, other) for other in taken):
            return place
    return None


def draw_legend(sheet: Sheet, left: float, baseline: float):
    """What the colours in the panels mean."""
    x = left + 2.0
    for word, colour in [*PICTURE_STEPS.items(), ("unnamed", None)]:
        if colour:
            sheet.disc((x + 4, baseline - 5), 4, colour, 8)
        else:
            sheet.ring((x + 4, baseline - 5), 3.6, 1.3, PICTURE.unnamed, 8)
        sheet.text(x + 13, baseline, word, 13.5, PICTURE.dim)
        x += 108


def _turn(a, b, c) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _overlap(a, b) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
