# SPDX-License-Identifier: GPL-3.0-or-later
"""Many round dots drawn at once: each is a square of one buffer, which the shader makes round and gives a rim."""

from dataclasses import dataclass

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)
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
            self.shader = disc_shader()
        count = len(centres)
        content = {
            "pos": np.repeat(centres.astype(np.float32), 4, axis=0),
            "corner": np.tile(CORNERS, (count, 1)),
            "radii": np.repeat(radii.astype(np.float32), 4, axis=0),
            "color": np.repeat(colours.astype(np.float32), 4, axis=0),
        }
        faces = (4 * np.arange(count)[:, None] + [0, 1, 2, 0, 2, 3]).reshape(-1, 3).astype(np.int32)
        self.shader.bind()
        batch_for_shader(self.shader, "TRIS", content, indices=faces).draw(self.shader)

    def forget(self):
        """Lets go of what the GPU has."""
        self.shader = None


def disc_shader() -> gpu.types.GPUShader:
    """The shader that makes squares round."""
    info, between = gpu.types.GPUShaderCreateInfo(), gpu.types.GPUStageInterfaceInfo("mocap_autolabel_disc")
    between.smooth("VEC2", "at")
    between.flat("VEC2", "ends")
    between.flat("VEC4", "tint")
    info.push_constant("MAT4", "ModelViewProjectionMatrix")
    for place, (kind, name) in enumerate((("VEC2", "pos"), ("VEC2", "corner"), ("VEC2", "radii"), ("VEC4", "color"))):
        info.vertex_in(place, kind, name)
    info.vertex_out(between)
    info.fragment_out(0, "VEC4", "colour")
    info.vertex_source(DISC_VERTEX)
    info.fragment_source(DISC_FRAGMENT)
    return gpu.shader.create_from_info(info)
