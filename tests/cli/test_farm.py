# SPDX-License-Identifier: GPL-3.0-or-later
"""`label --engine dask`: a scheduler and workers started here, one of them killed, and a batch that is stopped."""

import gc
import json
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import CancelledError
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import pytest

from addon.cli import workers
from addon.cli.label import farm, running
from addon.core.data.errors import JobError
from addon.demo.take import MODEL
from addon.jobs import LabelJob
from addon.version import version
from tests.faults.stage import content, wait_for

from .conftest import lengthened

if os.name == "nt":
    pytest.skip("needs links, and a system where a process can be killed", allow_module_level=True)
distributed = pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")

FEW = ("--frames", "100:101", "--trc")
LONG = 30  # times the walk, which takes longer than whoever stops it needs


class Farm:
    """A scheduler, what asks it, and workers that know this package by its name."""

    def __init__(self, folder: Path, stack: ExitStack):
        self.folder, self.stack = folder, stack
        (folder / "site").mkdir()
        (folder / "site" / "mocap_autolabel").symlink_to(workers.ROOT)
        told = folder / "scheduler.json"
        self.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", told)
        wait_for(lambda: told.exists() and told.read_text().rstrip().endswith("}"))
        self.address = json.loads(told.read_text())["address"]
        self.client = stack.enter_context(distributed.Client(self.address, set_as_default=False))
        self.workers = {}

    def start(self, kind: str, *words) -> subprocess.Popen:
        line = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *map(str, words), "--no-dashboard"]
        paths = os.pathsep.join([str(self.folder / "site"), os.environ.get("PYTHONPATH", "")])
        more = {"cwd": self.folder, "env": os.environ | {"PYTHONPATH": paths}}
        process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **more)
        self.stack.callback(process.wait)
        self.stack.callback(process.kill)
        return process

    def names(self) -> set[str]:
        return {worker["name"] for worker in self.client.scheduler_info(n_workers=-1)["workers"].values()}

    def worker(self, name: str):
        """Has a worker of this name, with one thread."""
        if name not in self.names():
            words = ("--name", name, "--nthreads", 1, "--no-nanny", "--local-directory", self.folder)
            self.workers[name] = self.start("worker", self.address, *words)
            wait_for(lambda: name in self.names())

    def takes_at(self, name: str) -> int:
        info = self.client.scheduler_info(n_workers=-1)["workers"]
        addresses = [address for address, worker in info.items() if worker["name"] == name]
        processing = self.client.processing()
        return sum(len(processing.get(address, ())) for address in addresses)


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    with ExitStack() as stack:
        yield Farm(tmp_path_factory.mktemp("farm"), stack)


@pytest.fixture
def farmed(started, label):
    for name in ("one", "two"):
        started.worker(name)
    return lambda *words, **more: label(*words, "--engine", "dask", "--scheduler", started.address, **more)


@pytest.fixture
def takes(copies):
    return copies(*"abcd")


def made(out: Path) -> dict:
    """What a folder of results holds, but for the seconds that it took."""
    return {path.name: content(path) for path in out.iterdir()}


def timeless(answer) -> list:
    """What a batch says, but for its pace."""
    said = answer.json
    for take in said["takes"]:
        del take["timing"]
    said["failed"].sort(key=lambda failed: failed["take"])  # which come as they come, with --jobs too
    return [answer.status, sorted(answer.err.splitlines()), said]


def test_what_fails_what_is_there_and_what_is_done_is_said_as_by_one_machine(farmed, label, takes, tmp_path):
    takes[1].write_text("frame,camera,x,y\n1,nowhere,2,3\n")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "c.c3d").write_bytes(b"mine")
    here = timeless(label(*FEW, "--json", blobs=takes[:3]))
    for path in (tmp_path / "out").glob("a.*"):
        path.unlink()
    first = timeless(farmed(*FEW, "--json", blobs=takes[:3]))
    assert first == here
    assert [take["take"] for take in first[2]["takes"]] == ["a"]
    assert [failed["take"] for failed in first[2]["failed"]] == ["b", "c"]
    assert any("c.c3d: exists already" in line for line in first[1])
    assert (tmp_path / "out" / "c.c3d").read_bytes() == b"mine"
    more = ("--html", "--json")
    replaced, resumed = (timeless(farmed(*FEW, one, *more, blobs=takes[:3])) for one in ("--overwrite", "--resume"))
    assert [take["take"] for take in replaced[2]["takes"]] == ["a", "c"]
    assert resumed[2]["passed_over"] == ["a", "c"]


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGKILL])
def test_a_batch_that_is_stopped_or_killed_leaves_nothing_half_written(started, farmed, room, takes, tmp_path, kind):
    lengthened(room.blobs, takes[0], LONG)
    line = ["label", takes[0], "--model", MODEL, "--cameras", room.cameras, "--out", tmp_path / "out"]
    line = [*workers.door(), *map(str, line), "--engine", "dask", "--scheduler", started.address]
    batch = subprocess.Popen(line, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: list((tmp_path / "out").glob(".part-*")))
    batch.send_signal(kind)
    _, said = batch.communicate()
    if kind == signal.SIGKILL:
        wait_for(lambda: not list((tmp_path / "out").glob("*")))
    else:
        assert batch.returncode == 1
        assert "stopped before the end; nothing half-written was left" in said.splitlines()[-1]
        assert not list((tmp_path / "out").glob("*"))
    wait_for(lambda: not started.takes_at("one") + started.takes_at("two"))


def test_workers_of_another_version_or_without_the_package_end_the_batch_in_a_sentence(farmed, takes, monkeypatch):
    with monkeypatch.context() as changed:
        changed.setattr(farm, "version", lambda: "99.0")
        answer = farmed(*FEW, blobs=takes[:1])
        assert f"has version {version()} of Mocap Autolabel; expected version 99.0" in answer.reason
    monkeypatch.setattr(farm, "THERE", "mocap_autolabel.addon.cli.nowhere")
    assert "a worker has another Mocap Autolabel or none (No module named" in farmed(*FEW, blobs=takes[:1]).reason


def test_a_worker_that_does_not_see_the_takes_says_so(tmp_path):
    status, said = farm.work("batch", version(), str(tmp_path / "walk.csv"), b"")
    assert status == farm.UNFIT
    assert said.endswith(f"does not see the take {tmp_path / 'walk.csv'}")


def test_a_take_whose_workers_are_lost_again_and_again_fails_and_a_lost_scheduler_ends_the_batch():
    class Lost:
        def __init__(self, error):
            self.error = error

        def result(self):
            raise self.error

    client = SimpleNamespace(scheduler=SimpleNamespace(address="tcp://farm:8786"))

    def answer(error):
        return farm._answer_of(client, Lost(error), LabelJob(Path("walk.csv"), None, MODEL, Path()))

    killed = answer(distributed.KilledWorker("key", SimpleNamespace(address="tcp://one"), 3))
    assert str(killed).startswith("walk.csv: the workers that had it were lost 4 times; expected workers that stay")
    assert "a fault of Mocap Autolabel itself (ValueError: odd)" in str(answer(ValueError("odd")))
    with pytest.raises(JobError, match="the scheduler at tcp://farm:8786 went away; expected it to stay"):
        answer(CancelledError())


def test_what_a_farm_lacks_is_one_sentence(label, takes, monkeypatch):
    def refused(status, *words):
        return label(*FEW, *words, blobs=takes[:2]).refusal(status)

    def no_cluster(**words):
        raise RuntimeError("can't start new thread")

    ended: list[str] = []
    monkeypatch.setattr(distributed.Client, "__del__", lambda client: ended.append(client.status))
    monkeypatch.setattr(farm, "CONNECT_S", 0.2)
    for address in ("tcp://127.0.0.1:1", "odd://there"):
        assert f"no scheduler answers at {address}" in refused(1, "--engine", "dask", "--scheduler", address)
    gc.collect()
    # Else its end, at that of the process, waits for 20 s and leaves a traceback; clients of other tests end here, too.
    assert ended[1:]
    assert set(ended) == {"closed"}
    monkeypatch.setattr(distributed, "LocalCluster", no_cluster)
    reason = refused(1, "--engine", "dask", "--jobs", "2")
    assert reason == "dask's own cluster does not start (can't start new thread); expected fewer --jobs"
    assert "--scheduler is of --engine dask" in refused(2, "--scheduler", "tcp://127.0.0.1:8786")
    monkeypatch.setattr(running, "find_spec", lambda name: None)
    reason = refused(2, "--engine", "dask", "--scheduler", "tcp://127.0.0.1:8786")
    assert "needs the Python package distributed, which is not here" in reason


def test_a_worker_is_killed_and_the_results_are_those_of_one_machine(started, farmed, label, takes, tmp_path):
    assert label(*FEW, blobs=takes).status == 0
    (tmp_path / "out").rename(tmp_path / "here")
    killed = []

    def kill():
        wait_for(lambda: started.takes_at("one"))
        started.workers["one"].kill()
        killed.append(started.workers["one"].wait())

    killer = threading.Thread(target=kill)
    killer.start()
    answer = farmed(*FEW, "--progress", blobs=takes)
    killer.join()
    assert killed == [-signal.SIGKILL]
    assert (answer.status, len(answer.out.splitlines())) == (0, len(takes)), answer.err
    assert answer.err.splitlines() == [f"{number} of 4 takes" for number in range(1, 5)]
    assert made(tmp_path / "out") == made(tmp_path / "here")


def test_without_a_scheduler_dask_has_as_many_workers_as_jobs_here_and_leaves_nothing(
    label, takes, tmp_path, monkeypatch
):
    assert label(*FEW, blobs=takes[:3]).status == 0  # there will be something to replace
    here = timeless(label(*FEW, "--json", "--overwrite", "--jobs", "2", blobs=takes[:3]))
    results = made(tmp_path / "out")
    asked, start, threads = [], distributed.LocalCluster, set(threading.enumerate())

    def started_here(**words):
        asked.append((words["n_workers"], Path(words["local_directory"])))
        return start(**words)

    monkeypatch.setattr(distributed, "LocalCluster", started_here)
    before = processes_of_ours()
    assert timeless(label(*FEW, "--json", "--overwrite", "--engine", "dask", "--jobs", "2", blobs=takes[:3])) == here
    assert made(tmp_path / "out") == results
    [(workers_here, scratch)] = asked
    assert workers_here == 2 and not scratch.exists()
    assert processes_of_ours() == before
    # Of what it ran in this process only threads that wait for work and have no name of a worker may be left.
    assert [one.name for one in set(threading.enumerate()) - threads if "Dask-Default" in one.name] == []


def processes_of_ours() -> set[int]:
    return {child.pid for child in psutil.Process().children(recursive=True)}
