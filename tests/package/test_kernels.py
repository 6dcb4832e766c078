# SPDX-License-Identifier: GPL-3.0-or-later
"""The wheels of the compiled library, as far as they can be looked at without building one."""

import runpy
import zipfile

import pytest

from scripts import build, build_kernels

MOST_BYTES = 300_000


@pytest.mark.parametrize("platform", build_kernels.TARGETS)
def test_a_wheel_serves_every_python_of_its_platform(platform, tmp_path, monkeypatch):
    built = []

    def compiled(target, library):
        built.append(target)
        library.write_bytes(b"machine code")

    monkeypatch.setattr(build_kernels, "compile_library", compiled)
    (tmp_path / f"old-py3-none-{build_kernels.TARGETS[platform].tag}.whl").touch()
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


def test_every_zip_has_a_library_and_what_has_been_built_is_small():
    assert set(build_kernels.TARGETS) == set(build.WHEEL_TAGS)
    found = sorted(build_kernels.WHEELS.glob("*.whl"))
    if not found:
        pytest.skip("no wheel has been built here")
    assert max(wheel.stat().st_size for wheel in found) < MOST_BYTES
