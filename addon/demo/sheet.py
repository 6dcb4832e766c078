# SPDX-License-Identifier: GPL-3.0-or-later
"""A flat drawing in pixels as a scene before a camera without perspective, which Blender renders to a picture.

Pixels count from the top left corner of the picture, x to the right and y down.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np

from ..blendfile import unbroken

LETTER_WIDTH = 0.64  # of an average letter of Blender's built-in font, in units of its size
_KINDS = ("objects", "meshes", "curves", "materials", "cameras", "worlds")  # of what a drawing is made of
_TURN = np.linspace(0, 2 * np.pi, 24, endpoint=False)
CIRCLE = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)


class Sheet:
    """Collects shapes and words; a higher layer is in front. A colour is (r, g, b), 0 to 1, as it looks on screen."""

    def __init__(self, width: int, height: int, paper: tuple):
        self.width, self.height, self.paper = width, height, paper
        self.shapes: dict[tuple, list[np.ndarray]] = {}
        self.words: list[tuple] = []

    def polygon(self, corners, colour: tuple, layer: int = 0):
        """A filled convex polygon with corners (N, 2) px."""
        self.shapes.setdefault((colour, layer), []).append(np.asarray(corners, dtype=float))

    def disc(self, centre, radius: float, colour: tuple, layer: int = 0):
        """A filled circle."""
        self.polygon(np.asarray(centre) + radius * CIRCLE, colour, layer)

    def lines(self, points, colour: tuple, layer: int = 0, thickness: float = 1.2):
        """Straight lines from each of the points (N, 2) px to the next."""
        for start, end in pairwise(np.asarray(points, dtype=float)):
            length = np.hypot(*(end - start))
            if length > 0:
                side = np.array([start[1] - end[1], end[0] - start[0]]) / length * thickness / 2
                self.polygon([start + side, end + side, end - side, start - side], colour, layer)

    def text(self, x: float, y: float, words: str, size: float, colour: tuple, align: str = "LEFT"):
        """Words on a baseline at y; `align` is LEFT, CENTER or RIGHT of x."""
        self.words.append((x, y, words, size, colour, align))

    def render(self, path: Path):
        """Renders the drawing to `path`, a PNG. Needs bpy; leaves no data behind in it."""
        import bpy

        before = {kind: set(getattr(bpy.data, kind)) for kind in _KINDS}
        scene = bpy.data.scenes.new("Picture")
        try:
            self._build(bpy, scene)
            scene.render.filepath = str(Path(path).resolve())
            with unbroken():
                bpy.ops.render.render(write_still=True, scene=scene.name)
        finally:
            bpy.data.scenes.remove(scene)
            for kind, kept in before.items():
                bpy.data.batch_remove(set(getattr(bpy.data, kind)) - kept)

    def _build(self, bpy, scene):
        view = bpy.data.objects.new("View", bpy.data.cameras.new("View"))
        view.data.type, view.data.ortho_scale = "ORTHO", self.width
        view.location = (self.width / 2, -self.height / 2, 50.0)
        scene.camera = view
        scene.collection.objects.link(view)
        render = scene.render
        render.engine, render.image_settings.file_format = "CYCLES", "PNG"
        render.resolution_x, render.resolution_y, render.resolution_percentage = self.width, self.height, 100
        # Every ray meets a light at once: one bounce, and as many samples as smooth edges need.
        scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", 16, False
        scene.cycles.max_bounces = 0
        scene.view_settings.view_transform = "Standard"
        self.polygon([(0, 0), (self.width, 0), (self.width, self.height), (0, self.height)], self.paper, -1)
        colours = {colour for colour, _ in self.shapes} | {words[4] for words in self.words}
        materials = {colour: _light(bpy, colour) for colour in colours}

        def add(data, colour: tuple):
            data.materials.append(materials[colour])
            thing = bpy.data.objects.new(data.name, data)
            scene.collection.objects.link(thing)
            return thing

        for (colour, layer), polygons in self.shapes.items():
            corners = np.concatenate(polygons) * [1, -1]
            ends = np.cumsum([len(polygon) for polygon in polygons]).tolist()
            faces = [list(range(end - len(one), end)) for end, one in zip(ends, polygons, strict=True)]
            mesh = bpy.data.meshes.new("shape")
            mesh.from_pydata([(x, y, layer) for x, y in corners.tolist()], [], faces)
            add(mesh, colour)
        for x, y, words, size, colour, align in self.words:
            curve = bpy.data.curves.new("words", "FONT")
            curve.body, curve.align_x, curve.size = words, align, size
            add(curve, colour).location = (x, -y, 20.0)


def _light(bpy, colour: tuple):
    """A material that looks like `colour` on a screen (the sRGB curve)."""
    material = bpy.data.materials.new("flat")
    if not material.node_tree:
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    glow = nodes.new("ShaderNodeEmission")
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in colour]
    glow.inputs["Color"].default_value = (*linear, 1)
    material.node_tree.links.new(glow.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material
