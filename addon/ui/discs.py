# SPDX-License-Identifier: GPL-3.0-or-later
"""Many round dots drawn at once: each is a square of one buffer, which the shader makes round and gives a rim."""

from dataclasses import dataclass

import gpu
import numpy as np

from .boxes import BOX_CORNERS, box_batch, made_shader

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
        """Lets go of what the GPU has."""
        self.shader = None
