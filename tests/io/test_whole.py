# SPDX-License-Identifier: GPL-3.0-or-later
"""Output files appear whole or not at all."""

from pathlib import Path

import pytest

from addon.core.errors import InputError, JobError
from addon.io.whole import whole_file, whole_files


def test_a_file_appears_only_when_the_block_ends_well(tmp_path):
    target = tmp_path / "new" / "take.c3d"
    with whole_file(target) as temporary:
        temporary.write_text("all of it")
        assert temporary.suffix == ".c3d"
        assert temporary.name == target.name
        assert temporary.stat().st_dev == target.parent.stat().st_dev
        assert not target.exists()
    assert target.read_text() == "all of it"
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize("trouble", [ValueError, KeyboardInterrupt, GeneratorExit])
def test_nothing_is_left_of_a_block_that_fails(tmp_path, trouble):
    with pytest.raises(trouble), whole_file(tmp_path / "take.c3d") as temporary:
        temporary.write_text("half of")
        raise trouble
    assert not list(tmp_path.iterdir())


def test_an_existing_file_stays_as_it_is_unless_it_may_be_replaced(tmp_path):
    target = tmp_path / "take.c3d"
    target.write_text("old")
    with pytest.raises(InputError, match="exists already"), whole_file(target):
        pytest.fail("the block must not begin")
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
    with pytest.raises(ValueError, match="oops"), whole_files(targets) as parts:
        parts[0].write_text("0")
        raise ValueError("oops")
    assert not list(tmp_path.iterdir())
    with whole_files(targets) as parts:
        parts[0].write_text("0")
        parts[1].write_text("1")
    assert sorted(tmp_path.iterdir()) == targets[:2]


def test_a_place_that_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="folder"), whole_file(tmp_path / "file" / "take.c3d"):
        pytest.fail("the block must not begin")
    with pytest.raises(InputError, match="is a folder"), whole_file(tmp_path, overwrite=True):
        pytest.fail("the block must not begin")
    with pytest.raises(JobError, match="No space"), whole_file(tmp_path / "take.c3d"):
        raise OSError(28, "No space left on device")


def test_a_link_that_leads_nowhere_counts_as_a_file_that_exists(tmp_path):
    target = tmp_path / "take.c3d"
    target.symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match="exists already"), whole_file(target):
        pytest.fail("the block must not begin")
    assert target.is_symlink()


@pytest.mark.skipif(not Path("/dev/null").is_char_device(), reason="this system has no /dev/null")
def test_a_device_is_never_replaced_by_a_file():
    with pytest.raises(InputError, match="no ordinary file"), whole_file(Path("/dev/null"), overwrite=True):
        pytest.fail("the block must not begin")


def test_a_name_too_long_is_refused_and_one_that_just_fits_is_taken(tmp_path):
    with pytest.raises(InputError, match="expected another name"), whole_file(tmp_path / ("n" * 300)):
        pytest.fail("the block must not begin")
    with whole_file(tmp_path / ("n" * 250)) as temporary:
        temporary.write_text("all of it")
    assert [path.name for path in tmp_path.iterdir()] == ["n" * 250]


def test_a_folder_that_may_not_be_written_is_told_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda path, mode: path != tmp_path)  # nothing is forbidden to root
    with pytest.raises(InputError, match="may not be written"), whole_file(tmp_path / "take.c3d"):
        pytest.fail("the block must not begin")
