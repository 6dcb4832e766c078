# SPDX-License-Identifier: GPL-3.0-or-later
"""How large a metre is in a scene, whose unit may be another: what is known in metres is shown as long as it is."""

import bpy
import numpy as np

# On what was shown, or taken for the room's: how many of Blender's units a metre of it is, also once the scene has
# another unit. One in files of versions that showed all as in metres.
METRE = "mocap_metre"


def metre_in(scene: bpy.types.Scene) -> float:
    """How many of Blender's units a metre is: 100 in a scene of centimetres, 1 in one without units."""
    unit = scene.unit_settings
    return 1.0 if unit.system == "NONE" else float(np.float32(1 / unit.scale_length))


def metre_of(block: bpy.types.ID) -> float:
    """How many of Blender's units a metre of something was made."""
    return float(block.get(METRE, 1.0))


def enlarged(metre: float) -> np.ndarray:
    """(4, 4) from metres to Blender's units."""
    return np.diag([metre, metre, metre, 1.0])
