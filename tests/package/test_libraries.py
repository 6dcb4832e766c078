# SPDX-License-Identifier: GPL-3.0-or-later
"""The compiled libraries as each system's loader reads them: what they offer and need; and the wheels that bring them.

Those that have been built here are looked at: `kernels/build_kernels.py` builds them for all systems on any of them.
"""

import hashlib
import re
import runpy
import struct
import tarfile
import zipfile
from dataclasses import dataclass

import pytest

from addon.core.kernels.library import LIBRARY_VERSION
from kernels import build_kernels
from scripts import build

lief = pytest.importorskip("lief", reason="lief, which reads libraries, is not installed")

CALLED = re.compile(r"\bcompiled\.(\w+)")
DECLARED = re.compile(r"^KERNEL [\w *]*?(\w+)\(", re.MULTILINE)
# What every Windows 10, macOS 11 and Linux with glibc 2.17 has. Windows' C library is made of parts with these names.
OF_THE_SYSTEM = {
    "linux-x64": r"(libc|libm)\.so\.6",
    "windows-x64": r"KERNEL32\.dll|api-ms-win-crt-[a-z]+-l1-1-0\.dll",
    "macos-arm64": r"/usr/lib/libSystem\.B\.dylib",
    "macos-x64": r"/usr/lib/libSystem\.B\.dylib",
}
MACHINES = {"linux-x64": "X86_64", "windows-x64": "AMD64", "macos-arm64": "ARM64", "macos-x64": "X86_64"}
NEWEST_GLIBC, OLDEST_MACOS, OLDEST_WINDOWS = (2, 17), [11, 0, 0], (10, 0)
# Of Apple's code signatures: `CodeDirectory` in xnu's osfmk/kern/cs_blobs.h.
SIGNATURE, DIRECTORY, AD_HOC, SHA256 = 0xFADE0CC0, 0xFADE0C02, 0x2, 2


@dataclass(frozen=True)
class Built:
    """A library that has been built: of which platform, its bytes, and what is read out of them."""

    platform: str
    content: bytes
    binary: object

    @property
    def needs(self) -> list[str]:
        """The libraries that it needs."""
        names = [getattr(one, "name", one) for one in self.binary.libraries]
        return names[1:] if self.platform.startswith("macos") else names


@pytest.fixture(scope="module", params=build_kernels.TARGETS)
def built(request) -> Built:
    target = build_kernels.TARGETS[request.param]
    wheel = build_kernels.WHEELS / f"{build_kernels.PACKAGE}-{build_kernels.version()}-py3-none-{target.tag}.whl"
    if not wheel.exists():
        pytest.skip(f"the library for {request.param} has not been built here")
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(target.library))
        content = archive.read(name)
    return Built(request.param, content, lief.parse(list(content)))


def test_it_offers_what_is_called(built):
    called = set()
    for path in (build.ROOT / "addon" / "core" / "kernels").glob("*.py"):
        called |= set(CALLED.findall(path.read_text(encoding="utf-8")))
    sources = [path.read_text(encoding="utf-8") for path in build_kernels.SOURCES.glob("*.c")]
    declared = {name for source in sources for name in DECLARED.findall(source)}
    offered = {one.name.removeprefix("_") for one in built.binary.exported_functions}
    assert called <= declared
    assert len(declared) > 20
    assert declared <= offered


def test_it_is_for_its_machine_and_the_oldest_system_that_is_promised(built):
    header = built.binary.header
    machine = getattr(header, "machine_type", None) or getattr(header, "machine", None) or header.cpu_type
    assert machine.name == MACHINES[built.platform]
    if built.platform.startswith("macos"):
        assert built.binary.build_version.minos == OLDEST_MACOS
    elif built.platform == "windows-x64":
        wanted = built.binary.optional_header
        for part in ("operating_system", "subsystem"):
            version = [getattr(wanted, f"{size}_{part}_version") for size in ("major", "minor")]
            assert tuple(version) <= OLDEST_WINDOWS
    else:
        words = {str(one.symbol_version) for one in built.binary.dynamic_symbols if one.has_version}
        numbers = re.findall(r"GLIBC_(\d+)\.(\d+)", " ".join(words))
        assert numbers and max((int(major), int(minor)) for major, minor in numbers) <= NEWEST_GLIBC


def test_it_needs_nothing_but_the_system_and_knows_nothing_of_where_it_was_built(built):
    assert [name for name in built.needs if not re.fullmatch(OF_THE_SYSTEM[built.platform], name)] == []
    for place in (str(build.ROOT), "/tmp/", "/home/", "/root/", "\\Users\\"):
        assert place.encode() not in built.content, place


@pytest.mark.parametrize("built", ["macos-arm64"], indirect=True)
def test_apple_silicon_finds_its_signature_and_every_page_as_signed(built):
    """Macs with Apple's processors load no library without one, be it nobody's."""
    assert built.binary.has_code_signature
    blob = bytes(built.binary.code_signature.content)
    magic, _, count = struct.unpack_from(">3I", blob)
    parts = [struct.unpack_from(">2I", blob, 12 + 8 * index)[1] for index in range(count)]
    (at,) = (part for part in parts if struct.unpack_from(">I", blob, part)[0] == DIRECTORY)
    assert magic == SIGNATURE
    _, _, _, flags, first, _, _, pages, limit, size, kind, _, shift = struct.unpack_from(">9I4B", blob, at)
    assert flags & AD_HOC and (size, kind) == (32, SHA256)
    assert limit == built.binary.code_signature.data_offset
    page = 1 << shift
    assert pages == -(-limit // page)
    for number in range(pages):
        signed = blob[at + first + size * number :][:size]
        content = built.content[number * page : min((number + 1) * page, limit)]
        assert hashlib.sha256(content).digest() == signed, f"page {number}"


MOST_BYTES = 300_000


@pytest.mark.parametrize("platform", build_kernels.TARGETS)
def test_a_wheel_serves_every_python_of_its_platform_and_the_next_lies_beside_it(platform, tmp_path, monkeypatch):
    """Windows neither removes nor replaces a library that is loaded: each version has a place of its own."""
    built, places, target = [], [], build_kernels.TARGETS[platform]

    def compiled(target, library):
        built.append(target)
        library.write_bytes(f"library {len(built)}".encode())

    monkeypatch.setattr(build_kernels, "compile_library", compiled)
    for number in (1, 2):
        monkeypatch.setattr(build_kernels, "version", lambda number=number: f"0.{number}.0+{number * 12}")
        wheel = build_kernels.build(platform, tmp_path / "wheels")
        assert build_kernels.build(platform, tmp_path / "wheels") == wheel and len(built) == number
        assert list((tmp_path / "wheels").iterdir()) == [wheel], "that of another version is gone"
        name, version, *tags = wheel.name.removesuffix(".whl").split("-")
        assert (name, version) == (build_kernels.PACKAGE, build_kernels.version())
        assert tags == ["py3", "none", target.tag]
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(tmp_path)
        places.append(runpy.run_path(str(tmp_path / name / "__init__.py"))["PATH"])
        assert places[-1].name == target.library
    assert [place.read_bytes() for place in places] == [b"library 1", b"library 2"]


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
