# SPDX-License-Identifier: GPL-3.0-or-later
"""One word, one thing: no two classes and constants of the add-on share a name; and tests name recorded folders."""

import ast
import re
from collections import defaultdict
from pathlib import Path

ADDON = Path(__file__).resolve().parents[1] / "addon"
# What every module of its kind has: the classes that Blender registers, a verb's help, a reader's "expected …".
OF_EVERY_MODULE = {"DESCRIPTION", "KIND", "EXPECTED"}


def names_defined(path: Path) -> set[str]:
    """Classes and constants at the top of a file."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef):
            found.add(node.name)
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets:
            for one in getattr(target, "elts", [target]):
                if isinstance(one, ast.Name) and one.id.isupper():
                    found.add(one.id)
    return found


def test_no_name_is_given_twice():
    places = defaultdict(list)
    for path in sorted(ADDON.rglob("*.py")):
        for name in names_defined(path) - OF_EVERY_MODULE:
            places[name].append(path.relative_to(ADDON).as_posix())
    assert len(places) > 500
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


HERE = Path(__file__).parent
OVER_EVERYTHING = re.compile(
    r"""\b(?:shared_data|DATA|PEOPLE|MCGILL|ROOM)\b.*\.(?:rglob\(|iterdir\(|glob\(["'][^"']*\*/)"""
)


def test_no_test_goes_through_all_of_the_recorded_data():
    sources = {path: path.read_text(encoding="utf-8") for path in HERE.rglob("*.py") if path != Path(__file__)}
    assert len(sources) > 150
    assert [path.name for path, text in sources.items() if OVER_EVERYTHING.search(text)] == []
