# SPDX-License-Identifier: GPL-3.0-or-later
"""What has to be worked out again when Blender opens another file or goes back a step."""

import bpy
from bpy.app.handlers import persistent

from ..ops.label_folder import show_batch
from ..ops.picking import keep_picked, restore_picked
from ..ops.reposing import follow_soon, forget_reposing
from ..ops.timeline import forget_rows
from ..props import adopt_settings, refresh_review
from ..scene import naming
from ..scene.opened import opened
from ..scene.take import takes_of
from ..scene.trouble import forget_trouble


@persistent
def after_load(*_):
    """A file was opened: what was read from the last one is forgotten, and takes made elsewhere are found."""
    opened.forget()
    forget_trouble()
    forget_rows()
    forget_reposing()
    bpy.context.view_layer.update()  # constraints of cameras, which what was edited in takes of blobs is measured by
    bpy.context.window_manager.mocap_autolabel.picked.clear()
    adopt_takes()
    if not bpy.app.background:
        follow_soon()
    show_batch()


@persistent
def before_undo(*_):
    """A step will be undone or redone: what stays picked is what is picked now."""
    keep_picked(bpy.context)


@persistent
def after_undo(*_):
    """A step was undone or redone: the tables may be of a take that is gone, and the body of other labels."""
    follow_soon()
    refresh_review(bpy.context.window_manager, bpy.context.scene)
    restore_picked(bpy.context)


def adopt_takes():
    """Makes a take that the command line put into a scene the active one, and fills the review of the current scene."""
    for scene in bpy.data.scenes:
        settings, takes = scene.mocap_autolabel, takes_of(scene)
        adopt_settings(settings)
        if settings.take is None and settings.source.preview is None and takes:
            settings.take = takes[-1]
            settings.source.rate = scene.render.fps / scene.render.fps_base
        if settings.source.cameras is None and takes:
            settings.source.cameras = takes[-1].get(naming.CAMERAS)
    refresh_review(bpy.context.window_manager, bpy.context.scene)
