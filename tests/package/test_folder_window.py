# SPDX-License-Identifier: GPL-3.0-or-later
"""Label Folder in a real Blender's window; `tours/folder.py` walks it, this file judges it."""

import shutil

import pytest

from addon.io.batch import read_table

pytestmark = [pytest.mark.real_blender, pytest.mark.window, pytest.mark.slow]


@pytest.fixture(scope="module")
def tour(watch, virtual_take, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tour")
    (folder / "takes").mkdir()
    for name in ("take.csv", "take.csv.truth.csv"):
        shutil.copy(virtual_take / name, folder / "takes" / name)
    (folder / "takes" / "notes.csv").write_text("no,blobs\n")
    task = {"cameras": str(virtual_take / "cameras.toml"), "takes": str(folder / "takes"), "markerset": "body26"}
    return watch("folder", folder, **task)


def test_takes_are_labelled_while_somebody_works_in_blender(tour):
    assert tour["doing"]
    assert tour["cube moved meanwhile"]
    assert tour["watched"] == [["notes", "failed"], ["take", "labelled"]]


def test_a_click_stops_it_and_the_table_stays(tour):
    assert tour["said"] == ""
    rows = read_table(tour["folder"] / "labelled" / "summary.csv")
    assert [(row.take, row.state, row.page) for row in rows] == [
        ("notes", "failed", ""),
        ("take", "labelled", "take.report.html"),
    ]


def test_a_click_opens_a_take_of_the_list_which_stays(tour):
    assert tour["opened"]
    assert tour["listed still"] == ["notes", "take"]
