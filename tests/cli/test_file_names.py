# SPDX-License-Identifier: GPL-3.0-or-later
"""Files whose names are any bytes: taken as they are, and nothing is written that cannot be read again."""

import json
import shutil
import sys

import pytest

from addon.demo.take import MODEL
from addon.io.labels import LabelFile
from addon.io.points import read_points

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only here any bytes are a name of a file")
STEM = b"w\xff\xc3lk\nx\ty\xe2\x80\xa8".decode("utf-8", "surrogateescape")


def readable(folder, frames: int):
    """Whether a take's outputs are there and can be read."""
    for ending in (".c3d", ".trc"):
        assert len(read_points(folder / f"{STEM}{ending}").xyz) == frames
    with LabelFile(folder / f"{STEM}.labels.csv") as labels:
        assert any(row.marker for row in labels.rows())
    assert json.loads((folder / f"{STEM}.report.json").read_text())["frames"] == frames


def test_points(run, room, tmp_path):
    source = shutil.copy(room.c3d, tmp_path / f"{STEM}.c3d")
    assert run("label", source, "--model", MODEL, "--out", tmp_path / STEM, "--trc").status == 0
    readable(tmp_path / STEM, 20)


@pytest.mark.blender
def test_blobs_with_a_blender_file_that_serves_as_calibration(label, room, tmp_path):
    source = shutil.copy(room.blobs, tmp_path / f"{STEM}.csv")
    calibration = shutil.copy(room.cameras, tmp_path / f"{STEM}.toml")
    assert label("--trc", "--blend", blobs=[source], cameras=calibration).status == 0
    readable(tmp_path / "out", 20)
    saved = shutil.move(tmp_path / "out" / f"{STEM}.blend", tmp_path / f"{STEM}.blend")
    assert label("--overwrite", blobs=[source], cameras=saved).status == 0
