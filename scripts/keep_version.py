# SPDX-License-Identifier: GPL-3.0-or-later
"""Saves what this version saves, so that every later one is tried on it: `python -m scripts.keep_version NAME`.

To be run when a version is released, in a Python with the older of the two Blenders (`.venv-3.11`), whose files both
open. It writes to tests/earlier/NAME/: `takes.blend` with a scene of 3D points and one of blobs, both with corrections,
fills, smoothing and other settings than the usual ones, edits, a report, a calibration, a small model, and in
`expected.json` what the version itself read out of them. All is made of the blobs that the version before kept, which
are of a person who does not exist.
"""

import contextlib
import importlib
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

MODULE = "bl_ext.mocap_earlier.mocap_autolabel"
EARLIER = Path(__file__).resolve().parents[1] / "tests" / "earlier"
MODEL, RATE = "gait15", 60.0
FEW = ("LASI", "RASI", "LKNE", "RKNE", "LANK", "RANK", "RHEE")


class Version:
    """The extension of the sources in a folder, enabled."""

    def __init__(self, root: Path, folder: Path):
        import addon_utils

        bpy.ops.wm.read_factory_settings(use_empty=True)
        (folder / "mocap_autolabel").symlink_to(root, target_is_directory=True)
        repos = bpy.context.preferences.extensions.repos
        repos.new(name="Earlier", module="mocap_earlier", custom_directory=str(folder), source="USER")
        if addon_utils.enable(MODULE, default_set=True) is None:
            raise RuntimeError(f"{root} is no extension that starts")
        self.operators = bpy.ops.mocap_autolabel

    def part(self, name: str):
        """A module of the version's."""
        return importlib.import_module(f"{MODULE}.addon.{name}")

    def call(self, name: str, **words) -> None:
        """Calls an operator."""
        getattr(self.operators, name)(**words)

    def command(self, *words: object) -> None:
        """Runs a command of the version's; RuntimeError where it fails."""
        with contextlib.suppress(SystemExit):
            if self.part("cli").main([str(word) for word in words]):
                raise RuntimeError(f"{words[0]} failed, see above")


def make_inputs(version: Version, folder: Path) -> None:
    """Copies walk.csv and room.toml, and writes walk.c3d without names and named/one.c3d with them."""
    before = max(EARLIER.glob("*/walk.csv")).parent
    blobs, room = (shutil.copy(before / name, folder / name) for name in ("walk.csv", "room.toml"))
    version.command("reconstruct", blobs, "--cameras", room, "--rate", RATE, "--out", folder / "walk.c3d")
    more = ("--model", MODEL, "--rate", RATE, "--out", folder / "named")
    version.command("label", blobs, "--cameras", room, *more)
    (folder / "named" / "walk.c3d").rename(folder / "named" / "one.c3d")


def save(version: Version, inputs: Path, out: Path) -> None:
    """Writes everything to the folder `out`."""
    bpy.ops.wm.read_homefile(use_empty=True)
    expected = {}
    for kind in ("points", "blobs"):
        scene = bpy.context.scene if kind == "points" else bpy.data.scenes.new(kind)
        scene.name = kind
        bpy.context.window.scene = scene
        if kind == "points":
            version.call("import_points", filepath=str(inputs / "walk.c3d"))
        else:
            version.call("import_cameras", filepath=str(inputs / "room.toml"))
            version.call("import_blobs", filepath=str(inputs / "walk.csv"))
        settings = bpy.context.scene.mocap_autolabel
        settings.subjects.markerset, settings.source.rate = MODEL, RATE
        version.call("label")
        _correct(version, kind)
        expected[kind] = _read(version)
        if kind == "points":
            version.call("save_corrections")
            shutil.move(inputs / "walk.edits.json", out / "walk.edits.json")
    version.call("add_training_takes", filepath=str(inputs / "named" / "one.c3d"))
    version.call("add_performer")
    for kind, read in expected.items():
        read["settings"] = _change(bpy.data.scenes[kind].mocap_autolabel)
    bpy.ops.wm.save_as_mainfile(filepath=str(out / "takes.blend"), compress=True, relative_remap=False)
    for extra in out.glob("*.blend?"):
        extra.unlink()
    version.command("label", inputs / "walk.c3d", "--model", MODEL, "--out", out / "made")
    shutil.move(out / "made" / "walk.report.json", out / "walk.report.json")
    shutil.rmtree(out / "made")
    few = ("--markers", ",".join(FEW), "--name", "few", "--out", out / "few.markerset.json")
    version.command("train", inputs / "named" / "one.c3d", *few)
    for name in ("room.toml", "walk.csv"):  # where the take of blobs was labelled from is gone by then
        shutil.copy(inputs / name, out / name)
    (out / "expected.json").write_text(json.dumps(expected) + "\n", encoding="utf-8", newline="\n")


def _correct(version: Version, kind: str) -> None:
    """Exchanges two names, takes one away, fills and smooths."""
    bpy.context.scene.frame_set(6)
    for names, operator, scope in ((("LKNE", "RKNE"), "swap_markers", "ON"), (("RTOE",), "unlabel", "FRAME")):
        items = {item["mocap_marker"]: item for item in _take().all_objects if "mocap_marker" in item}
        for item in bpy.context.selected_objects:
            item.select_set(False)
        for name in reversed(names):
            items[name].select_set(True)
            bpy.context.view_layer.objects.active = items[name]
        version.call(operator, scope=scope)
    if kind == "points":
        version.call("fill_gaps", extent="TAKE")
        version.call("smooth")


def _change(settings: bpy.types.PropertyGroup, path: str = "") -> dict:
    """Changes all settings that are numbers, words or choices, and gives their values by their names."""
    changed = {}
    for name, rule in settings.bl_rna.properties.items():
        if name in NOT_CHANGED:
            continue
        value, place = getattr(settings, name), f"{path}{name}"
        if isinstance(value, bpy.types.PropertyGroup):
            changed |= _change(value, f"{place}.")
            continue
        if rule.type not in CHANGES or rule.subtype == "FILE_PATH":
            continue
        setattr(settings, name, CHANGES[rule.type](value, rule))
        value = getattr(settings, name)
        changed[place] = round(value, 6) if isinstance(value, float) else value
    return changed


NOT_CHANGED = ("rna_type", "name", "markerset")  # Blender's own, and the one that the takes were labelled by
CHANGES = {
    "BOOLEAN": lambda value, _: not value,
    "INT": lambda value, _: value + 1,
    "FLOAT": lambda value, _: 0.9 * value + 0.01,
    "ENUM": lambda value, rule: next(item.identifier for item in rule.enum_items if item.identifier != value),
    "STRING": lambda value, _: f"{value}x",
}


def _take() -> bpy.types.Collection:
    return bpy.context.scene.mocap_autolabel.take


def _read(version: Version) -> dict:
    """What the version reads out of the active take: how many rows are each marker, and where markers are."""
    stored = version.part("scene.opened").Opened().take(_take(), bpy.context.scene)
    counts = np.bincount(stored.labels.marker[stored.labels.marker >= 0], minlength=len(stored.names))
    places = np.round(stored.motion.markers[[0, 9, -1]], 6)
    return {
        "markers": list(stored.names),
        "rows": counts.tolist(),
        "frames": stored.motion.frames[[0, -1]].tolist(),
        "rate": stored.rate,
        "places": np.where(np.isfinite(places), places, None).tolist(),
        "edits": len(stored.edits),
        "fills": [[fill.marker, fill.first, fill.last] for fill in stored.fills],
        "cutoff": stored.cutoff,
    }


def main(name: str) -> None:
    """Write the folder `name`."""
    with tempfile.TemporaryDirectory(prefix="mocap-earlier-") as folder:
        extension, inputs, out = (Path(folder) / part for part in ("extension", "inputs", "out"))
        for part in (extension, inputs, out):  # Blender files keep the path that they were saved to
            part.mkdir()
        version = Version(Path.cwd(), extension)
        make_inputs(version, inputs)
        save(version, inputs, out)
        shutil.copytree(out, EARLIER / name)
        print(*(f"{path.name} {path.stat().st_size}" for path in sorted(out.iterdir())), sep="\n", flush=True)
        os._exit(0)  # Blender 4.5 as a module may wait for ever for itself when Python ends


if __name__ == "__main__":
    main(*sys.argv[1:])
