# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar, what is drawn over the 3D view, and what is worked out again for another file or an earlier step."""

from contextlib import ExitStack

import bpy
from bpy.app.handlers import persistent

from ..ops.correcting import review_now
from ..ops.importing import look_when_free
from ..ops.label_folder import follow, leave_batch, show_batch
from ..ops.live import follow_live, leave_live, rest_rig
from ..ops.long_work import leave_work, take_up, take_up_soon
from ..ops.picking import picked_points, restore_picked
from ..ops.reposing import follow_soon, forget_reposing
from ..props import know_markerset, list_trouble, refresh_review
from ..scene import naming
from ..scene.later import never
from ..scene.opened import opened
from ..scene.retargeting import follow_actions
from ..scene.rig_preview import follow_rigs
from ..scene.take import adopt_copies, takes_of
from ..scene.timing import RATE
from . import advanced, figure, graph, label_tool, live, overlay, panels, quality, review, timeline

PANEL_MODULES = (panels, review, advanced, live, label_tool)  # from above; a panel behind the one that it is in


def add_handlers(stack: ExitStack):
    """Adds the overlay and what listens to Blender; each brings its way back to `stack`."""
    for draw in (figure.draw, overlay.draw, live.draw, quality.draw, label_tool.draw):
        drawing = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL")
        stack.callback(bpy.types.SpaceView3D.draw_handler_remove, drawing, "WINDOW")
    timeline.add_timeline(stack)
    graph.add_graph(stack)
    label_tool.add_tool(stack)
    bpy.types.TOPBAR_MT_file_import.append(panels.draw_import)
    stack.callback(bpy.types.TOPBAR_MT_file_import.remove, panels.draw_import)
    for forget in (
        opened.forget,
        forget_reposing,
        overlay.letters.forget,
        overlay.discs.forget,
        leave_batch,
        leave_live,
        leave_work,
    ):
        stack.callback(forget)
    events = bpy.app.handlers
    for listeners, function in (
        (events.load_post, after_load),
        (events.save_pre, before_save),
        (events.undo_pre, before_undo),
        (events.redo_pre, before_undo),
        (events.undo_post, after_undo),
        (events.redo_post, after_undo),
    ):
        listeners.append(function)
        stack.callback(listeners.remove, function)
    follow_hand()
    stack.callback(bpy.msgbus.clear_by_owner, follow_actions)
    # While an extension is being enabled the file is out of bounds; a moment later it is not. The timer is persistent
    # because Blender 4.5 as a module hangs at its end when a file is opened under one that is not.
    bpy.app.timers.register(adopt_takes, first_interval=0.0, persistent=True)
    for timer in (list_trouble, adopt_takes, review_now, look_when_free, follow, follow_live, take_up, follow_rigs):
        stack.callback(never, timer)


def follow_hand():
    """Listens to hands that choose an action, or another scene; Blender forgets that with every file."""
    for chosen, notify in ((bpy.types.AnimData, "action"), follow_actions), ((bpy.types.Window, "scene"), after_switch):
        bpy.msgbus.subscribe_rna(key=chosen, owner=follow_actions, args=(), notify=notify)


def after_switch():
    """A window shows another scene, maybe a new copy: what is picked and the tables were of the last one's take."""
    adopt_copies()
    bpy.context.window_manager.mocap_autolabel.picked.clear()
    review_now()


@persistent
def after_load(*_):
    """A file was opened: what was read from the last one is forgotten, and takes made elsewhere are found."""
    leave_live()
    opened.forget()
    forget_reposing()
    follow_hand()
    follow_actions(give_back=False)  # files of earlier versions note what a person may have set since
    bpy.context.view_layer.update()  # constraints of cameras, which what was edited in takes of blobs is measured by
    bpy.context.window_manager.mocap_autolabel.picked.clear()
    adopt_takes()
    if not bpy.app.background:
        follow_soon()
    show_batch()
    take_up_soon()


@persistent
def before_save(*_):
    """The file will be saved: no pose of a stream is to be in it."""
    rest_rig()


@persistent
def before_undo(*_):
    """A step will be undone or redone: what stays picked is what is picked now, and what is half done is begun anew."""
    forget_reposing()
    if not picked_points(bpy.context):
        bpy.context.window_manager.mocap_autolabel.picked.clear()


@persistent
def after_undo(*_):
    """A step was undone or redone: the tables may be of a take that is gone, and the body of other labels."""
    follow_actions()  # what was switched back after a step was noted is not in it
    follow_soon()
    refresh_review(bpy.context.window_manager, bpy.context.scene)
    restore_picked(bpy.context)


def adopt_takes():
    """Makes a take that the command line put into a scene the active one, and fills the review of the current scene."""
    for scene in bpy.data.scenes:
        settings, takes = scene.mocap_autolabel, takes_of(scene)
        if settings.take is None and settings.source.preview is None and takes:
            settings.take = takes[-1]
            settings.source.rate = float(takes[-1][RATE])
        if settings.source.cameras is None and takes:
            settings.source.cameras = takes[-1].get(naming.CAMERAS)
        know_markerset(settings, scene)  # a take was made by the command line, or by an earlier version
    refresh_review(bpy.context.window_manager, bpy.context.scene)
