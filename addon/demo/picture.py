# SPDX-License-Identifier: GPL-3.0-or-later
"""One frame of a labelled take as an SVG picture: the room, the body, and what two cameras saw.

Pixels count from the top left corner of the picture, x to the right and y down.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..blendfile import Chunks
from ..core.data.markersets import MarkerSet
from ..core.data.takes import EXCLUSIVE, NO_MARKER, Labels, Motion
from ..core.geometry.cameras import Cameras
from ..core.review.suspects import runs
from ..io.html.markup import Html, element

LETTER_WIDTH = 0.64  # of an average letter, in units of its size
PICTURE_WIDTH, PICTURE_HEIGHT = 1280, 720  # px
PANELS = 850  # px, where the panels of the cameras begin; what is left of it is the room's
PAPER, PANE, GRID, BODY = "#13161d", "#0b0e13", "#2b3342", "#3d475c"
INK, DIM, CAMERA_COLOUR = "#edf2fa", "#8f9cb3", "#b8c7e0"
TRUNK_COLOUR = "#fad46b"
ARM_COLOURS, LEG_COLOURS = ("#ff8ca8", "#5cccfa"), ("#ff9e5c", "#80a8ff")  # right, left


class Sheet:
    """Collects shapes, what is drawn later in front, and words in front of them all."""

    def __init__(self):
        self.shapes: list[Html] = []
        self.words: list[Html] = []

    def rectangle(self, x: float, width: float, colour: str):
        """A filled rectangle as high as the picture."""
        self.shapes.append(element("rect", x=x, width=width, height=PICTURE_HEIGHT, fill=colour))

    def disc(self, centre: np.ndarray, radius: float, colour: str):
        """A filled circle."""
        x, y = np.round(centre, 1).tolist()
        self.shapes.append(element("circle", cx=x, cy=y, r=round(radius, 1), fill=colour))

    def lines(self, points, colour: str, thickness: float = 1.2):
        """Straight lines with round ends from each of the points (N, 2) px to the next."""
        way = "L".join(f"{x:.1f} {y:.1f}" for x, y in np.asarray(points, dtype=float).tolist())
        self.shapes.append(element("path", d=f"M{way}", stroke=colour, stroke_width=f"{thickness:.1f}"))

    def text(self, x: float, y: float, words: str, size: float, colour: str, anchor: str = "start"):
        """Words on a baseline at y; `anchor` is start, middle or end, which of them is at x."""
        place = {"x": round(float(x), 1), "y": round(float(y), 1), "font_size": size, "text_anchor": anchor}
        self.words.append(element("text", words, fill=colour, **place))

    def write(self, path: Path):
        """Writes the drawing."""
        whole = element(
            "svg",
            element("g", *self.shapes, fill="none", stroke_linecap="round", stroke_linejoin="round"),
            element("g", *self.words, font_family="system-ui, sans-serif"),
            xmlns="http://www.w3.org/2000/svg",
            viewBox=f"0 0 {PICTURE_WIDTH} {PICTURE_HEIGHT}",
        )
        path.write_text(whole + "\n", encoding="utf-8", newline="\n")


@dataclass(frozen=True, eq=False)
class Shot:
    """What the picture shows: a frame of a motion, by its index, and the labelled blobs of it.

    camera (N,) index of the camera of each blob, xy (N, 2) px
    """

    cameras: Cameras
    markerset: MarkerSet
    motion: Motion
    index: int
    camera: np.ndarray
    xy: np.ndarray
    labels: Labels

    @property
    def ahead(self) -> np.ndarray:
        """(3,) where the subject looks."""
        return self.motion.rotations[self.index, 0, :, 0]

    @property
    def capsules(self) -> Iterable[tuple[np.ndarray, np.ndarray, float]]:
        """The body's in the world: start and end (3,) m, and radius m."""
        capsules, scale = self.markerset.capsules, self.motion.scale[self.index]
        turn, joints = (part[self.index, capsules.segment] for part in (self.motion.rotations, self.motion.joints))
        ends = (joints + (turn @ (end * scale)[..., None])[..., 0] for end in (capsules.start, capsules.end))
        return zip(*ends, capsules.radius * scale.mean(), strict=True)


def draw(shot: Shot, title: str, subtitle: str, path: Path):
    """Draws the picture of `shot` with its title to `path`."""
    sheet = Sheet()
    sheet.rectangle(0, PICTURE_WIDTH, PAPER)
    colours = limb_colours(shot.markerset)
    draw_room(sheet, shot, colours)
    sheet.rectangle(PANELS - 14, PICTURE_WIDTH - PANELS + 14, PANE)
    for row, index in enumerate(two_cameras(shot)):
        draw_panel(sheet, shot, index, colours, np.array([PANELS, 34.0 + 342 * row]), np.array([416.0, 304.0]))
    sheet.text(26, 42, title, 25, INK)
    sheet.text(26, 66, subtitle, 14.5, DIM)
    sheet.write(path)


def limb_colours(markerset: MarkerSet) -> list[str]:
    """A colour for each marker by the limb that carries it: trunk and head, either arm, either leg."""
    joints, parents = markerset.skeleton.rest_joints, markerset.skeleton.parents
    central = np.abs(joints[:, 1]) < 0.02
    colours = []
    for segment in markerset.attachment:
        top = segment
        while not central[top] and not central[parents[top]]:
            top = parents[top]
        limb = LEG_COLOURS if joints[top, 2] < joints[0, 2] + 0.1 else ARM_COLOURS
        colours.append(TRUNK_COLOUR if central[segment] else limb[int(joints[top, 1] > 0)])
    return colours


def view_of(shot: Shot) -> Cameras:
    """A camera that looks at the subject from in front and a little to the side, from the gap between two cameras."""
    middle = np.nanmean(shot.motion.markers[shot.index], axis=0)
    ahead = np.arctan2(shot.ahead[1], shot.ahead[0]) + np.radians(np.array([-58, -50, -42, -34, 34, 42, 50, 58]))
    bearing = np.arctan2(*(shot.cameras.centres - middle)[:, 1::-1].T)
    angle = ahead[np.abs((ahead[:, None] - bearing + np.pi) % (2 * np.pi) - np.pi).min(axis=1).argmax()]
    away = np.array([4.5 * np.cos(angle), 4.5 * np.sin(angle), 0.9])
    depth = -away / np.linalg.norm(away)
    right = np.cross(depth, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(depth, right), depth])
    eye = np.array([middle[0], middle[1], 1.05]) + away
    matrix = np.array([[1030.0, 0, PANELS / 2], [0, 1030.0, PICTURE_HEIGHT / 2], [0, 0, 1]])
    size = np.array([[PANELS, PICTURE_HEIGHT]])
    return Cameras(("view",), size, matrix[None], np.zeros((1, 5)), rotation[None], -(rotation @ eye)[None])


def draw_room(sheet: Sheet, shot: Shot, colours: list[str]):
    """A floor with a grid of 1 m, the cameras as pyramids on stands, the body, and its markers with their names."""
    view = view_of(shot)
    x, y = np.round(shot.cameras.centres.mean(axis=0)[:2])
    along = np.linspace(-9, 9, 73)
    for step in range(-9, 10):
        flat, across = np.stack([x + along, np.full(73, y + step)]), np.stack([np.full(73, x + step), y + along])
        for line in (flat, across):
            _lines(sheet, view, np.vstack([line, np.zeros(73)]).T, GRID)
    for index, name in enumerate(shot.cameras.names):
        corners = pyramid(shot.cameras, index, 0.28)
        _lines(sheet, view, [corners[0], corners[0] * [1, 1, 0]], BODY)
        _lines(sheet, view, corners[[1, 2, 3, 4, 1, 0, 2, 0, 3, 0, 4]], CAMERA_COLOUR)
        [[(u, v)]] = view.project(corners[:1])
        if 30 < u < PANELS - 40 and 110 < v < PICTURE_HEIGHT - 10:
            sheet.text(u, v - 21, name, 13, CAMERA_COLOUR, "middle")
    draw_limbs(sheet, limbs(view, shot))
    pixels = view.project(shot.motion.markers[shot.index])[0]
    seen = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    for index in seen.tolist():
        sheet.disc(pixels[index], 4.5, colours[index])
    order = seen[np.argsort(pixels[seen, 0])]
    half = (len(order) + 1) // 2
    edges = pixels[seen, 0].min() - 74, pixels[seen, 0].max() + 74
    for column, edge, anchor, way in ((order[:half], edges[0], "end", 1), (order[half:], edges[1], "start", -1)):
        column = column[np.argsort(pixels[column, 1])]
        for marker, height in zip(column, np.linspace(110, PICTURE_HEIGHT - 40, len(column)), strict=True):
            sheet.text(edge - way * 6, height + 5, shot.markerset.markers[marker], 15, colours[marker], anchor)
            sheet.lines([(edge, height), (edge + way * 20, height), pixels[marker]], colours[marker], 0.7)


def draw_panel(sheet: Sheet, shot: Shot, index: int, colours: list[str], corner: np.ndarray, size: np.ndarray):
    """What one camera saw about the subject: the body's outline, the blobs in their markers' colours, and names."""
    mine = shot.camera == index
    named = mine & shot.labels.named
    shapes = limbs(shot.cameras.select([index]), shot)
    about = np.vstack([*(places for places, _ in shapes), shot.xy[named]])
    low, high = about.min(axis=0), about.max(axis=0)
    scale = (size / (high - low)).min() * 0.8
    shift = corner + size / 2 - scale * (low + high) / 2
    draw_limbs(sheet, [(shift + scale * places, scale * radii) for places, radii in shapes])
    spots = shift + scale * shot.xy
    for blob in np.flatnonzero(mine & ((spots > corner) & (spots < corner + size)).all(axis=1)).tolist():
        marker, right = shot.labels.marker[blob], corner[0] + size[0]
        sheet.disc(spots[blob], 3.2, DIM if marker == NO_MARKER else colours[marker])
        name = "" if marker == NO_MARKER else shot.markerset.markers[marker]
        if name and spots[blob, 0] + LETTER_WIDTH * 10 * len(name) < right:
            sheet.text(spots[blob, 0] + 5, spots[blob, 1] + 4, name, 10, colours[marker])
    sheet.text(corner[0], corner[1] - 8, shot.cameras.names[index], 14.5, INK)
    counts = f"{np.count_nonzero(named)} of {np.count_nonzero(mine)} blobs named"
    sheet.text(corner[0] + size[0], corner[1] - 8, counts, 13, DIM, "end")


def two_cameras(shot: Shot) -> list[int]:
    """The camera with the most to show, and of those that look from elsewhere the one with the next most.

    A blob that was in conflict or remained shows more than one that was clear.
    """
    worth = np.where(shot.labels.named, np.where(shot.labels.step == EXCLUSIVE, 1.0, 5.0), 0.0)
    worth = np.bincount(shot.camera, worth, minlength=len(shot.cameras))
    first = int(np.argmax(worth))
    look = shot.cameras.rotation[:, 2]
    worth[look @ look[first] > 0.5] = -1
    return [first, int(np.argmax(worth))]


def limbs(camera: Cameras, shot: Shot) -> list[tuple[np.ndarray, np.ndarray]]:
    """Places (6, 2) px along every capsule as one camera sees it, and its radius (6,) px there."""
    found = []
    for start, end, radius in shot.capsules:
        steps = np.linspace(start, end, 6)
        depth = steps @ camera.rotation[0, 2] + camera.translation[0, 2]
        pixels = camera.project(steps)[0]
        if (depth > 0.2).all() and np.isfinite(pixels).all():
            found.append((pixels, camera.focal[0] * radius / depth))
    return found


def draw_limbs(sheet: Sheet, shapes: list[tuple[np.ndarray, np.ndarray]]):
    """The body as thick lines with round ends."""
    for places, radii in shapes:
        for pair, radius in zip(pairwise(places), radii[1:], strict=True):
            sheet.lines(pair, BODY, 2 * radius)


def pyramid(cameras: Cameras, index: int, depth: float) -> np.ndarray:
    """(5, 3) m: the centre of a camera and the corners of its image held `depth` m in front of it."""
    width, height = cameras.size[index]
    pixels = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]], dtype=float)
    local = pixels @ np.linalg.inv(cameras.matrix[index]).T * depth
    return np.vstack([cameras.centres[index], (local - cameras.translation[index]) @ cameras.rotation[index]])


def _lines(sheet: Sheet, view: Cameras, points, colour: str):
    """Lines between points (N, 3) m as the view shows them, what is behind it left out."""
    pixels = view.project(np.asarray(points))[0]
    for start, stop in runs((np.abs(pixels) < 5 * PICTURE_WIDTH).all(axis=1)):
        sheet.lines(pixels[start:stop], colour)


def best_shot(cameras: Cameras, markerset: MarkerSet, chunks: Chunks) -> tuple[int, Shot]:
    """The frame with the most markers, of those the one with the widest step; its number and its picture.

    Raises ValueError when no frame has a body.
    """
    best, score = None, -1.0
    for blobs, chunk in chunks:
        scores = _scores(chunk.motion)
        if len(scores) and scores.max() > score:
            best, score = (blobs, chunk, int(np.argmax(scores))), float(scores.max())
    if best is None:
        raise ValueError("nobody was found in any frame")
    blobs, chunk, index = best
    rows = np.flatnonzero(blobs.frame == index)
    of_frame = blobs.camera[rows], blobs.xy[rows], chunk.labels[rows]
    return int(blobs.frames[index]), Shot(cameras, markerset, chunk.motion, index, *of_frame)


def _scores(motion: Motion) -> np.ndarray:
    """(F,) markers seen, and for a tie how far they are from the body's middle, ahead and behind; -1 for nobody."""
    seen = np.isfinite(motion.markers).all(axis=2)
    away = motion.expected - motion.expected.mean(axis=1, keepdims=True)
    reach = np.abs(np.einsum("fmi,fi->fm", away, motion.rotations[:, 0, :, 0])).mean(axis=1)
    return np.where(motion.confidence > 0, seen.sum(axis=1) + np.minimum(np.nan_to_num(reach), 0.99), -1.0)
