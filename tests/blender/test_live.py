# SPDX-License-Identifier: GPL-3.0-or-later
"""*Live*: a stream named by a process beside Blender, shown in its window, recorded, and made a take."""

import json
import sys
import time
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.posing.finer import finer
from addon.core.retarget.matching import match_bones
from addon.io.markersets import open_markerset
from addon.io.points import read_points
from addon.scene.retargeting import rest_bones
from addon.scene.take import is_take
from scripts.virtual_take import write_virtual_take
from tests.inputs.rigs import MIXAMO, RigBone, add_rig, bones_of, mixamo
from tests.io.streams.servers import NatNetServer, QtmServer, there_and_back

from .hands import ours, press, refused, reopen

MOST_OFF = np.radians(0.1)  # of a limb of a rig from the body's
RATE, PATIENCE = 100.0, 120.0  # frames a second, s; a busy machine is slow


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Somebody who walks, and the true place of each marker."""
    return write_virtual_take(tmp_path_factory.mktemp("live"), 300, 1, "walk.csv", "room.toml")


@pytest.fixture
def live(settings, tmp_path):
    """The module, with settings in which only the source is left to say, and a wait for what comes."""
    settings.subjects.markerset, settings.live.folder = "body26", str(tmp_path / "recordings")
    module = ours("ops.live")

    def until(comes) -> list:
        end, ticks = time.monotonic() + PATIENCE, []
        while not comes():
            assert time.monotonic() < end, module.how_it_ended()
            ticks.append(module.follow_live())
            time.sleep(0.01)
        return ticks

    @contextmanager
    def connected(xyz, server=QtmServer, rig=None):
        """A stream that goes there and back over a take (T, M, 3) m, to which Blender is connected."""
        with server(there_and_back(xyz, RATE), RATE) as one:
            settings.live.source, settings.live.rig = one.source, rig
            press("connect")
            yield one

    yield SimpleNamespace(module=module, settings=settings, until=until, now=module.going_on, connected=connected)
    module.leave_live()


@pytest.mark.parametrize("server", [QtmServer, NatNetServer])
def test_a_stream_is_shown_and_what_is_recorded_of_it_becomes_a_take(live, walk, server):
    before = len(bpy.data.objects)
    with live.connected(walk.xyz, server) as one:
        assert not bpy.ops.mocap_autolabel.connect.poll()
        live.until(lambda: len(live.now().names) > 0.9 * len(walk.names))
        stream = live.now()
        frame, places = stream.frame, dict(zip(stream.names, stream.named, strict=True))
        at = (frame - 1) % (2 * len(walk.xyz) - 2)
        for name, true in zip(walk.names, walk.xyz[min(at, 2 * len(walk.xyz) - 2 - at)], strict=True):
            assert name not in places or np.allclose(places[name], true, atol=1e-3)
        live.until(lambda: live.now().frame > frame)  # they move
        assert f"of {len(stream.markers)} markers named" in stream.words and "dropped" in stream.words
        assert len(bpy.data.objects) == before and len(bpy.data.actions) == 0
        assert not stream.out.exists() and not stream.recording
        press("record")
        assert not bpy.ops.mocap_autolabel.record.poll()
        start = stream.frame
        live.until(lambda: live.now().frame > start + 2 * RATE)
        end = stream.frame
        if server is QtmServer:
            press("stop_live")
            assert stream.words == "Stopping"
        else:
            one.ended = True  # it sends nothing any more
        live.until(lambda: live.now() is None)
    kept = read_points(stream.out)
    assert start - 5 <= kept.first_frame and kept.first_frame + len(kept.xyz) > end > start + 2 * RATE
    assert is_take(live.settings.take) and live.settings.take["mocap_source"] == str(stream.out)
    said = live.module.how_it_ended()
    assert ("has sent nothing that is new" in said) == (server is NatNetServer)
    assert said.endswith("names given live changed")
    # By the same set, as after a take of several of which Automatic found it.
    subjects = live.settings.subjects
    subjects.markerset, subjects.performing = "auto", "AUTO"
    live.module._take_in(stream)
    assert is_take(live.settings.take) and live.module.how_it_ended() == said


def test_two_performers_move_their_rigs_and_what_is_recorded_is_a_take_of_both(live, walk, tmp_path):
    other = write_virtual_take(tmp_path, 300, 5, "walk.csv", "room.toml").xyz + np.array([0.0, 2.0, 0.0])
    both = np.concatenate([walk.xyz[: len(other)], other], axis=1)
    subjects = live.settings.subjects
    subjects.performing = "AUTO"
    live.settings.live.source = "qtm://127.0.0.1"
    refused("expected how many subjects are in the stream", "connect")
    subjects.performing, rigs = "LISTED", [mixamo(), mixamo()]
    for name in ("ann", "bob"):
        row = subjects.performers.add()
        row.name, row.markerset, row.rig = name, "body26", rigs[0]
    hips = [rig.pose.bones[0] for rig in rigs]
    before = [bone.location[:] for bone in hips]
    with live.connected(both):
        live.until(lambda: all(one.body is not None for one in live.now().performers))
        live.until(lambda: hips[0].location[:] != before[0])
        assert hips[1].location[:] == before[1], "nobody has it"
        for _ in "and back":  # rigs go from one to the other while they move
            first = subjects.performers[0].rig
            subjects.performers[0].rig, subjects.performers[1].rig = rigs[first is rigs[0]], first
            end = live.now().frame + 5
            live.until(partial(lambda end: live.now().frame > end and all(o.body for o in live.now().performers), end))
        stream = live.now()
        for performer in stream.performers:
            own = [place for name, place in zip(stream.names, stream.named, strict=True) if name[:3] == performer.name]
            assert np.linalg.norm(performer.body.joints[0] - np.mean(own, axis=0)) < 0.3
        bpy.context.view_layer.update()
        ann, bob = (np.array(row.rig.matrix_world @ row.rig.pose.bones[0].head) for row in subjects.performers)
        between = stream.performers[1].body.joints[0] - stream.performers[0].body.joints[0]
        assert (bob - ann) @ between > 0.99 * np.linalg.norm(bob - ann) * np.linalg.norm(between)  # in a larger room
        press("record")
        start = live.now().frame
        live.until(lambda: live.now().frame > start + RATE)
        press("stop_live")
        live.until(lambda: live.now() is None)
    assert [bone.location[:] for bone in hips] == before
    assert is_take(live.settings.take) and live.module.how_it_ended().endswith("names given live changed")


def test_a_frame_that_is_just_being_written_is_not_shown_and_a_fault_of_the_program_ends_the_stream(
    live, walk, tmp_path, monkeypatch
):
    latest, whole = tmp_path / "frame", {"frame": 1, "unnamed": [], "at": 0.0, "ms": 1.0, "changed": 0, "late": 0}
    with live.connected(walk.xyz):
        stream = live.now()
    stream._latest = latest
    torn = [{"markers": markers} for markers in ({"LASI": [1]}, [], {"LA": [1] * 3}, {"LASI": [1] * 6})]
    for text in ("{", "7", *(json.dumps(whole | some) for some in ({}, *torn))):
        latest.write_text(text)
        live.module.follow_live()
        assert stream.frame < 0
    latest.write_text(json.dumps(whole | {"markers": {"LASI": [1, 2, 3]}}))
    live.module.follow_live()
    assert stream.names == ["LASI"]
    monkeypatch.setattr(stream, "_worker", None)
    with pytest.raises(AttributeError):
        live.module.follow_live()
    assert live.now() is None and bpy.ops.mocap_autolabel.connect.poll()


def test_what_ends_a_stream_is_said(live, walk, monkeypatch):
    live.settings.live.source = " "
    refused("Say where the stream comes from", "connect")
    refused("Connect first", "record")
    live.settings.live.source, live.settings.live.folder = "take.c3d", ""
    app = SimpleNamespace(binary_path="blender", online_access=False)
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "bpy", SimpleNamespace(app=app, context=bpy.context))
        refused("Allow Online Access is off in Blender's preferences; expected it on", "connect")
    live.settings.subjects.markerset = "auto"
    refused("expected a marker set from the list", "connect")
    live.settings.subjects.markerset = "body26"
    press("connect")
    refused("Choose the folder for recordings, then connect again", "record")
    live.until(lambda: live.now() is None)
    assert live.module.how_it_ended().startswith("take.c3d: is no address of a stream; expected qtm://HOST,")
    with live.connected(walk.xyz):
        live.until(lambda: live.now().frame > 0)
        live.now()._worker.process.kill()
        live.until(lambda: live.now() is None)
    assert live.module.how_it_ended().startswith("its process was killed (SIGKILL)")


def test_another_file_ends_the_stream_and_what_was_recorded_stays(live, walk, tmp_path):
    with live.connected(walk.xyz):
        live.until(lambda: live.now().frame > 0)
        press("record")
        stream, start = live.now(), live.now().frame
        live.until(lambda: live.now().frame > start + 50)
        bpy.ops.ed.undo_push(message="Something else")
        assert live.now() is stream
        reopen(tmp_path / "other.blend")
        assert live.now() is None and live.module.follow_live() is None
        stream._worker.process.wait(PATIENCE)
    assert len(read_points(stream.out).xyz) > 50


def test_body_and_rig_move_without_keys_and_the_rig_is_then_as_it_was(live, walk, tmp_path):
    rig, segments = mixamo(), finer(open_markerset("body26")).skeleton.segments
    with bones_of(rig) as bones:
        bones.new("coat").tail = 0, 0, 1
    bone = rig.pose.bones[0]
    bone.rotation_mode, bone.rotation_euler, bone["IK_FK"] = "XYZ", (0.1, 0.2, 0.3), 0.0

    def state() -> list:
        kept = [(one.location[:], one.rotation_euler[:], one.rotation_quaternion[:]) for one in rig.pose.bones]
        return [*kept, [one.get("IK_FK") for one in rig.pose.bones], rig.data.pose_position]

    before, objects = state(), len(bpy.data.objects)
    with live.connected(walk.xyz, rig=rig):
        live.until(lambda: live.now().performers[0].body is not None)
        body, names = live.now().performers[0].body, live.now().names
        assert len(body.joints) == len(segments)
        assert np.linalg.norm(body.bones[0, 0] - live.now().named[names.index("SACR")]) < 0.2
        np.testing.assert_allclose(body.bones[segments.index("shank.L"), 0], body.joints[segments.index("shank.L")])
        live.until(lambda: live.now().performers[0].body.joints[0, 0] != body.joints[0, 0])
        bpy.context.view_layer.update()
        bones = match_bones(rest_bones(rig))
        knee, ankle = (np.array(rig.pose.bones[bones[f"{part}.L"]].head) for part in ("shank", "foot"))
        begin, end = (live.now().performers[0].body.joints[segments.index(f"{part}.L")] for part in ("shank", "foot"))
        own, way = np.array(rig.matrix_world.to_3x3()) @ (ankle - knee), end - begin
        assert own @ way / np.linalg.norm(own) / np.linalg.norm(way) > np.cos(MOST_OFF)
        assert state() != before and len(bpy.data.actions) == 0 and len(bpy.data.objects) == objects
        own = rig.pose.bones["coat"]
        own.location = 1, 2, 3  # somebody's
        live.settings.live.rig = None
        frame = live.now().frame
        live.until(lambda: live.now().frame > frame)
        assert own.location[:] == (1, 2, 3)
        own.location = 0, 0, 0
        assert state() == before
        live.settings.live.rig = rig
        live.until(lambda: state() != before)
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "live.blend"), copy=True)
        assert state() == before
        live.until(lambda: state() != before)
        live.module.leave_live()
    assert state() == before


def test_a_rig_that_cannot_move_is_told(live, walk):
    rig = add_rig([RigBone("chest", None, np.zeros(3), np.ones(3))], MIXAMO)
    held = mixamo()
    held.pose.bones[0].constraints.new("COPY_LOCATION").target = rig
    held.pose.bones[0].location, held.pose.bones[0]["IK_FK"], held.data.pose_position = (1, 2, 3), 0.0, "REST"
    with live.connected(walk.xyz, rig=rig):
        live.until(lambda: "has no bone for hips" in live.now().words)
        live.settings.live.rig = held
        live.until(lambda: "does not go where it is put; expected it without" in live.now().words)
        bone = held.pose.bones[0]
        assert (bone.location[:], bone["IK_FK"], held.data.pose_position) == ((1, 2, 3), 0.0, "REST")
