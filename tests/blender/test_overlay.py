# SPDX-License-Identifier: GPL-3.0-or-later
"""What the overlay draws, and that it draws: through a camera everything lies where Blender itself puts it."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Matrix, Vector

from addon.core.data.takes import NO_MARKER, Blobs
from addon.scene import take as takes
from addon.scene.blob_dots import FrameRays, blob_dots
from addon.scene.cameras import look_through
from addon.scene.clock import TakeClock
from addon.scene.opened import Opened
from addon.scene.preview import read_preview, store_preview

from .hands import ours


@pytest.fixture
def marks(extension):
    return ours("ui.marks")


@pytest.fixture
def shown(empty, made):
    """A take through a lens that bends, in the scene and read back."""
    take = made.take(lens=-0.15)
    collection = takes.show_take(empty, take)
    return take, Opened().take(collection, empty.scene)


def test_blobs_lie_on_their_markers_with_the_lens_taken_out(empty, shown):
    take, stored = shown
    for number in range(4):
        camera = bpy.context.scene.objects[stored.cameras.names[number]]
        seen = blob_dots(stored, 10, number, np.array(camera.matrix_world.normalized()))
        named = seen.marker != NO_MARKER
        assert named.sum() > 3
        look_through(empty.scene, camera)
        empty.view_layer.update()
        for pair in zip(seen.xyz[named], take.motion.expected[10, seen.marker[named]], strict=True):
            here, there = (world_to_camera_view(empty.scene, camera, Vector(point)).xy for point in pair)
            assert (here - there).length < 1e-4


def test_links_take_the_colour_of_their_step(shown, marks):
    """And a lost frame has blobs and no links, one outside of the take has nothing."""
    _, stored = shown
    seen = blob_dots(stored, 10, 0, np.eye(4))
    ends, colours = marks.links(stored, 10, seen)
    named = seen.marker != NO_MARKER
    assert len(ends) == named.sum()
    pairs = {1: (marks.GREEN, marks.GREEN), 2: (marks.CYAN, marks.MAGENTA), 3: (marks.BLACK, marks.WHITE)}
    for step, (first, last) in zip(stored.labels.step[seen.trajectory[named]], colours, strict=True):
        assert (tuple(first), tuple(last)) == pairs[int(step)]
    lost = blob_dots(stored, 3, 0, np.eye(4))
    assert (len(lost.xyz), len(marks.links(stored, 3, lost)[0])) == (1, 0)
    assert [stored.index_of(frame) for frame in (100, 101, 120, 121)] == [-1, 0, 19, -1]


def test_words_never_lie_on_each_other_on_marks_only_where_they_must_and_off_what_covers_the_view(marks):
    places = np.random.default_rng(1).uniform(0, 120, (30, 2))
    places[5] = np.nan
    widths = np.full(30, 30.0)
    starts = marks.room_for_words(places, widths, 11.0, 6.0)
    assert np.isnan(starts[5]).all()
    kept = starts[np.isfinite(starts[:, 0])]
    assert len(kept) > 8
    for index, one in enumerate(kept):
        for other in kept[:index]:
            assert abs(one[0] - other[0]) >= 33 or abs(one[1] - other[1]) >= 11
    assert marks.room_for_words(np.array([[50.0, 50.0]]), widths[:1], 11.0, 6.0)[0, 0] == 56.0
    places = np.array([[50.0, 50.0], [70.0, 50.0], [20.0, 50.0]])
    starts = marks.room_for_words(places, np.full(3, 30.0), 11.0, 6.0, 3.5)
    assert starts[0].tolist() == [35.0, 56.0]  # above: a mark is on its right, and one on its left
    assert (starts[1:, 0] == [76.0, -16.0]).all()
    places = np.array([[50.0, 50.0], [10.0, 200.0]])
    toolbar = np.array([[0.0, 0.0, 100.0, 100.0]])
    starts = marks.room_for_words(places, np.full(2, 30.0), 11.0, 6.0, 3.5, toolbar)
    assert np.isnan(starts[0]).all()
    assert np.isfinite(starts[1]).all()

    class Canvas(ours("ui.overlay").Canvas):
        def __init__(self):
            self.scale, self._words = 1.0, []

    canvas = Canvas()
    canvas.text("38 of 38 points named", 60, 20)
    canvas.names(["LASI"], np.array([[70.0, 24.0]]))
    (_, _, low, _), (_, _, high, _) = canvas._words
    assert high >= low + 11, "names keep off the words of the view"


def test_colours_are_explained_of_points_and_of_blobs(shown, marks, monkeypatch):
    overlay, said = ours("ui.overlay"), []
    monkeypatch.setattr(overlay, "draw_colours", lambda _, title, rows: said.append((title, [one for one, _ in rows])))
    _, stored = shown
    seen = marks.point_marks(stored, 10)
    overlay._draw_counts(None, stored, seen, None)
    assert said == [(f"{len(stored.names)} of {len(stored.names)} markers found", ["named", "doubtful"])]


def test_of_a_take_that_a_person_hides_nothing_is_drawn(extension, empty, shown):
    [take] = takes.takes_of(empty.scene)
    empty.scene.mocap_autolabel.take = take
    layer, ui = empty.view_layer.layer_collection.children[take.name], ours("ui.overlay")
    for name in ("exclude", "hide_viewport"):
        setattr(layer, name, True)
        assert takes.is_hidden(take, empty.view_layer)
        ui.draw_frame(None, empty)  # which has nothing to draw on
        setattr(layer, name, False)
    assert not takes.is_hidden(take, empty.view_layer)
    with pytest.raises(AttributeError):
        ui.draw_frame(None, empty)


def test_a_trail_is_broken_where_the_marker_was_not_seen(extension):
    figure = ours("ui.figure")
    path = np.column_stack([np.arange(20.0), np.zeros(20), np.zeros(20)])
    path[8:11] = np.nan
    ends, faded = figure.trail(path, 9, 5)
    assert ends[:, 0, 0].tolist() == [4.0, 5.0, 6.0, 11.0, 12.0, 13.0]
    assert (faded[2] > faded[0]).all()
    assert [len(part) for part in figure.trail(path[:0], 0, 5)] == [0, 0]


def test_sides_are_told_apart_by_people_who_see_few_colours(extension):
    sides = ours("scene.armature")
    colours = np.array([sides.SIDE_COLOURS[side] for side in ("L", "R", "")])
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    # Machado, Oliveira and Fernandes 2009, without the cones for long, middle and short waves.
    blind = [
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
    ]
    for seen in [np.eye(3), *map(np.array, blind)]:
        shown = np.clip(linear @ seen.T, 0, 1) ** (1 / 2.2)
        assert np.linalg.norm(shown[:, None] - shown[None], axis=2)[np.triu_indices(3, 1)].min() > 0.3
    names = ("LKNE", "RKNE", "SACR", "LBUL", "hand.L", "hand.R")
    assert [sides.side_in(name, names) for name in names] == ["L", "R", "", "", "L", "R"]


def previewed(take, *cameras: int):
    """The blobs of a take as they are seen before it is labelled, in all cameras or some."""
    mesh = store_preview(bpy.context.scene, "walk", take.rows, take.cameras, take.rate, TakeClock.of(take.rows.frames))
    return read_preview(mesh, take.cameras.select(list(cameras)) if cameras else take.cameras)


def test_blobs_are_looked_at_before_they_are_labelled_and_their_rays_meet_where_markers_are(empty, made):
    take = made.take()
    stored = previewed(take)
    np.testing.assert_array_equal(stored.rows.frames, take.rows.frames)
    np.testing.assert_array_equal(stored.rows.frame, take.rows.frame)
    np.testing.assert_allclose(stored.rows.xy, take.rows.xy, atol=1e-4)
    assert len(blob_dots(stored, 4, 0, np.eye(4)).xyz) == 1
    assert len(previewed(take, 1, 2).rows) == np.isin(take.rows.camera, [1, 2]).sum()
    found = FrameRays.of(stored, 10)
    off = np.linalg.norm(found.points[:, None] - take.motion.markers[10], axis=2)
    assert len(found.points) > 5
    assert off.min(axis=1).max() < 0.02
    here = take.rows.frame == 10
    assert len(found.ends) + len(found.loose) == here.sum(), "each blob has one ray"
    for ends in (found.ends, found.loose):
        assert np.isin(ends[:, 0].round(6), take.cameras.centres.round(6)).all()
    alone = FrameRays.of(previewed(take, 1), 10)
    assert (len(alone.points), len(alone.loose)) == (0, (take.rows.camera[here] == 1).sum())
    many = np.repeat(np.flatnonzero(here), 200)
    flood = replace(stored, rows=take.rows.part(slice(0, len(take.rows.frames)), many))
    assert (len(FrameRays.of(flood, 10).points), len(FrameRays.of(flood, 10).loose)) == (0, 200 * here.sum())


def test_where_rays_meet_is_seen_until_there_are_markers_while_nothing_plays(extension, empty, made, monkeypatch):
    overlay, drawn, display = ours("ui.overlay"), [], empty.scene.mocap_autolabel.display
    monkeypatch.setattr(overlay, "Blobs", Blobs)
    monkeypatch.setattr(overlay, "draw_rays", lambda *given: drawn.append(given[-1]))
    monkeypatch.setattr(overlay, "draw_markers", lambda *_: None)
    view = SimpleNamespace(region_3d=SimpleNamespace(view_perspective="PERSP"))
    for wanted, names, plays in ((False, (), False), (False, (), True), (False, ("C7",), False), (True, ("C7",), True)):
        stored = SimpleNamespace(rows=made.take().rows, names=names, index_of=lambda _: 10)
        monkeypatch.setattr(overlay, "shown", lambda _, stored=stored: stored)
        screen, display.show_rays = SimpleNamespace(is_animation_playing=plays), wanted
        context = SimpleNamespace(scene=empty.scene, screen=screen, space_data=view)
        overlay.draw_frame(SimpleNamespace(perspective=np.eye(4)), context)
    assert drawn == [False, True]


def contrast(*colours: np.ndarray) -> float:
    """The contrast of two colours of a theme, as WCAG 2.2 has it: 3 for what is read at a glance, 4.5 for text."""
    linear = [np.where(one <= 0.04045, one / 12.92, ((one + 0.055) / 1.055) ** 2.4) for one in colours]
    dark, light = sorted(one @ [0.2126, 0.7152, 0.0722] + 0.05 for one in linear)
    return light / dark


def test_the_timeline_is_drawn_in_the_colours_of_the_theme_in_which_its_names_can_be_read(extension):
    theme, grounds = bpy.context.preferences.themes[0], []
    for name in ("Light", "Dark"):
        [path] = [path for one in bpy.utils.preset_paths("interface_theme") for path in Path(one).glob(f"*_{name}.xml")]
        bpy.ops.script.execute_preset(filepath=str(path), menu_idname="USERPREF_MT_interface_theme_presets")
        rows, names = (ours("ui.timeline").Colours.of(theme, names) for names in (False, True))
        np.testing.assert_allclose(rows.ground, theme.dopesheet_editor.space.back, atol=0.5 / 255)
        assert all(contrast(ground, names.words) > 4.5 for ground in (names.ground, names.stripe, names.chosen))
        assert contrast(names.ground, names.faint) > 3
        assert (abs(names.stripe - names.ground) < abs(names.faint - names.ground)).all()
        grounds.append(rows.ground.sum())
    assert grounds[0] > grounds[1]


@pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="this Blender draws nothing without a window")
def test_it_draws(empty, settings, made, monkeypatch):
    """Into a picture of its own: blobs and links leave their colours, and cameras and space have their views."""
    import gpu

    gpu.init()
    overlay = ours("ui.overlay")
    take = made.take()
    takes.show_take(empty, take)
    settings.take = takes.takes_of(empty.scene)[-1]
    empty.scene.frame_set(111)
    camera = empty.scene.objects["cam 1"]
    size = (656, 491)
    look_through(empty.scene, camera)
    pixel = {"scale_x": empty.scene.render.pixel_aspect_x, "scale_y": empty.scene.render.pixel_aspect_y}
    lens = camera.calc_matrix_camera(empty.evaluated_depsgraph_get(), x=size[0], y=size[1], **pixel)

    class Canvas(overlay.Canvas):
        def __init__(self, context):
            self.size, self.scale = size, 1.0
            self.perspective = np.array(lens @ camera.matrix_world.normalized().inverted())

    def drawn(paint):
        offscreen = gpu.types.GPUOffScreen(*size)
        with offscreen.bind():
            gpu.state.active_framebuffer_get().clear(color=(0.2, 0.2, 0.2, 1.0))
            with gpu.matrix.push_pop():
                gpu.matrix.load_matrix(
                    Matrix(((2 / size[0], 0, 0, -1), (0, 2 / size[1], 0, -1), (0, 0, 1, 0), (0, 0, 0, 1)))
                )
                gpu.matrix.load_projection_matrix(Matrix())
                with Canvas(None) as canvas:
                    paint(canvas)
            buffer = gpu.state.active_framebuffer_get().read_color(0, 0, *size, 4, 0, "FLOAT")
        offscreen.free()
        buffer.dimensions = size[0] * size[1] * 4
        return np.array(buffer).reshape(size[1], size[0], 4)

    overlay.letters.width("é", overlay.TEXT_SIZE)
    overlay.letters._make_picture()  # where nothing is being drawn
    stored = overlay.shown(empty.scene)
    picture = drawn(lambda canvas: overlay.draw_camera(canvas, stored, 10, camera, settings))
    rows = np.flatnonzero((take.rows.frame == 10) & (take.rows.camera == 1) & (take.labels.step == 1))
    assert len(rows)
    for x, y in take.rows.xy[rows]:
        red, green, blue, _ = picture[round(size[1] - y), round(x)]
        assert green > 0.5 > max(red, blue), "an exclusive blob is green"
    rays, points = (drawn(lambda canvas, on=on: overlay.draw_rays(canvas, stored, 10, on)) for on in (True, False))
    assert (np.abs(rays[..., 0] - 0.2) > 0.05).sum() > (np.abs(points[..., 0] - 0.2) > 0.05).sum() > 50
    plain = drawn(lambda canvas: overlay.draw_markers(canvas, stored, 10, settings))
    assert (np.abs(plain[..., 0] - 0.2) > 0.3).sum() > 50

    def paint_words_and_dots(canvas):
        canvas.text("LKNE", 100, 200)
        canvas.text("é", 300.4, 200.2, (1.0, 0.0, 0.0, 1.0))
        canvas.discs(np.array([[200.0, 300.0], [np.nan, 0.0]]), np.array([[0.0, 1.0, 0.0, 1.0]] * 2), 5.0, 2.0)

    picture = drawn(paint_words_and_dots)
    word, letter = picture[197:212, 98:135, :3], picture[197:215, 298:312, :3]
    assert (word.min(axis=2) > 0.9).sum() > 20 and (word.max(axis=2) < 0.1).sum() > 20, "white with a dark shadow"
    assert ((letter[..., 0] > 0.8) & (letter[..., 1] < 0.2)).sum() > 5
    for away, colour in ((0, (0, 1, 0)), (4, (0, 1, 0)), (6, (0.02, 0.02, 0.02)), (9, (0.2, 0.2, 0.2))):
        np.testing.assert_allclose(picture[300, 200 + away, :3], colour, atol=0.1)
    outside = picture.copy()
    outside[185:220, 90:320], outside[290:311, 190:211] = 0.2, 0.2
    np.testing.assert_allclose(outside[..., :3], 0.2, atol=0.01)
