# SPDX-License-Identifier: GPL-3.0-or-later
"""The border between Python and C: the same functions and types on both sides, and one switch."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from addon.core.kernels import library
from addon.core.kernels.structures import ADDRESS, COUNT, NUMBER, SIGNATURES, STRUCTURES

ROOT = Path(__file__).resolve().parents[3]
HEADER = (ROOT / "kernels" / "src" / "kernels.h").read_text(encoding="utf-8")
SOURCES = "".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "kernels" / "src").glob("*.c")))


@pytest.fixture
def library_file() -> Path:
    """The compiled library that is in use."""
    if library.compiled is None:
        pytest.skip("the compiled library is not in use")
    return Path(library.compiled._name)


def without_comments(text: str) -> str:
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)


def declared(text: str) -> list[type]:
    """The types of declarations in C, one for each name: `double a, b[3];` or `const double *a, size_t b`."""
    kinds = []
    for part in filter(None, (part.strip() for part in re.split(r"[;]", text))):
        kind, names = re.fullmatch(r"(?:const )?(\w+) (.*)", part, re.DOTALL).groups()
        for name in names.split(","):
            size = re.search(r"\[(\d+)\]", name)
            one = ADDRESS if "*" in name else {"int64_t": COUNT, "double": NUMBER}[kind]
            kinds.append(one * int(size[1]) if size else one)
    return kinds


@pytest.mark.parametrize("name", STRUCTURES)
def test_structures_are_those_of_the_header(name):
    body = re.search(r"typedef struct \{([^{}]*)\} " + name + ";", without_comments(HEADER), re.DOTALL)[1]
    assert [kind for _, kind in STRUCTURES[name]._fields_] == declared(body)


def test_structures_and_signatures_are_those_of_the_sources():
    assert set(re.findall(r"\} (\w+);", without_comments(HEADER))) == set(STRUCTURES)
    found = {}
    for name, arguments in re.findall(r"^KERNEL \w+ (\w+)\(([^)]*)\) \{", without_comments(SOURCES), re.MULTILINE):
        kinds = [declared(one.strip()) for one in arguments.split(",") if one.strip() != "void"]
        found[name] = [kind for kinds_of_one in kinds for kind in kinds_of_one]
    assert found.pop("version") == []
    assert found == SIGNATURES


def test_numpy_is_used_where_there_is_no_library_or_one_of_another_version(monkeypatch):
    assert library._loaded() is not None
    monkeypatch.setattr(library, "LIBRARY_VERSION", library.LIBRARY_VERSION + 1)
    assert library._loaded() is None
    monkeypatch.setattr(library, "LIBRARY_PACKAGE", "mocap_autolabel_no_kernels")
    assert library._loaded() is None


@pytest.mark.parametrize(("value", "used"), [("1", "False"), ("0", "True"), ("", "True")])
def test_the_switch_chooses(value, used):
    code = "from addon.core.kernels import in_use; print(in_use())"
    environment = os.environ | {library.SWITCH: value, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    assert subprocess.check_output([sys.executable, "-c", code], env=environment, text=True).strip() == used


def test_after_an_update_the_library_is_that_of_the_new_version(tmp_path, monkeypatch, library_file):
    """The package of the version before is still imported then, and its library gone."""
    package = tmp_path / library.LIBRARY_PACKAGE
    package.mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, library.LIBRARY_PACKAGE, None)  # so that what is there comes back at the end
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.delenv(library.SWITCH, raising=False)
    (package / "__init__.py").write_text(f"PATH = {str(tmp_path / 'gone')!r}\n", encoding="utf-8")
    assert library._loaded() is None
    (package / "__init__.py").write_text(f"PATH = {str(library_file)!r}\n", encoding="utf-8")
    assert library._loaded() is not None
