# SPDX-License-Identifier: GPL-3.0-or-later
"""The two facts that pyproject.toml cannot state: the version and the layout.

The repository's root is itself the package `mocap_autolabel`, because it is the root of a Blender extension too.
"""

import tomllib
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent


class BuildPy(build_py):
    """Packs the package without the scripts that lie beside its `__init__.py`."""

    def find_package_modules(self, package, package_dir):
        modules = super().find_package_modules(package, package_dir)
        return [m for m in modules if package != "mocap_autolabel" or m[1] == "__init__"]


setup(
    version=tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"],
    packages=["mocap_autolabel"]
    + [f"mocap_autolabel.{name}" for name in find_packages(str(ROOT), include=["addon", "addon.*"])],
    package_dir={"mocap_autolabel": "."},
    package_data={"mocap_autolabel": ["blender_manifest.toml", "LICENSE", "py.typed", "assets/**"]},
    include_package_data=False,
    cmdclass={"build_py": BuildPy},
)
