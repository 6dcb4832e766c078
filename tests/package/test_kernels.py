# SPDX-License-Identifier: GPL-3.0-or-later
"""The wheels of the compiled library, as far as they can be looked at without building one."""

import runpy
import tarfile
import zipfile

import pytest

from addon.core.kernels.library import LIBRARY_VERSION
from kernels import build_kernels
from scripts import build

MOST_BYTES = 300_000


@pytest.mark.parametrize("platform", build_kernels.TARGETS)
def test_a_wheel_serves_every_python_of_its_platform(platform, tmp_path, monkeypatch):
    built = []

    def compiled(target, library):
        built.append(target)
        library.write_bytes(b"machine code")

    monkeypatch.setattr(build_kernels, "compile_library", compiled)
    (tmp_path / f"{build_kernels.PACKAGE}-old-py3-none-{build_kernels.TARGETS[platform].tag}.whl").touch()
    wheel = build_kernels.build(platform, tmp_path)
    assert build_kernels.build(platform, tmp_path) == wheel and len(built) == 1
    assert list(tmp_path.iterdir()) == [wheel]
    name, version, *tags = wheel.name.removesuffix(".whl").split("-")
    assert (name, version) == (build_kernels.PACKAGE, build_kernels.version())
    assert tags == ["py3", "none", build_kernels.TARGETS[platform].tag]
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    found = runpy.run_path(str(tmp_path / name / "__init__.py"))["PATH"]
    assert found.name == build_kernels.TARGETS[platform].library
    assert found.read_bytes() == b"machine code"


def test_pip_builds_what_an_index_takes_and_all_that_builds_it_is_in_its_sources(tmp_path, monkeypatch):
    monkeypatch.setattr(build_kernels, "compile_library", lambda target, library: library.write_bytes(b"machine code"))
    monkeypatch.setattr(build_kernels, "this_platform", lambda: "linux-x64")
    number = build_kernels.version().partition("+")[0]
    assert number.partition(".")[0] == str(LIBRARY_VERSION)
    name = build_kernels.build_wheel(str(tmp_path), None, None)
    assert name == f"{build_kernels.PACKAGE}-{number}-py3-none-manylinux_2_17_x86_64.whl"
    with zipfile.ZipFile(tmp_path / name) as archive:
        about = archive.read(f"{build_kernels.PACKAGE}-{number}.dist-info/METADATA").decode()
    assert f"Version: {number}\n" in about and "License-Expression: GPL-3.0-or-later\n" in about
    with tarfile.open(tmp_path / build_kernels.build_sdist(str(tmp_path))) as packed:
        names = {entry.partition("/")[2] for entry in packed.getnames()}
    folder = build_kernels.HERE
    wanted = {path.relative_to(folder).as_posix() for path in folder.rglob("*.[cht]*") if path.is_file()}
    assert wanted | {"build_kernels.py", "PKG-INFO"} == names - {"src"}


def test_every_zip_may_have_a_library_and_what_has_been_built_is_small():
    assert set(build_kernels.TARGETS) == set(build.WHEEL_TAGS)
    found = sorted(build_kernels.WHEELS.glob("*.whl"))
    if not found:
        pytest.skip("no wheel has been built here")
    assert max(wheel.stat().st_size for wheel in found) < MOST_BYTES
