# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever is read goes through `io.source.open_binary`, which no pipe, device or socket keeps waiting."""

import ast
import os
import re
import socket
from pathlib import Path

import pytest

from addon.io import source
from addon.io.batch import is_result, is_table, read_table
from addon.io.blobs import check_header
from addon.io.edits import read_edits
from addon.io.html.markup import is_page
from addon.io.labels import LabelFile
from addon.io.models import read_model
from addon.io.points import read_points
from addon.io.poses import cache_mark, check_cache
from addon.io.provenance import earlier_run
from addon.io.source import digest, open_binary
from addon.io.whole import TURN, turns
from tests.io.checks import refused

ADDON = Path(__file__).resolve().parents[2] / "addon"
READERS = {"read_text", "read_bytes", "fromfile", "memmap", "loadtxt", "genfromtxt", "iterparse"}
# What else is opened to be read, by file and function: what this run made itself a moment ago, in a folder of its own,
# locks, and what ships with the program.
OWN = {
    ("io/source.py", "open_at_once"): "the one way",
    ("io/tables.py", "_mapped"): "a scratch file",
    ("io/rows.py", "parse_plain"): "bytes in memory",
    ("io/source.py", "root_of_xml"): "text in memory",
    ("io/poses.py", "write_cache"): "what is being written",
    ("io/scratch.py", "_take_away"): "a lock, which is opened to be locked",
    ("io/whole.py", "_flush"): "what was just written",
    ("io/whole.py", "_flush_folder"): "a folder",
    ("io/tables.py", "__enter__"): "a scratch file",
    ("io/tables.py", "rows"): "a scratch file",
    ("cli/console.py", "open_streams"): "the null device",
    ("cli/parcels.py", "read_parcel"): "what is open",
    ("cli/workers.py", "look"): "scratch files",
    ("ops/live.py", "look"): "a scratch file",
    ("scene/character.py", "export_character"): "what was just written",
    ("version.py", "version"): "ships with the program",
}


def openings(path: Path):
    """The functions of a file that open something not only to write it."""
    for one in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(one, ast.FunctionDef) and any(reads(call) for call in ast.walk(one)):
            yield one.name


def reads(call: ast.AST) -> bool:
    """Whether this is a call that opens a file, and not only to write it."""
    if not isinstance(call, ast.Call):
        return False
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    of = getattr(getattr(call.func, "value", None), "id", "")
    if name in READERS or (of == "os" and name == "open") or (of in ("np", "json", "tomllib") and name == "load"):
        return not isinstance(call.func, ast.Name)  # by its own name it is ours, and goes through the one way
    modes = [word.value for word in call.args if isinstance(word, ast.Constant) and isinstance(word.value, str)]
    return name == "open" and not any(mode[:1] in ("w", "x", "a") and "+" not in mode for mode in modes)


def test_nothing_else_opens_files_and_what_reads_them_starts_no_process_and_asks_no_network():
    found = {(path.relative_to(ADDON).as_posix(), name) for path in ADDON.rglob("*.py") for name in openings(path)}
    assert found == OWN.keys()
    never = ("socket", "subprocess", "multiprocessing", "pickle", "urllib.request", "http.client", "webbrowser")
    for path in (ADDON / "io").rglob("*.py"):
        forbidden = never[1:] if path.parent.name == "streams" else never
        imports = [one for one in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if hasattr(one, "names")]
        named = [alias.name for one in imports if isinstance(one, ast.Import) for alias in one.names]
        named += [one.module or "" for one in imports if isinstance(one, ast.ImportFrom)]
        assert not [name for name in named if name.startswith(forbidden)], path


def test_no_thread_is_started_but_for_a_farm():
    threads = re.compile(r"^\s*(?:import|from) (?:_thread|threading|concurrent|multiprocessing)\b", re.MULTILINE)
    found = [path.name for path in ADDON.rglob("*.py") if threads.search(path.read_text(encoding="utf-8"))]
    assert found == ["farm.py"]


@pytest.fixture(params=["pipe", "device", "socket", "folder"])
def thing(request, tmp_path, monkeypatch):
    """What is no file, at a path."""
    if os.name == "nt" and request.param != "folder":
        pytest.skip("such things have no path on Windows")
    monkeypatch.chdir(tmp_path)  # the path of a socket may be short only
    path = tmp_path / "walk.report.json"
    if request.param == "pipe":
        os.mkfifo(path)
    elif request.param == "device":
        path.symlink_to("/dev/zero")
    elif request.param == "socket":
        with socket.socket(socket.AF_UNIX) as one:
            one.bind(path.name)
    else:
        path.mkdir()
    return path


def test_neither_readers_nor_a_turn_wait_for_what_is_no_file(thing):
    for reader in (open_binary, read_table, read_edits, read_model, cache_mark, lambda path: check_cache(path, "1 a")):
        refused(r"is (a pipe|a folder|no table)", reader, thing)
    refused(r"is (a pipe|a folder)", earlier_run, thing, {})
    assert not is_table(thing)
    assert not is_page(thing)
    assert not is_result(thing.with_name("walk.c3d"))
    thing.rename(thing.with_name(TURN))
    with turns([thing.parent]):
        pass


@pytest.mark.parametrize(
    "reader",
    [
        *(check_header, lambda path: LabelFile(path).__enter__(), digest, read_points),
        lambda path: open_binary(path).seek(-1),
    ],
)
def test_what_fails_while_it_is_read_is_named(tmp_path, monkeypatch, reader):
    path = tmp_path / "take.trc"
    path.write_text("frame,camera,x,y\n")
    # As of a disk that fails, the system names no file of what cannot be read once it is open.
    monkeypatch.setattr(source, "open_at_once", lambda path, flags: os.open(path, os.O_WRONLY))
    refused(r"cannot be read \((Bad file descriptor|Invalid argument)\)", reader, path)
