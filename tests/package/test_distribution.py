# SPDX-License-Identifier: GPL-3.0-or-later
"""The Python package as pip installs it: complete, with its command, and of the extension's version."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from scripts import build

LEFT_OUT = shutil.ignore_patterns(".*", "__pycache__", "build", "dist", "wheels", "*.egg-info", "demo-out", "tests")


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """A folder with the package as a normal installation has it, made from a copy of the sources."""
    folder = tmp_path_factory.mktemp("distribution")
    shutil.copytree(build.ROOT, folder / "sources", ignore=LEFT_OUT)
    pip = [sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps", "--target"]
    subprocess.run([*pip, folder / "installed", folder / "sources"], check=True, stdin=subprocess.DEVNULL)
    return folder / "installed"


def run(installed: Path, *command) -> str:
    environment = os.environ | {"PYTHONPATH": str(installed)}
    return subprocess.check_output(command, cwd=installed, env=environment, text=True)


def test_the_command_runs_outside_the_repository_and_finds_its_assets(installed):
    listed = run(installed, sys.executable, installed / "bin" / "mocap-autolabel", "models")
    assert {"gait15", "body26", "body39", "actor41", "actor53"} <= {line.split(":")[0] for line in listed.split("\n")}


def test_nothing_of_the_extension_is_missing_and_no_script_is_added(installed):
    package = installed / "mocap_autolabel"
    for folder in ("addon", "assets"):
        wanted = {path.relative_to(build.ROOT) for path in (build.ROOT / folder).rglob("*") if path.is_file()}
        wanted = {path for path in wanted if "__pycache__" not in path.parts}
        assert {path for path in wanted if not (package / path).exists()} == set()
    assert [path.name for path in package.glob("*.py")] == ["__init__.py"]


def test_its_version_is_the_manifests(installed):
    code = "from importlib.metadata import version; print(version('mocap-autolabel'))"
    assert run(installed, sys.executable, "-c", code).strip() == build.version()
