# SPDX-License-Identifier: GPL-3.0-or-later
"""Batches that are disturbed, a try of some kinds; `python -m tests.faults` makes hundreds."""

import subprocess
import sys

import pytest

from tests.faults.__main__ import Judge
from tests.faults.stage import ROOT, Said, files_of

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
