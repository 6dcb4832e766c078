# SPDX-License-Identifier: GPL-3.0-or-later
"""The Python package as pip installs it: complete, with its command, and of the extension's version."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from kernels import build_kernels
from scripts import build

pytest.importorskip("setuptools", reason="setuptools, which builds the package, is not installed")
LEFT_OUT = shutil.ignore_patterns(".*", "__pycache__", "build", "dist", "wheels", "*.egg-info", "demo-out")
BUILDS = (
    "import sys; sys.path[:0] = ['scripts', 'kernels']; import backend; "
    "getattr(backend, 'build_' + sys.argv[1])(sys.argv[2])"
)
NEVER_BUILT = "no compiled library of these sources has been built here"


@pytest.fixture(scope="module")
def sources(tmp_path_factory) -> Path:
    """What the source distribution holds, unpacked; the library that was built of it lies there if it does here."""
    folder = tmp_path_factory.mktemp("sources")
    shutil.copytree(build.ROOT, folder / "copy", ignore=LEFT_OUT)
    subprocess.run([sys.executable, "-c", BUILDS, "sdist", folder], cwd=folder / "copy", check=True)
    [packed] = folder.glob("*.tar.gz")
    shutil.unpack_archive(packed, folder, filter="data")
    return folder / packed.name.removesuffix(".tar.gz")


@pytest.fixture(scope="module")
def wheel(sources, tmp_path_factory) -> Path:
    """The wheel of those sources; the library is not built again where it was."""
    if build_kernels.WHEELS.is_dir():
        shutil.copytree(build_kernels.WHEELS, sources / "wheels" / "kernels")
    return wheel_of(sources, tmp_path_factory.mktemp("wheel"))


def wheel_of(sources: Path, folder: Path) -> Path:
    done = subprocess.run(
        [sys.executable, "-c", BUILDS, "wheel", folder],
        cwd=sources,
        env=os.environ | {"PIP_NO_INDEX": "1", "PIP_CONFIG_FILE": os.devnull, "PIP_FIND_LINKS": ""},
        check=True,
        capture_output=True,
        text=True,
    )
    (folder / "said").write_text(done.stderr, encoding="utf-8")
    [built] = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """A folder with the package as a normal installation has it."""
    folder = tmp_path_factory.mktemp("installed")
    pip = [sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps", "--target"]
    subprocess.run([*pip, folder, wheel], check=True, stdin=subprocess.DEVNULL)
    return folder


def run(installed: Path, *command) -> str:
    return subprocess.check_output(command, cwd=installed, env=os.environ | {"PYTHONPATH": str(installed)}, text=True)


def test_what_is_installed_runs_anywhere_with_all_of_the_extension_no_script_and_the_manifests_version(installed):
    listed = run(installed, sys.executable, installed / "bin" / "mocap-autolabel", "models")
    assert {"gait15", "body26", "body39", "actor41", "actor53"} <= {line.split(":")[0] for line in listed.split("\n")}
    package = installed / "mocap_autolabel"
    for folder in ("addon", "assets"):
        wanted = {path.relative_to(build.ROOT) for path in (build.ROOT / folder).rglob("*") if path.is_file()}
        wanted = {path for path in wanted if "__pycache__" not in path.parts}
        assert {path for path in wanted if not (package / path).exists()} == set()
    assert [path.name for path in package.glob("*.py")] == ["__init__.py"]
    code = "from importlib.metadata import version; print(version('mocap-autolabel'))"
    assert run(installed, sys.executable, "-c", code).strip() == build.version()


def test_the_wheel_is_of_one_platform_and_brings_the_compiled_library(wheel, installed):
    target = build_kernels.TARGETS.get(build_kernels.this_platform())
    if target is None or not any(build_kernels.WHEELS.glob(f"*-{build_kernels.version()}-py3-none-{target.tag}.whl")):
        pytest.skip(NEVER_BUILT)
    assert wheel.name == f"mocap_autolabel-{build.version()}-py3-none-{target.tag}.whl"
    code = (
        "import mocap_autolabel_kernels as k; from mocap_autolabel.addon.core.kernels import in_use;"
        "print(k.PATH); assert in_use()"
    )
    assert Path(run(installed, sys.executable, "-c", code).strip()).is_relative_to(installed)
    with zipfile.ZipFile(wheel) as archive:
        [about] = (archive.read(name).decode() for name in archive.namelist() if name.endswith(".dist-info/WHEEL"))
    assert "Root-Is-Purelib: false" in about


def test_the_source_distribution_holds_what_is_needed_and_without_a_compiler_its_wheel_is_for_all(sources, tmp_path):
    """Where the compiler is installed, or the library was built, there would be one: so the sources are changed."""
    shutil.copytree(sources, tmp_path / "sources", ignore=LEFT_OUT)
    (tmp_path / "sources" / "kernels" / "compiler.txt").write_text("ziglang==0.0.0", encoding="utf-8")
    (tmp_path / "out").mkdir()
    assert wheel_of(tmp_path / "sources", tmp_path / "out").name.endswith("-py3-none-any.whl")
    assert "built without the compiled library, NumPy does its work" in (tmp_path / "out" / "said").read_text("utf-8")
    for folder in ("addon", "assets", "docs", "farm", "kernels", "scripts", "tests"):
        wanted = {path.relative_to(build.ROOT) for path in (build.ROOT / folder).rglob("*") if path.is_file()}
        wanted = {path for path in wanted if not {"__pycache__", ".hypothesis"} & set(path.parts)}
        assert {path for path in wanted if not (sources / path).exists()} == set()
    for name in ("CHANGELOG.md", "LICENSE", "README.md", "blender_manifest.toml", "requirements.txt", "run.py"):
        assert (sources / name).is_file(), name
