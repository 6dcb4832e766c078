# SPDX-License-Identifier: GPL-3.0-or-later
"""Calibration health in the sidebar: what is odd about the cameras of a take, and errors before and after refining."""

import bpy

from ..ops.importing import cameras_at_hand
from ..scene.calibration import kept_health, kept_refinement
from ..scene.take import holds_points, is_take
from .parts import Step, draw_text


class MOCAP_AUTOLABEL_PT_calibration(Step, bpy.types.Panel):
    """Whether the cameras go together, and what to do where they do not."""

    bl_label = "Calibration Health"
    bl_parent_id = "MOCAP_AUTOLABEL_PT_cameras"

    @classmethod
    def poll(cls, context):
        settings = context.scene.mocap_autolabel
        return bool(settings.blobs_path) and not settings.points_path and cameras_at_hand(context.scene)

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        report = kept_refinement(settings.cameras)
        take = settings.take if is_take(settings.take) and not holds_points(settings.take) else None
        health = kept_health(take)
        for words in health or ():
            draw_text(context, layout, words[0].upper() + words[1:], icon="ERROR")
        if health == []:
            layout.label(text="All cameras go together", icon="CHECKMARK")
        elif health is None:
            layout.label(text="Shown when a take is labelled", icon="INFO")
        layout.operator("mocap_autolabel.refine_calibration", icon="CON_CAMERASOLVER")
        if report is not None:
            _draw_errors(layout, report)
            layout.operator("mocap_autolabel.label", text="Label Again", icon="PLAY")


def _draw_errors(layout: bpy.types.UILayout, report: dict):
    """The reprojection error of each camera before and after, px."""
    column = layout.column(align=True)
    for cells in (("Camera", "Before", "After"), *_rows(report)):
        row = column.row(align=True)
        for words in cells:
            row.label(text=words)


def _rows(report: dict):
    for name, row in report["cameras"].items():
        known = row["before_px"] is not None and row["after_px"] is not None
        yield (name, *(f"{row[key]:.2f} px" if known else "–" for key in ("before_px", "after_px")))


CLASSES = (MOCAP_AUTOLABEL_PT_calibration,)
