# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be tried here of systems that are not here: encodings, line ends, and libraries that are in use."""

import ast
import builtins
import importlib.util
import os
import re
import runpy
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from scripts import build, build_kernels

ADDON = sorted((build.ROOT / "addon").rglob("*.py"))
SOURCES = [*ADDON, *sorted((build.ROOT / "scripts").glob("*.py")), *sorted(build.ROOT.glob("*.py"))]
OPENS = {"open", "read_text", "write_text", "TextIOWrapper", "fdopen"}


def offenders(paths: list[Path], offends: Callable[[str, str, set[str]], bool]) -> list[str]:
    """The calls in sources that offend, told by what is called, a file's mode, and the words that are given."""
    found = []
    texts = {path: path.read_text(encoding="utf-8") for path in paths}
    for path, text in texts.items():
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


def test_texts_are_opened_with_their_encoding_said():
    """Windows takes another one than UTF-8 where none is said."""

    def offends(name, mode, words):
        return (name != "open" or "b" not in mode) and "encoding" not in words

    # Methods of ours that have the same names are called with what they read.
    assert [one for one in offenders(SOURCES, offends) if not re.search(r"(: |[^.\w])read_text\(", one)] == []


def test_files_are_written_with_the_same_line_ends_everywhere():
    """Without `newline` Windows writes two characters at the end of each line, and the same take gives other bytes."""

    def offends(name, mode, words):
        writes = name == "write_text" or (name == "open" and set(mode) & set("wax") and "b" not in mode)
        return writes and "newline" not in words

    assert offenders([path for path in ADDON if path.parent.name != "cli"], offends) == []


@pytest.fixture
def unpack_wheels(tmp_path):
    """Blender's own unpacker of wheels, for a folder; gives what could not be removed."""
    spec = importlib.util.find_spec("bpy")
    if spec is None:
        pytest.skip("the bpy module, which brings Blender's unpacker of wheels, is not installed")
    (tool,) = Path(spec.submodule_search_locations[0]).glob(
        "*/scripts/modules/_bpy_internal/extensions/wheel_manager.py"
    )
    spec = importlib.util.spec_from_file_location("wheel_manager", tool)
    manager = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(manager)
    local = tmp_path / "local"

    def unpack(wheel: Path) -> tuple[list[str], list[Exception]]:
        stale, failed = [], []
        manager.apply_action(
            local_dir=str(local),
            local_dir_site_packages=str(local / "site-packages"),
            wheel_list=[("mocap_autolabel", [str(wheel)])],
            error_fn=failed.append,
            remove_error_fn=lambda path, _: stale.append(path),
            debug=False,
        )
        return stale, failed

    unpack.folder = local / "site-packages"
    return unpack


def library_of(folder: Path) -> Path:
    """Where the package of the compiled library that is unpacked to `folder` says that the library is."""
    return runpy.run_path(str(folder / build_kernels.PACKAGE / "__init__.py"))["PATH"]


def test_an_update_brings_its_library_though_the_old_one_is_in_use(unpack_wheels, tmp_path, monkeypatch):
    """As on Windows, which neither removes nor replaces a library that is loaded."""
    target, wheels = build_kernels.TARGETS["windows-x64"], []
    for number in ("1", "2"):
        monkeypatch.setattr(build_kernels, "version", lambda number=number: f"0.{number}.0+{number * 12}")
        wheels.append(tmp_path / f"{build_kernels.PACKAGE}-{build_kernels.version()}-py3-none-win_amd64.whl")
        build_kernels.pack(wheels[-1], target, f"library {number}".encode())
    assert unpack_wheels(wheels[0]) == ([], [])
    old = library_of(unpack_wheels.folder)
    assert old.read_bytes() == b"library 1"

    status = old.stat()

    def refusing(function):
        def call(path, *arguments, **words):
            reads = function is open and arguments[:1] in ((), ("r",), ("rb",))
            if not reads and Path(path).name == old.name and os.path.samestat(_status(path, words), status):
                raise PermissionError(13, "Access is denied", path)
            return function(path, *arguments, **words)

        return call

    for module, name in ((os, "unlink"), (os, "remove"), (builtins, "open")):
        monkeypatch.setattr(module, name, refusing(getattr(module, name)))
    stale, failed = unpack_wheels(wheels[1])
    monkeypatch.undo()
    assert failed == []
    assert library_of(unpack_wheels.folder).read_bytes() == b"library 2"
    assert stale == [str(old.parent)], "Blender takes it away when it starts next"
    shutil.rmtree(stale[0])
    assert library_of(unpack_wheels.folder).read_bytes() == b"library 2"


def _status(path: str, words: dict) -> os.stat_result:
    """Of a path, which may be beside an open folder; of the root where there is no such file."""
    try:
        return os.stat(path, dir_fd=words.get("dir_fd"))
    except OSError:
        return Path(os.sep).stat()
