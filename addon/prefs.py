# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user sets once for all files: where own marker sets live, and who teaches them."""

from pathlib import Path

import bpy
from bpy.props import StringProperty

PACKAGE = __package__.rpartition(".")[0]


class MocapPreferences(bpy.types.AddonPreferences):
    """Preferences of the extension."""

    bl_idname = PACKAGE or __package__

    markerset_folder: StringProperty(
        name="Own Marker Sets",
        description="Folder for the marker sets that you make; empty for the extension's own folder",
        subtype="DIR_PATH",
    )

    taught_by: StringProperty(
        name="Your Name",
        description="What marker sets keep of who taught them; empty for the name that you are logged in by",
    )

    def draw(self, context):
        self.layout.prop(self, "markerset_folder")
        self.layout.prop(self, "taught_by")
        from .core.kernels import in_use

        if not in_use():
            self.layout.label(text="Without the compiled library NumPy does the same work, more slowly", icon="INFO")


def _chosen(name: str) -> str:
    """What a user set; empty without the extension."""
    addon = bpy.context.preferences.addons.get(PACKAGE)
    return getattr(addon.preferences, name) if addon and addon.preferences else ""


def taught_by() -> str:
    """The name of who teaches marker sets; empty where nobody gave one."""
    return _chosen("taught_by")


def markerset_folder(create: bool = False) -> Path:
    """The folder of the user's own marker sets; made when `create` is set."""
    if chosen := _chosen("markerset_folder"):
        folder = Path(bpy.path.abspath(chosen))
        if create:
            folder.mkdir(parents=True, exist_ok=True)
        return folder
    return Path(bpy.utils.extension_path_user(PACKAGE, path="markersets", create=create))
