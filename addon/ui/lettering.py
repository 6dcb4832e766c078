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

from ..scene.later import redraw, soon
from .boxes import BOX_CORNERS, box_batch, made_shader

LETTERS_IN_A_ROW = 32  # places in a row of the texture, of which each letter has two: its own and its shadow's
USUAL = tuple(map(chr, range(32, 127)))  # drawn into the texture at once: names are mostly made of them
REACH = 2  # px that a letter, or its shadow, may reach beyond its step to either side
MOST_WORDS = 4096  # whose letters' places are kept: names are few, but numbers change with every frame
SHADOW = 0.4  # opacity of each of the letters, a pixel apart, that a shadow is made of
SHADOW_STEPS = tuple((x, y) for x in (-1, 0, 1) for y in (-1, 0, 1))

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
SHADOW_COLOUR = (0.0, 0.0, 0.0, 1.0)


@dataclass(eq=False)
class Letters:
    """The letters of one size that were needed so far, in a texture that is made again when another is needed."""

    size: float = 0.0
    places: dict[str, int] = field(default_factory=dict)
    steps: dict[str, float] = field(default_factory=dict)
    words: dict[str, tuple[np.ndarray, np.ndarray, float]] = field(default_factory=dict)
    cell: tuple[int, int] = (1, 1)
    picture: gpu.types.GPUOffScreen | None = None
    shader: gpu.types.GPUShader | None = None

    def width(self, words: str, size: float) -> float:
        return self._laid_out(words, size)[2]

    def draw(self, words: Iterable[Word], size: float, shadow: bool = False):
        """Draws words of a size, px, in the region's own pixels; with a `shadow` they are read on anything."""
        words = [word for word in words if word[0]]
        if not words:
            return
        parts = [self._laid_out(text, size) for text, *_ in words]
        count = [len(steps) for steps, _, _ in parts]
        # Whole pixels, or letters blur.
        begin = np.round(np.array([(x, y) for _, x, y, _ in words], dtype=float))
        boxes = np.repeat(begin - [0, self._below()], count, axis=0)
        boxes[:, 0] += np.concatenate([steps for steps, _, _ in parts])
        places = 2 * np.concatenate([own for _, own, _ in parts])
        colours = np.repeat(np.array([colour for *_, colour in words], np.float32), count, axis=0)
        if shadow:  # below all letters: none lies on another
            dark = np.broadcast_to(np.array(SHADOW_COLOUR, np.float32), colours.shape) * [1, 1, 1, 0.9]
            boxes, places = np.concatenate([boxes, boxes]), np.concatenate([places + 1, places])
            colours = np.concatenate([dark.astype(np.float32), colours])
        self._make_picture()
        self._draw_boxes(boxes, places, colours)

    def forget(self):
        self._drop_picture()
        self.shader = None

    def _laid_out(self, text: str, size: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Of a word where its letters begin, px, their places in the texture, and how wide it is."""
        if size != self.size:
            for known in (self.places, self.steps, self.words):
                known.clear()
            self._drop_picture()
            self.size = size
        if text not in self.words:
            usual = () if self.places else USUAL
            for letter in sorted({*usual, *text} - set(self.places)):
                blf.size(0, size)
                self.places[letter] = len(self.places)
                self.steps[letter] = round(blf.dimensions(0, letter + "|")[0] - blf.dimensions(0, "|")[0])
                self._drop_picture()
            ends = np.cumsum([0, *(self.steps[letter] for letter in text)])
            if len(self.words) >= MOST_WORDS:
                self.words.clear()
            self.words[text] = ends[:-1], np.array([self.places[letter] for letter in text], int), float(ends[-1])
        return self.words[text]

    def _below(self) -> int:
        """How far a letter's box reaches below its base, px."""
        return int(0.4 * self.size) + 1

    def _drop_picture(self):
        if self.picture is not None:
            self.picture.free()
            self.picture = None

    def _make_picture(self):
        """Draws all letters that are known, and their shadows, into the texture."""
        if self.picture is not None:
            return
        widest = max(self.steps.values())
        self.cell = (int(widest) + 2 * REACH + 2, int(1.6 * self.size) + 2)
        rows = (2 * len(self.places) + LETTERS_IN_A_ROW - 1) // LETTERS_IN_A_ROW
        wide, high = LETTERS_IN_A_ROW * self.cell[0], rows * self.cell[1]
        # With a new picture Blender forgets what it was drawing on, so what is drawn now is drawn once more.
        self.picture = gpu.types.GPUOffScreen(wide, high)
        soon(_draw_again)
        with self.picture.bind(), gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
            gpu.state.active_framebuffer_get().clear(color=(0.0, 0.0, 0.0, 0.0))
            gpu.matrix.load_identity()
            gpu.matrix.load_projection_matrix(pixel_matrix(wide, high))
            gpu.state.blend_set("ALPHA")
            blf.size(0, self.size)
            for letter, place in self.places.items():
                self._draw_letter(letter, 2 * place, 1.0, ((0, 0),))
                self._draw_letter(letter, 2 * place + 1, SHADOW, SHADOW_STEPS)

    def _draw_letter(self, letter: str, place: int, opacity: float, steps: Iterable[tuple[int, int]]):
        blf.color(0, 1.0, 1.0, 1.0, opacity)
        left = place % LETTERS_IN_A_ROW * self.cell[0] + REACH
        base = place // LETTERS_IN_A_ROW * self.cell[1] + self._below()
        for x, y in steps:
            blf.position(0, left + x, base + y, 0)
            blf.draw(0, letter)

    def _draw_boxes(self, starts: np.ndarray, places: np.ndarray, colours: np.ndarray):
        if self.shader is None:
            corners, between = "VEC2 pos, VEC2 uv, VEC4 color", "VEC2 at, @VEC4 tint"
            self.shader = made_shader("letter", LETTER_VERTEX, LETTER_FRAGMENT, corners, between, texture="letters")
        ends = starts[:, None] - [REACH, 0] + BOX_CORNERS * np.array(self.cell)
        cells = np.column_stack([places % LETTERS_IN_A_ROW, places // LETTERS_IN_A_ROW])[:, None] + BOX_CORNERS
        size = np.array([self.picture.width, self.picture.height]) / np.array(self.cell)
        self.shader.bind()
        self.shader.uniform_sampler("letters", self.picture.texture_color)
        tints = np.repeat(colours[:, None], 4, axis=1)
        box_batch(self.shader, pos=ends, uv=cells / size, color=tints).draw(self.shader)


def _draw_again():
    for editor in ("VIEW_3D", "DOPESHEET_EDITOR"):
        redraw(editor)


def pixel_matrix(wide: int, high: int) -> Matrix:
    """What makes pixels, from the lower left corner, of a picture so wide and high into the GPU's own places."""
    return Matrix(((2 / wide, 0, 0, -1), (0, 2 / high, 0, -1), (0, 0, -1, 0), (0, 0, 0, 1)))
