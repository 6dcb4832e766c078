# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything that Blender has to know of the add-on, added whole or not at all, and taken out again whole."""

from contextlib import ExitStack
from types import ModuleType

import bpy

from . import ops, prefs, props, ui

OF_BLENDER = (
    bpy.types.AddonPreferences,
    bpy.types.FileHandler,
    bpy.types.Menu,
    bpy.types.Operator,
    bpy.types.Panel,
    bpy.types.PropertyGroup,
    bpy.types.UIList,
)
COMMAND = "mocap_autolabel"

# Blender calls no `unregister` after a `register` that failed, so every step brings its own way back.
_registered = ExitStack()


def register():
    """Adds classes, properties, handlers, overlay and command; on failure what was added is taken out again."""
    with ExitStack() as stack:
        for cls in classes_in(prefs, props, *ops.OPERATOR_MODULES, *ui.PANEL_MODULES):
            bpy.utils.register_class(cls)
            stack.callback(bpy.utils.unregister_class, cls)
        _add_property(stack, bpy.types.Scene, props.SceneSettings)
        _add_property(stack, bpy.types.WindowManager, props.ReviewState)
        _add_property(stack, bpy.types.Object, props.RigSettings)
        ui.add_handlers(stack)
        command = bpy.utils.register_cli_command(COMMAND, _run_command)
        stack.callback(bpy.utils.unregister_cli_command, command)
        _registered.push(stack.pop_all())


def classes_in(*modules: ModuleType) -> list[type]:
    """What modules define for Blender, in their order."""
    found = [(module.__name__, one) for module in modules for one in vars(module).values() if isinstance(one, type)]
    return [one for name, one in found if one.__module__ == name and issubclass(one, OF_BLENDER)]


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
