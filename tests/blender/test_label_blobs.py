# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs named through cameras in Blender: what is named in two is in space at once, and stays so from then on."""

from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.data.takes import BY_EDIT, NO_MARKER, NO_STEP
from addon.core.edits.kinds import DeleteBlob, UnlabelBlob
from addon.io.edits import read_edits
from addon.io.points import read_points

from .conftest import open_room, rows_of_export, write_room
from .hands import bones, choose, keys_of, ours, picked, press, refused, reopen, session, shown, stored_take

FRAMES, LOST = 30, "CLAV"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return write_room(tmp_path_factory.mktemp("blobs"), FRAMES, lens=-0.05)


@pytest.fixture
def labelled(extension, empty, files, made, monkeypatch):
    """The take in a scene, labelled by a naming that knows all markers but one."""
    pipeline = ours("core.pipelines.blobs")
    takes = ours("core.data.takes")
    lost = files.names.index(LOST)

    def label_take(chunks, cameras, markerset, rate, options, occlusion=None, edits=()):
        for blobs in chunks:
            rows = np.isin(files.motion.frames[files.seen.frame], blobs.frames)
            marker = np.where(files.truth.marker[rows] == lost, NO_MARKER, files.truth.marker[rows])
            step = np.where(marker == NO_MARKER, NO_STEP, files.truth.step[rows])
            part = np.isin(files.motion.frames, blobs.frames)
            motion = takes.Motion(*(getattr(files.motion, name)[part].copy() for name in vars(files.motion)))
            motion.markers[:, lost] = np.nan
            yield takes.LabelledChunk(takes.Labels(marker, step, np.where(marker == NO_MARKER, 0, 0.9)), motion)

    monkeypatch.setattr(pipeline, "label_take", label_take)
    (files.folder / "walk.edits.json").unlink(missing_ok=True)
    open_room(files)
    empty.scene.mocap_autolabel.labelling.occlusion = "capsules"
    press("label")
    empty.scene.frame_set(115)
    return empty


def row_of(files, name: str, camera: int, frame: int = 115) -> int:
    own = (files.truth.marker == files.names.index(name)) & (files.seen.camera == camera)
    return int(np.flatnonzero(own & (files.seen.frame == frame - 101))[0])


def cameras_that_see(files, name: str) -> list[int]:
    own = (files.truth.marker == files.names.index(name)) & (files.seen.frame == 115 - 101)
    return files.seen.camera[own].tolist()


def name_in_two(files, scope: str = "FRAME"):
    for camera in cameras_that_see(files, LOST)[:2]:
        press("pick", point=row_of(files, LOST, camera))
        press("name_point", marker=LOST, scope=scope)


@pytest.mark.parametrize(("most", "foreseen"), [(29, 1e9), (59, 1)])
def test_a_take_whose_keys_would_fill_the_memory_is_refused_as_soon_as_that_is_known(
    labelled, files, extension, monkeypatch, most, foreseen
):
    """Once it has so many frames, or half of the file has shown twice as many."""
    poses, jobs = map(ours, ("io.poses", "jobs.blobs"))
    keys = 3 * len(files.names) + 7 * files.motion.joints.shape[1]
    for name, value in (("MOST_SHOWN", most * keys), ("FORESEEN_FROM", 30), ("FORESEEN", foreseen)):
        monkeypatch.setattr(poses, name, value)
    read = jobs.read_blobs
    half = (lambda *given: (replace(rows, fraction=0.5) for rows in read(*given))) if foreseen == 1 else read
    monkeypatch.setattr(jobs, "read_blobs", half)
    before = labelled.scene.mocap_autolabel.take
    refused(r"walk\.csv: has .* frames, whose keys .*Label Folder", "label")
    assert labelled.scene.mocap_autolabel.take == before


def test_a_marker_that_is_named_in_two_cameras_is_in_space_at_once(labelled, files):
    first, second = cameras_that_see(files, LOST)[:2]
    press("pick", point=row_of(files, LOST, first))
    press("name_point", marker=LOST, scope="FRAME")
    assert len(keys_of(LOST)) == 0, "one camera makes a ray, no point"
    press("pick", point=row_of(files, LOST, second))
    press("name_point", marker=LOST, scope="FRAME")
    [key] = keys_of(LOST)
    truth = files.motion.expected[14, files.names.index(LOST)]
    assert key[0] == 115
    np.testing.assert_allclose(key[1:], truth, atol=1e-4)
    np.testing.assert_allclose(shown()[LOST].matrix_world.translation, truth, atol=1e-4)
    words = [row.name for row in session().corrections]
    assert len(words) == 2 and all("CLAV is the blob at" in one and one.endswith("frame 115") for one in words)
    assert (stored_take().labels.step == BY_EDIT).sum() == 2
    press("export_c3d", filepath=files.folder / "ours.c3d")
    take = read_points(files.folder / "ours.c3d")
    assert np.flatnonzero(np.isfinite(take.xyz[:, take.names.index(LOST)][:, 0])).tolist() == [14]
    assert sum(row[4:6] == [LOST, "edit"] for row in rows_of_export(files.folder / "ours.labels.csv")) == 2


def test_a_name_holds_along_the_track_of_the_blob(labelled, files):
    name_in_two(files, "WHOLE")
    keys = keys_of(LOST)
    assert len(keys) > 6
    truth = files.motion.expected[keys[:, 0].astype(int) - 101, files.names.index(LOST)]
    np.testing.assert_allclose(keys[:, 1:], truth, atol=1e-3)
    assert (files.truth.marker[stored_take().labels.step == BY_EDIT] == files.names.index(LOST)).all()
    for scope, wanted in (("ON", slice(14, None)), ("BACK", slice(None, 15))):
        press("clear_corrections")
        name_in_two(files, scope)
        frames = keys_of(LOST)[:, 0].astype(int) - 101
        assert set(frames) <= set(np.arange(FRAMES)[wanted].tolist())
        assert 14 in frames


def test_what_is_said_of_blobs_is_kept_over_save_undo_and_relabelling(labelled, files, extension, tmp_path):
    name_in_two(files)
    place = keys_of(LOST)[0]
    reopen(tmp_path / "take.blend")
    # What the sidebar and the exports go by was read while the file was being opened.
    np.testing.assert_allclose(stored_take().motion.markers[14, files.names.index(LOST)], place[1:], atol=1e-5)
    press("label")
    np.testing.assert_allclose(keys_of(LOST), [place], atol=1e-4)
    assert len(stored_take().edits) == 2
    press("remove_correction", index=1)
    assert len(keys_of(LOST)) == 0, "without it the marker is gone, also from a take that was labelled with it"
    bpy.context.scene.frame_set(115)
    press("pick", point=row_of(files, "C7", 0))
    before = keys_of("C7")
    press("unlabel", scope="FRAME")
    press("remove_correction", index=1)
    np.testing.assert_allclose(keys_of("C7"), before, atol=2e-4)


def test_blobs_are_picked_along_their_tracks_lose_their_names_swap_and_are_none(labelled, files):
    module, scene = ours("ops.picking"), labelled.scene
    press("pick", point=row_of(files, "LANK", 2))
    for frame in (116, 114):
        scene.frame_set(frame)
        assert module.picked_points(bpy.context) == [row_of(files, "LANK", 2, frame)]
    scene.frame_set(200)
    assert module.picked_points(bpy.context) == []
    scene.frame_set(116)
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, 120, 125
    refused("the blob is of frame 116", "name_point", marker="LKNE", scope="RANGE")
    scene.frame_set(115)
    row, other = row_of(files, "LANK", 2), row_of(files, "LKNE", 2)
    press("pick", point=row)
    assert [item.name for item in bpy.context.selected_objects] == ["LANK"]
    press("pick", point=other, mode="TOGGLE")
    assert picked() == [row, other]
    refused("2 blobs of cam 2 are picked; expected one of each camera", "name_point", marker="C7", scope="FRAME")
    press("swap_markers", scope="FRAME")
    labels = stored_take().labels.marker
    assert (files.names[labels[row]], files.names[labels[other]]) == ("LKNE", "LANK")
    press("clear_corrections")
    press("pick", point=row)
    press("unlabel", scope="FRAME")
    press("pick", point=other)
    press("no_marker", scope="FRAME")
    labels = stored_take().labels.marker
    assert (labels[[row, other]] == NO_MARKER).all()
    press("save_corrections")
    assert [type(edit) for edit in read_edits(files.folder / "walk.edits.json")] == [UnlabelBlob, DeleteBlob]


def test_the_lost_marker_is_the_likeliest_for_its_blob(labelled, files, extension):
    dots = ours("scene.blob_dots")
    opened = ours("scene.opened").opened
    scene = labelled.scene
    stored, tracks = stored_take(), opened.tracks(scene.mocap_autolabel.take, scene)
    row = row_of(files, LOST, cameras_that_see(files, LOST)[0])
    assert stored.names[dots.likely_of_blob(stored, tracks, row)[0]] == LOST
    camera = int(files.seen.camera[row])
    assert np.flatnonzero(dots.asked_in_image(stored, 14, camera)).tolist() == [files.names.index(LOST)]
    origin, direction = dots.ray_of(stored, row)
    truth = files.motion.expected[14, files.names.index(LOST)]
    off = np.linalg.norm(np.cross(truth - origin, direction / np.linalg.norm(direction)))
    assert off < 1e-3, "a marker lies on its blob's ray, the lens taken out"


def test_who_looks_through_a_camera_points_at_its_blobs(labelled, files, extension):
    """Each of them lies where the picture has it, the lens taken out, and is what a pointer beside it means."""
    module = ours("ops.picking")
    scene, size = labelled.scene, (656, 491)
    camera = scene.mocap_autolabel.source.cameras.objects[1]
    press("look_through", camera=camera.name)
    pixel = {"scale_x": scene.render.pixel_aspect_x, "scale_y": scene.render.pixel_aspect_y}
    lens = camera.calc_matrix_camera(labelled.evaluated_depsgraph_get(), x=size[0], y=size[1], **pixel)
    matrix = lens @ camera.matrix_world.normalized().inverted()
    view = SimpleNamespace(view_perspective="CAMERA", perspective_matrix=matrix)
    space = SimpleNamespace(region_3d=view, use_local_camera=False, camera=camera)
    region = SimpleNamespace(type="WINDOW", width=size[0], height=size[1])
    area = SimpleNamespace(regions=[region], spaces=SimpleNamespace(active=space))
    stored = stored_take()
    dots, places = module.dots_in_view(labelled, stored, area)
    assert dots.trajectory.tolist() == np.flatnonzero((files.seen.frame == 14) & (files.seen.camera == 1)).tolist()
    seen = files.room.undistort(files.seen.xy[dots.trajectory], files.seen.camera[dots.trajectory])
    x, y = files.room.matrix[1, :2] @ np.column_stack([seen, np.ones(len(places))]).T
    np.testing.assert_allclose(places, np.column_stack([x, size[1] - y]), atol=0.1)
    preferences = SimpleNamespace(system=SimpleNamespace(ui_scale=1.0))
    context = SimpleNamespace(scene=scene, view_layer=labelled.view_layer, preferences=preferences)
    assert [module.dot_at(context, stored, area, place + 0.4)[1] for place in places] == list(range(len(places)))
    assert module.dot_at(context, stored, area, (-50, -50))[1] is None
    labelled.view_layer.layer_collection.children[scene.mocap_autolabel.take.name].exclude = True
    nothing = {module.dot_at(context, stored, area, place)[1] for place in places}
    assert nothing == {None}, "who sees it not picks it not"


def test_markers_of_blobs_are_placed_and_answered(labelled, files):
    press("place_marker", marker=LOST, location=(0.1, 0.2, 0.5))
    [key] = keys_of(LOST)
    np.testing.assert_allclose(key, (115, 0.1, 0.2, 0.5), atol=1e-6)
    choose("C7")
    press("is_right", scope="WHOLE")
    choose("LANK")
    press("unlabel", scope="FRAME")
    assert 115 not in keys_of("LANK")[:, 0]
    edits = stored_take().edits
    assert [type(edit).__name__ for edit in edits.items[:2]] == ["Place", "Right"]
    name_in_two(files)
    np.testing.assert_allclose(keys_of(LOST)[0, 1:], files.motion.expected[14, files.names.index(LOST)], atol=1e-4)
    assert type(stored_take().edits[-1]).__name__ == "AssignBlob"


def test_the_body_follows_where_the_labels_are_others(labelled):
    """Elsewhere it rests on rays, which labelling alone follows; only its size is that of all frames."""
    before, kept = bones(), stored_take().motion.joints[:14]
    choose("LWRA", "LKNE")
    press("swap_markers", scope="ON")
    now = bones()
    np.testing.assert_array_equal(stored_take().motion.joints[:14], kept)
    np.testing.assert_allclose(now[:14, :, :3, 3], before[:14, :, :3, 3], atol=0.02)
    assert np.abs(now[14:] - before[14:]).max() > 0.1
    press("remove_correction", index=0)
    assert np.median(np.abs(bones()[14:, :, :3, 3] - before[14:, :, :3, 3])) < 0.01
