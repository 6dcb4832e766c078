# SPDX-License-Identifier: GPL-3.0-or-later
"""Stages of long work as progress of the whole, and who is named in trouble."""

import pytest

from addon.core.data.errors import ForceableError, InputError, of_file
from addon.core.data.progress import Stage, finished, in_stages

BEGINS = {"read": 0.0, "skip": 0.25, "solve": 0.25, "write": 0.75}


def work():
    yield Stage("read", "read it")
    yield 0.5
    yield 1.0
    yield Stage("skip", "nothing to do")
    yield 0.5
    yield Stage("solve", "solve it")
    yield 0.5, "frame 7"
    yield Stage("write", "write it")
    return "done"


def test_stages_are_told_as_parts_of_the_whole():
    told = [(progress.fraction, progress.note) for progress in in_stages(work(), BEGINS)]
    skipped = [(0.25, "nothing to do")] * 2
    read, rest = [(0.0, "read it"), (0.125, "read it"), (0.25, "read it")], [(0.5, "frame 7"), (0.75, "write it")]
    assert told == [*read, *skipped, (0.25, "solve it"), *rest]
    assert finished(in_stages(work(), BEGINS)) == "done"


def test_a_stage_that_nobody_planned_is_a_mistake_of_the_program():
    with pytest.raises(KeyError):
        finished(in_stages(iter([Stage("dance", "")]), BEGINS))


def test_all_that_work_yields_is_told_and_who_is_told_can_end_it():
    ended, told = [], []

    def long():
        try:
            yield "a"
            yield "b"
        finally:
            ended.append(True)
        return 3

    assert finished(long(), told.append) == 3
    assert told == ["a", "b"]

    def refuse(word):
        raise RuntimeError(word)

    with pytest.raises(RuntimeError, match="a"):
        finished(going := long(), refuse)
    assert len(ended) == 2
    assert going.gi_frame is None, "it would go on when nobody waits any more"


@pytest.mark.parametrize(
    ("trouble", "file"),
    [(InputError("bad"), "own.json"), (InputError("bad", "b.csv"), "b.csv"), (ForceableError("bad"), "")],
)
def test_trouble_of_the_kind_gets_the_file_it_lacks(trouble, file):
    with pytest.raises(type(trouble), match="bad") as caught, of_file("own.json", InputError):
        raise trouble
    assert caught.value.file == file
