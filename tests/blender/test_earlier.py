# SPDX-License-Identifier: GPL-3.0-or-later
"""What earlier versions saved is opened by this one: takes in Blender files, edits, reports, calibrations, models.

The files were made by those versions themselves, see `scripts/keep_version.py`.
"""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.core.edits.kinds import Swap, UnlabelPoint
from addon.io.batch import row_of
from addon.io.cameras import read_cameras
from addon.io.edits import read_edits
from addon.io.models import open_model, write_model
from addon.io.points import read_points
from scripts.keep_version import EARLIER, FEW, MODEL

from .hands import choose, ours, press, reopen, stored_take

VERSIONS = sorted(path.parent.name for path in EARLIER.glob("*/expected.json"))


@pytest.fixture(scope="module", params=VERSIONS)
def kept(request) -> Path:
    return EARLIER / request.param


@pytest.fixture(params=["points", "blobs"])
def take(request, kept, extension, empty):
    """The name of a take of a version's, which is open in its scene; beside it what the version read out of it."""
    bpy.ops.wm.open_mainfile(filepath=str(kept / "takes.blend"))
    bpy.context.window.scene = bpy.data.scenes[request.param]
    bpy.context.view_layer.update()
    return json.loads((kept / "expected.json").read_text(encoding="utf-8"))[request.param]


def test_a_take_and_its_settings_are_as_the_version_that_saved_it_read_it(take):
    now = stored_take()
    assert list(now.names) == take["markers"]
    assert np.bincount(now.labels.marker[now.labels.named], minlength=len(now.names)).tolist() == take["rows"]
    assert now.motion.frames[[0, -1]].tolist() == take["frames"]
    assert now.rate == pytest.approx(take["rate"])
    np.testing.assert_allclose(now.motion.markers[[0, 9, -1]], np.array(take["places"], dtype=float), atol=1e-5)
    assert (len(now.edits), now.cutoff) == (take["edits"], take["cutoff"])
    assert not [outcome for outcome in now.outcomes if outcome.reason]
    assert [[fill.marker, fill.first, fill.last] for fill in now.fills] == take["fills"]
    assert not any(now.unfit)
    collection = bpy.context.scene.mocap_autolabel.take
    assert {"toes.L", "toes.R"} <= set(ours("scene.character").moving_in(collection, now).segments)
    settings = bpy.context.scene.mocap_autolabel
    assert settings.subjects.markerset == MODEL
    assert settings.take is not None
    assert len(take["settings"]) > 40
    for name, value in take["settings"].items():
        kept = settings.path_resolve(name)
        assert (pytest.approx(value, abs=1e-4) if isinstance(value, float) else value) == kept, name
    lists = [scene.mocap_autolabel for scene in bpy.data.scenes]
    assert sorted([row.name for row in one.training.takes] for one in lists) == [[], ["one.c3d"]]
    assert sorted([row.name for row in one.subjects.performers] for one in lists) == [[], ["performer1"]]


def test_a_take_is_corrected_filled_smoothed_exported_and_saved_again(take, tmp_path):
    before = stored_take()
    bpy.context.scene.frame_set(3)
    choose("LASI")
    press("unlabel", scope="FRAME")
    assert len(stored_take().edits) == take["edits"] + 1
    assert np.isnan(stored_take().unfilled.markers[2, before.names.index("LASI")]).all()
    filling = bpy.context.scene.mocap_autolabel.filling
    filling.method, filling.use_longest = "auto", False
    press("fill_gaps", extent="TAKE")
    assert ["LASI", 3, 3] in [[fill.marker, fill.first, fill.last] for fill in stored_take().fitting]
    press("smooth")
    for ending, export in (("labels.csv", "labels"), ("c3d", "c3d"), ("trc", "trc"), ("html", "report")):
        operator = getattr(bpy.ops.mocap_autolabel, f"export_{export}")
        assert operator(filepath=str(tmp_path / f"walk.{ending}")) == {"FINISHED"}
    written = read_points(tmp_path / "walk.c3d")
    assert set(take["markers"]) <= set(written.names)
    places = stored_take().motion.markers
    reopen(tmp_path / "again.blend")
    np.testing.assert_allclose(stored_take().motion.markers, places, atol=1e-5)


def test_its_edits_report_calibration_and_model_are_used(kept, tmp_path):
    assert [type(edit) for edit in read_edits(kept / "walk.edits.json")] == [Swap, UnlabelPoint]
    report = json.loads((kept / "walk.report.json").read_text(encoding="utf-8"))
    assert report["model"] == MODEL
    row = row_of(report, "walk.c3d")
    assert (row.take, row.frames) == ("walk", 16)
    assert len(read_cameras(kept / "room.toml")) == 4
    model = open_model(kept / "few.markerset.json")
    assert len(model.markerset.markers) == len(FEW)
    assert set(model.markerset.markers) <= set(open_model(MODEL).markerset.markers)
    assert model.likelihood is not None
    assert model.training_takes
    assert all(one.points.shape[1:] == (len(FEW), 3) for one in model.training_takes), "it can be trained on"
    write_model(tmp_path / "again.markerset.json", model)
    assert open_model(tmp_path / "again.markerset.json").markerset.markers == model.markerset.markers
