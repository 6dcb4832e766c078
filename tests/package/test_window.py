# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's way through a real Blender's window; the modules in `tours` walk it, this file judges it."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from addon.cli import main
from addon.core.data.takes import Points
from addon.demo.take import MODEL, make_performance
from addon.io.markersets import open_markerset
from addon.io.points import of_frames, write_c3d
from scripts.virtual_take import write_virtual_points

pytestmark = [pytest.mark.real_blender, pytest.mark.window, pytest.mark.slow]


@pytest.fixture(scope="module")
def tour(watch, virtual_take, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tour")
    write_virtual_points(folder, 120)
    files = {"cameras": str(virtual_take / "cameras.toml"), "blobs": str(virtual_take / "take.csv")}
    return watch("sidebar", folder, **files, points=str(folder / "walk.c3d"))


def test_a_take_is_named_after_three_clicks_esc_leaves_nothing_and_each_stage_fits_a_screen(tour):
    assert [name.removeprefix("mocap_autolabel.") for name in tour["at first"]] == ["import_take"]
    assert tour["found"] == "body26"
    assert "mocap_autolabel.label" in tour["opened"]
    assert tour["running after the click"]
    assert tour["after Esc"] == {"running": False, "take": False, "actions": 0}
    assert tour["labelled"]
    assert {f"mocap_autolabel.{name}" for name in ("accept_trouble", "smooth")} <= tour["to review"].keys()
    assert {f"mocap_autolabel.{name}" for name in ("add_character", "export_c3d")} <= tour["to use"].keys()
    # Opened meanwhile, another file is no end of it; only a file that was never saved cannot be opened again.
    assert not tour["elsewhere"] and not tour["undone"] and tour["chosen"] == "body26"
    assert tour["open again"]["file"] and tour["open again"]["named"] > 0.8 and not tour["open again"]["doing"]
    assert tour["window closed"]
    assert tour["never saved"] == {"running": False, "doing": "", "take": False}
    # Each stage is at most a window of 1600 x 1000 px high, so a screen of 1080 px has room to spare.
    assert len(tour["heights"]) == 6
    assert max(tour["heights"].values()) == pytest.approx(1)


KEPT = ("range", "edits", "fills", "answered")


def walked(watch, script: str, folder: Path) -> dict:
    """What is seen on a way through the window with a take of points."""
    write_virtual_points(folder, 120)
    return watch(script, folder, points=str(folder / "walk.c3d"), markerset="body26", frame=40)


@pytest.fixture(scope="module")
def room(watch, tmp_path_factory):
    return walked(watch, "room", tmp_path_factory.mktemp("room"))


def test_keys_show_what_is_meant_correct_and_answer_and_all_of_it_reaches_the_file(room):
    place, before, after = room["view"]
    assert max(map(abs, place)) < 8, "it was looked at 9 9 9, where nobody is"
    assert after == pytest.approx(before, abs=1e-5)
    assert room["labelled"]["edits"] == []
    unlabelled, *answers = room["corrected"]["edits"]
    assert "has no name" in unlabelled
    assert answers
    assert len(room["corrected"]["answered"]) == 1
    assert room["corrected"]["lost"] < room["labelled"]["lost"]
    labelled, corrected, filled = (room[step] for step in ("labelled", "corrected", "filled"))
    assert filled["fills"]
    assert len({labelled["file"], corrected["file"], filled["file"]}) == 3
    assert filled["edits"] == corrected["edits"]


def test_nothing_is_lost_undo_brings_back_what_was_before_and_a_reopened_file_is_what_was_saved(room):
    for step in ("labelled again", "undone", "redone", "reopened"):
        assert {what: room[step][what] for what in KEPT} == {what: room["filled"][what] for what in KEPT}, step
    assert (room["undone"]["labels"], room["undone"]["file"]) == (room["filled"]["labels"], room["filled"]["file"])
    assert room["reopened"] == room["redone"]


@pytest.fixture(scope="module")
def tool(watch, tmp_path_factory):
    return walked(watch, "label", tmp_path_factory.mktemp("label"))


def test_dots_are_picked_in_every_way_swapped_by_keys_and_named_by_the_pie(tool):
    left, right = tool["knees"]
    assert (tool["clicked"], tool["selected"]) == ([left], ["LKNE"])
    assert tool["with Shift"] == [left, right] and tool["with Shift again"] == [right]
    assert tool["beside"] == []
    assert set(tool["knees"]) <= set(tool["in a box"])
    assert tool["in a lasso"] == [tool["knees"][1]] and tool["swapped"] == ["LKNE and RKNE swapped, all frames"]
    assert tool["undone"] == [] and tool["picked after undo"] == tool["knees"]
    [unlabelled] = tool["unlabelled"]
    assert tool["named by the pie"] == [unlabelled, f"LANK is {unlabelled.split(' has ')[0].lower()}, all frames"]
    assert tool["after Esc"] == tool["named by the pie"]


def test_quick_label_goes_from_marker_to_marker(tool):
    first, after, back, skipped, second = tool["asked"]
    assert {first, second} < set(tool["truth"])
    assert first == back != after, "what was taken back is asked for again"
    assert skipped == after, "what was passed over is not asked for again"
    assert tool["given"] == [f"{second} is trajectory {tool['truth'][second]}, all frames"]
    assert not tool["quick label runs"]


PREVIEWED = (1.0, 0.75, 0.2)  # what a fill that is not kept yet is drawn in


def test_fills_are_seen_before_they_are_kept_markers_placed_and_playback_goes_on(tool):
    assert tool["kept"][0] and not tool["kept"][1]
    picture = imread(tool["folder"] / "6-graph.png")[..., :3]
    x, y, wide, high = tool["graph"]
    graph = picture[len(picture) - y - high : len(picture) - y, x : x + wide]
    assert (np.abs(graph - PREVIEWED).max(axis=2) < 0.06).sum() > 50
    words, place = tool["placed"]
    assert words.startswith(f"{tool['gap']} is placed by hand, frame")
    assert np.isfinite(place).all()
    assert tool["played"] and tool["tool"] == "mocap_autolabel.label_tool"


MARKERS, LONG_GHOSTS, FLICKERS = 53, 20, 600
A_PIXEL = 3  # frames, about


@pytest.fixture(scope="module")
def timeline(watch, tmp_path_factory):
    return watch("timeline", tmp_path_factory.mktemp("timeline"), frames=2000)


def test_markers_and_what_has_no_name_have_rows_and_a_click_on_one_goes_there_and_picks(timeline):
    assert timeline["rows"][0] == MARKERS + LONG_GHOSTS + 1, "the short ones share one"
    assert timeline["rows unfolded"] == MARKERS + LONG_GHOSTS + FLICKERS
    assert abs(timeline["click"]["frame"] - timeline["click"]["asked"]) <= A_PIXEL
    assert timeline["click"]["selected"] == ["RFHD"]
    assert timeline["ghost"]["picked"] == timeline["ghost"]["wanted"]


def test_a_drag_selects_a_range_and_undo_takes_it_back(timeline):
    used, *ends = timeline["drag"]["range"]
    assert used
    assert all(abs(one - other) <= A_PIXEL for one, other in zip(ends, timeline["drag"]["wanted"], strict=True))
    assert timeline["drag"]["selected"] == [timeline["drag"]["row"]]
    for after in ("undone", "stopped"):
        assert timeline[after]["range"][0] is False and timeline[after]["selected"] == ["RFHD"]


def test_names_are_clicked_the_wheel_scrolls_and_other_keys_are_left_alone(timeline):
    assert timeline["name clicked"]["selected"] == [timeline["name clicked"]["row"]]
    assert timeline["name clicked"]["frame"] == timeline["undone"]["frame"], "a name is no time"
    assert len(timeline["added"]) == 2
    assert timeline["scrolled"] == 8 * 3 and timeline["scrolled by names"] == 9 * 3
    assert timeline["panned"] == pytest.approx(9 * 3 - 4, abs=0.5) and timeline["zoomed"] < 0.95
    assert timeline["keys left"]


def test_the_rows_are_coloured_and_switched_off_it_leaves_blenders_own(timeline):
    names = "whole", "range", "ghosts", "unfolded", "off"
    seen = {name: imread(timeline["folder"] / f"timeline-{name}.png")[..., :3] for name in names}
    for name in names[:4]:
        grey = seen[name].max(axis=2) - seen[name].min(axis=2) < 0.1
        assert (~grey[len(grey) // 2 :]).mean() > 0.02, name
    assert abs(seen["unfolded"] - seen["off"]).mean() > 0.02


def test_a_take_of_a_set_of_ones_own_is_named_after_three_clicks(watch, tmp_path):
    known, rng = open_markerset(MODEL), np.random.default_rng(3)
    places = known.offsets + rng.normal(0, 0.03, known.offsets.shape)
    mine = replace(known, markers=tuple(f"MY{name}" for name in known.markers), aliases={}, offsets=places)
    take, own = make_performance(mine).take, tmp_path / "own"
    write_c3d(tmp_path / "named.c3d", of_frames(take, (1, 240)))
    unnamed = take.xyz[240:480, rng.permutation(len(mine))]
    write_c3d(tmp_path / "walk.c3d", Points(("",) * len(mine), unnamed, take.residual[:240], take.rate, 1))
    own.mkdir()
    assert main(["train", str(tmp_path / "named.c3d"), "--out", str(own / "mine.markerset.json")]) == 0
    two = shutil.copytree(own, tmp_path / "two")
    (two / "yours.markerset.json").write_text((own / "mine.markerset.json").read_text().replace('"MY', '"YR'))
    seen = watch("own", tmp_path, points=str(tmp_path / "walk.c3d"), own=str(own), two=str(two))
    assert Path(seen["found"]).name == "mine.markerset.json"
    assert seen["named"] == seen["points"] == unnamed[..., 0].size
    assert {Path(one).name for one in seen["asked"]} == {"mine.markerset.json", "yours.markerset.json"}
    assert seen["answered"] == {"mine": "MY", "yours": "YR"}[Path(seen["asked"][0]).name.partition(".")[0]]
    print("| from a file to names | clicks | seconds |\n| --- | --- | --- |")
    print(f"| a set of one's own, learned before | 3 | {seen['seconds']:.0f} |")


def test_a_rig_follows_choices_corrections_and_undo_until_it_is_baked(watch, tmp_path):
    seen = walked(watch, "rig", tmp_path)
    first, feet, corrected = seen["retargeted"], seen["feet left"], seen["corrected"]
    assert first[:2] == ["walk retargeted", True] and feet[:2] == corrected[:2] == ["walk retargeted", False]
    assert len({first[2], feet[2], corrected[2]}) == 3
    back = [seen[f"{key} {number}"] for number, key in enumerate(["undo"] * 3 + ["redo"] * 3 + ["undo", "redo"])]
    assert back == [feet, first, None, first, feet, corrected, feet, corrected]
    assert seen["baked"] == seen["reopened"] == ["walk on Hero", False, corrected[2]]


def test_a_second_person_comes_from_a_file_to_a_rig_without_a_detour(watch, tmp_path):
    seen = walked(watch, "trial", tmp_path)
    assert seen["tab"] == "Mocap" and seen["wrong"] and seen["mended"] and seen["time is kept"]
    assert sum(clicks for clicks, _, _ in seen["steps"].values()) <= 17
    assert {path.suffix for path in tmp_path.glob("trial.*")} >= {".c3d", ".fbx"}
    for name, step in seen["steps"].items():
        print(name, *step)
