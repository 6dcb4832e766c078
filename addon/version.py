# SPDX-License-Identifier: GPL-3.0-or-later
"""The version, which only the manifest has."""

import tomllib
from pathlib import Path

MANIFEST = Path(__file__).resolve().parents[1] / "blender_manifest.toml"


def version() -> str:
    """The version of the add-on."""
    return tomllib.loads(MANIFEST.read_text(encoding="utf-8"))["version"]
