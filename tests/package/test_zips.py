# SPDX-License-Identifier: GPL-3.0-or-later
"""What the built zips contain and say of themselves."""

import re
import tomllib
import zipfile
from itertools import pairwise

import pytest

from scripts import build

FLAVOURS = [(name, platform) for name, blender in build.BLENDERS.items() for platform in blender.pythons]
WHEELS = ["scipy-1.0-cp313-cp313-win_amd64.whl", "threadpoolctl-1.0-py3-none-any.whl"]


@pytest.fixture(scope="module", params=list(build.BLENDERS))
def archive(request, make_zip):
    with zipfile.ZipFile(make_zip(request.param)) as opened:
        yield opened


def test_only_what_the_extension_needs_is_in_it(archive):
    top = {name.split("/")[0] for name in archive.namelist()}
    assert top == {"__init__.py", "blender_manifest.toml", "LICENSE", "addon", "assets", "wheels"}
    assert not [name for name in archive.namelist() if "__pycache__" in name or "/." in name]


def test_every_source_and_asset_is_in_it(archive):
    wanted = [path for folder in ("addon", "assets") for path in (build.ROOT / folder).rglob("*") if path.is_file()]
    names = {str(path.relative_to(build.ROOT).as_posix()) for path in wanted if "__pycache__" not in path.parts}
    assert names <= set(archive.namelist())


def test_its_wheels_are_those_of_its_manifest_and_never_numpy(archive):
    manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    wheels = sorted("./" + name for name in archive.namelist() if name.endswith(".whl"))
    assert wheels == sorted(manifest["wheels"])
    assert {re.split("[/-]", wheel)[2] for wheel in wheels} == {"scipy", "threadpoolctl"}


def test_the_same_sources_give_the_same_bytes(make_zip, tmp_path):
    first = make_zip("5.2")
    platform = first.stem.split("blender5.2-")[1]
    assert build.build("5.2", platform, tmp_path).read_bytes() == first.read_bytes()


@pytest.mark.parametrize(("name", "platform"), FLAVOURS)
def test_each_manifest_is_narrowed_to_its_platform_and_blender(name, platform):
    text = (build.ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    manifest = tomllib.loads(build.narrowed(text, build.BLENDERS[name], platform, WHEELS))
    assert manifest["id"] == "mocap_autolabel"
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert list(manifest["permissions"]) == ["files"]
    assert manifest["platforms"] == [platform]
    assert manifest["blender_version_min"].startswith(name)
    assert manifest["wheels"] == ["./wheels/" + wheel for wheel in WHEELS]


def test_no_two_zips_for_a_platform_claim_the_same_blender():
    ranges = sorted((blender.first, blender.last or "999") for blender in build.BLENDERS.values())
    assert all(last <= first for (_, last), (first, _) in pairwise(ranges))
