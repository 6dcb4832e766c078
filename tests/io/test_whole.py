# SPDX-License-Identifier: GPL-3.0-or-later
"""Output files appear whole or not at all."""

import errno
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path, PureWindowsPath

import pytest

from addon.core.data.errors import InputError, JobError
from addon.io import scratch, whole
from addon.io.whole import LIST, PART, LeftAlone, finish_renaming, free_path, keep_apart, whole_file, whole_files

ROOT = Path(__file__).resolve().parents[2]
LINUX = Path("/proc/self/fd").is_dir() and os.name == "posix"  # Wine shows /proc too, with other numbers


def refused(words: str, *targets: Path, **how):
    """Files that cannot be written are refused before the work begins."""
    with pytest.raises(InputError, match=words), whole_files(targets, **how):
        pytest.fail("the block must not begin")


def at_renaming(monkeypatch, act):
    """Calls `act` with each path right before a file gets that name."""
    rename = Path.replace

    def renamed(part, target):
        act(target)
        return rename(part, target)

    monkeypatch.setattr(Path, "replace", renamed)


def fill(parts, text: str = "new"):
    for part in parts:
        part.write_text(text)


def held(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def link(path: Path, target: Path):
    """Makes a link, or skips the test where there are none: Wine makes them without a word, and does not see them."""
    path.symlink_to(target)
    if not path.is_symlink():
        pytest.skip("Wine has no links")


def test_a_file_appears_only_when_the_block_ends_well(tmp_path):
    target = tmp_path / "new" / "take.c3d"
    with whole_file(target) as temporary:
        temporary.write_text("all of it")
        assert temporary.name == target.name
        assert temporary.stat().st_dev == target.parent.stat().st_dev
        assert not target.exists()
    assert held(target.parent) == {"take.c3d": "all of it"}


@pytest.mark.parametrize("trouble", [ValueError, KeyboardInterrupt, GeneratorExit])
def test_nothing_is_left_of_a_block_that_fails(tmp_path, trouble):
    new = tmp_path / "new"
    with pytest.raises(trouble), whole_files([new / "take.c3d", new / "er" / "take.json"]) as parts:
        parts[0].write_text("half of")
        raise trouble
    assert not list(tmp_path.iterdir())


def test_an_existing_file_stays_as_it_is_unless_it_may_be_replaced(tmp_path):
    target = tmp_path / "take.c3d"
    target.write_text("old")
    refused("exists already", target)
    with pytest.raises(ValueError, match="oops"), whole_file(target, overwrite=True) as temporary:
        temporary.write_text("new")
        raise ValueError("oops")
    assert target.read_text() == "old"
    with whole_file(target, overwrite=True) as temporary:
        temporary.write_text("new")
    assert target.read_text() == "new"


def test_a_file_that_appears_meanwhile_is_not_replaced(tmp_path):
    target = tmp_path / "take.c3d"
    with pytest.raises(InputError), whole_file(target) as temporary:
        temporary.write_text("ours")
        target.write_text("theirs")
    assert target.read_text() == "theirs"


def test_the_files_of_a_job_appear_together(tmp_path):
    targets = [tmp_path / "take.c3d", tmp_path / "take.json", tmp_path / "take.blend"]
    with whole_files(targets) as parts:
        fill(parts[:2])
    assert sorted(tmp_path.iterdir()) == targets[:2]


def test_a_place_that_cannot_be_written_and_a_link_that_leads_nowhere_are_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    refused("folder", tmp_path / "file" / "take.c3d")
    refused("is a folder", tmp_path, overwrite=True)
    if Path("/dev/null").is_char_device():
        refused("no ordinary file", Path("/dev/null"), overwrite=True)
    with pytest.raises(JobError, match="No space"), whole_file(tmp_path / "take.c3d"):
        raise OSError(28, "No space left on device")
    target = tmp_path / "take.c3d"
    link(target, tmp_path / "nowhere")
    refused("exists already", target)
    assert target.is_symlink()


@pytest.mark.skipif(os.name == "nt", reason="Wine ends no name at 255 letters, and Windows ends the whole path at 259")
def test_a_name_too_long_is_refused_and_one_that_just_fits_is_taken(tmp_path):
    refused("expected another name", tmp_path / ("n" * 300))
    with whole_file(tmp_path / ("n" * 250)) as temporary:
        temporary.write_text("all of it")
    assert held(tmp_path) == {"n" * 250: "all of it"}
    for name in ("n" * 300, "n" * 300 + "/take.c3d"):
        refused("cannot be the name", tmp_path / "new" / "newer" / name)
    assert not (tmp_path / "new").exists()


@pytest.mark.skipif(os.name != "nt", reason="other systems reserve no names")
@pytest.mark.parametrize("name", ["aux.c3d", "aux.tar.c3d", "con.c3d", "lpt1.tar.c3d", "new/aux.c3d", "new/nul"])
def test_the_name_of_a_device_is_refused(tmp_path, name):
    refused("cannot be the name of a file", tmp_path / name)
    refused("cannot be the name of a file", tmp_path / name, overwrite=True)


@pytest.mark.filterwarnings("error")
def test_names_of_devices_are_told_without_a_warning_of_python():
    told = [name for name in ("aux.tar.c3d", "new/nul", "auxiliary.c3d") if whole._is_reserved(PureWindowsPath(name))]
    assert told == ["aux.tar.c3d", "new/nul"]


@pytest.mark.skipif(os.name != "nt", reason="other systems replace files that are open")
def test_where_a_program_has_one_of_the_files_open_none_is_replaced(tmp_path):
    targets = [tmp_path / "a.csv", tmp_path / "b.csv"]
    fill(targets, "old")
    with targets[1].open():
        refused("b.csv: cannot be replaced .* expected no other program to have it open", *targets, overwrite=True)
    with pytest.raises(InputError, match="to have it open"), whole_files(targets, overwrite=True) as parts:
        fill(parts)
        kept = targets[1].open()
    kept.close()
    assert held(tmp_path) == {"a.csv": "old", "b.csv": "old"}
    with whole_files(targets, overwrite=True) as parts:
        fill(parts)
    assert held(tmp_path) == {"a.csv": "new", "b.csv": "new"}


def test_a_free_name_is_found(tmp_path):
    assert free_path(tmp_path / "walk", ".refined.toml") == tmp_path / "walk.refined.toml"
    (tmp_path / "walk.refined.toml").touch()
    assert free_path(tmp_path / "walk", ".refined.toml") == tmp_path / "walk-2.refined.toml"


def test_a_folder_that_may_not_be_written_is_told_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda path, mode: path != tmp_path)  # nothing is forbidden to root
    refused("may not be written", tmp_path / "take.c3d")


def test_a_folder_that_another_run_takes_away_meanwhile_as_it_failed_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda path, mode: path.rmdir() is None)
    with whole_file(tmp_path / "new" / "take.c3d") as part:
        part.write_text("whole")
    assert held(tmp_path / "new") == {"take.c3d": "whole"}


def test_links_and_letter_case_make_no_other_file(tmp_path):
    take = tmp_path / "take.c3d"
    take.write_text("recorded")
    link(tmp_path / "linked.c3d", take)
    (tmp_path / "hard.c3d").hardlink_to(take)
    link(tmp_path / "folder", tmp_path)
    around = f"../{tmp_path.name}/take.c3d"
    for name in ("take.c3d", "linked.c3d", "hard.c3d", "TAKE.c3d", "folder/take.c3d", around):
        refused("is read", tmp_path / name, overwrite=True, read=[take])
        refused("twice", take, tmp_path / name, overwrite=True)
    refused("twice", tmp_path / "new.c3d", tmp_path / "New.C3D")
    assert take.read_text() == "recorded"
    assert len(list(tmp_path.iterdir())) == 4


def test_files_are_on_disk_before_they_get_their_names_and_the_last_gets_its_name_last(tmp_path, monkeypatch):
    said, flush = [], os.fsync

    def flushed(number):
        said.append(Path(f"/proc/self/fd/{number}").resolve() if LINUX else number)
        flush(number)

    monkeypatch.setattr("os.fsync", flushed)
    at_renaming(monkeypatch, said.append)
    targets = [tmp_path / name for name in ("take.labels.csv", "take.c3d", "take.report.json")]
    with whole_files(targets) as parts:
        fill(parts)
    assert [one for one in said if one in targets] == targets
    if LINUX:
        before = {one.name for one in said[: said.index(targets[0])]}
        assert before >= {target.name for target in targets}
        assert said[-1] == tmp_path


kills = pytest.mark.skipif(os.name == "nt", reason="needs a system where a process can be killed")
# Writes three files and is killed when so many of them have got their names.
KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from addon.io.whole import whole_files
folder, renamed, left, words = Path(sys.argv[2]), Path.replace, int(sys.argv[3]), sys.argv[4:]
def replace(part, target):
    global left
    if not left:
        os.kill(os.getpid(), signal.SIGKILL)
    left -= 1
    return renamed(part, target)
Path.replace = replace
with whole_files([folder / name for name in ("1", "2", "3")], "overwrite" in words) as parts:
    for part in parts:
        part.write_text("new")
    if left < 0:
        os.kill(os.getpid(), signal.SIGKILL)
"""


def killed(folder, *words):
    command = [sys.executable, "-c", KILLED, str(ROOT), str(folder), *map(str, words)]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL


@kills
@pytest.mark.parametrize("renamed", [0, 1, 2])
def test_who_is_killed_between_two_names_is_finished_by_the_next_run(tmp_path, renamed):
    killed(tmp_path, renamed)
    assert len([path for path in tmp_path.iterdir() if path.name in "123"]) == renamed
    with whole_file(tmp_path / "other") as temporary:
        temporary.write_text("all of it")
    assert held(tmp_path) == {**dict.fromkeys("123", "new"), "other": "all of it"}


@kills
def test_what_was_put_there_since_is_not_replaced_by_what_a_killed_run_left(tmp_path):
    for name in "123":
        (tmp_path / name).write_text("old")
    killed(tmp_path, 1, "overwrite")
    (tmp_path / "2").write_text("put here since")
    finish_renaming(tmp_path)
    assert held(tmp_path) == {"1": "new", "2": "put here since", "3": "new"}


@kills
def test_what_a_killed_run_left_half_written_goes_and_nothing_else(tmp_path):
    mine = [tmp_path / name for name in (".part-mine", f"{PART}0123456789ab", f"{PART}holiday")]
    for folder in mine:
        folder.mkdir()
        (folder / "picture").write_text("mine")
    killed(tmp_path, -1)
    assert len(list(tmp_path.iterdir())) == 4
    with whole_file(tmp_path / "running") as temporary:
        temporary.write_text("all of it")
        finish_renaming(tmp_path)
        assert temporary.read_text() == "all of it"
    assert sorted(tmp_path.iterdir()) == sorted([*mine, tmp_path / "running"])
    assert all((folder / "picture").read_text() == "mine" for folder in mine)


def planted(folder, content: str):
    """A folder of parts as somebody else could make it, with a file to move in, beside one to take away."""
    parts = folder / f"{PART}0123456789ab"
    parts.mkdir(parents=True)
    (parts / scratch.LOCK).touch()
    (parts / "in").write_text("theirs")
    (parts / LIST).write_text(content)
    (folder / "mine").write_text("mine")
    return parts


LISTS = {
    "a list": "[]",
    "a number": "5",
    "nothing": "",
    "cut off": '{"in": [',
    "deep": "[" * 100_000,
    "no states": '{"in": 5, "mine": {"away": []}}',
    "no mark": '{"in": [[6, 0], null], "mine": [null, [4, 0]]}',
    "another's mark": '{"in": [[6, 0], null], "mine": [null, [4, 0]], ".mocap-autolabel.lock": [1, 2]}',
    "as in version 1": '{"in": null, "mine": {"away": [4, 0]}}',
}


@pytest.mark.parametrize("what", LISTS)
def test_a_list_that_is_not_surely_ours_is_left_alone_and_said(tmp_path, what):
    folder = tmp_path / "takes"
    parts = planted(folder, LISTS[what])
    for path in (folder / "mine", parts / "in"):
        os.utime(path, ns=(0, 0))  # as the list says it is
    with pytest.warns(LeftAlone, match=re.escape(f"{parts}: is left alone")), whole_file(folder / "take.c3d") as part:
        part.write_text("whole")
    assert {path.name for path in folder.iterdir()} == {"take.c3d", "mine", parts.name}
    assert (parts / "in").read_text() == "theirs"


@kills
def test_a_copy_of_what_a_killed_run_left_is_left_alone(tmp_path):
    killed(tmp_path / "one", 1)
    shutil.copytree(tmp_path / "one", tmp_path / "other")
    (tmp_path / "other" / "1").unlink()
    with pytest.warns(LeftAlone):
        finish_renaming(tmp_path / "other")
    assert [path.name.startswith(PART) for path in (tmp_path / "other").iterdir()] == [True]
    finish_renaming(tmp_path / "one")
    assert sorted(path.name for path in (tmp_path / "one").iterdir()) == ["1", "2", "3"]


@pytest.mark.parametrize(("names", "stop"), [("12", 1), ("12", 2), ("123", 2)])
def test_a_stop_among_names_is_one_behind_the_last(tmp_path, monkeypatch, names, stop):
    calls = []

    def stopped(target):
        calls.append(target)
        if len(calls) == stop:
            raise KeyboardInterrupt

    at_renaming(monkeypatch, stopped)
    targets = [tmp_path / name for name in names]
    with pytest.raises(KeyboardInterrupt), whole_files(targets) as parts:
        fill(parts)
    assert sorted(tmp_path.iterdir()) == targets


@pytest.mark.parametrize("step", ["lock_now", "_hold"])
def test_a_stop_while_the_folder_of_parts_is_made_leaves_none(tmp_path, monkeypatch, step):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(scratch, step, stopped)
    with pytest.raises(KeyboardInterrupt), whole_file(tmp_path / "take.csv"):
        pytest.fail("the block must not begin")
    assert not list(tmp_path.iterdir())


def test_what_a_stop_leaves_of_the_folder_of_parts_is_taken_away_before_the_process_ends(tmp_path, monkeypatch):
    clear, stops = scratch._clear, [KeyboardInterrupt]

    def stopped_once(folder):
        if stops:
            raise stops.pop()
        clear(folder)

    monkeypatch.setattr(scratch, "_clear", stopped_once)
    with pytest.raises(KeyboardInterrupt), whole_file(tmp_path / "take.csv") as part:
        part.write_text("whole")
    assert len(list(tmp_path.iterdir())) == 2
    scratch.take_away_own()
    assert [path.name for path in tmp_path.iterdir()] == ["take.csv"]


def test_the_file_that_the_system_names_is_to_blame_and_a_folder_that_goes_away_is_no_success(tmp_path):
    with pytest.raises(JobError, match="elsewhere: the system says: No space"), whole_file(tmp_path / "take.c3d"):
        raise OSError(errno.ENOSPC, "No space left on device", "/elsewhere")
    with (
        pytest.raises(JobError, match=f"{re.escape(str(tmp_path))}: cannot be written"),
        whole_file(tmp_path / "take.c3d") as part,
    ):
        raise OSError(errno.ENOSPC, "No space left on device", str(part))
    (tmp_path / "share").mkdir()
    with pytest.raises(JobError, match="went away"), whole_file(tmp_path / "share" / "take.c3d") as part:
        part.write_text("new")
        (tmp_path / "share").rename(tmp_path / "elsewhere")
        (tmp_path / "share").mkdir()
    assert not list((tmp_path / "share").iterdir())
    finish_renaming(tmp_path / "elsewhere")
    assert not list((tmp_path / "elsewhere").iterdir())


def test_what_cannot_get_its_name_after_others_did_gets_it_with_the_next_run(tmp_path, monkeypatch):
    def full(target):
        if target.name == "2":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        at_renaming(patch, full)
        with pytest.raises(JobError, match="No space left"), whole_files([tmp_path / name for name in "123"]) as parts:
            fill(parts)
    assert (tmp_path / "1").read_text() == "new"
    finish_renaming(tmp_path)
    assert held(tmp_path) == dict.fromkeys("123", "new")


@pytest.mark.parametrize("lock", [None, b""])
def test_a_folder_of_parts_whose_maker_had_no_time_goes_at_once(tmp_path, lock):
    folder = tmp_path / f"{PART}0123456789ab"
    folder.mkdir()
    (tmp_path / whole.TURN).touch()  # which nobody has any more either
    if lock is not None:
        (folder / scratch.LOCK).write_bytes(lock)
        (folder / "take.c3d").write_text("half of")
    finish_renaming(tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_could_not_be_locked_stays_for_a_day(tmp_path, monkeypatch):
    def unknown(_file):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    with whole_file(tmp_path / "sure") as sure, monkeypatch.context() as patch:
        sure.write_text("locked")
        patch.setattr(scratch, "lock_now", unknown)
        with whole_file(tmp_path / "take.c3d") as part:
            part.write_text("at work")
            patch.undo()
            finish_renaming(tmp_path)
            assert part.read_text() == "at work"
            assert sure.read_text() == "locked"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sure", "take.c3d"]


def test_a_folder_that_somebody_takes_for_forsaken_while_it_is_made_is_made_again(tmp_path, monkeypatch):
    lock_now, folders = scratch.lock_now, []

    def meanwhile(file):
        folders.append(Path(file.name).parent)
        if len(folders) == 1:
            Path(file.name).unlink()
            folders[0].rmdir()
        lock_now(file)

    monkeypatch.setattr(scratch, "lock_now", meanwhile)
    with whole_file(tmp_path / "take.c3d") as part:
        assert part.parent == folders[1]
        part.write_text("whole")
    assert [path.name for path in tmp_path.iterdir()] == ["take.c3d"]


def test_two_runs_give_names_one_after_the_other(tmp_path, monkeypatch):
    looked, order = threading.Event(), []

    def other():
        with whole_file(tmp_path / "take.c3d") as part:
            part.write_text("whole")
        order.append("named")

    monkeypatch.setattr(whole.time, "sleep", lambda _seconds: looked.set())
    thread = threading.Thread(target=other)
    with whole.turns([tmp_path]):
        thread.start()
        assert looked.wait(60)
        order.append("turn over")
    thread.join()
    assert order == ["turn over", "named"]
    assert [path.name for path in tmp_path.iterdir()] == ["take.c3d"]


def test_paths_longer_than_windows_takes_are_apart_from_others(tmp_path, monkeypatch):
    def realpath(path):
        raise FileNotFoundError(2, "The filename or extension is too long", path)

    monkeypatch.setattr(os.path, "realpath", realpath)
    keep_apart([tmp_path / "read.c3d"], [tmp_path / "written.c3d"])
