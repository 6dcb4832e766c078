# SPDX-License-Identifier: GPL-3.0-or-later
"""What is put beside the recorded takes changes no test: tests name the folders that they go through."""

import re
from pathlib import Path

import pytest

from tests import recorded

HERE = Path(__file__).parent
OVER_EVERYTHING = re.compile(
    r"""\b(?:shared_data|DATA|PEOPLE|MCGILL|ROOM)\b.*\.(?:rglob\(|iterdir\(|glob\(["'][^"']*\*/)"""
)


def test_takes_come_from_the_named_folders_alone(tmp_path):
    for name in ("ann/b.c3d", "ann/a.C3D", "ann/notes.txt", "bob/a.c3d", "bob/deeper/a.c3d"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert recorded.takes(tmp_path, "ann") == [tmp_path / "ann" / "a.C3D", tmp_path / "ann" / "b.c3d"]
    (tmp_path / "carl").mkdir()
    with pytest.raises(LookupError, match="no takes in carl"):
        recorded.takes(tmp_path, "ann", "carl")


def test_no_test_goes_through_all_of_the_recorded_data():
    sources = {path: path.read_text(encoding="utf-8") for path in HERE.rglob("*.py") if path != Path(__file__)}
    assert len(sources) > 150
    assert [path.name for path, text in sources.items() if OVER_EVERYTHING.search(text)] == []
