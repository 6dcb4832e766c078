# SPDX-License-Identifier: GPL-3.0-or-later
"""The farm recipes: run by what they are for, or by what stands for it, with the command in the place of Blender."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from addon.demo.take import MODEL

ROOT = Path(__file__).resolve().parents[2]
RECIPES = ROOT / "farm"
SLURM, OPENJD, FLAMENCO = (RECIPES / name for name in ("slurm-label.sh", "openjd-label.yaml", "flamenco_label.js"))
STUB = """#!{python}
import sys
sys.path.insert(0, {root!r})
from addon.cli import main
assert sys.argv[1:4] == ["--background", "--command", "mocap_autolabel"], sys.argv
sys.exit(main(sys.argv[4:]))
"""
# What a Flamenco Manager gives its scripts, as far as this one asks for it.
MANAGER = """
const author = {
    Task: (name, type) => {
        const commands = [];
        return { name, type, commands, addCommand: (command) => commands.push(command) };
    },
    Command: (name, parameters) => ({ name, parameters }),
};
const tasks = [];
const job = { settings: JSON.parse(process.argv[2]), addTask: (task) => tasks.push(task) };
"""
PRINTED = "\ncompileJob(job);\nconsole.log(JSON.stringify({ type: JOB_TYPE, tasks }));\n"

pytestmark = pytest.mark.skipif(os.name == "nt" or not shutil.which("bash"), reason="needs bash")


@pytest.fixture
def takes(room, copies) -> list[Path]:
    """Two takes of points, one with a space in its name."""
    return copies("one", "walk 2", source=room.c3d)


@pytest.fixture
def listed(takes, tmp_path) -> Path:
    path = tmp_path / "takes.txt"
    path.write_text("".join(f"{take}\n" for take in takes))
    return path


@pytest.fixture
def blender(tmp_path, monkeypatch) -> Path:
    """A `blender` found before any other, which is the command."""
    stub = tmp_path / "bin" / "blender"
    stub.parent.mkdir()
    stub.write_text(STUB.format(python=sys.executable, root=str(ROOT)))
    stub.chmod(0o755)
    monkeypatch.setenv("PATH", os.pathsep.join([str(stub.parent), os.environ["PATH"]]))
    return stub


def labelled(out: Path) -> list[str]:
    return sorted(path.name.removesuffix(".report.json") for path in out.glob("*.report.json"))


def run(line, **more) -> subprocess.CompletedProcess:
    done = subprocess.run([str(word) for word in line], capture_output=True, text=True, check=False, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.mark.parametrize("path", [SLURM, OPENJD, FLAMENCO], ids=lambda path: path.name)
def test_the_guide_quotes_the_recipes_as_they_are(path):
    guide = (ROOT / "docs" / "guide" / "farm.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(?:bash|yaml|javascript)\n(.*?)^```$", guide, re.MULTILINE | re.DOTALL)
    assert path.read_text(encoding="utf-8") in blocks
    assert f"farm/{path.name}" in guide


def test_every_job_of_a_slurm_array_labels_its_part(blender, listed, tmp_path):
    assert SLURM.read_text().splitlines()[3] == "#SBATCH --array=0-99%20"
    found = []
    for number in (4, 5, 6):  # more jobs than takes, and numbers that begin anywhere
        array = {"SLURM_ARRAY_TASK_ID": str(number), "SLURM_ARRAY_TASK_MIN": "4", "SLURM_ARRAY_TASK_COUNT": "3"}
        line = ["bash", SLURM, listed, "--model", MODEL, "--out", tmp_path / "out"]
        found.append(len(run(line, env=os.environ | array).stdout.splitlines()))
    assert found == [1, 1, 0]
    assert labelled(tmp_path / "out") == ["one", "walk 2"]


def test_every_task_of_an_open_job_description_labels_its_part(blender, listed, tmp_path):
    if importlib.util.find_spec("openjd.cli" if importlib.util.find_spec("openjd") else "openjd") is None:
        pytest.skip("needs openjd-cli")
    given = {"Takes": listed, "Model": MODEL, "Out": tmp_path / "out", "Tasks": 2, "Options": "--trc"}
    words = [word for name, value in given.items() for word in ("-p", f"{name}={value}")]
    run([sys.executable, "-m", "openjd", "run", OPENJD, *words], cwd=tmp_path)
    assert labelled(tmp_path / "out") == ["one", "walk 2"]
    assert (tmp_path / "out" / "walk 2.trc").exists()


@pytest.mark.skipif(not shutil.which("node"), reason="needs node")
def test_every_task_of_a_flamenco_job_labels_its_part(blender, takes, tmp_path):
    # As Flamenco's add-on evaluates a setting.
    scene = SimpleNamespace(folder=str(takes[0].parent), pattern="*.c3d")
    bpy = SimpleNamespace(path=SimpleNamespace(abspath=str))

    def compiled(**settings):
        script = tmp_path / "job.js"
        script.write_text(MANAGER + FLAMENCO.read_text(encoding="utf-8") + PRINTED, encoding="utf-8")
        return json.loads(run(["node", script, json.dumps(settings)]).stdout)

    settings = {"model": MODEL, "out": str(tmp_path / "out"), "cameras": "", "html": False, "takes_per_task": 1}
    told = {setting["key"]: setting for setting in compiled(takes="", **settings)["type"]["settings"]}
    assert set(settings) | {"takes", "folder", "pattern"} == set(told)
    found = eval(told["takes"]["eval"], {}, {"bpy": bpy, "Path": Path, "settings": scene})
    assert found.split(";") == [str(take) for take in takes]
    tasks = compiled(takes=found, **settings)["tasks"]
    assert [(task["name"], task["type"]) for task in tasks] == [("label-1-1", "blender"), ("label-2-2", "blender")]
    for task in tasks:
        [command] = task["commands"]
        assert (command["name"], command["parameters"]["exe"]) == ("exec", "{blender}")
        run([blender, *command["parameters"]["args"]])
    assert labelled(tmp_path / "out") == ["one", "walk 2"]
    [task] = compiled(takes=found, **settings | {"cameras": "room.xcp", "html": True, "takes_per_task": 2})["tasks"]
    words = task["commands"][0]["parameters"]["args"]
    assert words[4:6] == [str(take) for take in takes] and words[-3:] == ["--cameras", "room.xcp", "--html"]
