# SPDX-License-Identifier: GPL-3.0-or-later
"""The take's body for retargeting: as an armature with usual bone names at rest in a T-pose, and as BVH and FBX."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
from bpy.props import StringProperty

from ..core.data.errors import JobError
from ..scene.character import BLENDER_AXES, BVH_AXES, add_character
from ..scene.opened import opened
from ..scene.performers import homes
from ..scene.stored import alone
from ..scene.take import Stored, set_time
from .base import OfTake
from .exporting import ExportsPerformers, performer_property
from .reposing import follow_now

BVH_UNITS = 100.0  # to a metre: BVH has no unit, and what reads it takes centimetres


class MOCAP_AUTOLABEL_OT_add_character(OfTake, bpy.types.Operator):
    """Add an armature that moves as the take's body does, with the chosen bone names and a T-pose as its rest."""

    bl_label = "Add Character"

    def work(self, context):
        settings = context.scene.mocap_autolabel
        follow_now(context)
        stored, added = opened.take(settings.take, context.scene), []
        for one in stored.performers:
            home = homes(settings.take).get(one.name, settings.take)
            added.append(add_character(context, home, alone(stored, one), settings.bone_names, BLENDER_AXES).name)
        self.report({"INFO"}, f"Added {', '.join(added)}")


class ExportsCharacter(OfTake, ExportsPerformers):
    """The exports of a performer's character by Blender's own exporters.

    They differ in `axes`, which the armature is turned into, and in `export`, which writes it: JobError if it cannot.
    """

    of_body = True
    performer: performer_property(together=False)

    def write(self, paths: list[Path], stored: Stored):
        """Writes an armature that is there for the export only."""
        context = bpy.context
        settings = context.scene.mocap_autolabel
        home = homes(settings.take).get(self.performer_name, settings.take)
        with _alone(context, stored) as show:
            show(add_character(context, home, stored, settings.bone_names, self.axes))
            self.export(paths[0], stored)


class MOCAP_AUTOLABEL_OT_export_bvh(ExportsCharacter, bpy.types.Operator):
    """Write the take's body as BVH: usual bone names, a T-pose as its rest, y up, in centimetres."""

    bl_label = "Export BVH"
    filename_ext, axes = ".bvh", BVH_AXES
    filter_glob: StringProperty(default="*.bvh", options={"HIDDEN"})

    def export(self, path: Path, stored: Stored):
        """Writes the active armature."""
        frames = stored.motion.frames + stored.shift
        _exporter("export_anim", "bvh", "BVH")(
            filepath=str(path),
            check_existing=False,
            global_scale=BVH_UNITS,
            frame_start=int(frames[0]),
            frame_end=int(frames[-1]),
            rotate_mode="ZXY",
            root_transform_only=True,
        )


class MOCAP_AUTOLABEL_OT_export_fbx(ExportsCharacter, bpy.types.Operator):
    """Write the take's body as FBX: usual bone names, and a T-pose as its rest."""

    bl_label = "Export FBX"
    filename_ext, axes = ".fbx", BLENDER_AXES
    filter_glob: StringProperty(default="*.fbx", options={"HIDDEN"})

    def export(self, path: Path, stored: Stored):
        """Writes the selected armature."""
        _exporter("export_scene", "fbx", "FBX")(
            filepath=str(path),
            check_existing=False,
            use_selection=True,
            object_types={"ARMATURE"},
            add_leaf_bones=False,
            bake_anim_use_all_bones=True,
            bake_anim_use_nla_strips=False,
            bake_anim_use_all_actions=False,
            bake_anim_simplify_factor=0.0,
        )


def _exporter(family: str, name: str, called: str) -> Callable[..., set[str]]:
    """One of Blender's exporters, which are add-ons that can be switched off."""
    operator = getattr(getattr(bpy.ops, family), name)
    try:
        operator.get_rna_type()
    except KeyError:
        raise JobError(
            f"Blender's own {called} exporter is switched off; expected it enabled in the preferences, under Add-ons"
        ) from None
    return operator


@contextmanager
def _alone(context: bpy.types.Context, stored: Stored) -> Iterator[Callable[[bpy.types.Object], None]]:
    """While a thing is shown as the only one that is selected, in a scene that plays the take as it was recorded.

    Afterwards the thing is gone, and scene and selection are as they were.
    """
    scene, layer = context.scene, context.view_layer
    render, played = scene.render, (scene.frame_start, scene.frame_end, scene.frame_current)
    rate, active, selected = (render.fps, render.fps_base), layer.objects.active, list(context.selected_objects)
    shown: list[bpy.types.Object] = []

    def show(item: bpy.types.Object):
        shown.append(item)
        for other in selected:
            other.select_set(False)
        item.select_set(True)
        layer.objects.active = item

    try:
        set_time(scene, stored.rate, stored.motion.frames + stored.shift)
        yield show
    finally:
        blocks = [(item.data, item.animation_data.action) for item in shown]
        bpy.data.batch_remove([*shown, *(block for pair in blocks for block in pair)])
        for item in selected:
            item.select_set(True)
        layer.objects.active = active
        render.fps, render.fps_base = rate
        scene.frame_start, scene.frame_end = played[:2]
        scene.frame_set(played[2])
