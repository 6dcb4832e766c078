# SPDX-License-Identifier: GPL-3.0-or-later
"""The labelled take as a page that people pass on: the one that `label --html` writes."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ..core.data.takes import LabelledChunk
from ..core.review.overview import OverviewSubject
from ..jobs.pages import KeptTake, write_kept_page
from ..scene.stored import Stored
from .exporting import ExportsTake


class MOCAP_AUTOLABEL_OT_export_report(ExportsTake, bpy.types.Operator):
    """Save a page that shows how the take was labelled: one file that opens in any browser, to be passed on."""

    bl_label = "Save Report"
    filename_ext, of_body = ".report.html", True
    filter_glob: StringProperty(default="*.report.html", options={"HIDDEN"})
    open_after: BoolProperty(name="Open It", description="Show the page in the browser once it is saved", default=True)

    def execute(self, context):
        """Saves the page, and opens it where that is wanted and there is a window."""
        done = super().execute(context)
        if done == {"FINISHED"} and self.open_after and not bpy.app.background:
            bpy.ops.wm.path_open(filepath=self.filepath)
        return done

    def write(self, paths: list[Path], stored: Stored):
        """Writes the page."""
        [path] = paths
        write_kept_page(path, kept_take(stored))


def kept_take(stored: Stored) -> KeptTake:
    """A take as its page takes it."""
    return KeptTake(
        stored.name,
        bpy.path.abspath(stored.source) if stored.source else "",
        stored.model,
        stored.rate,
        OverviewSubject(stored.names, stored.words, stored.parents),
        stored.cameras,
        stored.rows,
        LabelledChunk(stored.labels, stored.unfilled, stored.suspects, outcomes=stored.outcomes),
        stored.edits,
        stored.fitting,
    )
