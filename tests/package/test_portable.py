# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of all sources, and what can be tried here of other systems: encodings, line ends, libraries in use."""

import ast
import re
import runpy
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

from kernels import build_kernels
from scripts import build

ADDON = sorted((build.ROOT / "addon").rglob("*.py"))
SOURCES = [*ADDON, *sorted((build.ROOT / "scripts").glob("*.py")), *sorted(build.ROOT.glob("*.py"))]
OPENS = {"open", "read_text", "write_text", "TextIOWrapper", "fdopen"}


def offenders(paths: list[Path], offends: Callable[[str, str, set[str]], bool]) -> list[str]:
    """The calls in sources that offend, told by what is called, a file's mode, and the words that are given."""
    found = []
    for path, text in {path: path.read_text(encoding="utf-8") for path in paths}.items():
        if not any(f"{name}(" in text for name in OPENS):
            continue
        for node in ast.walk(ast.parse(text)):
            name = getattr(node.func, "attr", getattr(node.func, "id", "")) if isinstance(node, ast.Call) else ""
            if name not in OPENS or ast.unparse(node.func) in ("os.open", "Image.open"):
                continue
            if offends(name, mode_of(node), {word.arg for word in node.keywords}):
                found.append(f"{path.relative_to(build.ROOT)}:{node.lineno}: {ast.unparse(node)[:60]}")
    return found


def mode_of(node: ast.Call) -> str:
    """The mode that a call opens a file in, if it opens one."""
    given = [word.value for word in node.keywords if word.arg == "mode"]
    given += node.args[0 if isinstance(node.func, ast.Attribute) else 1 :][:1]
    return str(given[0].value) if given and isinstance(given[0], ast.Constant) else "r"


def test_texts_are_opened_with_their_encoding_and_written_with_the_same_line_ends_everywhere():
    """Windows takes another one than UTF-8 where none is said."""

    def offends(name, mode, words):
        return (name != "open" or "b" not in mode) and "encoding" not in words

    # Methods of ours that have the same names are called with what they read.
    assert [one for one in offenders(SOURCES, offends) if not re.search(r"(: |[^.\w])read_text\(", one)] == []
    # Without `newline` Windows writes two characters at the end of each line, and the same take gives other bytes.

    def offends(name, mode, words):
        writes = name == "write_text" or (name == "open" and set(mode) & set("wax") and "b" not in mode)
        return writes and "newline" not in words

    assert offenders([path for path in ADDON if path.parent.name != "cli"], offends) == []


def test_an_update_brings_its_library_beside_the_old_one(tmp_path, monkeypatch):
    """Windows neither removes nor replaces a library that is loaded: each version has a place of its own."""
    target, places = build_kernels.TARGETS["windows-x64"], []
    for number in ("1", "2"):
        monkeypatch.setattr(build_kernels, "version", lambda number=number: f"0.{number}.0+{number * 12}")
        wheel = tmp_path / f"{build_kernels.PACKAGE}-{build_kernels.version()}-py3-none-win_amd64.whl"
        build_kernels.pack(wheel, target, f"library {number}".encode())
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(tmp_path / "site-packages")
        found = runpy.run_path(str(tmp_path / "site-packages" / build_kernels.PACKAGE / "__init__.py"))["PATH"]
        assert found.read_bytes() == f"library {number}".encode()
        places.append(found)
    assert places[0] != places[1]
    assert places[0].read_bytes() == b"library 1"


def test_importing_the_package_loads_neither_blender_nor_anything_heavy():
    code = (
        "import sys, addon\n"
        "print(sorted({'bpy', 'lzallright', 'numpy', 'olefile', 'scipy', 'threadpoolctl'} & set(sys.modules)))"
    )
    assert subprocess.check_output([sys.executable, "-c", code], cwd=build.ROOT, text=True).strip() == "[]"


def test_every_source_states_its_licence():
    licence = "# SPDX-License-Identifier: GPL-3.0-or-later\n"
    assert [
        str(path)
        for path in [*ADDON, build.ROOT / "__init__.py"]
        if not path.read_text(encoding="utf-8").startswith(licence)
    ] == []
