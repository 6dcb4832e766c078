# SPDX-License-Identifier: GPL-3.0-or-later
"""Open Take, which takes anything, what is told of it before it is labelled, and Label Folder beside Blender."""

import shutil
import time
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest

from addon.core.pipelines.known_sets import HOW_TO_CHOOSE, HOW_TO_FIND, HOW_TO_TURN
from addon.core.points.possible import HOW_TO_MIRROR
from addon.core.points.refusals import HOW_TO_ASK
from addon.io.batch import read_table
from addon.io.markersets import SUFFIX, markerset_file
from addon.io.points import write_c3d
from addon.scene.take import is_take
from tests.core.pipelines.test_known_sets import drawn, standing

from .conftest import write_room
from .hands import ours, press, refused, session

MOST_PANELS = 8


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
    return str([*layout.mock_calls, *panels.draw_text.mock_calls])


def test_panels_are_few_and_a_person_sees_those_of_one_stage(shown):
    ui, shows, settings = ours("ui"), ours("ui.parts").shows, bpy.context.scene.mocap_autolabel
    modules = (*ui.PANEL_MODULES, ui.timeline, ui.quality)
    panels = {one for module in modules for one in vars(module).values() if isinstance(one, type)}
    panels = {one for one in panels if issubclass(one, bpy.types.Panel)}
    assert 4 <= len(panels) <= MOST_PANELS
    assert len([one for one in panels if not hasattr(one, "bl_parent_id")]) == 4
    take = settings.take
    for settings.take, settings.display.stage, seen in (
        (None, "REVIEW", []), (take, "REVIEW", ["REVIEW"]), (take, "USE", ["USE"])
    ):  # fmt: skip
        assert [stage for stage in ("REVIEW", "USE") if shows(bpy.context, stage)] == seen


def test_files_of_a_built_in_and_of_an_own_set_are_named_after_three_clicks(settings, tmp_path):
    """The button and that of the file browser, which call one operator, and Label; what is worn is found."""
    folder = ours("prefs").markerset_folder(create=True)
    own = shutil.copy(markerset_file("gait15"), folder / f"house{SUFFIX}")
    for name, found in (("body39", "body39"), ("gait15", str(own))):
        write_c3d(tmp_path / f"{name}.c3d", standing(drawn(name)))
        opened(tmp_path, f"{name}.c3d")
        press("find_markerset")  # which the window does by itself
        told = settings.subjects.found or session().likely[0].name
        assert told in (found, name)
        press("label")
        assert settings.take is not None
    own.unlink()


def test_sets_that_are_not_sure_are_offered_an_own_one_first_and_none_is_taken(settings, tmp_path, monkeypatch):
    state, own = session(), tmp_path / f"house{SUFFIX}"
    write_c3d(tmp_path / "one.c3d", standing(drawn("body39")))
    opened(tmp_path, "one.c3d")
    shutil.copy(markerset_file("body39"), own)

    def both(_take, models):
        yield from ()
        return None, list(models)

    monkeypatch.setattr(ours("core.pipelines.known_sets"), "set_worn", both)
    for known in (["body39"], ["body39", str(own)]):
        monkeypatch.setattr(ours("jobs.job"), "known_models", lambda _, known=known: known)
        press("find_markerset")
        assert [one.name for one in state.likely] == known[::-1]
        assert not settings.subjects.found
    assert ours("ui.panels").asks_which(state, settings), "Label waits for the answer"
    card = drawn_in_take(monkeypatch)
    assert "'Label as body39'" in card and "text='Label'" not in card, "no button is there that cannot be pressed"
    assert "'Plug-in Gait full body: 39 markers (body39)'" in card
    assert ("learn_file" in card) == (settings.source.named > 0)
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


def test_a_take_that_is_open_can_be_closed_and_what_is_labelled_stays(settings, tmp_path, monkeypatch):
    write_c3d(tmp_path / "body39.c3d", standing(drawn("body39")))
    opened(tmp_path, "body39.c3d")
    settings.subjects.markerset = "body39"
    press("label")
    labelled = settings.take
    assert "close_take" not in drawn_in_take(monkeypatch)
    opened(tmp_path, "body39.c3d")
    assert "close_take" in drawn_in_take(monkeypatch)
    preview = settings.source.preview.name
    press("close_take")
    assert preview not in bpy.data.objects and not settings.source.points_path
    assert list(ours("scene.take").takes_of(bpy.context.scene)) == [labelled]
    refused("No take is open", "close_take")


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
    card, teach = drawn_in_take(monkeypatch), ours("ui.panels").TEACH
    assert "learn_file" not in card and teach in card
    settings.source.named = 3
    card = drawn_in_take(monkeypatch)
    assert "learn_file" in card and teach not in card
    write_c3d(tmp_path / "other.c3d", standing(drawn("body39")))
    opened(tmp_path, "other.c3d")
    assert not state.unsure


def test_a_take_that_was_opened_while_something_went_on_is_looked_at_after_it(settings, tmp_path, monkeypatch):
    importing, state, later = ours("ops.importing"), session(), []
    write_c3d(tmp_path / "one.c3d", standing(drawn("body39")))
    opened(tmp_path, "one.c3d")
    bpy_there, find = MagicMock(wraps=bpy), MagicMock()
    bpy_there.context, bpy_there.app.background, bpy_there.ops.mocap_autolabel.find_markerset = bpy.context, False, find
    monkeypatch.setattr(importing, "bpy", bpy_there)
    monkeypatch.setattr(importing, "soon", lambda function, _: later.append(function))
    state.doing = "Labelling: 3%"
    importing.look_who_is_there(bpy.context)
    assert later == [importing.look_when_free]
    assert importing.look_when_free() == importing.LOOK_AGAIN
    state.doing = ""
    assert importing.look_when_free() is None
    find.assert_called_once_with("INVOKE_DEFAULT")


def test_blobs_come_with_their_calibration_and_a_marker_set_in_one_go_or_as_their_folder(settings, room, monkeypatch):
    opened(room.folder, "walk.csv", "room.toml", f"toy{SUFFIX}")
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
    refused("of their cameras; expected both to be opened at once", "import_take", filepath=room.blobs)
    (tmp_path / "empty.csv").touch()
    refused(r"empty\.csv: is empty; expected a blob file", "import_take", filepath=tmp_path / "empty.csv")
    press("import_cameras", filepath=room.cameras)
    (tmp_path / "nobody.mp4").write_bytes(b"")
    refused("nobody", "import_take", filepath=tmp_path / "nobody.mp4")


PATIENCE = 120.0  # s; a busy machine labels slowly


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """A calibration, a marker set, and a folder with a take of blobs and one that is none."""
    many = write_room(tmp_path_factory.mktemp("many"), 6)
    (many.folder / "in").mkdir()
    shutil.move(many.blobs, many.folder / "in")
    (many.folder / "in" / "bad.csv").write_text("no,blobs\n")
    return many.folder


@pytest.fixture
def ready(empty, settings, many, tmp_path):
    """A scene in which only the button is left to press."""
    press("import_cameras", filepath=many / "room.toml")
    press("open_markerset", filepath=many / "toy.markerset.json")
    settings.folder.path, settings.folder.out = str(many / "in"), str(tmp_path / "out")
    settings.source.rate = 60.0
    module = ours("ops.label_folder")
    yield SimpleNamespace(context=empty, settings=settings, module=module, out=tmp_path / "out")
    module.leave_batch()


def test_a_folder_is_labelled_and_its_takes_opened(ready):
    press("label_folder")
    rows = [(row.name, row.state, row.measured) for row in session().folder_takes]
    assert rows == [("bad", "failed", False), ("walk", "labelled", True)]
    assert "holds neither blobs nor 3D points" in session().folder_takes[0].reason
    assert (session().folder_doing, session().folder_trouble) == ("", "")
    assert (ready.out / "walk.report.html").is_file()
    refused("is not there; expected a take that Label Folder labelled", "open_folder_take", index=0)
    refused("no take is chosen", "open_folder_take", index=5)
    press("open_folder_take", index=1)
    assert is_take(bpy.context.scene.mocap_autolabel.take)
    assert [row.name for row in session().folder_takes] == ["bad", "walk"]


def test_a_folder_that_is_watched_goes_on_beside_blender_until_it_is_stopped(ready, many):
    settings, module = ready.settings, ready.module
    settings.folder.watch, settings.source.rate = True, 59.94
    line, table, blobs = module.folder_line(settings)
    assert blobs
    assert {"--target=0.999", "--rate=59.94"} <= {*line}
    assert "--idle=0" not in line
    batch = module.FolderBatch(
        line, table, module.scene_cameras.cameras_of(settings.source.cameras, ready.context.scene)
    )
    module._latest[:] = [batch]
    assert not bpy.ops.mocap_autolabel.label_folder.poll()
    until = time.monotonic() + PATIENCE
    while session().folder_doing != "2 of 2 takes, 1 failed":
        assert module.follow() == module.FOLLOWED_EVERY
        assert time.monotonic() < until
        time.sleep(0.05)
    assert session().folder_share == 1.0
    press("stop_folder")
    while module.follow() is not None:
        assert time.monotonic() < until
        time.sleep(0.05)
    assert (session().folder_doing, session().folder_trouble, module.follow()) == ("", "", None)
    assert [row.state for row in read_table(table)] == ["failed", "labelled"]
    assert bpy.ops.mocap_autolabel.label_folder.poll()


def test_what_can_be_done_about_a_take_is_told_as_in_the_sidebar(extension):
    told = {"take": "walk", "state": "failed", "at_stake": 0, "measured": False, "trouble": 0, "on_body": 0}
    reason = (
        f"expected one, {HOW_TO_CHOOSE} body39; {HOW_TO_FIND}; or {HOW_TO_TURN} y; or {HOW_TO_ASK}; or {HOW_TO_MIRROR}"
    )
    _, _, words, *_ = ours("ops.label_folder")._row(SimpleNamespace(**told, reason=reason, named=None, found=0.0))
    assert "--" not in words and "MODEL" not in words
    assert "under Marker Set, as body39" in words


def test_what_stops_a_folder_is_said(ready, many, tmp_path):
    settings = ready.settings
    settings.folder.path = ""
    assert not bpy.ops.mocap_autolabel.label_folder.poll()
    settings.folder.path = str(tmp_path / "none")
    refused("is no folder; expected one with takes", "label_folder")
    settings.folder.path = str(many / "in")
    ready.out.mkdir()
    shutil.copy(many / "in" / "walk.csv", ready.out / "summary.csv")
    refused("exists already", "label_folder")
    assert "exists already" in session().folder_trouble
