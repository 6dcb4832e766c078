# SPDX-License-Identifier: GPL-3.0-or-later
"""Many short words drawn at once: each letter is drawn once into a texture, and words are boxes of it in one buffer.

Blender's own `blf.draw` hands every word to the GPU by itself, and waits: a hundred names would cost a redraw more than
everything else in it.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import blf
import gpu
import numpy as np
from mathutils import Matrix

from .boxes import BOX_CORNERS, box_batch

LETTERS_IN_A_ROW = 32  # letters in a row of the texture

LETTER_VERTEX = """
void main()
{
  at = uv;
  tint = color;
  gl_Position = ModelViewProjectionMatrix * vec4(pos, 0.0, 1.0);
}
"""
LETTER_FRAGMENT = """
void main()
{
  colour = vec4(tint.rgb, tint.a * texture(letters, at).a);
}
"""

# Words, where they begin (px) and their colour.
Word = tuple[str, float, float, tuple[float, float, float, float]]


@dataclass(eq=False)
class Letters:
    """The letters of one size that were needed so far, in a texture that is made anew when another is needed."""

    size: float = 0.0
    places: dict[str, int] = field(default_factory=dict)
    steps: dict[str, float] = field(default_factory=dict)
    cell: tuple[int, int] = (1, 1)
    below: int = 0
    picture: gpu.types.GPUOffScreen | None = None
    shader: gpu.types.GPUShader | None = None

    def width(self, words: str, size: float) -> float:
        """How wide words are, px."""
        self._know(words, size)
        return sum(self.steps[letter] for letter in words)

    def draw(self, words: Iterable[Word], size: float):
        """Draws words of a size, px, in the region's own pixels."""
        words = list(words)
        self._know("".join(text for text, *_ in words), size)
        boxes, places, colours = [], [], []
        for text, x, y, colour in words:
            # Whole pixels, or letters blur.
            left, base = round(x), round(y)
            for letter in text:
                boxes.append((left, base - self.below))
                places.append(self.places[letter])
                colours.append(colour)
                left += self.steps[letter]
        if not boxes:
            return
        self._make_picture()
        self._draw_boxes(np.array(boxes), np.array(places), np.array(colours))

    def forget(self):
        """Lets go of what the GPU has."""
        if self.picture is not None:
            self.picture.free()
        self.picture = self.shader = None

    def _know(self, text: str, size: float):
        """Makes sure of a place in the texture for every letter."""
        if size != self.size:
            self.places.clear()
            self.steps.clear()
            self._drop_picture()
            self.size = size
        for letter in sorted(set(text) - set(self.places)):
            blf.size(0, size)
            self.places[letter] = len(self.places)
            self.steps[letter] = round(blf.dimensions(0, letter + "|")[0] - blf.dimensions(0, "|")[0])
            self._drop_picture()

    def _drop_picture(self):
        if self.picture is not None:
            self.picture.free()
            self.picture = None

    def _make_picture(self):
        """Draws all letters that are known into the texture."""
        if self.picture is not None:
            return
        widest = max(self.steps.values())
        self.cell, self.below = (int(widest) + 4, int(1.6 * self.size) + 2), int(0.4 * self.size) + 1
        rows = (len(self.places) + LETTERS_IN_A_ROW - 1) // LETTERS_IN_A_ROW
        wide, high = LETTERS_IN_A_ROW * self.cell[0], rows * self.cell[1]
        self.picture = gpu.types.GPUOffScreen(wide, high)
        with self.picture.bind(), gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
            gpu.state.active_framebuffer_get().clear(color=(0.0, 0.0, 0.0, 0.0))
            gpu.matrix.load_identity()
            gpu.matrix.load_projection_matrix(pixel_matrix(wide, high))
            gpu.state.blend_set("ALPHA")
            blf.size(0, self.size)
            blf.color(0, 1.0, 1.0, 1.0, 1.0)
            for letter, place in self.places.items():
                blf.position(
                    0,
                    place % LETTERS_IN_A_ROW * self.cell[0] + 1,
                    place // LETTERS_IN_A_ROW * self.cell[1] + self.below,
                    0,
                )
                blf.draw(0, letter)

    def _draw_boxes(self, starts: np.ndarray, places: np.ndarray, colours: np.ndarray):
        if self.shader is None:
            self.shader = letter_shader()
        # A letter may reach a pixel beyond its step to either side.
        ends = starts[:, None] - [1, 0] + BOX_CORNERS * np.array(self.cell)
        cells = np.column_stack([places % LETTERS_IN_A_ROW, places // LETTERS_IN_A_ROW])[:, None] + BOX_CORNERS
        size = np.array([self.picture.width, self.picture.height]) / np.array(self.cell)
        self.shader.bind()
        self.shader.uniform_sampler("letters", self.picture.texture_color)
        tints = np.repeat(colours[:, None], 4, axis=1)
        box_batch(self.shader, pos=ends, uv=cells / size, color=tints).draw(self.shader)


def letter_shader() -> gpu.types.GPUShader:
    """The shader that takes letters from the texture and gives them a colour."""
    info, between = gpu.types.GPUShaderCreateInfo(), gpu.types.GPUStageInterfaceInfo("mocap_autolabel_letter")
    between.smooth("VEC2", "at")
    between.flat("VEC4", "tint")
    info.push_constant("MAT4", "ModelViewProjectionMatrix")
    info.sampler(0, "FLOAT_2D", "letters")
    info.vertex_in(0, "VEC2", "pos")
    info.vertex_in(1, "VEC2", "uv")
    info.vertex_in(2, "VEC4", "color")
    info.vertex_out(between)
    info.fragment_out(0, "VEC4", "colour")
    info.vertex_source(LETTER_VERTEX)
    info.fragment_source(LETTER_FRAGMENT)
    return gpu.shader.create_from_info(info)


def pixel_matrix(wide: int, high: int) -> Matrix:
    """What makes pixels, from the lower left corner, of a picture so wide and high into the GPU's own places."""
    return Matrix(((2 / wide, 0, 0, -1), (0, 2 / high, 0, -1), (0, 0, -1, 0), (0, 0, 0, 1)))
