# SPDX-License-Identifier: GPL-3.0-or-later
"""Open Take, which takes anything, and what the sidebar then tells of it before anything is labelled."""

import shutil
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest

from addon.io.markersets import SUFFIX, markerset_file
from addon.io.points import write_c3d
from tests.core.pipelines.test_known_sets import drawn, standing

from .conftest import write_room
from .hands import ours, press, refused, session

MOST_PANELS, MOST_CLICKS = 8, 3


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return write_room(tmp_path_factory.mktemp("room"), 30)


def opened(folder, *names: str):
    """Opens files of a folder, or with no names the folder, as the file browser does."""
    files = [{"name": name} for name in names]
    press("import_take", directory=folder, files=files)


def drawn_in_take(monkeypatch) -> str:
    """All that the panel Take asks Blender to draw."""
    panels, layout = ours("ui.panels"), MagicMock()
    monkeypatch.setattr(panels, "draw_text", MagicMock())
    panels.take.draw(SimpleNamespace(layout=layout), bpy.context)
    return str(layout.mock_calls)


def test_panels_are_few_and_a_person_sees_those_of_one_stage(extension, settings):
    ui, parts = ours("ui"), ours("ui.parts")
    modules = (*ui.PANEL_MODULES, ui.timeline, ui.quality)
    panels = {one for module in modules for one in vars(module).values() if isinstance(one, type)}
    panels = {one for one in panels if issubclass(one, bpy.types.Panel)}
    assert 4 <= len(panels) <= MOST_PANELS
    assert len([one for one in panels if not hasattr(one, "bl_parent_id")]) == 4
    assert not parts.shows(bpy.context, "REVIEW")


def test_a_stage_follows_a_labelled_take(shown):
    parts, settings = ours("ui.parts"), bpy.context.scene.mocap_autolabel
    assert (parts.shows(bpy.context, "REVIEW"), parts.shows(bpy.context, "USE")) == (True, False)
    settings.display.stage = "USE"
    assert (parts.shows(bpy.context, "REVIEW"), parts.shows(bpy.context, "USE")) == (False, True)


def test_files_of_a_built_in_and_of_an_own_set_are_named_after_three_clicks(settings, tmp_path):
    """The button and the one of the file browser, which call one operator, and Label; what is worn is found."""
    folder = ours("prefs").markerset_folder(create=True)
    own = shutil.copy(markerset_file("gait15"), folder / f"house{SUFFIX}")
    for name, found in (("body39", "body39"), ("gait15", str(own))):
        write_c3d(tmp_path / f"{name}.c3d", standing(drawn(name)))
        clicks = 2
        opened(tmp_path, f"{name}.c3d")
        press("find_markerset")  # which the window does by itself
        told = settings.subjects.found or session().likely[0].name
        assert told in (found, name)
        clicks += 1
        press("label")
        assert clicks <= MOST_CLICKS
        assert settings.take is not None
    own.unlink()


def test_where_two_sets_fit_both_are_offered_an_own_one_first_and_none_is_taken(settings, tmp_path, monkeypatch):
    state, own = session(), tmp_path / f"house{SUFFIX}"
    write_c3d(tmp_path / "one.c3d", standing(drawn("body39")))
    opened(tmp_path, "one.c3d")
    shutil.copy(markerset_file("body39"), own)

    def both(_take, models):
        yield from ()
        return None, list(models)

    monkeypatch.setattr(ours("core.pipelines.known_sets"), "set_worn", both)
    monkeypatch.setattr(ours("jobs.job"), "known_models", lambda _: ["body39", str(own)])
    press("find_markerset")
    assert [one.name for one in state.likely] == [str(own), "body39"]
    assert not settings.subjects.found
    assert ours("ui.panels").asks_which(state, settings), "Label waits for the answer"
    assert "'Label as body39'" in drawn_in_take(monkeypatch)
    refused("as well as", "label")
    settings.labelling.use_range, settings.labelling.range_first, settings.labelling.range_last = True, 9, 2
    refused("are none", "label", markerset="body39")
    settings.labelling.use_range = False
    refused("no such file", "label", markerset=str(tmp_path / f"gone{SUFFIX}"))
    assert ours("ui.panels").asks_which(state, settings), "nothing was labelled, so nothing is chosen"
    assert bpy.ops.mocap_autolabel.label(markerset="body39") == {"FINISHED"}, "the answer is the third click"
    assert settings.subjects.markerset == "body39"
    assert settings.take is not None
    assert not ours("ui.panels").asks_which(state, settings)


@pytest.mark.parametrize("sure", [True, False])
def test_a_set_that_is_not_sure_is_offered_and_not_taken(settings, tmp_path, monkeypatch, sure):
    write_c3d(tmp_path / "one.c3d", standing(drawn("body39")))
    opened(tmp_path, "one.c3d")

    def one(_take, models):
        yield from ()
        [worn] = (model for model in models if model.markerset.name == "body39")
        return worn if sure else None, [worn]

    monkeypatch.setattr(ours("core.pipelines.known_sets"), "set_worn", one)
    press("find_markerset")
    assert settings.subjects.found == ("body39" if sure else "")
    assert [one.name for one in session().likely] == ([] if sure else ["body39"])


def test_a_labelled_take_and_another_that_is_opened_are_told_apart(settings, tmp_path, monkeypatch):
    props, state = ours("props"), session()
    for name in ("body39", "gait15"):
        write_c3d(tmp_path / f"{name}.c3d", standing(drawn(name)))
    opened(tmp_path, "body39.c3d")
    settings.subjects.markerset = "body39"
    press("label")
    first, settings.subjects.markerset = settings.take, "auto"
    assert props.is_opened(settings)
    opened(tmp_path, "gait15.c3d")
    assert "'Labelled'" in drawn_in_take(monkeypatch)
    settings.take, state.unfolded = first, True
    assert not props.is_opened(settings)
    assert "'Label Again'" not in drawn_in_take(monkeypatch)
    assert "gait15.c3d" in drawn_in_take(monkeypatch)
    panel = ours("ui.review")
    monkeypatch.setattr(panel, "draw_text", MagicMock())
    panel.review.draw(SimpleNamespace(layout=MagicMock()), bpy.context)
    assert "To refit, open body39.c3d again" in str(panel.draw_text.mock_calls)
    assert not settings.subjects.found
    settings.subjects.found = str(tmp_path / f"gone{SUFFIX}")
    assert not props.found_here(settings.subjects)
    press("label")
    assert props.is_opened(settings)
    assert settings.subjects.found == "gait15"
    assert "'Label Again'" not in drawn_in_take(monkeypatch)
    state.unfolded = True
    press("label")
    assert "'Label Again'" in drawn_in_take(monkeypatch), "somebody who unfolded it may want to try on"


def test_an_own_set_that_was_found_can_be_trained_on(settings, tmp_path):
    layout = MagicMock()
    settings.subjects.found = shutil.copy(markerset_file("gait15"), tmp_path / f"house{SUFFIX}").as_posix()
    ours("ui.advanced")._draw_training(layout, bpy.context)
    assert "Train the Chosen One On" in str(layout.mock_calls)


def test_why_no_set_was_found_is_told_in_the_card(settings, tmp_path, monkeypatch):
    state = session()
    write_c3d(tmp_path / "three.c3d", standing(np.eye(3)))
    opened(tmp_path, "three.c3d")
    press("find_markerset")
    assert "none of the" in state.unsure
    assert "under Marker Set, or one that is trained" in state.unsure
    refused("none of the", "label")
    assert "none of the" in state.unsure, "it is still told, after the button was pressed"
    assert "learn_file" not in drawn_in_take(monkeypatch)
    settings.source.named = 3
    assert "learn_file" in drawn_in_take(monkeypatch)
    write_c3d(tmp_path / "other.c3d", standing(drawn("body39")))
    opened(tmp_path, "other.c3d")
    assert not state.unsure


def test_a_take_that_was_opened_while_something_went_on_is_looked_at_after_it(settings, tmp_path, monkeypatch):
    importing, state = ours("ops.importing"), session()
    write_c3d(tmp_path / "one.c3d", standing(drawn("body39")))
    opened(tmp_path, "one.c3d")
    bpy_there, find = MagicMock(wraps=bpy), MagicMock()
    bpy_there.context, bpy_there.app.background, bpy_there.ops.mocap_autolabel.find_markerset = bpy.context, False, find
    monkeypatch.setattr(importing, "bpy", bpy_there)
    state.doing = "Labelling: 3%"
    importing.look_who_is_there(bpy.context)
    bpy_there.app.timers.is_registered.assert_called_with(importing.look_when_free)
    assert importing.look_when_free() == importing.LOOK_AGAIN
    state.doing = ""
    assert importing.look_when_free() is None
    find.assert_called_once_with("INVOKE_DEFAULT")


def test_blobs_come_with_their_calibration_and_a_marker_set_in_one_go_or_as_their_folder(settings, room, monkeypatch):
    opened(room.folder, "walk.csv", "room.toml", f"small{SUFFIX}")
    assert settings.source.blobs_path == room.blobs
    assert len(settings.source.cameras.objects) == 4
    assert settings.subjects.markerset_path == room.markerset
    settings.source.cameras, importing = None, ours("ops.importing")
    reads = MagicMock(wraps=importing.read_cameras)
    monkeypatch.setattr(importing, "read_cameras", reads)
    opened(room.folder)
    assert settings.source.blobs_path == room.blobs
    assert len(settings.source.cameras.objects) == 4
    assert len([one for one in reads.call_args_list if str(one.args[0]) == room.cameras]) == 1


def test_a_folder_of_several_takes_is_label_folders(settings, room, tmp_path):
    for name in ("one.c3d", "two.c3d"):
        write_c3d(tmp_path / name, standing(drawn("gait15")))
    opened(tmp_path)
    assert (settings.folder.path, settings.folder.out) == (str(tmp_path), str(tmp_path / "labelled"))
    assert not settings.source.points_path
    opened(tmp_path, "one.c3d")
    assert settings.folder.path == str(tmp_path)
    settings.folder.out = "mine"
    opened(tmp_path)
    assert settings.folder.out == "mine"
    other = shutil.copytree(tmp_path, tmp_path / "other")
    opened(other)
    assert (settings.folder.path, settings.folder.out) == (str(other), str(other / "labelled"))


def test_a_calibration_beside_points_is_not_looked_at_and_that_is_said(settings, room, tmp_path, capfd):
    write_c3d(tmp_path / "one.c3d", standing(drawn("gait15")))
    (tmp_path / "notes.txt").write_text("no calibration")
    opened(tmp_path)
    shutil.copy(room.cameras, tmp_path / "room.toml")
    opened(tmp_path, "room.toml")
    opened(tmp_path, "one.c3d")
    words = "the calibration is not looked at for 3D points"
    assert words not in capfd.readouterr().out
    opened(tmp_path, "one.c3d", "room.toml")
    assert words in capfd.readouterr().out
    shutil.copy(tmp_path / "one.c3d", tmp_path / "two.c3d")
    opened(tmp_path)
    assert words in capfd.readouterr().out
    shutil.copy(room.blobs, tmp_path / "walk.csv")
    opened(tmp_path)
    assert words not in capfd.readouterr().out


def test_what_is_none_of_these_is_one_sentence(settings, room, tmp_path):
    (tmp_path / "notes.docx").write_text("no take")
    (tmp_path / "cam1.mp4").write_bytes(b"")
    refused(r"notes\.docx: is of a kind that is not known \(\.docx\); expected 3D points", "import_take",
            filepath=tmp_path / "notes.docx")  # fmt: skip
    refused("cam1.mp4: holds pictures, which need the calibration", "import_take", filepath=tmp_path / "cam1.mp4")
    (tmp_path / "cam1.mp4").unlink()
    refused("holds no take; expected 3D points", "import_take", directory=tmp_path)
    write_c3d(tmp_path / "one.c3d", standing(drawn("gait15")))
    write_c3d(tmp_path / "two.c3d", standing(drawn("gait15")))
    files = [{"name": "one.c3d"}, {"name": "two.c3d"}]
    refused("2 takes are chosen; expected one", "import_take", directory=tmp_path, files=files)
    refused("need the calibration of their cameras; expected that to be opened", "import_take", filepath=room.blobs)
    (tmp_path / "empty.csv").touch()
    refused(r"empty\.csv: is empty; expected a blob file", "import_take", filepath=tmp_path / "empty.csv")
    press("import_cameras", filepath=room.cameras)
    (tmp_path / "nobody.mp4").write_bytes(b"")
    refused("nobody", "import_take", filepath=tmp_path / "nobody.mp4")
