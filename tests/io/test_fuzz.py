# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever a file holds, a reader gives its content or one InputError: never another exception, never a hang."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from addon.core.data.errors import InputError
from tests import fuzz
from tests.fuzz import READERS, samples

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    return samples(tmp_path_factory.mktemp("samples"))


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\0" * 3000,
        b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8,
        b"hello\n",
        b"\xff\xfe",
        b"[" * 5000,
        b"<a>" * 5000,
    ],
    ids=["empty", "zeros", "picture", "text", "mark", "brackets", "tags"],
)
def test_a_file_of_the_wrong_kind_is_refused_in_one_sentence(kind, content, files, tmp_path):
    shutil.copytree(files[kind].parent, tmp_path / "case")
    path = tmp_path / "case" / files[kind].name
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        READERS[kind](path)
    assert Path(caught.value.file).parent in (path.parent, path)


@pytest.mark.parametrize("kind", [kind for kind in READERS if kind != "res"])
def test_a_missing_file_and_a_folder_are_refused(kind, files, tmp_path):
    missing = tmp_path / files[kind].name
    with pytest.raises(InputError):
        READERS[kind](missing)
    missing.mkdir()
    with pytest.raises(InputError):
        READERS[kind](missing)


def test_the_command_finds_no_fault_in_any_reader():
    pytest.importorskip("resource", reason="this system has no limits for a process")
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", "--count", "15", "--seed", "1"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    told = re.findall(r"^(\w+): 15 files, \d+ refused, \d+ read, 0 faults", done.stdout, re.MULTILINE)
    assert told == list(READERS)


PLANTED = """
import os, signal, sys, time, warnings
import tests.fuzz as fuzz, tests.fuzz.watched as watched
def blocked():
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGALRM, signal.SIGPROF})
    time.sleep(600)
def slow():
    try:
        while True:
            pass
    except OSError:
        pass
def reader(path):
    content = path.read_text()
    if content.startswith('do '):
        exec(content[3:])
ways = WAYS
watched.SECONDS, fuzz.STUCK = 0.5, 8
fuzz.READERS['blobs'] = reader
fuzz.case = lambda kind, contents, seed, number: b'do ' + ways[number].encode()
fuzz.VERB_EVERY, fuzz.cli.main = len(ways), lambda words: 1
fuzz.main(sys.argv[1:])
"""
MISCHIEF = [
    ("pass", ""),
    ("os._exit(9)", "the process ended with 9"),
    ("slow()", "TooSlowError: takes over 0.5 s"),
    ("bytes(3 << 30)", "takes over 1024 MB"),
    ("open(path.parent / 'beside', 'w').close()", "leaves something beside"),
    ("open(os.path.join(os.environ['TMPDIR'], 'rest'), 'w').close()", "leaves ['rest']"),
    ("warnings.warn('odd')", "UserWarning: odd"),
    ("open(path)", "cannot be raised: ResourceWarning"),
    ("blocked()", "the process ended with 1"),
    ("raise fuzz.InputError('is odd', 'a.csv')", "is no sentence of what is wrong"),
    ("raise fuzz.InputError('is odd; expected an even one')", "names no file"),
    ("raise KeyError('x')", "KeyError: 'x'"),
    ("pass", "verb: status 1, and says []"),
]


def test_readers_that_do_what_none_may_are_told_and_the_rest_goes_on(monkeypatch, tmp_path):
    pytest.importorskip("resource", reason="this system has no limits for a process")
    planted = tmp_path / "planted.py"
    planted.write_text(PLANTED.replace("WAYS", repr([way for way, _ in MISCHIEF])))
    monkeypatch.setattr(fuzz, "COMMAND", [sys.executable, str(planted)])
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])))
    answers = dict(fuzz.results("blobs", 0, range(len(MISCHIEF))))
    for number, (way, said) in enumerate(MISCHIEF):
        assert said in (answers[number] or "") and bool(said) == (answers[number] is not None), way
