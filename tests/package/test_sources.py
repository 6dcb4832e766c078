# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules that every source file keeps, because Blender loads the add-on under a name of its own."""

import ast
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [*sorted((ROOT / "addon").rglob("*.py")), ROOT / "__init__.py"]
PURE = [path for path in SOURCES if path.parent.name in ("core", "io") or path.parent.parent.name in ("core", "io")]
# Blender brings these, the standard library or the zip's wheels the rest.
BLENDERS_OWN = {"bpy", "bpy_extras", "mathutils", "gpu", "gpu_extras", "blf", "bmesh", "addon_utils", "numpy"}
WHEELS = {"lzallright", "olefile", "scipy", "threadpoolctl"}
OPTIONAL = {"distributed"}  # of the command line, which says in a sentence that it is not there


def absolute_imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (name.name.split(".")[0] for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module.split(".")[0]


def offenders(paths, wrong):
    found = {str(path.relative_to(ROOT)): sorted(wrong(set(absolute_imports(path)))) for path in paths}
    return {path: names for path, names in found.items() if names}


def test_imports_are_relative_or_come_with_blender_or_the_wheels():
    allowed = BLENDERS_OWN | WHEELS | OPTIONAL | set(sys.stdlib_module_names)
    assert offenders(SOURCES, lambda names: names - allowed) == {}


def test_core_and_formats_know_no_blender():
    assert len(PURE) > 10
    assert offenders(PURE, lambda names: names & (BLENDERS_OWN - {"numpy"})) == {}


def test_importing_the_package_loads_neither_blender_nor_anything_heavy():
    code = (
        "import sys, addon\n"
        "print(sorted({'bpy', 'lzallright', 'numpy', 'olefile', 'scipy', 'threadpoolctl'} & set(sys.modules)))"
    )
    assert subprocess.check_output([sys.executable, "-c", code], cwd=ROOT, text=True).strip() == "[]"


def test_every_source_states_its_licence():
    licence = "# SPDX-License-Identifier: GPL-3.0-or-later\n"
    assert [str(path) for path in SOURCES if not path.read_text(encoding="utf-8").startswith(licence)] == []
