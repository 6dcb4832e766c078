# SPDX-License-Identifier: GPL-3.0-or-later
"""The two doors, what comes out of them and what they load, and `demo`: the project's own take, scored and shown."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

from addon.cli import demo
from addon.cli.workers import door
from addon.demo import take as demo_take
from addon.demo.take import MODEL
from addon.io.markersets import open_markerset


def test_models_lists_the_built_in_ones_and_published_sets_in_words(run):
    models = {model["name"]: model for model in run("models", "--json").json["models"]}
    assert {"gait15", "body26", "body39", "actor41", "actor53"} <= set(models)
    assert len(models["gait15"]["markers"]) == 15
    assert models["gait15"]["aliases"]["s2"] == "SACR"
    assert "LASI" in run("models").out
    layouts = {layout["name"]: layout for layout in run("models", "--json").json["layouts"]}
    assert {"helen_hayes", "frontwaist53", "baseline41", "core50", "qualisys_sports", "cast", "ior"} <= set(layouts)
    assert "WaistLFront" in layouts["baseline41"]["markers"]
    assert "ForefootOut" in run("models").out


def test_help_and_version_are_results(run):
    for words in (["--help"], ["--version"], ["label", "--help"]):
        answer = run(*words).quiet()
        assert answer.out


def test_a_process_gives_status_and_last_line(tmp_path):
    words = "label", tmp_path / "no.csv", "--model", MODEL, "--cameras", tmp_path / "no.toml", "--out", tmp_path
    done = subprocess.run([*door(), *map(str, words)], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    words = f"mocap-autolabel: {tmp_path / 'no.csv'}: there is no such file; expected"
    assert done.stderr.splitlines()[-1].startswith(words)


@pytest.mark.blender
def test_blenders_door_is_the_same_command_line(capsys):
    from addon import registration

    assert registration._run_command(["models", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["models"]
    assert registration._run_command(["lable"]) == 2
    assert capsys.readouterr().err.startswith("mocap-autolabel: ")


def test_inside_blender_its_own_program_is_started_again(monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace(app=SimpleNamespace(binary_path="/opt/blender/blender")))
    assert door() == ["/opt/blender/blender", "--background", "--command", "mocap_autolabel"]


@pytest.fixture
def short(monkeypatch):
    """Only the beginning of the demo's walk."""
    from addon.core.simulation.virtual import DEMO

    monkeypatch.setattr(demo_take, "DEMO", DEMO[:1])


def test_without_blender_everything_but_its_file(run, short, monkeypatch, tmp_path):
    monkeypatch.setattr(demo, "has_blender", lambda: False)
    result = run("demo", "--out", tmp_path / "demo", "--json").quiet().json
    assert result["figures"]["precision"] > 0.99 and result["figures"]["recall"] > 0.95
    assert "no .blend" in result["note"]
    endings = {"c3d", "csv", "csv.truth.csv", "labels.csv", "report.html", "report.json", "svg", "trc"}
    written = {path.name for path in (tmp_path / "demo").iterdir()}
    assert written == {"room.toml", *(f"walk.{ending}" for ending in endings)}
    assert "exists already" in run("demo", "--out", tmp_path / "demo").reason
    drawn = ElementTree.parse(tmp_path / "demo" / "walk.svg").getroot()
    words = ["".join(text.itertext()) for text in drawn.iter("{http://www.w3.org/2000/svg}text")]
    assert set(open_markerset(demo_take.MODEL).markers) <= set(words)
    assert sum(text.endswith("blobs named") for text in words) == 2


@pytest.mark.slow
@pytest.mark.blender
def test_with_blender_a_scene_and_a_picture(run, short, tmp_path):
    answer = run("demo", "--out", tmp_path / "demo").quiet()
    assert answer.out.startswith("60 frames of a virtual person, seen by 8 cameras")
    assert (tmp_path / "demo" / "walk.blend").stat().st_size > 10_000


# Of SciPy, NumPy's testing and what others bring, half a second; of ours, what other takes, verbs and options need.
HEAVY = ("scipy", "unittest", "xml", "numpy.testing", "numpy.f2py", "concurrent", "multiprocessing", "asyncio", "bpy")
OTHERS = (
    "addon.cli.label.farm", "addon.cli.workers", "addon.io.html",
    "addon.core.filling", "addon.core.placement_quality", "addon.core.papers.partial_solvers.solver",
    "addon.core.points.whole_take.recognition", "addon.core.simulation", "addon.core.training",
)  # fmt: skip
ROOT = Path(__file__).resolve().parents[2]
OF_BLOBS = ("addon.core.blobs", "addon.core.reconstruction", "addon.io.toml_cameras", "addon.io.xml_cameras")
CODE = (
    "import json, sys; from addon.cli import main; status = main(sys.argv[1:]); "
    "print(json.dumps(sorted(sys.modules)), file=sys.stderr); sys.exit(status)"
)


@pytest.mark.parametrize(("kind", "unneeded"), [("points", HEAVY + OTHERS + OF_BLOBS), ("blobs", HEAVY + OTHERS)])
def test_labelling_loads_nothing_that_it_does_not_need(room, tmp_path, kind, unneeded):
    given = [room.c3d] if kind == "points" else [room.blobs, "--cameras", room.cameras, "--frames", "100:103"]
    loaded = loaded_by(CODE, "label", *given, "--model", MODEL, "--out", tmp_path / "out")
    assert "addon.core.points.models" in loaded
    assert [name for name in loaded if any(name == one or name.startswith(one + ".") for one in unneeded)] == []


def test_listing_the_models_names_no_marker_and_importing_the_package_loads_nothing_heavy():
    naming = "scipy", "addon.core.points", "addon.core.blobs"
    assert [name for name in loaded_by(CODE, "models") if name.startswith(naming)] == []
    heavy = {"bpy", "lzallright", "numpy", "olefile", "scipy", "threadpoolctl"}
    assert (
        heavy & set(loaded_by("import addon, json, sys; print(json.dumps(list(sys.modules)), file=sys.stderr)"))
        == set()
    )


def loaded_by(code: str, *words) -> list[str]:
    """The modules that are there when a script has run."""
    line = [sys.executable, "-c", code, *map(str, words)]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=True)
    return json.loads(done.stderr.splitlines()[-1])
