# SPDX-License-Identifier: GPL-3.0-or-later
"""What is put beside the recorded takes changes no test: tests name the folders that they go through."""

import re
from pathlib import Path

HERE = Path(__file__).parent
OVER_EVERYTHING = re.compile(
    r"""\b(?:shared_data|DATA|PEOPLE|MCGILL|ROOM)\b.*\.(?:rglob\(|iterdir\(|glob\(["'][^"']*\*/)"""
)


def test_no_test_goes_through_all_of_the_recorded_data():
    sources = {path: path.read_text(encoding="utf-8") for path in HERE.rglob("*.py") if path != Path(__file__)}
    assert len(sources) > 150
    assert [path.name for path, text in sources.items() if OVER_EVERYTHING.search(text)] == []
