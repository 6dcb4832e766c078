# SPDX-License-Identifier: GPL-3.0-or-later
"""`live`: a stream in, a line for each frame out, and all of it in a C3D."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from itertools import islice
from types import SimpleNamespace

import ezc3d
import numpy as np
import pytest

from addon.cli.live import refuse_offline
from addon.cli.workers import door
from addon.core.body.bodies import BodyModel
from addon.core.body.sides import mirror_order
from addon.core.data.errors import InputError, JobError
from addon.core.points.several.wearers import AUTO
from addon.core.points.whole_take.live import WINDOW_S, WindowNames
from addon.demo.take import MODEL
from addon.io import tables
from addon.io.markersets import open_markerset
from addon.io.points import read_points
from addon.io.streams.wire import StreamFrame
from addon.jobs import live
from scripts.virtual_take import write_virtual_take
from tests.io.streams.servers import NatNetServer, QtmServer, free_port, there_and_back

RATE = 100.0


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Frames of somebody who goes there and back for ever, with the true place of each marker."""
    take = write_virtual_take(tmp_path_factory.mktemp("live"), 300, 1, "walk.csv", "room.toml")
    return SimpleNamespace(names=take.names, xyz=take.xyz, played=partial(there_and_back, take.xyz, RATE))


@contextmanager
def naming(server, *words) -> Iterator[subprocess.Popen]:
    """The command at work on what a server streams; it is stopped by Ctrl-C in the end, and has no word of trouble."""
    command = [*door(), "live", server.source, *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        yield process
        process.send_signal(signal.SIGINT)
        process.rest, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (0, b"")


@pytest.fixture
def fed(monkeypatch):
    """Has streams be of these frames, whatever their address."""

    def feed(frames, rate: float | None = RATE):
        stream = type("Stream", (list,), {"rate": rate, "behind": False})(frames)
        monkeypatch.setattr(live, "open_stream", lambda *_: nullcontext(stream))

    return feed


def place(xyz: np.ndarray, number: int) -> np.ndarray:
    at = (number - 1) % (2 * len(xyz) - 2)
    return xyz[min(at, 2 * len(xyz) - 2 - at)]


@pytest.mark.parametrize("server", [QtmServer, NatNetServer])
def test_a_stream_is_named_and_kept_until_it_is_stopped(walk, server, tmp_path):
    out = tmp_path / "live.c3d"
    with server(walk.played(), RATE) as one, naming(one, "--model", MODEL, "--out", out) as process:
        lines = [json.loads(process.stdout.readline())]
        while len(lines[-1]["markers"]) < 0.9 * len(walk.names):
            lines.append(json.loads(process.stdout.readline()))
    lines += map(json.loads, process.rest.splitlines())
    for line in lines:
        assert line.keys() == {"frame", "seconds", "markers", "unnamed", "renamed", "late", "ms"}
        true = dict(zip(walk.names, place(walk.xyz, line["frame"]), strict=True))
        assert all(np.allclose(spot, true[name], atol=1e-3) for name, spot in line["markers"].items())
    assert lines[0]["markers"] == {} and len(lines[0]["unnamed"]) > 20
    assert (np.diff([line["frame"] for line in lines]) > 0).all()
    labels = ezc3d.c3d(str(out))["parameters"]["POINT"]["LABELS"]["value"]
    markers = open_markerset(MODEL).markers
    assert tuple(labels[: len(markers)]) == markers and labels[len(markers)] == "*1"
    kept = read_points(out)
    assert kept.rate == pytest.approx(RATE, rel=0.01) and kept.first_frame <= lines[0]["frame"]
    last, kept = lines[-1], kept.picked(range(len(kept.names)))
    for name, spot in last["markers"].items():
        np.testing.assert_allclose(kept.xyz[last["frame"] - kept.first_frame, labels.index(name)], spot, atol=1e-3)
    assert np.isfinite(kept.xyz[0, len(markers) :, 0]).sum() == len(walk.names)


def test_an_open_client_of_motive_reads_the_names_that_are_served(walk, tmp_path):
    natnet = pytest.importorskip("natnet", reason="natnet is not installed")
    port, printed, frames, sets = free_port(), tmp_path / "lines", [], []
    client = natnet.NatNetClient(command_port=port, use_multicast=False)
    client.on_data_frame_received_event.handlers.append(frames.append)
    client.on_data_description_received_event.handlers.append(lambda told: sets.extend(told.marker_sets))
    with QtmServer(walk.played(), RATE) as one, printed.open("wb") as out:
        command = [*door(), "live", one.source, f"--subject=ann={MODEL}", "--serve", f"natnet://127.0.0.1:{port}"]
        with subprocess.Popen(command, stdout=out, stderr=subprocess.PIPE) as process:
            while not printed.stat().st_size:
                time.sleep(0.1)
            with client:
                client.request_modeldef()
                end = time.monotonic() + 60
                while sum(len(frame.labeled_markers) > 0.9 * len(walk.names) for frame in frames[-9:]) < 9:
                    client.update_sync()
                    assert time.monotonic() < end
            process.send_signal(signal.SIGINT)
            errors = process.communicate(timeout=60)[1]
    assert process.returncode == 0, errors
    [worn] = sets
    assert worn.name == "ann" and worn.marker_names == open_markerset(MODEL).markers
    lines = {line["frame"]: line for line in map(json.loads, printed.read_text().splitlines())}
    for frame in frames:
        line = lines[frame.prefix.frame_number]
        named = {f"ann:{worn.marker_names[one.marker_id - 1]}": one.pos for one in frame.labeled_markers}
        assert named.keys() == line["markers"].keys() and frame.suffix.timestamp == line["seconds"]
        for name, (x, y, z) in named.items():
            assert (x, -z, y) == pytest.approx(line["markers"][name], abs=1e-6)
            assert frame.marker_sets[0].marker_pos_list[worn.marker_names.index(name[4:])] == (x, y, z)
        assert len(frame.unlabeled_marker_pos) == len(line["unnamed"])


@pytest.mark.parametrize("who", [("--model", MODEL, "--subjects", "2"), [f"--subject={one}={MODEL}" for one in "12"]])
def test_two_who_are_in_a_stream_are_named_and_stay_who_they_are(walk, who, tmp_path):
    other = write_virtual_take(tmp_path, 300, 5, "walk.csv", "room.toml").xyz + np.array([0.0, 2.0, 0.0])
    both = np.concatenate([walk.xyz[: len(other)], other[:, ::-1]], axis=1)
    truth = [*(("a", name) for name in walk.names), *(("b", name) for name in walk.names[::-1])]
    out, two, called = tmp_path / "live.c3d", 2 * len(walk.names), set()
    with QtmServer(there_and_back(both, RATE), RATE) as one, naming(one, *who, "--out", out) as process:
        found = 0
        while found < 100:
            line = json.loads(process.stdout.readline())
            frame = place(both, line["frame"])
            found += len(line["markers"]) > 0.9 * two
            for name, spot in line["markers"].items():
                whose, marker = truth[np.linalg.norm(frame - spot, axis=1).argmin()]
                assert name.partition(":")[2] == marker
                called.add((name.partition(":")[0], whose))
    assert len(called) == 2 and len(dict(called)) == 2, "each is one of the two all the time"
    labels = ezc3d.c3d(str(out))["parameters"]["POINT"]["LABELS"]["value"]
    markers = open_markerset(MODEL).markers
    assert labels[:two] == [f"{number}:{marker}" for number in "12" for marker in markers]


def test_a_stream_that_ends_or_ends_in_trouble_is_kept(walk, run, tmp_path):
    few = [frame for frame, _ in zip(walk.played(), range(50), strict=False)]
    with QtmServer(few, RATE) as one:
        assert run("live", one.source, "--model", MODEL, "--out", tmp_path / "whole.c3d").status == 0
    assert len(read_points(tmp_path / "whole.c3d").xyz) == 50
    with NatNetServer(few, RATE) as one:  # after which it says nothing any more
        words = "--model", MODEL, "--out", tmp_path / "half.c3d", "--wait", "0.5", "--rate", "100"
        answer = run("live", one.source, *words)
    assert "has sent nothing that is new for 0.5 s" in answer.refusal(1)
    assert len(read_points(tmp_path / "half.c3d").xyz) == 50
    assert len(answer.out.splitlines()) <= 50


class Solver:
    """Says of each full window what is next: the height of the subject, and how many names, exchanged or not."""

    busy = False

    def __init__(self, body: BodyModel, said: list[tuple[float, int, bool]]):
        self.body, self.said = body, said

    def hand(self, work: partial):
        self.window, self.busy = work.args[-1], True

    def look(self) -> WindowNames:
        self.busy = False
        marker, subjects = np.full(len(self.window.number), -1), ()
        if len(self.window.xyz) == WINDOW_S * RATE and self.said:
            height, named, exchanged = self.said.pop(0)
            subjects, order = (self.body.rest(1, height),), np.arange(self.body.marker_count)
            marker[:named] = (mirror_order(self.body.markerset.markers) if exchanged else order)[:named]
        return WindowNames(self.window.number, marker, subjects=subjects)


def test_who_it_is_is_taken_from_more_names_or_where_names_were_wrong(walk, fed):
    body = BodyModel(open_markerset(MODEL))
    order, none = [walk.names.index(name) for name in body.markerset.markers], np.full(body.marker_count, -1)
    fed(StreamFrame(number, number / RATE, place(walk.xyz, number)[order], none) for number in range(1, 230))
    lines: list[dict] = []
    said = [(1.4, 4, False), (1.7, len(order), False), (1.5, 8, False), (1.8, len(order), True)]
    live.name_stream(live.LiveJob("qtm://here", MODEL), Solver(body, said), lines.append, lambda: False)
    heights = [line["bodies"][0]["scale"][0] for line in lines if line.get("bodies", [None]) != [None]]
    assert list(dict.fromkeys(heights)) == [1.4, 1.7, 1.8]


@pytest.mark.parametrize(("room", "at_once", "kept"), [(1, 20, 20), (1, 50, 50), (0, 20, 0)])
def test_what_was_recorded_is_kept_where_temporary_files_find_no_more_room(
    walk, fed, monkeypatch, tmp_path, room, at_once, kept
):
    append, fits = tables.RowFile.append, [True] * room

    def full(self, rows):
        if fits:
            fits.pop()
            return append(self, rows)
        self.file.write(b"part of a row")
        raise JobError("cannot hold temporary files; expected room there")

    fed(islice(walk.played(), 60))
    monkeypatch.setattr(live, "KEPT_FRAMES", at_once)
    monkeypatch.setattr(tables.RowFile, "append", full)
    job = live.LiveJob("natnet://here", MODEL, tmp_path / "live.c3d")
    with pytest.raises(JobError, match="cannot hold temporary files"):
        live.name_stream(job, SimpleNamespace(busy=False, hand=lambda _: None), lambda _: None, lambda: False)
    assert (tmp_path / "live.c3d").exists() == bool(kept)
    if kept:
        xyz = read_points(tmp_path / "live.c3d").xyz
        assert np.isfinite(xyz[..., 0]).sum(axis=1).tolist() == [len(walk.names)] * kept
        assert np.isfinite(xyz[..., 0]).any(axis=0).all()


@pytest.mark.parametrize(
    "numbers",
    [range(0, 10**8, 10**6), [1, *range(2**31, 2**31 + 60)], [*range(1000, 1020), *range(500, 560)]],
    ids=["steps", "jump", "anew"],
)
def test_numbers_of_frames_that_jump_at_first_take_no_time_and_no_memory(walk, fed, numbers, tmp_path):
    same = place(walk.xyz, 1), np.arange(len(walk.names))
    fed((StreamFrame(number, float("nan"), *same) for number in numbers), rate=None)
    lines: list[dict] = []
    beside = SimpleNamespace(busy=False, hand=lambda work: pytest.fail("big") if len(work.args[-1].xyz) > 1e5 else None)
    job = live.LiveJob("natnet://here", MODEL, tmp_path / "live.c3d")
    live.name_stream(job, beside, lines.append, lambda: False)
    assert [line["frame"] for line in lines] == list(numbers)
    assert all(line["markers"] == {} and line["ms"] < 1000 for line in lines)


def test_what_cannot_be_is_said_before_anybody_is_asked(run, tmp_path):
    def refused(*words) -> str:
        return run("live", *words).refusal(2)

    assert "is no address of a stream" in refused("take.c3d", "--model", MODEL)
    for many in ("auto", "0"):
        words = refused("qtm://127.0.0.1", "--model", MODEL, "--subjects", many)
        assert "expected a whole number from 1 to 8" in words and "or auto" not in words
    with pytest.raises(InputError, match="expected how many subjects"):
        assert live.LiveJob("qtm://127.0.0.1", MODEL, subjects=AUTO).worn
    assert "auto needs the whole take" in refused("qtm://127.0.0.1", "--model", "auto")
    assert "outside of this machine's own network" in refused("qtm://8.8.8.8", "--model", MODEL)
    assert "expected a name that ends in .c3d" in refused("qtm://127.0.0.1", "--model", MODEL, "--out", "a.trc")
    (tmp_path / "a.c3d").write_bytes(b"mine")
    assert "exists" in refused("qtm://127.0.0.1", "--model", MODEL, "--out", tmp_path / "a.c3d")
    bare = tmp_path / "bare.markerset.json"
    bare.write_text(json.dumps({"version": 1}))
    assert "bare.markerset.json" in refused("qtm://127.0.0.1", "--model", bare)


@pytest.mark.parametrize(("binary", "online", "fine"), [("", False, True), ("b", True, True), ("b", False, False)])
def test_blender_must_be_allowed_to_go_online(monkeypatch, binary, online, fine):
    app = SimpleNamespace(binary_path=binary, online_access=online)
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace(app=app))
    words = "Allow Online Access is off in Blender's preferences; expected it on, or"
    with nullcontext() if fine else pytest.raises(JobError, match=words):
        refuse_offline()
