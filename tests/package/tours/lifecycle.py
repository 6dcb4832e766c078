# SPDX-License-Identifier: GPL-3.0-or-later
"""The life of the installed extension, lived inside a Blender: `… lifecycle.py -- ZIP NEWER_ZIP REPORT`.

Runs as Blender's --python script or as a script of a Python with bpy. It judges nothing: it writes what it saw to the
JSON file REPORT for the test to judge.
"""

import importlib
import json
import pkgutil
import sys
from pathlib import Path

import bpy  # isort: skip (as a module it brings addon_utils)
import addon_utils

REPOSITORY = "user_default"
NAME = "mocap_autolabel"
MODULE = f"bl_ext.{REPOSITORY}.{NAME}"


def main(package: str, newer: str, report: str) -> None:
    """Install, exercise, disable, update and uninstall; write what was seen at each point."""
    addon_utils.enable("bl_pkg")
    seen = {"blender": bpy.app.version_string, "python": sys.version.split()[0], "before": traces()}

    bpy.ops.extensions.package_install_files(filepath=package, repo=REPOSITORY, enable_on_install=True)
    seen["installed"] = facts()
    seen["modules"] = import_everything()
    libraries = ("lzallright", "numpy", "olefile", "scipy", "threadpoolctl")
    seen["libraries"] = {name: importlib.import_module(name).__file__ for name in libraries}

    addon_utils.disable(MODULE, default_set=True)
    seen["disabled"] = facts()
    addon_utils.enable(MODULE, default_set=True)
    seen["enabled again"] = facts()

    bpy.ops.extensions.package_install_files(filepath=newer, repo=REPOSITORY, enable_on_install=True)
    seen["updated"] = facts()
    seen["warnings"] = policy_warnings()

    repositories = bpy.context.preferences.extensions.repos
    index = next(i for i, repository in enumerate(repositories) if repository.module == REPOSITORY)
    bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id=NAME)
    seen["uninstalled"] = facts()
    folder = Path(bpy.utils.user_resource("EXTENSIONS"))
    seen["files left"] = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    Path(report).write_text(json.dumps(seen, indent=1))


def facts() -> dict:
    """What a user could notice of the extension right now."""
    manifest = Path(bpy.utils.user_resource("EXTENSIONS"), REPOSITORY, NAME, "blender_manifest.toml")
    lines = manifest.read_text().split("\n") if manifest.exists() else []
    return {
        "enabled": MODULE in bpy.context.preferences.addons,
        "version": next((line.split('"')[1] for line in lines if line.startswith("version =")), None),
        "tabs": sorted({kind.bl_category for kind in _types() if getattr(kind, "bl_category", "") == "Mocap"}),
        "operators": {
            name: getattr(bpy.ops.mocap_autolabel, name).get_rna_type().properties.keys()
            for name in dir(bpy.ops.mocap_autolabel)
        },
        "traces": traces(),
    }


def traces() -> dict:
    """Everything that an add-on can leave in a running Blender."""
    handlers = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    functions = [f for handler in handlers.values() if isinstance(handler, list) for f in handler]
    types = _types()
    for kind in types:
        drawn = getattr(getattr(kind, "draw", None), "_draw_funcs", [])
        # Blender lists what the kind itself draws too, once somebody has ever added to it.
        functions += [f for f in drawn if f.__qualname__ != f"{kind.__name__}.draw"]
    keymaps = bpy.context.window_manager.keyconfigs.addon
    return {
        "types": sorted(kind.__name__ for kind in types),
        "properties": sum(len(kind.bl_rna.properties) for kind in types if hasattr(kind, "bl_rna")),
        "functions": sorted(f"{f.__module__}.{f.__qualname__}" for f in functions),
        "keys": sum(len(keymap.keymap_items) for keymap in keymaps.keymaps) if keymaps else 0,
        # Blender itself adds the folder that all extensions' wheels are unpacked to.
        "path": sorted(path for path in set(sys.path) if not Path(path).match(".local/lib/python*/site-packages")),
        "data": {
            collection.identifier: sorted(getattr(bpy.data, collection.identifier).keys())
            for collection in bpy.data.bl_rna.properties
            if collection.type == "COLLECTION"
        },
    }


def _types() -> list[type]:
    return [kind for name in dir(bpy.types) if isinstance(kind := getattr(bpy.types, name), type)]


def import_everything() -> list[str]:
    """Import every module of the extension, so that none hides a wrong import, and give their names."""
    root = importlib.import_module(MODULE)
    names = [found.name for found in pkgutil.walk_packages(root.__path__, MODULE + ".")]
    for name in names:
        importlib.import_module(name)
    return names


def policy_warnings() -> dict:
    """Blender's own list of what extensions did against its rules, made anew."""
    addon_utils._is_first_reset()
    return {name: list(warnings) for name, warnings in addon_utils._extensions_warnings_get().items()}


if __name__ == "__main__":
    main(*sys.argv[sys.argv.index("--") + 1 :])
