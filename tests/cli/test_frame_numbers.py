# SPDX-License-Identifier: GPL-3.0-or-later
"""Frame numbers near and beyond what 32 bits hold, and frames that nobody saw: kept as they are, or one sentence."""

import json

import numpy as np
import pytest

from addon.demo.take import MODEL
from addon.io.points import read_points

PAUSE = 5 * 60 * 240  # frames: five minutes at 240 Hz


def moved(room, folder, shift: int, again: int = 0):
    """The room's blobs with other frame numbers, and where `again` is given once more so many frames later."""
    head, *rows = room.blobs.read_text().splitlines(keepends=True)
    fields = [row.split(",", 1) for row in rows]
    shifts = (shift, shift + again) if again else (shift,)
    path = folder / "moved.csv"
    path.write_text(head + "".join(f"{int(frame) + more},{rest}" for more in shifts for frame, rest in fields))
    return path


def test_minutes_without_anybody_keep_the_numbers_of_all_files(label, room, tmp_path):
    answer = label("--trc", blobs=[moved(room, tmp_path, 0, PAUSE)])
    assert answer.status == 0
    report = json.loads((tmp_path / "out" / "moved.report.json").read_text())
    assert report["frames"] == PAUSE + 20
    assert {marker["longest_gap"] >= PAUSE - 20 for marker in report["markers"].values()} == {True}
    for ending in (".c3d", ".trc"):
        take = read_points(tmp_path / "out" / f"moved{ending}")
        seen = np.flatnonzero(np.isfinite(take.xyz).any(axis=(1, 2)))
        assert take.first_frame == 100
        assert np.isin([0, 19, PAUSE, PAUSE + 19], seen).all()
        assert not ((seen > 19) & (seen < PAUSE)).any()


def test_points_of_blobs_with_a_long_gap_are_made_in_seconds(run, room, tmp_path):
    out = tmp_path / "points.c3d"
    assert run("reconstruct", moved(room, tmp_path, 0, 2000), "--cameras", room.cameras, "--out", out).status == 0
    assert len(read_points(out).xyz) == 2020


@pytest.mark.blender
def test_a_take_longer_than_blender_counts_is_refused_before_it_is_worked_on(label, room, tmp_path, monkeypatch):
    monkeypatch.setattr("addon.scene.take.LAST_FRAME", 50)
    answer = label("--blend", blobs=[moved(room, tmp_path, 0, 60)])
    assert answer.status == 1
    assert "from frame 100 to 179; expected at most 50 frames" in answer.reason
    assert not list((tmp_path / "out").iterdir())


def trc_from(room, folder, run, first: int):
    """The room's take as a TRC that begins with another frame."""
    assert run("label", room.c3d, "--model", MODEL, "--out", folder, "--trc").status == 0
    lines = (folder / "take.trc").read_text().splitlines()
    rows = [line.split("\t", 1) for line in lines[6:]]
    path = folder / "far.trc"
    path.write_text("\n".join(lines[:6] + [f"{first + at}\t{rest}" for at, (_, rest) in enumerate(rows)]) + "\n")
    return path


@pytest.mark.parametrize("first", [5_000_000_000, 2**32 - 10])
def test_points_beyond_what_a_c3d_counts_are_told_with_file_and_line(run, room, tmp_path, first):
    path = trc_from(room, tmp_path, run, first)
    answer = run("label", path, "--model", MODEL, "--out", tmp_path / "out", "--trc")
    assert answer.status == 2
    assert "far.trc:" in answer.reason
    assert "up to 4294967295" in answer.reason
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())
