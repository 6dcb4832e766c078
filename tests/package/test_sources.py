# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules that every source file keeps, because Blender loads the add-on under a name of its own."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [*sorted((ROOT / "addon").rglob("*.py")), ROOT / "__init__.py"]


def test_importing_the_package_loads_neither_blender_nor_anything_heavy():
    code = (
        "import sys, addon\n"
        "print(sorted({'bpy', 'lzallright', 'numpy', 'olefile', 'scipy', 'threadpoolctl'} & set(sys.modules)))"
    )
    assert subprocess.check_output([sys.executable, "-c", code], cwd=ROOT, text=True).strip() == "[]"


def test_every_source_states_its_licence():
    licence = "# SPDX-License-Identifier: GPL-3.0-or-later\n"
    assert [str(path) for path in SOURCES if not path.read_text(encoding="utf-8").startswith(licence)] == []
