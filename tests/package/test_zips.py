# SPDX-License-Identifier: GPL-3.0-or-later
"""What the built zips contain and say of themselves."""

import re
import tomllib
import unicodedata
import zipfile
from itertools import pairwise
from pathlib import PurePosixPath

import pytest

from scripts import build

from .conftest import FLAVOURS, NOT_SHIPPED

LAST = [*build.BLENDERS][-1]
WHEELS = ["scipy-1.0-cp313-cp313-win_amd64.whl", "threadpoolctl-1.0-py3-none-any.whl"]
TEXTS = {".py", ".json", ".toml", ".md", ".c", ".h", ".html", ""}
DEVICES = ("con", "prn", "aux", "nul", "conin$", "conout$")
RESERVED = {*DEVICES, *(f"{port}{number}" for port in ("com", "lpt") for number in "0123456789¹²³")}
NEVER = re.compile(r'[<>:"|?*\\\x00-\x1f]')
# Windows takes 259 characters, unless somebody switched more on; its user names have up to 20.
LONGEST = 259 - len(r"C:\Users\01234567890123456789\AppData\Roaming\Blender Foundation\Blender\5.2\extensions/")
BESIDE = {"": "user_default/mocap_autolabel/", ".whl": ".local/lib/python3.13/site-packages/"}


@pytest.fixture(scope="module", params=[name for name, platform in FLAVOURS if platform == "linux-x64"])
def archive(request, make_zip):
    """A zip of each Python, the last with the compiled library."""
    with zipfile.ZipFile(make_zip(request.param, compiled=request.param == LAST)) as opened:
        yield opened


def test_every_source_and_asset_is_in_it_and_only_what_the_extension_needs(archive):
    top = {name.split("/")[0] for name in archive.namelist()}
    assert top == {"__init__.py", "blender_manifest.toml", "LICENSE", "addon", "assets", "wheels"}
    assert not [name for name in archive.namelist() if "__pycache__" in name or "/." in name]
    wanted = [path for folder in ("addon", "assets") for path in (build.ROOT / folder).rglob("*") if path.is_file()]
    names = {str(path.relative_to(build.ROOT).as_posix()) for path in wanted if "__pycache__" not in path.parts}
    assert names - NOT_SHIPPED == {name for name in archive.namelist() if name.split("/")[0] in ("addon", "assets")}


def test_its_wheels_are_those_of_its_manifest_and_never_numpy(archive):
    manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    wheels = sorted("./" + name for name in archive.namelist() if name.endswith(".whl"))
    assert wheels == sorted(manifest["wheels"])
    kernels = {"mocap_autolabel_kernels"} if "-compiled" in archive.filename else set()
    usual = {"lzallright", "olefile", "scipy", "threadpoolctl"}
    assert {re.split("[/-]", wheel)[2] for wheel in wheels} == usual | kernels


def test_the_same_sources_give_the_same_bytes(make_zip, tmp_path):
    first = make_zip("5.1")
    assert build.build("5.1", first.stem.split("blender5.1-")[1], tmp_path).read_bytes() == first.read_bytes()


@pytest.mark.parametrize(("name", "platform"), FLAVOURS)
def test_each_manifest_is_narrowed_to_its_platform_and_blender(name, platform):
    text = (build.ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    manifest = tomllib.loads(build.narrowed(text, build.BLENDERS[name], platform, WHEELS))
    assert manifest["id"] == "mocap_autolabel"
    assert list(manifest["permissions"]) == ["files", "network"] and "build" not in manifest
    assert manifest["platforms"] == [platform]
    assert manifest["blender_version_min"].startswith(name.partition("-")[0])
    assert manifest["wheels"] == ["./wheels/" + wheel for wheel in WHEELS]


def test_no_two_zips_for_a_platform_claim_the_same_blender():
    """Those of a Linux distribution apart, which nobody lists: which zip a Blender takes its Python says too."""
    listed = [one for name, one in build.BLENDERS.items() if "python" not in name]
    ranges = sorted((blender.first, blender.last or "999") for blender in listed)
    assert all(last <= first for (_, last), (first, _) in pairwise(ranges))
    takes = [((4, 5, 3), "311"), ((5, 0, 1), "311"), ((5, 1, 0), "313"), ((5, 2, 3), "313"), ((5, 2, 2), "314")]
    assert [build.for_blender(*one) for one in takes] == ["4.5", "4.5", "5.1", "5.1", "5.1-python3.14"]
    for version, python in (((4, 4, 3), "311"), ((5, 1, 0), "311")):
        with pytest.raises(LookupError, match=r"no zip is built for Blender .* with Python 311"):
            build.for_blender(version, python)


def faults_of_names(names: list[str]) -> list[str]:
    """What Windows or macOS would not take of the names in a zip."""
    found = []
    seen: dict[str, str] = {}
    for name in names:
        parts = PurePosixPath(name).parts
        if name.startswith("/") or ".." in parts or NEVER.search(name):
            found.append(f"{name}: no name everywhere")
        if any(part.partition(".")[0].rstrip(" ").lower() in RESERVED or part[-1] in " ." for part in parts):
            found.append(f"{name}: a device or no name of Windows")
        for folder in (name, *map(str, PurePosixPath(name).parents)):
            alike = unicodedata.normalize("NFC", folder).casefold()
            if seen.setdefault(alike, folder) != folder:
                found.append(f"{name}: the same as {seen[alike]} where case does not count")
    return found


def test_every_system_takes_all_names_of_a_zip_and_its_plain_files_have_the_same_line_ends(archive):
    for name in ("a\\b", "/a", "../a", "a:b", "a/NUL.txt", "com1", "aux .x", "a./b", "a ", "x\n", "Ä/B"):
        assert faults_of_names(["ä/b", name]) != []
    assert faults_of_names(archive.namelist()) == []
    assert all(name.isascii() for name in archive.namelist())
    assert max(len(BESIDE[""] + name) for name in archive.namelist()) <= LONGEST
    assert {entry.external_attr >> 16 & 0o170000 for entry in archive.infolist()} <= {0, 0o100000}
    assert not any(entry.is_dir() for entry in archive.infolist())
    texts = [name for name in archive.namelist() if PurePosixPath(name).suffix in TEXTS]
    assert len(texts) > 100
    for name in texts:
        content = archive.read(name)
        assert b"\r" not in content and not content.startswith(b"\xef\xbb\xbf"), name
        content.decode("utf-8")
    for wheel in (name for name in archive.namelist() if name.endswith(".whl")):
        with zipfile.ZipFile(archive.open(wheel)) as opened:
            names = [name.rstrip("/") for name in opened.namelist()]
        assert faults_of_names(names) == [], wheel
        longest = max(names, key=len)
        assert len(BESIDE[".whl"] + longest) <= LONGEST, longest
