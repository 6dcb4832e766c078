# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything that Blender has to know of the add-on, added whole or not at all, and taken out again whole."""

from contextlib import ExitStack

import bpy

from . import ops, prefs, props, ui

COMMAND = "mocap_autolabel"

# Blender calls no `unregister` after a `register` that failed, so every step brings its own way back.
_registered = ExitStack()


def register():
    """Adds classes, properties, handlers, overlay and command; on failure what was added is taken out again."""
    with ExitStack() as stack:
        for cls in (*prefs.CLASSES, *props.CLASSES, *ops.CLASSES, *ui.CLASSES):
            bpy.utils.register_class(cls)
            stack.callback(bpy.utils.unregister_class, cls)
        _add_property(stack, bpy.types.Scene, props.SceneSettings)
        _add_property(stack, bpy.types.WindowManager, props.ReviewState)
        ui.add_handlers(stack)
        command = bpy.utils.register_cli_command(COMMAND, _run_command)
        stack.callback(bpy.utils.unregister_cli_command, command)
        _registered.push(stack.pop_all())


def unregister():
    """Takes out everything that `register` added."""
    _registered.close()


def _add_property(stack: ExitStack, owner: type, group: type):
    owner.mocap_autolabel = bpy.props.PointerProperty(type=group)
    stack.callback(delattr, owner, "mocap_autolabel")


def _run_command(arguments: list[str]) -> int:
    """`blender --command mocap_autolabel …`: the command line's other door."""
    from .cli import main

    return main(arguments)
