# SPDX-License-Identifier: GPL-3.0-or-later
"""What is read or of another run is never written over, and nothing is written twice: verbs say so before they work."""

import os
import shutil

import pytest

from addon.cli import demo
from addon.cli.label import options
from addon.demo.take import MODEL
from addon.io.markersets import markerset_file

from .conftest import report_of

# What an output would replace. `hard` and `soft` are links to `take.c3d`, `b.c3d` is one to `sub/other.c3d`.
COMMANDS = {
    "train, model and report in one": "train take.c3d --out m.markerset.json --report m.markerset.json",
    "train, report over a take": "train take.c3d --out m.markerset.json --report take.c3d",
    "train, report over a link": "train take.c3d --out m.markerset.json --report hard.json",
    "train, model over a take": "train b.markerset.json --out b.markerset.json",
    "train, over the base": "train take.c3d --from b.markerset.json --out m.markerset.json --report b.markerset.json",
    "quality, report over the model": "quality real.markerset.json --report real.markerset.json",
    "simulate, blobs over a link": "simulate take.c3d --cameras room.toml --out soft.c3d",
    "simulate, truth over the room": "simulate take.c3d --cameras b.csv.truth.csv --out b.csv",
    "simulate, over the model": "simulate take.c3d --cameras room.toml --model b.markerset.json --out b.markerset.json",
    "simulate, blobs over one of a pair": "simulate take.c3d --cameras intri.yml --out extri.yml",
    "simulate, blobs over one of a folder": "simulate take.c3d --cameras cal --out cal/Res.dat",
    "reconstruct, points over a link": "reconstruct take.c3d --cameras room.toml --out hard.c3d",
    "refine, over the room": "refine b.csv --cameras room.toml --model body26 --out room.toml",
    "label, take": "label take.c3d --model body26 --out .",
    "label, another take": "label b.csv sub/other.c3d --cameras room.toml --model body26 --out .",
    "label, a file that is no take": "label sub/other.c3d other.labels.csv --model body26 --out .",
    "label, page over takes": "label sub/other.c3d summary.report.html --model body26 --out . --summary",
    "label, scene": "label b.csv --cameras b.blend --model body26 --out . --blend",
    "label, model": "label b.csv --cameras room.toml --model b.trc --out . --trc",
    "demo, picture and take in one": "demo --out .",
}
FILES = """b.csv b.csv.truth.csv b.markerset.json b.blend b.trc intri.yml extri.yml cal/a1.Pmat.cal cal/a1.rad
cal/Res.dat sub/other.c3d other.labels.csv summary.report.html"""
OVER_LINKS = "simulate, blobs over a link", "demo, picture and take in one"


@pytest.fixture
def files(tmp_path, room, monkeypatch):
    """A folder with a file of every name that the commands have."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(options, "has_blender", lambda: True)
    monkeypatch.setattr(demo, "has_blender", lambda: True)
    for folder in ("cal", "sub"):
        (tmp_path / folder).mkdir()
    for name in FILES.split():
        (tmp_path / name).write_text("frame,camera,x,y\n" if name == "b.csv" else name)
    for real, name in (
        (room.c3d, "take.c3d"),
        (room.cameras, "room.toml"),
        (markerset_file("gait15"), "real.markerset.json"),
    ):
        shutil.copy(real, tmp_path / name)
    for link, of in (("hard.c3d", "take.c3d"), ("hard.json", "take.c3d"), ("b.c3d", "sub/other.c3d")):
        (tmp_path / link).hardlink_to(tmp_path / of)
    (tmp_path / "soft.c3d").symlink_to("take.c3d")
    (tmp_path / "walk.svg").symlink_to("walk.c3d")
    return tmp_path


def held(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("overwrite", [[], ["--overwrite"]], ids=["", "overwrite"])
@pytest.mark.parametrize("what", COMMANDS)
def test_no_output_is_an_input_or_another_output(run, files, what, overwrite):
    reason = "written twice" if what.endswith("in one") else "written over"
    if what in OVER_LINKS and not (files / "soft.c3d").is_symlink():
        pytest.skip("Wine has no links: it makes them without a word, and does not see them")
    before = held(files)
    assert reason in run(*COMMANDS[what].split(), *overwrite).refusal(2)
    assert held(files) == before


@pytest.fixture
def label(run, room, tmp_path):
    """Labels a few frames of `tmp_path/take.c3d`, or of another, into `tmp_path/out`; gives the folder."""
    shutil.copy(room.c3d, tmp_path / "take.c3d")
    out = tmp_path / "out"

    def call(*words, source=tmp_path / "take.c3d"):
        run("label", source, "--model", MODEL, "--out", out, "--frames", ":110", *words).done()
        return out

    return call


def test_files_that_only_the_earlier_run_wrote_stay_and_are_told(label):
    out = label("--trc", "--html")
    before = (out / "take.trc").read_bytes()
    (out / "taken.trc").write_text("somebody's")
    label("--overwrite", "--html")
    assert report_of(out / "take.c3d")["notes"] == ["take.trc is not of this run, and stays as it is"]
    assert (out / "take.trc").read_bytes() == before
    assert len(report_of(label("--overwrite") / "take.c3d")["notes"]) == 2
    always = {"take.labels.csv", "take.c3d", "take.report.json"}
    assert {path.name for path in out.iterdir()} == always | {"take.trc", "take.report.html", "taken.trc"}


@pytest.mark.skipif(os.name == "nt", reason="links need leave there")
@pytest.mark.parametrize("link", [False, True])
def test_an_earlier_result_that_is_read_now_stays(label, tmp_path, link):
    source = given = label("--trc") / "take.trc"
    if link:
        (tmp_path / "elsewhere").mkdir()
        given = tmp_path / "elsewhere" / "take.trc"
        os.link(source, given)
    before = source.read_bytes()
    label("--overwrite", source=given)
    assert source.read_bytes() == before


def test_a_run_that_fails_takes_nothing_away(label, run, tmp_path):
    before = held(label("--trc"))
    words = "--model", MODEL, "--out", tmp_path / "out", "--overwrite", "--frames", "900000:"
    assert run("label", tmp_path / "take.c3d", *words).status != 0
    assert held(tmp_path / "out") == before
