# SPDX-License-Identifier: GPL-3.0-or-later
"""The Python package as pip installs it, and what run.py installs beside it: complete, pinned and of one version."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement

import run
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


def told_by(installed: Path, *command) -> str:
    return subprocess.check_output(command, cwd=installed, env=os.environ | {"PYTHONPATH": str(installed)}, text=True)


def test_what_is_installed_runs_anywhere_with_all_of_the_extension_no_script_and_the_manifests_version(installed):
    listed = told_by(installed, sys.executable, installed / "bin" / "mocap-autolabel", "models")
    assert {"gait15", "body26", "body39", "actor41", "actor53"} <= {line.split(":")[0] for line in listed.split("\n")}
    package = installed / "mocap_autolabel"
    for folder in ("addon", "assets"):
        wanted = {path.relative_to(build.ROOT) for path in (build.ROOT / folder).rglob("*") if path.is_file()}
        wanted = {path for path in wanted if "__pycache__" not in path.parts}
        assert {path for path in wanted if not (package / path).exists()} == set()
    assert [path.name for path in package.glob("*.py")] == ["__init__.py"]
    code = "from importlib.metadata import version; print(version('mocap-autolabel'))"
    assert told_by(installed, sys.executable, "-c", code).strip() == build.version()


def test_the_wheel_is_of_one_platform_and_brings_the_compiled_library(wheel, installed):
    target = build_kernels.TARGETS.get(build_kernels.this_platform())
    if target is None or not any(build_kernels.WHEELS.glob(f"*-{build_kernels.version()}-py3-none-{target.tag}.whl")):
        pytest.skip(NEVER_BUILT)
    assert wheel.name == f"mocap_autolabel-{build.version()}-py3-none-{target.tag}.whl"
    used = "from mocap_autolabel.addon.core.kernels import in_use; assert in_use()"
    code = f"{used}; import mocap_autolabel_kernels as k; print(k.PATH)"
    assert Path(told_by(installed, sys.executable, "-c", code).strip()).is_relative_to(installed)
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


SYSTEMS = [("linux", "x86_64"), ("win32", "AMD64"), ("darwin", "arm64"), ("darwin", "x86_64")]


def pins(name: str) -> list[tuple[Requirement, int]]:
    """Each line of a file of pins, and of how many files it has the hash."""
    text = (build.ROOT / name).read_text(encoding="utf-8").replace("\\\n", " ")
    rows = [line for line in text.split("\n") if line and not line.startswith("#")]
    hashed = re.compile(r"--hash=sha256:[0-9a-f]{64}\b")
    return [(Requirement(row.partition("--hash")[0]), len(hashed.findall(row))) for row in rows]


def asked() -> list[Requirement]:
    project = tomllib.loads((build.ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    lists = [project["project"]["dependencies"], project["build-system"]["requires"]]
    lists += project["project"]["optional-dependencies"].values()
    return [Requirement(one) for words in lists for one in words]


@pytest.mark.parametrize("python", run.PYTHONS)
@pytest.mark.parametrize("system", SYSTEMS, ids="-".join)
def test_everything_asked_for_is_pinned_once(python, system):
    here = default_environment() | dict(zip(("sys_platform", "platform_machine"), system, strict=True))
    here |= {"python_version": python, "python_full_version": python + ".4"}
    meant = [one for one, _ in pins(run.PINNED) if one.marker is None or one.marker.evaluate(here)]
    pinned = {one.name: str(one.specifier).removeprefix("==") for one in meant}
    assert len(pinned) == len(meant)
    wanted = [one for one in asked() if one.marker is None or one.marker.evaluate(here)]
    assert {"bpy", "numpy", "lzallright", "setuptools"} <= {one.name for one in wanted}
    assert [str(one) for one in wanted if not one.specifier.contains(pinned.get(one.name, "0"))] == []


@pytest.mark.parametrize("name", [run.PINNED, "kernels/compiler.txt"])
def test_every_pin_has_hashes_and_no_address(name):
    found = pins(name)
    assert found
    assert [str(one) for one, hashes in found if not hashes or not re.fullmatch(r"==[\w.]+", str(one.specifier))] == []
    text = (build.ROOT / name).read_text(encoding="utf-8")
    assert "://" not in text and "index" not in text and "find-links" not in text


def test_run_installs_the_pins_and_then_the_project_alone(tmp_path, monkeypatch):
    called = []
    for name in (run.PINNED, "pyproject.toml", "setup.py", "blender_manifest.toml"):
        (tmp_path / name).write_bytes((build.ROOT / name).read_bytes())
    (tmp_path / "env").mkdir()
    monkeypatch.setattr(run, "ROOT", tmp_path)
    monkeypatch.setattr(run, "output", lambda command: "3.13")
    monkeypatch.setattr(run, "call", lambda command: called.append(command[1:]) and 0)
    for _ in range(2):  # the second finds it done
        assert run.install("env", "3.13", ["python"]) is not None
    pinned, project = (words for words in called if "pip" in words)
    assert pinned[-3:] == ["--require-hashes", "--requirement", "requirements.txt"]
    assert project[-4:] == ["--no-deps", "--no-build-isolation", "--editable", "."]
