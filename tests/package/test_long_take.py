# SPDX-License-Identifier: GPL-3.0-or-later
"""A long take in a real Blender that has no extension: `tours/play_long.py` plays it, this file judges it."""

import json
from pathlib import Path

import numpy as np
import pytest

from addon.io import poses
from addon.io.points import read_points
from addon.jobs import LabelJob, label_file
from scripts.virtual_take import write_virtual_points

from .conftest import TOURS

pytestmark = pytest.mark.real_blender
FRAMES, LOOKED_AT = 90, (1, 30, 90)


def saved(folder: Path) -> Path:
    """The folder of a take in `folder` that was saved as one too long for keys."""
    pytest.importorskip("bpy", reason="what saves the take")
    write_virtual_points(folder, FRAMES)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(poses, "MOST_KEYS", 100)
        for _ in label_file(LabelJob(folder / "walk.c3d", None, "body26", folder / "out", blend=True)):
            pass
    return folder / "out"


@pytest.fixture
def played(blender_program, tmp_path):
    """What a Blender saw of a take that was saved to be played, and the take's points."""
    out, other = saved(tmp_path), tmp_path / "other"
    other.mkdir()
    script, seen = TOURS / "play_long.py", tmp_path / "seen.json"
    files = [str(out / "walk.blend"), str(other / "walk.blend"), str(seen)]
    arguments = ["--background", "--factory-startup", "--python", str(script), "--", *files, *map(str, LOOKED_AT)]
    done = blender_program.run(*arguments, home=tmp_path / "home")
    assert seen.exists(), done.stdout + done.stderr
    return json.loads(seen.read_text()), read_points(out / "walk.c3d")


def test_it_plays_without_the_extension_and_when_saved_elsewhere(played):
    seen, points = played
    assert not seen["extension"]
    assert seen["again"] == seen["opened"]
    names = list(points.names)
    compared = 0
    for frame, found in zip(LOOKED_AT, seen["opened"], strict=True):
        for name, place in found["markers"].items():
            known = points.xyz[frame - points.first_frame : frame - points.first_frame + 1, names.index(name)][0]
            if np.isfinite(known).all():
                np.testing.assert_allclose(place, known, atol=1e-5)
                compared += 1
    assert compared > 40
    heads = np.array([list(found["bones"].values()) for found in seen["opened"]])
    assert np.ptp(heads, axis=0).max() > 0.01
