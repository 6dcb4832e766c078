# SPDX-License-Identifier: GPL-3.0-or-later
"""What pyproject.toml cannot state: the version, the layout, and that a wheel carries the compiled library.

The repository's root is itself the package `mocap_autolabel`, because it is the root of a Blender extension too.
"""

import shutil
import sys
import tomllib
from pathlib import Path

import build_kernels  # in kernels/, which the build has on its path
from setuptools import find_packages, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent


class BuildPy(build_py):
    """Packs the package without the scripts that lie beside its `__init__.py`."""

    def find_package_modules(self, package, package_dir):
        modules = super().find_package_modules(package, package_dir)
        return [m for m in modules if package != "mocap_autolabel" or m[1] == "__init__"]


class BdistWheel(bdist_wheel):
    """Packs the compiled library too, which makes the wheel one platform's; without it, it is for all."""

    platform_tag = "any"

    def run(self):
        folder = Path(self.get_finalized_command("build").build_lib)
        shutil.rmtree(folder, ignore_errors=True)  # what an earlier build left would go along
        try:
            self.platform_tag = build_kernels.unpack_library(folder)
        except SystemExit as error:
            print(f"The wheel is built without the compiled library, NumPy does its work: {error}", file=sys.stderr)
        super().run()

    def get_tag(self):
        return "py3", "none", self.platform_tag

    def write_wheelfile(self, *arguments, **words):
        self.root_is_pure = self.platform_tag == "any"
        super().write_wheelfile(*arguments, **words)


setup(
    version=tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"],
    packages=["mocap_autolabel"]
    + [f"mocap_autolabel.{name}" for name in find_packages(str(ROOT), include=["addon", "addon.*"])],
    package_dir={"mocap_autolabel": "."},
    package_data={"mocap_autolabel": ["blender_manifest.toml", "LICENSE", "py.typed", "assets/**"]},
    include_package_data=False,
    cmdclass={"bdist_wheel": BdistWheel, "build_py": BuildPy},
)
