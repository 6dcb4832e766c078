# SPDX-License-Identifier: GPL-3.0-or-later
"""The real extension, enabled as Blender does it: everything it adds is taken out again."""

import subprocess
import sys

import addon_utils
import bpy
import pytest

KINDS = (
    bpy.types.Operator,
    bpy.types.Panel,
    bpy.types.UIList,
    bpy.types.PropertyGroup,
    bpy.types.FileHandler,
    bpy.types.AddonPreferences,
)


def everything():
    """What an extension can add to Blender: classes, properties, handlers, timers and commands."""
    classes = {
        cls.__module__ + "." + cls.__name__ for kind in KINDS for cls in kind.__subclasses__() if cls.is_registered
    }
    properties = {
        (kind.__name__, name)
        for kind in (bpy.types.Scene, bpy.types.WindowManager)
        for name, _ in kind.bl_rna.properties.items()
    }
    handlers = {
        name: [getattr(function, "__module__", "") for function in getattr(bpy.app.handlers, name)]
        for name in dir(bpy.app.handlers)
        if isinstance(getattr(bpy.app.handlers, name), list)
    }
    return classes, properties, handlers


def test_a_register_that_fails_leaves_nothing(extension, monkeypatch):
    addon_utils.disable(extension, default_set=False)
    before = everything()
    registration = sys.modules[f"{extension}.addon.registration"]

    def fail(stack):
        raise RuntimeError("no handlers today")

    monkeypatch.setattr(registration.ui, "add_handlers", fail)
    with pytest.raises(RuntimeError, match="no handlers today"):
        registration.register()
    assert everything() == before
    monkeypatch.undo()
    addon_utils.enable(extension, default_set=True)


def test_enabling_imports_neither_scipy_nor_the_command_line(extension):
    code = (
        "import sys, bpy; sys.path.insert(0, sys.argv[1]); from addon import registration; registration.register(); "
        "print([m for m in sys.modules if m.startswith(('scipy', 'ezc3d', 'c3d', 'addon.cli'))]); "
        "registration.unregister()"
    )
    root = str(sys.modules[extension].__path__[0])
    done = subprocess.run([sys.executable, "-c", code, root], capture_output=True, text=True, check=True)
    assert done.stdout.strip().splitlines()[-1] == "[]"
