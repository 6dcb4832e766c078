# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers smoothed in the scene and in exports: kept beside labels and fills, and taken back."""

import bpy
import numpy as np
import pytest

from addon.core.filling.smoothing import smoothed
from addon.io.points import read_points
from tests.io.pages import read

from .hands import choose, follows, keys_of, refused, reopen

RATE, CUTOFF = 60.0, 5.0


def is_smooth(files, name: str):
    """Asserts that a marker is keyed where its trajectory is when it is smoothed."""
    calm = smoothed(files.xyz, RATE, CUTOFF)[:, files.names.index(name)]
    there = np.isfinite(calm[:, 0])
    keys = keys_of(name)
    assert keys[:, 0].tolist() == (101 + np.flatnonzero(there)).tolist()
    np.testing.assert_allclose(keys[:, 1:], calm[there], atol=1e-5)


@pytest.fixture
def calm(labelled):
    """The take smoothed."""
    labelled.scene.mocap_autolabel.filling.cutoff = CUTOFF
    assert bpy.ops.mocap_autolabel.smooth() == {"FINISHED"}
    return labelled


def test_keys_and_exports_are_smooth_and_labels_stay(calm, files):
    is_smooth(files, "LWRA")
    bpy.ops.mocap_autolabel.export_c3d(filepath=str(files.folder / "ours.c3d"))
    take = read_points(files.folder / "ours.c3d")
    wanted = smoothed(files.xyz, RATE, CUTOFF)[:, files.names.index("LWRA")]
    np.testing.assert_allclose(take.xyz[:, take.names.index("LWRA")], wanted, atol=1e-5)
    assert not (take.residual == 0).any(), "smoothed is measured still"
    page = files.folder / "walk.report.html"
    assert bpy.ops.mocap_autolabel.export_report(filepath=str(page), open_after=False) == {"FINISHED"}
    said = " ".join(" ".join(read(page.read_text(encoding="utf-8")).said).split())
    raw = files.xyz[:, files.names.index("LWRA")]
    there, changed = (int(flags.all(axis=1).sum()) for flags in (np.isfinite(raw), np.abs(wanted - raw) > 0))
    assert f"LWRA {there} 0 {len(raw) - there} {changed} 0 " in said.partition("Where every sample is from")[2]
    assert bpy.ops.mocap_autolabel.take_back_smoothing() == {"FINISHED"}
    follows(files, "LWRA", files.names.index("LWRA"))
    refused("Nothing is smoothed", "take_back_smoothing")


def test_it_is_kept_through_files_corrections_and_labelling_again(calm, files):
    path = str(files.folder / "walk.blend")
    reopen(path)
    choose("LKNE", "RKNE")
    bpy.ops.mocap_autolabel.swap_markers(scope="WHOLE")
    bpy.ops.mocap_autolabel.clear_corrections()
    is_smooth(files, "LKNE")
    assert bpy.ops.mocap_autolabel.label() == {"FINISHED"}
    is_smooth(files, "LKNE")


def test_fills_are_made_of_what_was_measured(calm, files):
    calm.scene.mocap_autolabel.filling.method = "rigid"
    choose("RASI")
    calm.scene.frame_set(112)
    bpy.ops.mocap_autolabel.fill_gaps(extent="GAP")
    [row] = calm.window_manager.mocap_autolabel.fills
    assert row.reason == ""
    bpy.ops.mocap_autolabel.take_back_smoothing()
    assert [row.reason for row in calm.window_manager.mocap_autolabel.fills] == [""]


def test_a_cut_off_that_cannot_be_is_one_sentence(labelled):
    labelled.scene.mocap_autolabel.filling.cutoff = 45.0
    refused("45 Hz at 60 frames a second; expected one above 0 and below 30 Hz", "smooth")
    assert "mocap_smoothing" not in labelled.scene.mocap_autolabel.take
