# SPDX-License-Identifier: GPL-3.0-or-later
"""What run.py installs: everything that is asked for, pinned, with what its files hash to, for every system alike."""

import re
import tomllib

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement

import run
from scripts import build

SYSTEMS = [("linux", "x86_64"), ("win32", "AMD64"), ("darwin", "arm64"), ("darwin", "x86_64")]


def pins(name: str) -> list[tuple[Requirement, int]]:
    """Each line of a file of pins, and of how many files it has the hash."""
    text = (build.ROOT / name).read_text(encoding="utf-8").replace("\\\n", " ")
    rows = [line for line in text.split("\n") if line and not line.startswith("#")]
    return [
        (Requirement(row.partition("--hash")[0]), len(re.findall(r"--hash=sha256:[0-9a-f]{64}\b", row))) for row in rows
    ]


def asked() -> list[Requirement]:
    project = tomllib.loads((build.ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    lists = [project["project"]["dependencies"], project["build-system"]["requires"]]
    lists += project["project"]["optional-dependencies"].values()
    return [Requirement(one) for words in lists for one in words]


@pytest.mark.parametrize("python", run.PYTHONS)
@pytest.mark.parametrize("system", SYSTEMS, ids="-".join)
def test_everything_asked_for_is_pinned_once(python, system):
    here = default_environment() | {
        "python_version": python,
        "python_full_version": python + ".4",
        "sys_platform": system[0],
        "platform_machine": system[1],
    }
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
