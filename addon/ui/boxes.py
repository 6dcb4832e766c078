# SPDX-License-Identifier: GPL-3.0-or-later
"""Many boxes and round dots handed to the GPU at once, and the shaders that draw them."""

from dataclasses import dataclass

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

# Of a box that is 1 wide and 1 high, in the order in which its corners are given.
BOX_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)


def box_batch(shader: gpu.types.GPUShader, **attributes: np.ndarray) -> gpu.types.GPUBatch:
    """N boxes as two triangles each; what a shader is told of every corner is (N, 4, C), by its name there."""
    count = len(next(iter(attributes.values())))
    faces = (4 * np.arange(count)[:, None] + [0, 1, 2, 0, 2, 3]).reshape(-1, 3).astype(np.int32)
    # Rows one after the other, as the GPU reads them, however they lie: what is broadcast lies otherwise.
    content = {
        name: np.ascontiguousarray(values.reshape(-1, values.shape[-1]), np.float32)
        for name, values in attributes.items()
    }
    return batch_for_shader(shader, "TRIS", content, indices=faces)


def made_shader(
    name: str, vertex: str, fragment: str, corners: str, between: str, constants: str = "", texture: str = ""
) -> gpu.types.GPUShader:
    """A shader of its sources; what it is told of each corner, and a vertex tells of each fragment, as in "VEC2 at".

    With a `@` before it that is the same all over a triangle. Constants come beside the matrix that Blender sets.
    """
    info, passed = gpu.types.GPUShaderCreateInfo(), gpu.types.GPUStageInterfaceInfo(f"mocap_autolabel_{name}")
    for kind, word in (one.split() for one in between.split(", ")):
        (passed.flat if kind[0] == "@" else passed.smooth)(kind.lstrip("@"), word)
    for kind, word in (
        one.split() for one in ("MAT4 ModelViewProjectionMatrix, " + constants).rstrip(", ").split(", ")
    ):
        info.push_constant(kind, word)
    if texture:
        info.sampler(0, "FLOAT_2D", texture)
    for place, (kind, word) in enumerate(one.split() for one in corners.split(", ")):
        info.vertex_in(place, kind, word)
    info.vertex_out(passed)
    info.fragment_out(0, "VEC4", "colour")
    info.vertex_source(vertex)
    info.fragment_source(fragment)
    return gpu.shader.create_from_info(info)


SOFT = 1.0  # px over which an edge fades

DISC_VERTEX = """
void main()
{
  at = corner * (radii.x + radii.y + 1.0);
  ends = radii;
  tint = color;
  gl_Position = ModelViewProjectionMatrix * vec4(pos + at, 0.0, 1.0);
}
"""
DISC_FRAGMENT = f"""
void main()
{{
  float away = length(at);
  float filled = clamp((ends.x - away) / {SOFT} + 0.5, 0.0, 1.0);
  float whole = clamp((ends.x + ends.y - away) / {SOFT} + 0.5, 0.0, 1.0);
  if (ends.y <= 0.0) {{ colour = vec4(tint.rgb, tint.a * whole); }}
  else {{ colour = vec4(mix(vec3(0.02), tint.rgb, filled), mix(1.0, tint.a, filled) * whole); }}
}}
"""


@dataclass(eq=False)
class Discs:
    """What draws dots; its shader is made when it is needed first."""

    shader: gpu.types.GPUShader | None = None

    def draw(self, centres: np.ndarray, colours: np.ndarray, radii: np.ndarray):
        """Dots around centres (N, 2) px in colours (N, 4): radii (N, 2) px of the colour, and how wide the rim is."""
        if self.shader is None:
            corners, between = "VEC2 pos, VEC2 corner, VEC2 radii, VEC4 color", "VEC2 at, @VEC2 ends, @VEC4 tint"
            self.shader = made_shader("disc", DISC_VERTEX, DISC_FRAGMENT, corners, between)
        shape = (len(centres), 4, 2)
        of_corners = {
            "pos": np.broadcast_to(centres[:, None], shape),
            "corner": np.broadcast_to(2 * BOX_CORNERS - 1, shape),
            "radii": np.broadcast_to(radii[:, None], shape),
            "color": np.repeat(colours[:, None], 4, axis=1),
        }
        self.shader.bind()
        box_batch(self.shader, **of_corners).draw(self.shader)

    def forget(self):
        self.shader = None
