# SPDX-License-Identifier: GPL-3.0-or-later
"""Several performers in a scene: each with a collection, an armature, a body, markers and a colour of their own."""

import shutil
from dataclasses import replace

import bpy
import numpy as np
import pytest
from mathutils import Color

from addon.cli import main as command
from addon.core.data.takes import Motion
from addon.core.points.models import Model
from addon.core.posing.finer import finer
from addon.io.markersets import markerset_file, open_markerset
from addon.io.models import write_model
from addon.io.points import read_points, write_c3d
from addon.scene import naming, performers
from addon.scene import take as takes
from addon.scene.armature import SCALE
from addon.scene.opened import Opened
from addon.scene.relabelled import show_again
from tests.core.pipelines.test_known_sets import drawn, standing
from tests.inputs.walkers import FIRST, FRAMES, RATE, WORN, write_pair, write_seen

from .hands import choose, list_performers, only, ours, press, refused, reopen, session, shown, stored_take


def test_each_has_a_collection_with_all_that_is_theirs(empty, made):
    take = made.pair()
    collection = takes.show_take(empty, take)
    homes = performers.homes(collection)
    assert [home.name for home in homes.values()] == ["ann", "bob"]
    motion, count = take.motion, len(made.markerset())
    for number, (name, home) in enumerate(homes.items()):
        [armature] = only(home, "ARMATURE")
        assert armature.name == f"{name} armature"
        assert list(armature[SCALE]) == pytest.approx([1.6 * 1.1**number] * 3)
        assert [item[naming.MARKER] for item in only(home, "EMPTY")] == [
            f"{name}:{marker}" for marker in made.markerset().markers
        ]
        assert len(only(home, "MESH")) == len(made.markerset().capsules)
        for frame in (101, 115):
            empty.scene.frame_set(frame)
            joints = motion.joints[frame - 101, number * len(armature.pose.bones) :]
            heads = np.array([armature.pose.bones[segment].head for segment in made.markerset().skeleton.segments])
            np.testing.assert_allclose(heads, joints[: len(heads)], atol=1e-5)
            places = np.array([item.matrix_world.translation for item in only(home, "EMPTY")])
            seen = motion.markers[frame - 101, number * count : (number + 1) * count]
            there = np.isfinite(seen[:, 0])
            np.testing.assert_allclose(places[there], seen[there], atol=1e-5)
    colours = performers.colours_in(collection)
    assert colours["ann"] != colours["bob"]
    for name, home in homes.items():
        materials = {item.data.materials[0] for item in only(home, "MESH")}
        seen = [tuple(Color(one.diffuse_color[:3]).from_scene_linear_to_srgb()) for one in materials]
        assert seen == [pytest.approx(colours[name], abs=1e-4)]


def test_the_marker_set_that_automatic_finds_is_told_and_used_until_another_take_is_opened(settings, tmp_path):
    write_c3d(tmp_path / "one.c3d", standing(drawn("body39")))
    press("import_points", filepath=tmp_path / "one.c3d")
    refused("Automatic finds what a take of one performer shows", "edit_markerset")
    settings.subjects.performing = "SO_MANY"
    refused("Automatic finds what a take of one performer shows", "label")
    refused("Automatic finds what a take of one performer shows", "label", everybody=True)
    assert settings.subjects.performing == "SO_MANY"
    press("find_markerset")
    assert settings.subjects.found == "body39"
    settings.subjects.found, settings.subjects.performing = "", "ONE"
    press("label")
    assert settings.subjects.markerset == "auto"
    assert settings.subjects.found == "body39"
    press("edit_markerset")
    own = tmp_path / "mine.markerset.json"
    press("save_markerset", filepath=own)
    assert own.exists()
    settings.subjects.markerset = "auto"
    press("add_performer")
    assert settings.subjects.performers[0].markerset == "body39"
    press("import_points", filepath=tmp_path / "one.c3d")
    assert not settings.subjects.found


def test_two_are_seen_before_anything_is_labelled_and_labelled_by_the_button_that_is_offered(settings, tmp_path):
    state, both = session(), np.concatenate([drawn("body39"), drawn("body39", 1) + np.array([2, 0, 0])])
    write_c3d(tmp_path / "two.c3d", standing(both))
    press("import_take", filepath=tmp_path / "two.c3d")
    press("find_markerset")
    assert settings.subjects.found == "body39"
    assert ours("ui.panels").crowded_here(state, settings)
    settings.subjects.found = ""  # as by undo
    press("label", everybody=True)
    assert list(performers.homes(settings.take)) == ["1", "2"]


def test_two_where_one_is_asked_for_are_labelled_by_the_button_that_is_offered(seen):
    settings, state, panels = seen, session(), ours("ui.panels")
    settings.subjects.performing = "ONE"
    assert not panels.crowded_here(state, settings)
    with pytest.raises(RuntimeError, match=r"two subjects or more.*by Label All Performers, or by How Many") as caught:
        press("label")
    assert "--" not in str(caught.value)
    assert panels.crowded_here(state, settings)
    press("label", everybody=True)
    assert list(performers.homes(settings.take)) == ["1", "2"]
    assert settings.subjects.performing == "AUTO"
    assert not panels.crowded_here(state, settings)


def test_a_colour_is_the_bodys_and_of_all_that_is_drawn_also_when_labelled_again(empty, made):
    take = made.pair()
    collection = takes.show_take(empty, take)
    stored = Opened().take(collection, empty.scene)
    performers.set_colour(collection, "bob", (0.1, 0.2, 0.3))
    performers.set_colour(collection, "nobody", (0, 0, 0))
    drawn = performers.marker_colours(collection, stored.performers, len(stored.names))
    count = len(made.markerset())
    np.testing.assert_allclose(drawn[count:], np.tile([0.1, 0.2, 0.3], (count, 1)), atol=1e-4)
    assert not np.allclose(drawn[:count], drawn[count:])
    after = show_again(empty, take, whole=True)
    assert takes.takes_of(empty.scene) == [after]
    assert performers.colours_in(after)["bob"] == pytest.approx((0.1, 0.2, 0.3), abs=1e-4)
    assert [child.name for child in after.children] == ["ann", "bob"]
    alone = takes.show_take(empty, made.take())
    assert performers.marker_colours(alone, Opened().take(alone, empty.scene).performers, 18) is None


def test_the_file_keeps_who_is_who(empty, made, tmp_path):
    take = made.pair()
    takes.show_take(empty, take)
    reopen(tmp_path / "duet.blend")
    [collection] = takes.takes_of(bpy.context.scene)
    stored = Opened().take(collection, bpy.context.scene)
    assert stored.names == take.markerset.markers
    assert stored.performers == performers.performers_of(take.markerset)
    assert [stored.segments[one.joint_rows] for one in stored.performers] == [made.markerset().skeleton.segments] * 2
    above = np.array(stored.parents)
    assert (above[13:] == np.where(above[:13] < 0, -1, above[:13] + 13)).all()
    for field in ("markers", "joints", "scale", "expected"):
        np.testing.assert_allclose(getattr(stored.motion, field), getattr(take.motion, field), atol=1e-5)
    assert [one.reason for one in stored.suspects] == [one.reason for one in take.suspects]
    assert list(performers.colours_in(collection)) == ["ann", "bob"]


def test_one_performer_has_no_name(empty, made):
    collection = takes.show_take(empty, made.take())
    assert not performers.homes(collection)
    stored = Opened().take(collection, empty.scene)
    [only] = stored.performers
    assert (only.name, only.model, only.marker_rows, only.joint_rows) == ("", "toy", slice(0, 18), slice(0, 13))
    own = only.motion_of(stored.motion)
    for field in Motion.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(own, field), getattr(stored.motion, field))


def test_a_range_is_put_into_a_take_whose_bodies_had_other_joints(empty, made):
    markerset = open_markerset("body39")
    more = finer(markerset)
    assert not np.array_equal(more.attachment, markerset.attachment)
    old, whole = with_range(empty, made, markerset, more)
    found = np.isfinite(old.joints).all(axis=(1, 2))
    assert found.any()
    np.testing.assert_array_equal(np.isfinite(whole.joints).all(axis=(1, 2)), found)


def with_range(context, made, before, after) -> tuple[Motion, Motion]:
    """The motion of a take of two in a set, and after frames in which nothing is seen were labelled in another set."""
    old, new = (made.pair(markerset=one) for one in (before, after))
    takes.show_take(context, old)
    motion = Motion(*(getattr(new.motion, field)[5:9] for field in Motion.__dataclass_fields__))
    rows = replace(new.rows, frames=motion.frames, frame=new.rows.frame[:0], trajectory=new.rows.trajectory[:0])
    rows = replace(rows, xyz=new.rows.xyz[:0], residual=new.rows.residual[:0])
    again = show_again(context, replace(new, rows=rows, labels=new.labels[:0], motion=motion, suspects=()), whole=False)
    assert takes.takes_of(context.scene) == [again]
    assert not again.hide_viewport
    whole = Opened().take(again, context.scene).motion
    assert whole.frames.tolist() == old.motion.frames.tolist()
    return old.motion, whole


@pytest.fixture
def imported(settings, tmp_path):
    """A scene with the points of two people who walk, and the marker set that both wear."""
    write_pair(tmp_path)
    press("import_points", filepath=tmp_path / "pair.c3d")
    settings.subjects.markerset = WORN
    return settings


@pytest.fixture(params=["points", "blobs"])
def seen(request, settings, tmp_path):
    """The same, or the blobs of the two."""
    write_seen(tmp_path)
    if request.param == "points":
        press("import_points", filepath=tmp_path / "pair.c3d")
    else:
        press("import_cameras", filepath=tmp_path / "room.toml")
        press("import_blobs", filepath=tmp_path / "seen.csv")
    settings.subjects.markerset, settings.source.rate = WORN, RATE
    return settings


@pytest.mark.parametrize("performing", ["SO_MANY", "AUTO"])
def test_as_many_are_named_as_are_asked_for(imported, performing, tmp_path):
    """And what the command line writes and saves is the same."""
    imported.subjects.performing = performing
    press("label")
    markers = open_markerset(WORN).markers
    assert set(shown()) == {f"{number}:{name}" for number in (1, 2) for name in markers}
    assert {row.name for row in session().markers} == set(shown())
    press("jump", frame=20, marker="2:LASI")
    assert [item[naming.MARKER] for item in bpy.context.selected_objects] == ["2:LASI"]
    press("export_labels", filepath=tmp_path / "own.labels.csv")
    words = "label", tmp_path / "pair.c3d", "--model", WORN, "--subjects", "2", "--blend", "--out", tmp_path / "out"
    assert command([str(word) for word in words]) == 0
    assert (tmp_path / "own.labels.csv").read_bytes() == (tmp_path / "out" / "pair.labels.csv").read_bytes()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out" / "pair.blend"))
    [collection] = takes.takes_of(bpy.context.scene)
    stored = stored_take()
    assert [one.name for one in stored.performers] == ["1", "2"]
    for home in performers.homes(collection).values():
        [armature] = only(home, "ARMATURE")
        assert armature.animation_data.action is not None
        assert np.isfinite(list(armature[SCALE])).all()
    written = read_points(tmp_path / "out" / "pair.c3d")
    assert written.names[:30] == stored.names
    np.testing.assert_allclose(written.xyz[:, :30], stored.motion.markers, atol=1e-5)


def test_the_list_says_who_wears_what(imported, extension, monkeypatch, tmp_path):
    pipeline = ours("core.points.several.pipeline")
    # Whose body is whose a model says that was learned from the person's own take, which this set was not.
    monkeypatch.setattr(pipeline, "identified", lambda cost, _: (list(range(cost.shape[1])), np.inf))
    asked = ours("props").subjects_asked
    imported.subjects.performing = "LISTED"
    refused("nobody is in the list", "label")
    own = tmp_path / "ann.markerset.json"
    shutil.copy(markerset_file(WORN), own)
    press("add_performer")
    press("open_markerset", filepath=own)
    press("add_performer")
    first, second = imported.subjects.performers
    assert (first.name, second.name) == ("performer1", "ann")
    assert tuple(first.colour) != tuple(second.colour)
    assert asked(imported.subjects)["wearers"] == (("performer1", WORN), ("ann", str(own)))
    second.name = "ren\u00e9"
    alike = (("Ren\u00e9", "same name"), ("rene\u0301", "same name"))
    for name, reason in (*alike, *((name, "no name of a performer") for name in ("a b", "", "a\x7f", "a\u202eb"))):
        first.name = name
        refused(reason, "label")
    second.name = "ann"
    imported.subjects.performer_index = 0
    press("remove_performer")
    assert [row.name for row in imported.subjects.performers] == ["ann"]
    press("label")
    assert {name.split(":")[0] for name in shown()} == {"ann"}
    imported.subjects.performers[0].colour = (0.25, 0.5, 0.75)
    assert performers.colours_in(imported.take)["ann"] == pytest.approx((0.25, 0.5, 0.75), abs=1e-4)


def test_keys_of_two_that_would_fill_the_memory_are_refused_before_anybody_is_named_and_a_part_is_not(
    seen, monkeypatch
):
    """Though those of one would not."""
    worn, labelling, seen.subjects.performing = open_markerset(WORN), seen.labelling, "SO_MANY"
    poses, pipeline = map(ours, ("io.poses", "core.points.several.pipeline"))
    monkeypatch.setattr(poses, "MOST_SHOWN", FRAMES * (3 * len(worn) + 7 * len(worn.skeleton)) * 3 // 2)
    with monkeypatch.context() as patch:
        patch.setattr(pipeline, "cut", lambda *_, **__: pytest.fail("it was begun"))
        refused(f"has {FRAMES} frames, whose keys .* expected at most 30: choose a part .* Label Folder", "label")
    assert seen.take is None
    labelling.use_range, labelling.range_first, labelling.range_last = True, FIRST, FIRST + 19
    press("label")


@pytest.fixture
def duet(extension, empty, settings, made):
    """A labelled take of ann and bob in the scene, as the extension's operators know it."""
    collection = takes.show_take(empty, made.pair())
    settings.take = collection
    empty.scene.frame_set(115)
    return settings


def test_gaps_are_filled_by_each_ones_own_markers(duet, made, tmp_path):
    """The marker set of each is the one that stands for the name in the list."""
    write_model(tmp_path / "toy.markerset.json", Model(made.markerset()))
    list_performers(tmp_path, "ann", "bob")
    gap = slice(20 // 3, 20 // 2)
    there = np.isfinite(stored_take().motion.markers[gap, :, 0]).all(axis=0)
    missing = [stored_take().names[place] for place in np.flatnonzero(~there)]
    assert missing == ["ann:RASI", "bob:RASI"]
    duet.filling.method = "body"
    press("fill_gaps", extent="TAKE")
    filled = stored_take()
    assert {fill.marker for fill in filled.fitting} >= set(missing)
    for name in missing:
        place = filled.names.index(name)
        off = filled.motion.markers[gap, place] - filled.motion.expected[gap, place]
        assert np.linalg.norm(off, axis=1).max() < 0.01


def test_they_are_written_together_and_each_alone(duet, made, tmp_path):
    markers, take = made.markerset().markers, stored_take()
    press("export_c3d", filepath=tmp_path / "duet.c3d")
    assert read_points(tmp_path / "duet.c3d").names[:36] == take.names
    words = {"filepath": str(tmp_path / "duet.trc"), "performer": ":APART"}
    press("export_trc", **words)
    for number, name in enumerate(("ann", "bob")):
        own = read_points(tmp_path / f"duet {name}.trc")
        assert own.names == markers
        np.testing.assert_allclose(own.xyz[:], take.motion.markers[:, 18 * number : 18 * number + 18], atol=1e-5)
    refused(r"duet ann\.trc", "export_trc", **words)  # which nobody was asked about
    for _ in range(2):
        press("export_c3d", filepath=tmp_path / "b.c3d", performer="bob")
    alone = read_points(tmp_path / "b.c3d")
    assert alone.names == markers
    np.testing.assert_allclose(alone.xyz[:], take.motion.markers[:, 18:], atol=1e-5)


def test_each_has_a_character(empty, settings, made, tmp_path):
    take = made.pair(markerset=open_markerset("body26"))
    settings.take = takes.show_take(empty, take)
    press("add_character")
    joint = take.markerset.worn[0][1].skeleton.segments.index("thigh.L")
    empty.scene.frame_set(115)
    for number, (name, home) in enumerate(performers.homes(settings.take).items()):
        [character] = [item for item in only(home, "ARMATURE") if SCALE not in item]
        assert character.name == f"duet {name} character"
        seen = take.motion.joints[14, joint + number * take.motion.joints.shape[1] // 2]
        np.testing.assert_allclose(character.pose.bones["LeftUpLeg"].head, seen, atol=1e-3)
    assert [name for name, _ in performers.armatures_of(settings.take)] == ["ann", "bob"], "what is drawn as the figure"
    press("export_bvh", filepath=tmp_path / "duet.bvh")
    assert sorted(path.name for path in tmp_path.glob("*.bvh")) == ["duet ann.bvh", "duet bob.bvh"]
    press("export_bvh", filepath=tmp_path / "b.bvh", performer="bob")
    assert (tmp_path / "b.bvh").read_bytes() == (tmp_path / "duet bob.bvh").read_bytes()


def follows(name: str, trajectory: int):
    """Asserts that a marker is that trajectory in all frames, in the take and in the view."""
    take = stored_take()
    rows = np.flatnonzero(take.labels.marker == take.names.index(name))
    assert set(take.rows.trajectory[rows].tolist()) == {trajectory}
    here = rows[take.rows.frames[take.rows.frame[rows]] == bpy.context.scene.frame_current]
    np.testing.assert_allclose(shown()[name].matrix_world.translation, take.rows.xyz[here[0]], atol=1e-5)


def test_a_trajectory_is_named_as_whoevers_it_is_and_what_was_that_is_given_back(duet):
    press("pick", point=36)  # the ghost
    press("name_point", marker="bob:LASI", scope="WHOLE")
    follows("bob:LASI", 36)
    follows("ann:LASI", 1)
    press("remove_correction", index=0)
    follows("bob:LASI", 19)
    press("pick", point=1)
    press("other_performer", scope="WHOLE")
    follows("bob:LASI", 1)
    follows("ann:LASI", 19)
    assert len(stored_take().edits) == 2
    press("clear_corrections")
    follows("ann:LASI", 1)


def test_selected_markers_are_exchanged_in_a_range_and_performers_whole(duet):
    choose("ann:LASI", "bob:LASI", "ann:SACR")
    press("other_performer", scope="ON")
    assert [edit.markers for edit in stored_take().edits] == [("ann:SACR", "bob:SACR"), ("ann:LASI", "bob:LASI")]
    rows, marker = stored_take().rows, stored_take().labels.marker
    for point, before, after in ((1, 1, 19), (19, 19, 1), (0, 0, 18), (2, 2, 2)):
        mine = rows.trajectory == point
        late = rows.frames[rows.frame[mine]] >= 115
        assert set(marker[mine][late]) == {after}
        assert set(marker[mine][~late]) == {before}
    press("clear_corrections")
    press("exchange_performers", one="ann", other="bob", scope="WHOLE")
    for marker in range(18):
        name = stored_take().names[marker].split(":")[1]
        follows(f"ann:{name}", 18 + marker)
        follows(f"bob:{name}", marker)


def test_what_cannot_be_said_of_whose_it_is_nor_learned_of_several(duet, extension, made):
    press("pick", point=36)
    refused("has no name", "other_performer")
    press("pick_none")
    refused("nothing is selected", "other_performer")
    choose("ann:LASI")
    refused("is ann's already", "other_performer", performer="ann")
    refused("expected two performers", "exchange_performers", one="ann", other="ann")
    assert not len(stored_take().edits)
    training = ours("ops.training")
    for operator in (training.learn_take, training.learn_frame):
        assert "several performers" in operator.lacks(bpy.context)
    duet.take = takes.show_take(bpy.context, made.take())
    assert not bpy.ops.mocap_autolabel.other_performer.poll()
    assert not bpy.ops.mocap_autolabel.exchange_performers.poll()
