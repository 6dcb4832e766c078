# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed and full streams, closed terminals and odd paths: the exit status holds and a take is never lost to them."""

import io
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from pathlib import Path

import pytest

from addon.blendfile import has_blender, unbroken
from addon.cli import main
from addon.cli.console import stoppable
from addon.io.scratch import SCRATCH, take_away_scratch

from .conftest import no_room

ROOT = Path(__file__).resolve().parents[2]


class Full(io.StringIO):
    """A stream on a full disk."""

    def write(self, _text):
        no_room()


@pytest.fixture
def words(room, tmp_path):
    where = ["--cameras", str(room.cameras), "--out", str(tmp_path / "out"), "--frames", "100:100"]
    return ["label", str(room.blobs), "--model", "body26", *where]


@pytest.mark.skipif(os.name == "nt" or not has_blender(), reason="needs bpy and a shell that can close streams")
def test_files_never_take_the_numbers_of_closed_streams(room, tmp_path):
    script = "import sys; sys.path.insert(0, sys.argv.pop(1)); from addon.cli import main; sys.exit(main(sys.argv[1:]))"
    where = f"--cameras {room.cameras} --out {tmp_path} --model body26 --frames 100:100"
    line = f"{sys.executable} -c '{script}' {ROOT} label {room.blobs} {where} --blend >&- 2>&- <&-"
    assert subprocess.run(["sh", "-c", line], check=False).returncode == 0
    assert {path.name for path in tmp_path.iterdir()} >= {"walk.blend", "walk.c3d"}


@pytest.mark.parametrize(("name", "stream"), [("stdout", None), ("stderr", None), ("stderr", Full())])
def test_a_closed_or_full_stream_leaves_take_and_exit_status_as_they_are(monkeypatch, words, name, stream):
    monkeypatch.setattr(sys, name, stream)
    assert main([*words, "--progress"]) == 0
    assert main(words) == 2  # the files are there now
    assert main(["bogus"]) == 2


def test_results_that_find_no_room_are_a_failure_in_one_sentence(monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdout", Full())
    assert main(["models"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("mocap-autolabel: the results cannot be printed")
    assert "; expected " in said


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("kind", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_what_stops_the_work_is_raised_but_while_blender_is_at_work_behind_and_nohup_is_heard(kind):
    kind, behind = getattr(signal, kind), []
    before = signal.signal(kind, signal.SIG_DFL)  # the tests themselves may run under nohup
    try:
        with stoppable(), pytest.raises(KeyboardInterrupt), unbroken():
            os.kill(os.getpid(), kind)
            behind.append(kind)
        assert behind == [kind]
        signal.signal(kind, signal.SIG_IGN)
        with stoppable() if kind == signal.SIGHUP else nullcontext(), unbroken():
            os.kill(os.getpid(), kind)
        assert signal.getsignal(kind) is signal.SIG_IGN
    finally:
        signal.signal(kind, before)


@pytest.mark.parametrize("module", ["tomllib", "argparse", "tempfile"])
def test_ctrl_c_while_the_program_loads_is_one_sentence(module):
    script = f"""import sys
class Pressed:
    def find_spec(self, name, *_):
        if name == {module!r}:
            sys.meta_path.remove(self)
            raise KeyboardInterrupt
sys.meta_path.insert(0, Pressed())
from addon.cli import main
sys.exit(main(["models"]))"""
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "mocap-autolabel: stopped before the end; nothing half-written was left\n"


@pytest.mark.skipif(os.name != "posix", reason="needs a timer that interrupts")
def test_a_request_to_stop_where_python_raises_nothing_stops_all_the_same():
    class Gone:
        def __del__(self):
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(KeyboardInterrupt), stoppable():
        Gone()  # what is raised while something is taken away, Python only tells of
        for _ in range(100):
            time.sleep(0.1)


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("kind", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_whoever_is_stopped_while_blender_loads_stops_behind(tmp_path, kind):
    """With a package in the place of Blender's that loses what is raised while it loads, as Blender does."""
    work = f"os.kill(os.getpid(), signal.{kind}); time.sleep(1)"
    (tmp_path / "bpy.py").write_text(f"import os, signal, time\ntry: {work}\nexcept BaseException: pass\n")
    script = (
        "import sys; sys.path[:0] = sys.argv[1:]\n"
        "from addon.blendfile import start_blender\n"
        "from addon.cli.console import stoppable\n"
        "try:\n with stoppable(): start_blender()\n"
        "except KeyboardInterrupt: sys.exit(0 if 'bpy' in sys.modules else 2)\n"
        "sys.exit(3)"
    )
    line = [sys.executable, "-c", script, str(tmp_path), str(ROOT)]
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # a child under nohup ignores it
    try:
        assert subprocess.run(line, check=False).returncode == 0
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.skipif(os.name != "posix" or not has_blender(), reason="needs bpy, where a process can be killed")
@pytest.mark.parametrize("killed", [True, False])
def test_temporary_files_of_blender_are_gone_at_the_end_or_with_the_next_run(tmp_path, monkeypatch, killed):
    script = (
        "import os, signal, sys; sys.path.insert(0, sys.argv[2])\n"
        "from addon.blendfile import start_blender\n"
        "before = [os.environ.get(name) for name in ('TMPDIR', 'TEMP', 'TMP')]\n"
        "start_blender()\n"
        "assert [os.environ.get(name) for name in ('TMPDIR', 'TEMP', 'TMP')] == before\n"
        "import bpy; print(bpy.app.tempdir, flush=True)\n"
        "if sys.argv[1] == 'True': os.kill(os.getpid(), signal.SIGKILL)\n"
        "import atexit; atexit._run_exitfuncs(); os._exit(0)"  # Blender 4.5 may wait for itself for ever
    )
    line = ["env", f"TMPDIR={tmp_path}", sys.executable, "-c", script, str(killed), str(ROOT)]
    there = subprocess.run(line, stdout=subprocess.PIPE, text=True, check=False)
    assert there.returncode == (-signal.SIGKILL if killed else 0)
    name = there.stdout.split("\n")[-2]  # what Blender says of itself stands before
    assert Path(name).parent.parent == tmp_path and Path(name).parent.name.startswith(SCRATCH)
    assert len(list(tmp_path.iterdir())) == killed
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    take_away_scratch()
    assert not list(tmp_path.iterdir())


def test_paths_that_no_system_takes_and_pipes_without_a_writer_are_bad_input_and_minus_begins_a_value(
    run, words, label, tmp_path
):
    for place in ("--model", "--cameras", "--out"):
        assert "fault" not in run(*words, place, "l" * 5000).refusal(2)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.csv")
        assert "pipe.csv: is a pipe" in label(blobs=[tmp_path / "pipe.csv"]).refusal(2)
    assert label("--frames", "-5:100", "--facing", "-1e1").status == 0
