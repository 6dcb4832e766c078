# SPDX-License-Identifier: GPL-3.0-or-later
"""Many boxes handed to the GPU at once."""

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
