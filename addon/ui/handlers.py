# SPDX-License-Identifier: GPL-3.0-or-later
"""What has to be worked out anew when Blender opens another file or goes back a step."""

import bpy
from bpy.app.handlers import persistent

from ..ops.label_folder import show_batch
from ..ops.picking import keep_picked, restore_picked
from ..ops.reposing import follow_soon, forget_reposing
from ..ops.timeline import forget_rows
from ..props import SceneSettings, TrainingTakeRow, refresh_review, restore_choice
from ..scene import naming
from ..scene.opened import opened
from ..scene.take import takes_of
from ..scene.trouble import forget_trouble


@persistent
def after_load(*_):
    """A file was opened: what was read from the last one is forgotten, and takes made elsewhere are found."""
    opened.forget()
    for scene in bpy.data.scenes:
        adopt_training_takes(scene.mocap_autolabel)
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


def adopt_training_takes(settings: SceneSettings):
    """Takes those to learn from over from where files of the first versions have them."""
    for former in settings.lessons:
        row = settings.training_takes.add()
        for name in ("name", *TrainingTakeRow.__annotations__):
            setattr(row, name, getattr(former, name))
    settings.lessons.clear()


def adopt_takes():
    """Makes a take that the command line put into a scene the active one, and fills the review of the current scene.

    Scenes of the first versions get their marker set back.
    """
    for scene in bpy.data.scenes:
        settings, takes = scene.mocap_autolabel, takes_of(scene)
        if settings.take is None and settings.preview is None and takes:
            settings.take = takes[-1]
            settings.rate = scene.render.fps / scene.render.fps_base
        if settings.cameras is None and takes:
            settings.cameras = takes[-1].get(naming.CAMERAS)
        restore_choice(settings)
    refresh_review(bpy.context.window_manager, bpy.context.scene)
