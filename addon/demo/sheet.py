# SPDX-License-Identifier: GPL-3.0-or-later
"""A flat drawing in pixels, held up in front of a scene's render camera: what Cycles needs to write words on a picture.

Pixels count from the top left corner of the picture, x to the right and y down.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class SheetOptions:
    """How a drawing hangs before the camera.

    distance_m    of the lowest layer
    layer_step_m  by which the next is nearer
    corners       of a circle
    letter_width  of an average letter of Blender's built-in font, in units of its size
    """

    distance_m: float = 0.5
    layer_step_m: float = 0.002
    corners: int = 20
    letter_width: float = 0.64


SHEET = SheetOptions()


class Sheet:
    """Collects shapes and words; `build` turns them into objects that hang in front of the camera.

    A higher layer is nearer to the camera. A colour is (r, g, b) or (r, g, b, a), 0 to 1, as it is to look on screen.
    """

    def __init__(self, scene, width: int, height: int):
        self.scene, self.width, self.height = scene, width, height
        self.shapes: dict[tuple, list[np.ndarray]] = {}
        self.words: list[tuple] = []

    def polygon(self, corners, colour, layer: int = 0):
        """A filled convex polygon with corners (N, 2) px."""
        self.shapes.setdefault((tuple(colour), layer), []).append(np.asarray(corners, dtype=float))

    def box(self, left: float, top: float, width: float, height: float, colour, layer: int = 0):
        """A filled rectangle."""
        right, bottom = left + width, top + height
        self.polygon([(left, top), (right, top), (right, bottom), (left, bottom)], colour, layer)

    def disc(self, centre, radius: float, colour, layer: int = 0):
        """A filled circle."""
        self.polygon(np.asarray(centre) + radius * _circle(), colour, layer)

    def ring(self, centre, radius: float, thickness: float, colour, layer: int = 0):
        """A circle's outline."""
        rim = np.asarray(centre) + radius * np.vstack([_circle(), _circle()[:1]])
        for start, end in pairwise(rim):
            self.line(start, end, thickness, colour, layer)

    def line(self, start, end, thickness: float, colour, layer: int = 0):
        """A straight line."""
        start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        length = np.hypot(*(end - start))
        if length < 1e-6:
            return
        side = np.array([start[1] - end[1], end[0] - start[0]]) / length * thickness / 2
        self.polygon([start + side, end + side, end - side, start - side], colour, layer)

    def text(self, x: float, y: float, words: str, size: float, colour, layer: int = 9, align: str = "LEFT"):
        """Words on a baseline at y; `align` is LEFT, CENTER or RIGHT of x."""
        self.words.append((x, y, words, size, tuple(colour), layer, align))

    def build(self):
        """Makes the objects, children of the scene's camera."""
        import bpy

        materials: dict[tuple, object] = {}

        def paint(colour):
            if colour not in materials:
                materials[colour] = flat_material(bpy, colour)
            return materials[colour]

        for (colour, layer), polygons in self.shapes.items():
            self._add(bpy, self._mesh(bpy, polygons, layer), paint(colour))
        for x, y, words, size, colour, layer, align in self.words:
            text = self._add(bpy, self._text(bpy, words, size, align), paint(colour))
            text.location = self._place(x, y, layer)
            # Letters a hundredth of a metre high lose their corners when they are filled, so they are made large first.
            text.scale = [self._scale(layer)[1]] * 3

    def _scale(self, layer: int) -> tuple[float, float]:
        """Distance of a layer from the camera and the size of a pixel there, m."""
        lens = self.scene.camera.data
        distance = SHEET.distance_m - layer * SHEET.layer_step_m
        return distance, distance * lens.sensor_width / lens.lens / self.width

    def _place(self, x, y, layer: int) -> np.ndarray:
        """(..., 3) a pixel in the camera's axes."""
        distance, pixel = self._scale(layer)
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        lens = self.scene.camera.data
        right = x - self.width / 2 + lens.shift_x * self.width
        up = self.height / 2 - y + lens.shift_y * self.width
        return np.stack([right * pixel, up * pixel, np.full_like(x, -distance)], axis=-1)

    def _mesh(self, bpy, polygons: list[np.ndarray], layer: int):
        corners = np.concatenate(polygons)
        ends = np.cumsum([len(polygon) for polygon in polygons])
        faces = [range(end - len(polygon), end) for end, polygon in zip(ends, polygons, strict=True)]
        mesh = bpy.data.meshes.new("shape")
        mesh.from_pydata(self._place(corners[:, 0], corners[:, 1], layer).tolist(), [], [list(face) for face in faces])
        return mesh

    def _text(self, bpy, words: str, size: float, align: str):
        curve = bpy.data.curves.new("words", "FONT")
        curve.body, curve.align_x = words, align
        curve.size = size
        curve.resolution_u = 2
        return curve

    def _add(self, bpy, data, material):
        data.materials.append(material)
        thing = bpy.data.objects.new(data.name, data)
        thing.parent = self.scene.camera
        thing.visible_shadow = thing.visible_diffuse = thing.visible_glossy = False
        self.scene.collection.objects.link(thing)
        return thing


def words_width(words: str, size: float) -> float:
    """Roughly how many pixels the words take."""
    return SHEET.letter_width * size * len(words)


def linear(colour) -> tuple[float, float, float]:
    """The light that looks like `colour` on a screen (the sRGB curve)."""
    return tuple(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour[:3])


def flat_material(bpy, colour):
    """A material that looks like `colour` whatever the light; a fourth number is its opacity."""
    material = bpy.data.materials.new("flat")
    nodes, links = new_nodes(material)
    glow = nodes.new("ShaderNodeEmission")
    glow.inputs["Color"].default_value = (*linear(colour), 1)
    output = nodes.new("ShaderNodeOutputMaterial")
    surface = glow.outputs[0]
    if len(colour) == 4:
        mix = nodes.new("ShaderNodeMixShader")
        mix.inputs[0].default_value = colour[3]
        links.new(nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
        links.new(surface, mix.inputs[2])
        surface = mix.outputs[0]
    links.new(surface, output.inputs["Surface"])
    return material


def new_nodes(material):
    """The empty node tree of a material: its nodes and its links."""
    if not material.node_tree:
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material.node_tree.nodes, material.node_tree.links


def _circle() -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, SHEET.corners, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
