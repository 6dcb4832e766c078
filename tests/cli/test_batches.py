# SPDX-License-Identifier: GPL-3.0-or-later
"""Several takes at once: what goes wrong with one of them, and a batch that is disturbed, stopped and resumed."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from addon import jobs
from addon.cli import serving, workers
from addon.cli.label import running
from addon.demo.take import MODEL
from addon.io import scratch, tables
from tests.faults.__main__ import Judge
from tests.faults.stage import ROOT, Said, at_work, files_of, wait_for

from .conftest import lengthened, no_room

FEW = ("--frames", "100:103", "--trc")
LONG = 30  # times the walk, which takes longer than whoever stops it needs


@pytest.fixture
def takes(copies):
    return copies("one", "two", "three")


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture
def poisoned(monkeypatch):
    def poison(trouble):
        whole = jobs.label_file

        def label_file(job):
            if job.source.stem == "two":
                raise trouble
            return whole(job)

        monkeypatch.setattr(jobs, "label_file", label_file)

    return poison


@pytest.mark.parametrize(
    ("trouble", "reason"),
    [
        (MemoryError(), "two.csv: the memory is full"),
        (ValueError("no\nsense"), "two.csv: a fault of Mocap Autolabel itself (ValueError: no sense)"),
        (OSError(errno.EIO, "Input/output error"), "two.csv: the system says: Input/output error"),
    ],
)
def test_whatever_one_take_fails_of_the_others_are_labelled_and_printed(label, takes, poisoned, trouble, reason):
    poisoned(trouble)
    answer = label(*FEW, "--json", blobs=takes)
    assert reason in answer.refusal(1)
    assert [[take["take"] for take in answer.json[kind]] for kind in ("takes", "failed")] == [["one", "three"], ["two"]]


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_files_that_are_no_takes_do_not_stop_the_others_and_processes_are_shared(
    run, room, takes, tmp_path, monkeypatch, jobs
):
    popen, lines = subprocess.Popen, []
    monkeypatch.setattr(subprocess, "Popen", lambda line, **more: lines.append(line) or popen(line, **more))
    takes[1].write_text("frame,camera,x,y\n1,nowhere,3,4\n")
    (tmp_path / "takes" / "text.csv").write_text("hello")
    (tmp_path / "takes" / "none.c3d").write_bytes(b"")
    line = ["label", tmp_path / "takes" / "*.c*", tmp_path / "gone.csv", room.c3d, "--cameras", room.cameras]
    answer = run(*line, "--model", MODEL, "--out", tmp_path / "out", *FEW, "--jobs", jobs, "--json")
    for reason in ("gone.csv: there is no such", "two.csv:2: camera 'nowhere'", "text.csv:1: holds neither blobs nor"):
        assert reason in answer.err
    assert answer.refusal(2) and {take["take"] for take in answer.json["takes"]} == {"one", "three", "take"}
    failed = {(take["take"], take["status"]) for take in answer.json["failed"]}
    assert failed == {(name, 2) for name in ("two", "text", "none", "gone")}
    assert len(list((tmp_path / "out").iterdir())) == 3 * 4
    assert len(lines) == (0 if jobs == "1" else 2)
    run("label", takes[0], "--cameras", room.cameras, "--model", MODEL, "--out", tmp_path / "alone", *FEW).done()
    alone = (tmp_path / "alone" / "one.labels.csv").read_bytes()
    assert all((tmp_path / "out" / f"{name}.labels.csv").read_bytes() == alone for name in ("one", "three"))


def test_a_take_that_is_given_twice_is_labelled_once(label, takes):
    said = label(*FEW, blobs=[takes[0], takes[0].with_name("*.csv")]).done()
    assert [line.partition(":")[0] for line in said.out.splitlines()] == ["one", "three", "two"]


def test_takes_that_another_batch_does_meanwhile_are_done(label, takes, monkeypatch, tmp_path):
    out, whole, begun = tmp_path / "out", jobs.label_file, []
    label(*FEW, blobs=takes[:2])
    done = {path: path.read_bytes() for path in out.iterdir()}

    def label_file(job):
        begun.append(job.source.stem)
        work = whole(job)
        yield next(work)
        for path, content in done.items():
            path.write_bytes(content)
        return (yield from work)

    shutil.rmtree(out)
    monkeypatch.setattr(jobs, "label_file", label_file)
    said = label(*FEW, "--resume", blobs=takes[:2])
    assert (said.status, said.err, begun) == (0, "", ["one"]) and said.out.count(", done before\n") == 2


def test_who_stops_a_batch_stops_it(label, takes, poisoned):
    poisoned(KeyboardInterrupt())
    answer = label(*FEW, blobs=takes)
    assert (answer.status, answer.out) == (1, "") and "stopped before the end" in answer.err


def test_what_was_sent_by_one_who_is_gone_is_not_begun(room, takes, tmp_path):
    line = ["label", f"--model={MODEL}", f"--cameras={room.cameras}", f"--out={tmp_path / 'out'}", str(takes[0])]
    sent = json.dumps(line).encode() + b"\n"
    done = subprocess.run([*workers.door(), serving.SERVE], input=sent, capture_output=True, check=True)
    assert serving.ANSWER.encode() not in done.stdout
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(os.name == "nt", reason="needs a system where a process can be killed")
def test_a_process_that_is_killed_names_its_take(label, takes, monkeypatch):
    hand = workers.Worker.hand

    def killed(self, work):
        if work.args[0].source.name == "two.csv":
            self.process.kill()
        hand(self, work)

    monkeypatch.setattr(workers.Worker, "hand", killed)
    answer = label(*FEW, "--jobs", "2", "--json", blobs=takes)
    assert "two.csv: its process was killed (SIGKILL)" in answer.refusal(1)
    assert [take["take"] for take in answer.json["takes"]] == ["one", "three"]


@pytest.mark.skipif(os.name == "nt", reason="needs a system where the current folder can go")
def test_processes_work_where_the_current_folder_is_gone(label, takes, monkeypatch, tmp_path):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    (tmp_path / "here").rmdir()
    label(*FEW, "--jobs", "2", blobs=takes[:2]).quiet()


@pytest.mark.parametrize(("started", "labelled"), [(1, ["one", "two"]), (0, [])])
def test_processes_that_cannot_be_started_leave_the_takes_to_the_others(label, takes, monkeypatch, started, labelled):
    popen, lines = subprocess.Popen, []

    def start(line, **more):
        lines.append(line)
        return popen(line, **more) if len(lines) <= started else no_room(errno.ENOMEM)

    monkeypatch.setattr(subprocess, "Popen", start)
    answer = label(*FEW, "--jobs", "2", "--json", blobs=takes[:2])
    assert [take["take"] for take in answer.json["takes"]] == labelled
    assert answer.status == (0 if labelled else 1)
    assert labelled or ".csv: no process can be started for it" in answer.reason


def test_a_full_temporary_folder_is_called_by_its_name(label, temporary, monkeypatch, tmp_path):
    def begun(self):
        begin(self).file.close()
        self.file = SimpleNamespace(write=lambda _: no_room(), close=lambda: None)
        return self

    begin = tables.RowFile.__enter__
    monkeypatch.setattr(tables.RowFile, "__enter__", begun)
    reason = label(*FEW).refusal(1)
    assert reason.startswith(f"{temporary}{os.sep}mocap-autolabel-")
    assert "cannot hold temporary files (No space left on device); expected room there, or another TMPDIR" in reason
    assert not list(temporary.iterdir()) and not (tmp_path / "out").exists()


def test_what_a_killed_run_left_among_temporary_files_goes_with_a_run_that_makes_none(run, room, temporary, tmp_path):
    left = temporary / f"{scratch.SCRATCH}0123456789ab"
    left.mkdir()
    (left / scratch.LOCK).touch()
    (left / "table-1").write_text("half of")
    assert run("label", room.c3d, "--model", MODEL, "--out", tmp_path / "out").status == 0
    assert not list(temporary.iterdir())


def stamps(out):
    return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in out.iterdir()}


def test_resume_passes_over_what_is_done_and_does_the_rest(label, takes, tmp_path):
    out = tmp_path / "out"
    label(*FEW, blobs=takes[:2])
    before = {path.name: path.read_bytes() for path in out.iterdir() if not path.name.endswith(".json")}
    done = stamps(out)
    (out / "two.c3d").unlink()
    said = label(*FEW, "--resume", blobs=takes).quiet()
    assert [line.endswith(", done before") for line in said.out.splitlines()] == [True, False, False]
    assert {name: (out / name).read_bytes() for name in before} == before
    now = stamps(out)
    assert all(now[name] == stamp for name, stamp in done.items() if name.startswith("one")), "only that take"
    again = label(*FEW, "--resume", "--json", "--jobs", "2", blobs=takes).json
    assert again["passed_over"] == ["one", "three", "two"]
    assert [report["take"] for report in again["takes"]] == ["one", "two", "three"]


def test_resume_replaces_nothing_that_it_did_not_make_as_it_is(label, run, takes, room, tmp_path):
    out = tmp_path / "out"
    label(*FEW, blobs=takes[:1])

    def refused(reason, *words, **more):
        before = stamps(out)
        assert reason in label(*words, "--resume", blobs=takes[:1], **more).refusal(2)
        assert stamps(out) == before

    refused("differs in --rate, --height;", *FEW, "--rate", "50", "--height", "1.7")
    moved = tmp_path / "moved.toml"
    moved.write_text(room.cameras.read_text() + "\n# moved\n")
    refused("differs in cameras;", *FEW, cameras=moved)
    report = out / "one.report.json"
    whole = report.read_text(encoding="utf-8")
    report.write_text(whole.replace('"unlabelled": ', '"unlabelled": 1'), encoding="utf-8")
    refused("one.report.json: was changed since it was made", *FEW)
    report.write_text(whole, encoding="utf-8")
    (out / "one.c3d").write_bytes((out / "one.c3d").read_bytes() + b"\0")
    refused("one.c3d: was changed since it was made", *FEW)
    takes[0].write_text(takes[0].read_text() + "\n")
    refused("differs in input;", *FEW)
    report.write_text("{}")
    refused("does not say what it was made of", *FEW)
    report.unlink()
    refused("exists already", *FEW)
    assert label(*FEW, "--resume", "--overwrite", blobs=takes[:1]).status == 0
    assert label(*FEW, "--resume", "--overwrite", blobs=takes[:1]).out.endswith("done before\n")


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc to find processes by")
@pytest.mark.parametrize("kind", ["SIGKILL", "SIGINT", "SIGTERM"])
def test_processes_side_by_side_end_with_the_one_that_started_them(room, takes, temporary, tmp_path, kind):
    for take in takes:
        lengthened(room.blobs, take, LONG)
    out = tmp_path / "out"
    words = "label", *takes, f"--model={MODEL}", f"--cameras={room.cameras}", f"--out={out}", "--jobs=2"
    line = [*workers.door(), *map(str, words)]
    batch = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: len(at_work(temporary)) == 3 and len(list(temporary.glob("mocap*"))) == 3)
    batch.send_signal(getattr(signal, kind))
    batch.wait()
    wait_for(lambda: not at_work(temporary))
    if kind == "SIGKILL":
        # The next run takes it away, and that may be a process of this one that came to its first take just then.
        assert {path.name[:5] for path in temporary.iterdir()} <= {"mocap"}
    else:
        assert batch.stderr.read().endswith("stopped before the end; nothing half-written was left\n")
        assert not list(temporary.iterdir())
        assert not out.exists()
    assert not any(out.glob("*"))


def test_a_batch_that_is_stopped_leaves_no_empty_folder(label, takes, tmp_path, monkeypatch):
    @contextmanager
    def stopped(_arguments):
        """Processes of which the last to end is not the one that made the folder."""

        def runner(_takes):
            (tmp_path / "out").mkdir()
            raise KeyboardInterrupt

        yield runner

    monkeypatch.setattr(running, "_runner", stopped)
    assert label(blobs=takes).status == 1
    assert not (tmp_path / "out").exists()


KINDS = ["kill", "full", "share"]  # each takes seconds


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc to find processes by")
def test_whatever_happens_to_a_batch_the_next_run_does_the_rest():
    command = [sys.executable, "-m", "tests.faults", *KINDS, "--count", "1", "--seed", "3"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert [line.partition(":")[0] for line in done.stdout.splitlines() if " tries, " in line] == KINDS


def test_a_fault_is_seen(tmp_path):
    def found(look):
        judge = Judge(["a"], dict.fromkeys(files_of(["a"]), b"whole"))
        look(judge)
        return [kind for kind, _ in judge.trouble]

    out, temporary = tmp_path / "out", tmp_path / "temporary"
    out.mkdir(), temporary.mkdir()
    (out / "a.c3d").write_bytes(b"who")
    (temporary / "left").touch()
    assert found(lambda judge: judge.whole(out)) == ["half files"]
    assert found(lambda judge: judge.claims(Said(0, ("a",), ()), out)) == ["claims"]
    assert found(lambda judge: judge.kept(out, {"a": {}})) == ["lost takes"]
    assert found(lambda judge: judge.left(out, temporary)) == ["left-overs"]
    assert found(lambda judge: judge.words(Said(1, (), ("Traceback",)))) == ["sentences that are none"]
    said = Said(1, (), ("mocap-autolabel: a.c3d: is empty; expected points",))
    assert found(lambda judge: judge.words(said)) == []
