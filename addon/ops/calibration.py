# SPDX-License-Identifier: GPL-3.0-or-later
"""Refine Calibration: cameras that were moved are put where the take's own blobs show them to stand."""

from functools import partial
from pathlib import Path

import bpy
from bpy.props import StringProperty

from ..core.data.errors import InputError
from ..core.geometry.cameras import Cameras
from ..io.whole import free_path
from ..jobs.refine import RefineJob, refine_file
from ..props import as_typed, chosen_model, frames_wanted
from ..scene import cameras as scene_cameras
from ..scene.cameras import show_refined
from .base import once, unless
from .importing import lacks_cameras
from .long_work import LongWork, known_by

ENDING = ".refined.toml"
BLOBS_FIRST = "Open the blobs first: the cameras are refined by them"


class MOCAP_AUTOLABEL_OT_refine_calibration(LongWork, bpy.types.Operator):
    """Move and turn the cameras so that the take's own named blobs meet; a new calibration is written beside them."""

    filepath: once(
        StringProperty, "File", "The .toml to write; beside the blobs where none is given", subtype="FILE_PATH"
    )

    doing = "Refining the calibration"

    needs = (
        unless(lambda context: not context.scene.mocap_autolabel.source.points_path, "3D points need no cameras"),
        lacks_cameras,
        unless(lambda context: context.scene.mocap_autolabel.source.blobs_path, BLOBS_FIRST),
    )

    def asked(self, context):
        settings, path = context.scene.mocap_autolabel, self.filepath
        self._of = known_by(settings.source.cameras)
        source = Path(bpy.path.abspath(settings.source.blobs_path))
        job = RefineJob(
            source=source,
            cameras=scene_cameras.cameras_of(settings.source.cameras, context.scene),
            model=chosen_model(settings.subjects),
            out=Path(bpy.path.abspath(path)) if path else free_path(source.with_suffix(""), ENDING),
            frames=frames_wanted(settings.labelling),
            rate=as_typed(settings.source.rate),
            overwrite=bool(path),
            if_refined=True,
        )
        return partial(refine_file, job)

    def _show(self, context, refined: tuple[dict, Cameras]):
        scene, (report, cameras) = context.scene, refined
        for words in report["camera_doubts"]:
            self.report({"WARNING"}, words)
        if not report["refined"]:
            self.report({"INFO"}, f"Nothing to refine: {_worst(report)}")
            return
        source = scene.mocap_autolabel.source
        if source.cameras is None or self._of.isdisjoint(known_by(source.cameras)):
            words = f"other cameras are chosen than those that were refined, which are in {Path(report['out']).name}"
            raise InputError(f"{words}; expected them to stay, so import that file")
        source.cameras = show_refined(scene, source.cameras, cameras, report)
        self.report({"INFO"}, f"{_worst(report)}, in {Path(report['out']).name}; label again to use it")


def _worst(report: dict) -> str:
    """The error of the camera that gained most, before and after, in half a sentence."""
    rows = [(name, row) for name, row in report["cameras"].items() if row["before_px"] is not None]
    name, row = max(rows, key=lambda pair: pair[1]["before_px"] - pair[1]["after_px"])
    if not report["refined"]:
        name, row = max(rows, key=lambda pair: pair[1]["before_px"])
        return f"no camera is more than {row['before_px']:.2f} px off, {name} the most"
    return f"camera {name} was {row['before_px']:.2f} px off and is {row['after_px']:.2f} px off now"
