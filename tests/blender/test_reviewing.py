# SPDX-License-Identifier: GPL-3.0-or-later
"""The list of what is the matter with a take, in Blender: true, worst first, gone to, mended and answered for good."""

import json
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest

from addon.core.data.progress import finished
from addon.core.data.takes import NO_MARKER, Suspect
from addon.core.review.trouble import IN_DOUBT
from addon.io.edits import read_edits
from addon.props import list_rows
from addon.scene import naming
from addon.scene.relabelled import show_again
from addon.scene.take import show_take

from .conftest import label_walk, write_walk_and_ghost
from .hands import GHOST, add_object, choose, only, ours, press, refused, session, shown, stored_take

FRAMES, FIRST, LOST = 60, 101, "LKNE"


@pytest.fixture
def state(extension, empty, tmp_path, name_as):
    """A take in a scene of which one knee was never named, though its point is there, and a ghost is far away."""
    files = write_walk_and_ghost(tmp_path, FRAMES, (2.5, 2.5, 0.2))
    knee, state = files.names.index(LOST), session()
    name_as(np.where(np.isin(np.arange(GHOST + 1), [knee, GHOST]), NO_MARKER, np.arange(GHOST + 1)))
    label_walk(tmp_path)
    state.trouble_done, state.trouble_index = "OPEN", 0
    return SimpleNamespace(review=state, knee=knee, folder=tmp_path)


def rows(state, **wanted):
    """Numbers and rows of the list, with some values."""
    return [
        (number, row)
        for number, row in enumerate(state.review.troubles)
        if all(getattr(row, key) == value for key, value in wanted.items())
    ]


def selected() -> list[str]:
    return [item[naming.MARKER] for item in bpy.context.selected_objects]


def test_a_marker_that_was_never_found_is_said_and_shown_and_named_by_one_button(state):
    number, row = rows(state, kind="missing", name=LOST)[0]
    assert row.reason.startswith(f"{LOST} is never found; trajectory {state.knee}, which has no name, is ")
    stakes = [row.stake for row in state.review.troubles]
    assert stakes == sorted(stakes, reverse=True)
    assert not any(str(GHOST) in row.name for row in state.review.troubles), "it is nowhere near the body"
    press("show_trouble", index=number)
    assert bpy.context.scene.frame_current == row.first
    assert selected() == [], "an empty that is not there cannot be selected"
    press("mend_trouble", index=number)
    assert not rows(state, name=LOST, kind="missing")
    assert not rows(state, kind="left over")


def test_the_gaps_of_one_marker_though_hidden_are_filled_by_its_button(state):
    scene = bpy.context.scene
    found = enumerate(ours("scene.trouble").trouble_of(scene.mocap_autolabel.take, scene))
    number, trouble = next((at, one) for at, one in found if (one.kind, one.action) == ("missing", "fill"))
    name = state.review.troubles[number].name
    assert ours("ops.reviewing").words_for(trouble) == f"Fill {name}"
    for empty in shown().values():
        empty.hide_set(True)
    press("mend_trouble", index=number)
    assert {fill.name for fill in state.review.fills} == {name}


def test_what_is_right_is_done_and_does_not_come_back(state):
    number, _ = rows(state, kind="missing", name=LOST)[0]
    press("accept_trouble", index=number)
    [(number, row)] = rows(state, kind="missing", name=LOST)
    assert row.answered
    assert row.stake == 0
    over, left = rows(state, kind="left over")[0]
    assert not left.answered
    press("accept_trouble", index=over)
    assert all(row.answered for _, row in rows(state, kind="left over"))
    press("save_corrections")
    assert next(type(one).__name__ for one in read_edits(state.folder / "walk.edits.json")) == "Right"
    press("label")
    assert [row.answered for _, row in rows(state, kind="missing", name=LOST)] == [True]
    assert all(row.answered for _, row in rows(state, kind="left over"))
    press("clear_corrections")
    assert not any(row.answered for row in state.review.troubles)


def test_what_was_answered_is_done_still_once_labelling_leaves_it_out(extension, empty, made):
    settings, state, take = empty.scene.mocap_autolabel, session(), replace(made.take(), source="walk.csv")
    settings.take = show_take(empty, take)
    doubts = [one.reason for one in state.troubles if one.kind == IN_DOUBT]
    assert len(doubts) == 2
    number = next(at for at, one in enumerate(state.troubles) if one.reason == doubts[0])
    press("accept_trouble", index=number)
    left = [one for one in take.suspects if one.words not in doubts[0]]
    assert len(left) == 1
    for _ in range(2):
        settings.take = show_again(empty, replace(take, suspects=tuple(left)), whole=True)
        ours("scene.opened").opened.forget_read()
        ours("props").refresh_review(empty.window_manager, empty.scene)
        assert {one.reason: one.answered for one in state.troubles if one.kind == IN_DOUBT} == {
            doubts[0]: True,
            doubts[1]: False,
        }
    press("clear_corrections")
    assert [one.answered for one in state.troubles if one.kind == IN_DOUBT] == [False, False], "it is asked again"


def test_rings_are_only_around_what_the_list_asks_about(state):
    figure = ours("ui.figure")
    known = ours("scene.trouble").known_trouble
    scene = bpy.context.scene
    collection, state.review.trouble_shown = scene.mocap_autolabel.take, ""
    stored = stored_take()
    scene.frame_set(FIRST + stored.clock.shift)
    assert figure.meant(bpy.context, collection, stored) is None, "nobody went there"
    press("show_trouble", index=0)
    assert figure.meant(bpy.context, collection, stored).reason == state.review.trouble_shown

    def rings() -> list:
        return figure.missing(stored_take(), 0, known(collection, scene)).tolist()

    assert rings() == [stored.motion.expected[0, state.knee].tolist()]
    number, _ = rows(state, kind="missing", name=LOST)[0]
    press("accept_trouble", index=number)
    assert rings() == []


def test_the_next_is_the_next_that_is_listed_and_open(state):
    is_listed = ours("ops.listing").is_listed
    assert len(state.review.troubles) > 1 and all(is_listed(state.review, row) for row in state.review.troubles)
    state.review.trouble_shown, state.review.trouble_index = "", 0
    press("next_trouble")
    assert state.review.trouble_index == 0, "the worst, which nobody was shown yet, comes first"
    press("next_trouble")
    assert state.review.trouble_index == 1
    press("next_trouble", back=True)
    assert state.review.trouble_index == 0
    state.review.trouble_done = "DONE"
    assert bpy.ops.mocap_autolabel.next_trouble() == {"CANCELLED"}
    state.review.trouble_done = "OPEN"
    worst, second = [row.reason for row in state.review.troubles][:2]
    press("accept_trouble", index=0)
    assert worst in [row.reason for row in state.review.troubles if row.answered]
    press("next_trouble")
    shown = state.review.troubles[state.review.trouble_index]
    assert (shown.reason, shown.answered) == (second, False), "what takes the place of the answered one"


def test_labelling_again_keeps_a_shorter_scene_and_puts_other_markers_into_no_take(state):
    scene, settings = bpy.context.scene, bpy.context.scene.mocap_autolabel
    assert (scene.frame_start, scene.frame_end) == (101, 160)
    scene.frame_start, scene.frame_end = 105, 150
    press("label")
    assert (scene.frame_start, scene.frame_end) == (105, 150)
    refused("expected one of the", "show_trouble", index=999)
    before = settings.take
    before.objects.link(hat := add_object("hat"))
    before["mocap_names"] = json.dumps(json.loads(before["mocap_names"])[::-1])  # of a set of the same name
    ours("scene.opened").opened.forget()
    press("label")
    assert settings.take != before
    assert before.hide_viewport and hat.name in before.objects
    assert not len(state.review.changes)


def test_a_take_of_blobs_has_its_cameras_and_can_be_answered(extension, empty, made):
    moved = Suspect(101, 160, "camera cam 1 seems to have moved: its blobs are 1.7 px off")
    empty.scene.mocap_autolabel.take = show_take(empty, replace(made.take(60), suspects=(moved,)))
    state = session()
    state.trouble_done = "ALL"
    [number] = [number for number, row in enumerate(state.troubles) if row.kind == "camera"]
    assert state.troubles[number].name == "cam 1"
    press("show_trouble", index=number)
    press("accept_trouble", index=number)
    assert [row.answered for row in state.troubles if row.kind == "camera"] == [True]
    assert len(state.corrections) == 1


def test_a_range_labelled_again_is_put_into_the_take_and_leaves_the_scene_its_frames(state, name_as):
    scene, settings = bpy.context.scene, bpy.context.scene.mocap_autolabel
    name_as(np.where(np.isin(np.arange(GHOST + 1), [9, GHOST]), NO_MARKER, np.arange(GHOST + 1)))  # the knee, no wrist
    scene.frame_set(140)
    settings.labelling.use_range, settings.labelling.range_first, settings.labelling.range_last = True, 121, 130
    press("label")
    assert [one.name for one in scene.collection.children if naming.TAKE in one] == [settings.take.name]
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == (101, 160, 140)
    stored = stored_take()
    assert stored.motion.frames.tolist() == list(range(101, 161))
    found = np.isfinite(stored.motion.markers[:, state.knee, 0])
    assert stored.motion.frames[found].tolist() == list(range(121, 131))
    words = [row.words for row in state.review.changes]
    wrist = stored.names[9]
    assert words == [f"{LOST} is named now in frames 121–130", f"{wrist} is named no more in frames 121–130"]
    settings.labelling.use_range = False
    press("label")
    assert len([one for one in scene.collection.children if naming.TAKE in one]) == 1
    words = [row.words for row in state.review.changes]
    assert f"{LOST} is named now in frames 101–120" in words
    assert not any("121" in one for one in words)
    press("clear")
    for first, last in ((121, 130), (141, 150)):
        settings.labelling.use_range, settings.labelling.range_first, settings.labelling.range_last = True, first, last
        press("label")
        assert (scene.frame_start, scene.frame_end) == (101, 160), "also where a range is labelled first"
    stored = stored_take()
    assert stored.motion.frames.tolist() == list(range(121, 151))
    named = np.bincount(stored.rows.frame[stored.labels.named], minlength=30) > 0
    assert named.tolist() == [True] * 10 + [False] * 10 + [True] * 10


def test_what_is_said_while_labelling_goes_on_is_not_lost(state):
    labelling = ours("ops.labelling")
    context, again = bpy.context, SimpleNamespace(report=lambda *_: None)
    again._job, again._name, again._clock = labelling.job_of(context), "walk", None
    steps = labelling.label_to_show(again._job)
    next(steps)
    choose("RKNE")
    press("unlabel", scope="WHOLE")
    labelling.LabelsTake._show(again, context, finished(steps))
    assert len(state.review.corrections) == 1
    assert rows(state, kind="missing", name="RKNE")


def test_the_lists_go_along_with_what_is_picked_and_the_next_is_still_the_next(state):
    review = state.review
    press("next_trouble")
    shown = review.trouble_index
    row = next(row for at, row in rows(state, kind="missing") if row.name != LOST and at != shown)
    bpy.context.scene.frame_set(int(row.first))
    press("timeline_pick", marker=row.name, first=int(row.first), last=int(row.first))
    assert review.troubles[review.trouble_index].name == row.name
    assert review.troubles[review.trouble_index].first <= row.first <= review.troubles[review.trouble_index].last
    assert review.markers[review.marker_index].name == row.name
    press("pick", point=state.knee)
    assert LOST in review.troubles[review.trouble_index].reason, "a point that may be it"
    press("next_trouble")
    assert review.trouble_index == shown + 1


def test_the_chosen_row_stays_when_a_correction_picks_and_what_is_above_it_goes(state):
    review = state.review
    at, row = next((at, row) for at, row in rows(state) if at > 0 and row.name != LOST)
    review.trouble_index, reason = at, row.reason
    lost = next(number for number, _ in rows(state, kind="missing", name=LOST))
    assert lost < at
    bpy.context.scene.frame_set(int(review.troubles[lost].first))
    press("pick", point=state.knee)
    review.trouble_index = at
    press("name_point", marker=LOST, scope="WHOLE")
    assert not rows(state, kind="missing", name=LOST)
    assert review.troubles[review.trouble_index].reason == reason


def test_the_way_through_the_list_goes_along_with_the_rows_that_are_left(state):
    review = state.review
    rows = [(f"trouble {number}",) for number in range(9)]
    list_rows(review, "troubles", "reason", rows)
    review.trouble_index = review.trouble_followed = 7
    review.trouble_left = 5
    list_rows(review, "troubles", "reason", rows[:4] + rows[5:])
    assert (review.trouble_index, review.trouble_followed, review.trouble_left) == (6, 6, 4)


def test_nothing_is_said_to_be_open_before_it_was_looked_for(state):
    panel, opened, layout = ours("ui.review"), ours("scene.opened").opened, MagicMock()
    state.review.troubles.clear()
    opened.looked_at.pop("trouble")
    panel._open_header(layout, bpy.context)
    panel._draw_troubles(layout, bpy.context, state.review)
    assert [call.kwargs["text"] for call in layout.label.mock_calls] == ["Being looked for"]


def test_what_was_listed_of_another_scene_is_not_answered_in_this_one(state, monkeypatch):
    bpy.ops.scene.new(type="LINK_COPY")
    refused("another scene's; expected a choice in this one's", "accept_trouble", index=0)
    press("accept_trouble", index=0)
    bpy.context.window.scene = bpy.data.scenes["Scene"]
    panel, timers, said, layout = ours("ui.review"), [], [], MagicMock()
    monkeypatch.setattr(panel, "soon", timers.append)
    monkeypatch.setattr(panel, "draw_text", lambda _context, _layout, words, *_, **__: said.append(words))
    manager = in_two_windows(monkeypatch, state, bpy.data.scenes["Scene"], bpy.data.scenes["Scene.001"])
    context = SimpleNamespace(scene=bpy.data.scenes["Scene"], window_manager=manager)
    panel._open_header(layout, context)
    panel._draw_lists(layout, context, state.review)
    assert [call[0] for call in layout.mock_calls] == ["operator"]
    assert (timers, said) == ([], ["The lists are of the scene in another window"])
    bpy.data.scenes.remove(bpy.data.scenes["Scene.001"])
    bpy.ops.scene.new(type="EMPTY")
    manager.windows[1].scene = bpy.data.scenes["Scene.001"]
    panel._draw_lists(layout, context, state.review)
    assert (timers, len(said)) == ([ours("ops.correcting").review_now], 1), "they are of neither window's scene"
    timers[0]()
    panel._draw_lists(layout, context, state.review)
    assert len(timers) == 1
    layout.label.assert_not_called()
    layout.row.assert_called()
    bpy.context.window.scene = bpy.data.scenes["Scene.001"]
    press("list_here")
    assert state.review.of_scene == bpy.data.scenes["Scene.001"].session_uid


def in_two_windows(monkeypatch, state, *scenes) -> SimpleNamespace:
    """Has a window for each scene, the first of which is all that a timer is told of; their manager."""
    windows = [SimpleNamespace(scene=scene) for scene in scenes]
    manager, there = SimpleNamespace(windows=windows, mocap_autolabel=state.review), MagicMock(wraps=bpy)
    there.context = SimpleNamespace(window_manager=manager, scene=scenes[0])
    for module in ("props", "ops.correcting"):
        monkeypatch.setattr(ours(module), "bpy", there)
    return manager


def test_the_lists_of_a_second_window_stay_its_own_a_moment_after_a_correction(state, monkeypatch):
    scene = bpy.context.scene
    bpy.ops.scene.new(type="NEW")
    press("list_here")
    other, bpy.context.window.scene = bpy.context.scene, scene
    state.review.of_scene = other.session_uid
    choose("LASI")
    in_two_windows(monkeypatch, state, other, scene)
    press("is_right")
    ours("ops.correcting").review_now()
    ours("props").list_trouble()
    assert (state.review.of_scene, len(state.review.corrections)) == (scene.session_uid, 1)
    assert len(state.review.troubles)


def test_a_view_that_cannot_be_split_stays(labelled):
    screen = bpy.context.screen
    with suppress(RuntimeError):
        for _ in range(20):
            press("show_graph")
            small = next(area for area in screen.areas if area.ui_type == "FCURVES")
            for area in screen.areas:
                area.type = "VIEW_3D" if area == small else "PROPERTIES"
    refused("the 3D view is too small to split; expected it larger", "show_graph")
    assert small.type == "VIEW_3D"
    with bpy.context.temp_override(area=small, region=small.regions[-1]):
        bpy.ops.screen.screen_full_area()
    refused("a maximized view cannot be split; expected it restored", "show_graph")
    bpy.context.screen.areas[0].type = "PROPERTIES"
    refused("there is no 3D view to split; expected one", "show_graph")
    bpy.ops.screen.back_to_previous()


def test_a_graph_shows_just_what_is_meant_from_however_far_before(labelled):
    area = max(bpy.context.screen.areas, key=lambda area: area.width * area.height)
    area.ui_type = "FCURVES"
    region, viewing = area.regions[-1], ours("ops.viewing")
    choose("LASI")
    ends = []
    for reach in (100, 30_000):
        with bpy.context.temp_override(area=area, region=region):
            bpy.ops.view2d.zoom_border(xmin=-reach, xmax=reach, ymin=-reach, ymax=reach, wait_for_input=False)
        viewing.fit_graphs(bpy.context, 110, 115)
        ends.append([region.view2d.region_to_view(x, 0)[0] for x in (0, region.width)])
    assert ends == pytest.approx(np.array([[109, 116]] * 2), abs=0.1)
    press("jump", frame=112, marker="LASI")
    left, right = (region.view2d.region_to_view(x, 0)[0] for x in (0, region.width))
    around = round(stored_take().rate)
    assert ((left + right) / 2, right - left) == pytest.approx((112, 2.2 * around), abs=0.1), "and the row of a list"


def test_an_armature_that_was_deleted_is_missed_until_it_is_shown_again(labelled, monkeypatch):
    def said() -> str:
        panel = ours("ui.review")
        monkeypatch.setattr(panel, "draw_text", MagicMock())
        panel.review.draw(SimpleNamespace(layout=MagicMock()), bpy.context)
        return str(panel.draw_text.mock_calls)

    assert "No armature" not in said()
    [armature] = only(bpy.context.scene.mocap_autolabel.take, "ARMATURE")
    bpy.data.objects.remove(armature)
    assert "No armature in Mocap: walk; Refit shows it again" in said()
    press("label")
    assert "No armature" not in said()
