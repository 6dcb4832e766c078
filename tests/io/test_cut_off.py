# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that end before their end are refused wherever the file tells it; what a file does not say is said."""

import re

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.data.takes import Points
from addon.io.points import read_points, write_c3d, write_trc
from addon.io.world import UNITS
from tests.io.samples import motive, walk


@pytest.fixture
def whole(tmp_path):
    """A take as C3D, TRC and Motive CSV."""
    take = walk(frames=40)
    write_c3d(tmp_path / "take.c3d", take)
    write_trc(tmp_path / "take.trc", take)
    text = motive().replace("Length Units", "Total Exported Frames,5,Length Units")
    (tmp_path / "take.csv").write_text(text, encoding="utf-8")
    for path in tmp_path.iterdir():
        assert len(read_points(path).xyz) in (5, 40)
    return tmp_path


@pytest.mark.parametrize("name", ["take.c3d", "take.trc", "take.csv"])
@pytest.mark.parametrize("left", [0.45, 0.6, 0.8, 0.9])
def test_what_is_cut_off_anywhere_is_refused(whole, name, left):
    content = (whole / name).read_bytes()
    (whole / name).write_bytes(content[: int(left * len(content))])
    with pytest.raises(InputError, match="expected"):
        read_points(whole / name)


@pytest.mark.parametrize(("name", "frames"), [("take.trc", "30 of 40"), ("take.csv", "3 of 5")])
def test_what_is_cut_off_between_two_lines_is_refused(whole, name, frames):
    lines = (whole / name).read_text(encoding="utf-8").splitlines(keepends=True)
    (whole / name).write_text("".join(lines[: -10 if name.endswith("trc") else -2]), encoding="utf-8")
    with pytest.raises(InputError, match=f"has {frames} frames; expected all of them"):
        read_points(whole / name)


def test_a_part_that_was_taken_out_of_a_trc_is_no_damage(whole):
    lines = (whole / "take.trc").read_text().splitlines(keepends=True)
    (whole / "take.trc").write_text("".join([*lines[:6], *lines[16:]]))
    take = read_points(whole / "take.trc")
    assert (len(take.xyz), take.first_frame) == (30, walk().first_frame + 10)


def test_a_trc_whose_last_line_has_no_end_is_whole(whole):
    text = (whole / "take.trc").read_text()
    (whole / "take.trc").write_text(text.removesuffix("\n"))
    assert len(read_points(whole / "take.trc").xyz) == 40
    (whole / "take.trc").write_text(text[: text.rindex("\t")])
    with pytest.raises(InputError, match="ends in the middle of a row"):
        read_points(whole / "take.trc")


def test_a_trc_keeps_frames_below_nought(tmp_path):
    take = walk()
    write_trc(tmp_path / "early.trc", Points(take.names, take.xyz, take.residual, take.rate, -7))
    assert read_points(tmp_path / "early.trc").first_frame == -7


@pytest.mark.parametrize("unit", ["m", "cm", "mm", "", "furlongs"])
def test_a_unit_that_no_file_names_is_assumed_and_said(tmp_path, unit):
    person = walk(frames=20, points=20)
    write_trc(tmp_path / "take.trc", person)
    text = (tmp_path / "take.trc").read_text()
    # A reader that splits a head at white space needs a word there.
    (tmp_path / "take.trc").write_text(re.sub(r"\tmm\t", f"\t{unit or '?'}\t", text, count=1))
    take = read_points(tmp_path / "take.trc")
    assert take.assumed == ("" if unit in UNITS else "mm")
    if unit not in ("m", "cm"):
        np.testing.assert_allclose(take.xyz, person.xyz, atol=1e-5)
