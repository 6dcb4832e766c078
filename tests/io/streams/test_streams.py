# SPDX-License-Identifier: GPL-3.0-or-later
"""Streams of points: what a server plays is what is read, frame for frame, and by the makers' clients too."""

import asyncio
import random
import socket
import struct
import time
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.io.streams import natnet_server
from addon.io.streams.natnet import CONNECT, FRAME_OF_DATA, KEEP_ALIVE, SERVER_INFO, NatNetStream, message
from addon.io.streams.natnet_server import ASK_MODELS, LEAVE, MAX_CLIENTS, MODELS, NOT_KNOWN, NamesServer
from addon.io.streams.sources import open_stream
from addon.io.streams.wire import LATE_FRAMES, StreamFrame
from tests.fuzz.wounds import mutated
from tests.io.checks import refused
from tests.io.samples import walk
from tests.io.streams.servers import NatNetServer, QtmServer, ViconServer, frames_of_points, free_port

WALK = frames_of_points(walk(frames=40, points=60).xyz, 120.0)


def same_points(read: list[StreamFrame], played: list[StreamFrame], without_id: int = 0):
    """Whether these are the frames, to what float32 holds of them; the first points of each have no number."""
    assert [one.number for one in read] == [one.number for one in played]
    for one, other in zip(read, played, strict=True):
        assert one.points.dtype == float and one.ids.dtype == np.int64
        np.testing.assert_allclose(one.points, other.points, atol=1e-6)
        assert one.seconds == pytest.approx(other.seconds, abs=1e-6)
        assert one.ids.tolist() == [-1] * without_id + other.ids[without_id:].tolist()


@pytest.mark.parametrize(("minor", "labelled"), [(25, 0), (25, 2), (19, 1)])
def test_qualisys_points_come_as_they_were_played(minor, labelled):
    with QtmServer(WALK, 2000.0, minor=minor, labelled=labelled) as server, open_stream(server.source) as stream:
        assert stream.rate == 2000
        same_points(list(stream), WALK, labelled)
        assert stream.late == 0


def test_a_qualisys_world_is_turned_to_z_up_and_markers_that_are_missing_are_left_out():
    hidden = [StreamFrame(1, 0.0, np.array([[1.0, 2.0, 3.0], [np.nan] * 3]), np.array([5, 6]))]
    with QtmServer(hidden, up="+Y") as server:
        with open_stream(server.source) as stream:
            [frame] = stream
        assert frame.points.tolist() == [[1, -3, 2]] and frame.ids.tolist() == [5]
        with open_stream(server.source, up="-x") as stream:
            assert next(stream).points.tolist() == [[2, -3, -1]]


@pytest.mark.parametrize("version", [(3, 0), (4, 1)])
@pytest.mark.parametrize("shared", [False, True], ids=["to us", "to a group"])
def test_motive_points_come_as_they_were_played(version, shared):
    with NatNetServer(WALK, 1000.0, version=version, shared=shared) as server:
        with open_stream(server.source) as stream:
            same_points([next(stream) for _ in WALK], WALK)
        if not shared:
            with open_stream(server.source, up="z") as stream:
                np.testing.assert_allclose(next(stream).points, WALK[0].points[:, [0, 2, 1]] * [1, 1, -1], atol=1e-6)


def test_markers_that_motive_sends_without_numbers_are_taken_where_there_are_no_others():
    with NatNetServer(WALK, legacy=True) as server, open_stream(server.source) as stream:
        frame = next(stream)
        np.testing.assert_allclose(frame.points, WALK[0].points, atol=1e-6)
        assert set(frame.ids.tolist()) == {-1}


def test_vicon_points_come_as_they_were_played_also_those_that_are_not_sent_again():
    # The server says of every other frame from the fourth on that its points are those of the one before.
    before = [WALK[at - (at > 1 and at % 2)] for at in range(len(WALK))]
    played = [replace(one, number=own.number, seconds=own.seconds) for one, own in zip(before, WALK, strict=True)]
    with ViconServer(WALK, 120.0) as server, open_stream(server.source) as stream:
        same_points([next(stream) for _ in WALK], played)
        assert stream.rate == pytest.approx(120, rel=1e-6)


def test_frames_that_come_twice_are_left_out_and_a_sender_may_begin_anew():
    twice = [WALK[0], WALK[1], WALK[1], WALK[0], WALK[2]]
    again = [StreamFrame(5 + LATE_FRAMES, 0.0, WALK[0].points, WALK[0].ids), WALK[0]]
    with QtmServer([*twice, *again]) as server, open_stream(server.source) as stream:
        assert [frame.number for frame in stream] == [1, 2, 3, 5 + LATE_FRAMES, 1]
        assert stream.late == 2


def test_who_is_slow_is_told_that_more_has_come():
    with QtmServer(WALK, 50.0) as server, open_stream(server.source) as stream:
        next(stream)
        assert not stream.behind
        time.sleep(0.2)
        assert stream.behind


def motive_packets(shared_data) -> list[bytes]:
    """The datagrams of a recording of Motive 2.1, in their order."""
    content = (shared_data / "streams" / "natnet3_motive21_traffic.pcapng").read_bytes()
    found, at = [], 0
    while at < len(content):
        kind, size = struct.unpack_from("<II", content, at)
        if kind == 6:  # a packet, behind 20 bytes, on Ethernet, in IPv4 without options
            (length,) = struct.unpack_from(">H", content, at + 28 + 38)
            if content[at + 28 + 12 : at + 28 + 14] == b"\x08\0" and content[at + 28 + 23] == 17:
                found.append(content[at + 28 + 42 : at + 28 + 34 + length])
        at += size
    return found


def test_what_motive_itself_sent_is_read(shared_data):
    frames = [one for one in motive_packets(shared_data) if one[:2] == b"\7\0"]
    stream = NatNetStream("natnet://1", ("127.0.0.1", 1), 1.0, "+Y")
    stream.sized = False
    read = [stream.decoded(one) for one in frames]
    assert len(read) == 518 and (np.diff([one.number for one in read]) == 1).all()
    assert np.diff([one.seconds for one in read]) == pytest.approx(1 / 120, abs=1e-6)
    assert {tuple(one.ids.tolist()) for one in read} == {(131073, 131074, 131075, 131076, 131077, 50007)}
    np.testing.assert_allclose(read[0].points[-1], [0.17081165, 0.84023464, 1.50765908], atol=1e-8)


def test_the_makers_client_of_qualisys_reads_the_servers():
    qtm_rt = pytest.importorskip("qtm_rt", reason="qtm-rt is not installed")

    async def read(server: QtmServer, *components: str) -> list:
        connection = await qtm_rt.connect("127.0.0.1", server.port, version="1.25")
        assert b"<Frequency>500" in await connection.get_parameters(["general"])
        packets = []
        await connection.stream_frames(components=components, on_packet=packets.append)
        for _ in range(100):
            await asyncio.sleep(0.02)
            if len(packets) == len(server.frames):
                break
        connection.disconnect()
        return packets

    with QtmServer(WALK, 500.0, labelled=1) as server:
        packets = asyncio.run(read(server, "3d", "3dnolabels"))
    assert [one.framenumber for one in packets] == [one.number for one in WALK]
    for packet, played in zip(packets, WALK, strict=True):
        markers = [*packet.get_3d_markers()[1], *packet.get_3d_markers_no_label()[1]]
        np.testing.assert_allclose([one[:3] for one in markers], played.points * 1000, rtol=1e-6)
        assert [one.id for one in markers[1:]] == played.ids[1:].tolist()
        assert packet.timestamp == round(played.seconds * 1e6)


@pytest.mark.parametrize("version", [(3, 0), (4, 1)])
def test_an_open_client_of_motive_reads_the_servers(version):
    natnet = pytest.importorskip("natnet", reason="natnet is not installed")
    client, frames = None, []
    with NatNetServer(WALK, 500.0, version=version) as server:
        client = natnet.NatNetClient(command_port=server.port, use_multicast=False)
        client.on_data_frame_received_event.handlers.append(frames.append)
        with client:
            end = time.monotonic() + 5
            while len(frames) < len(WALK) and time.monotonic() < end:
                client.update_sync()
    assert [one.prefix.frame_number for one in frames] == [one.number for one in WALK]
    for frame, played in zip(frames, WALK, strict=True):
        y_up = played.points[:, [0, 2, 1]] * [1, 1, -1]
        *seen, hidden = frame.labeled_markers
        np.testing.assert_allclose([one.pos for one in seen], y_up, rtol=1e-6)
        np.testing.assert_allclose(frame.unlabeled_marker_pos, y_up, rtol=1e-6)
        assert [one.id_num for one in seen] == played.ids.tolist() and hidden.occluded
        assert frame.suffix.timestamp == played.seconds and len(frame.skeletons[1].rigid_bodies) == 2
        assert frame.devices[1].channel_arrays == ((5.0,), (6.0, 7.0))


SETS = {"ann": {"LASI": "ann:LASI", "RASI": "ann:RASI"}, "b ü": {"LASI": "b ü:LASI"}}
LINE = {
    "frame": 7, "seconds": None, "unnamed": [[0.5, 0.25, 2.0]],
    "markers": {"ann:RASI": [1.0, 2.0, 3.0], "b ü:LASI": [0.1, 0.2, 0.3]},
}  # fmt: skip


@pytest.fixture
def served():
    with NamesServer(f"natnet://127.0.0.1:{free_port()}", SETS) as server:
        yield server


@pytest.fixture
def client(served):
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as one:
        one.connect(served._socket.getsockname())
        one.settimeout(0.2)
        yield one


def heard(client: socket.socket) -> dict[int, bytes]:
    """What a client has been sent: the content of the last message of each kind."""
    found = {}
    while True:
        try:
            content = client.recv(65535)
        except TimeoutError:
            return found
        kind, size = struct.unpack_from("<HH", content)
        assert size == len(content) - 4
        found[kind] = content[4:]


def test_whoever_says_hello_has_frames_until_they_leave_or_are_silent(served, client, monkeypatch):
    served.tell(LINE)
    client.send(message(KEEP_ALIVE, b""))  # whom nobody knows
    served.tell(LINE)
    assert heard(client) == {}
    client.send(message(CONNECT, b"Ping\0"))
    served.tell(LINE)
    assert heard(client).keys() == {SERVER_INFO, FRAME_OF_DATA}
    client.send(message(LEAVE, b""))
    served.tell(LINE)
    assert heard(client) == {}
    client.send(message(CONNECT, b""))
    served.tell(LINE)
    monkeypatch.setattr(natnet_server, "PATIENCE_S", -1.0)
    heard(client)
    served.tell(LINE)
    assert heard(client) == {} and served.unsent == 0


def test_frames_have_names_where_they_are_and_the_origin_where_they_are_not(served, client):
    client.send(message(CONNECT, b""))
    served.tell(LINE)
    content = heard(client)[FRAME_OF_DATA]
    reader = NatNetStream("natnet://1", ("127.0.0.1", 1), 1.0, "+Y")
    reader.sized = False
    frame = reader.decoded(message(FRAME_OF_DATA, content))
    np.testing.assert_allclose(frame.points, [[1, 2, 3], [0.1, 0.2, 0.3]], rtol=1e-6)
    assert frame.ids.tolist() == [(1 << 16) + 2, (2 << 16) + 1] and frame.number == 7 and frame.seconds == 0
    ann = b"ann\0" + struct.pack("<I6f", 2, 0, 0, 0, 1, 3, -2)
    assert content[4:].startswith(struct.pack("<I", 2) + ann)
    assert struct.pack("<I3f", 1, 0.5, 2.0, -0.25) in content


def test_what_clients_ask_for_is_answered(served, client):
    client.send(message(CONNECT, b""))
    client.send(message(ASK_MODELS, b""))
    client.send(message(2, b"UpAxis\0"))
    client.send(message(77, b""))
    served.tell(LINE)
    told = heard(client)
    assert told[NOT_KNOWN] == b""
    assert told[MODELS].endswith("\0\0\0\0b ü\0\1\0\0\0LASI\0".encode())


def test_nonsense_and_crowds_and_whoever_does_not_listen_disturb_nobody(served, client):
    chance = random.Random(1)
    begin = time.monotonic()
    for _ in range(500):  # of which the client takes none
        for kind in (CONNECT, ASK_MODELS, 2, LEAVE, KEEP_ALIVE):
            client.send(mutated(message(kind, b"Ping\0"), chance)[:60_000])
        served.tell(LINE)
    others = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2 * MAX_CLIENTS)]
    for other in others:
        other.sendto(message(CONNECT, b""), served._socket.getsockname())
        served.tell(LINE)
    assert len(served._clients) <= MAX_CLIENTS
    for other in others:
        other.close()
    for _ in range(500):  # to those who are gone
        served.tell(LINE)
    assert time.monotonic() - begin < 20
    served.tell(LINE | {"unnamed": [[0, 0, 0]] * 6000})  # more than fits
    assert served.unsent >= MAX_CLIENTS


def test_clients_from_elsewhere_have_nothing(served):
    hello = message(CONNECT, b"")
    served._hear(hello, ("8.8.8.8", 9))
    assert not served._clients
    served.anywhere = True
    served._hear(hello, ("127.0.0.1", 9))
    assert served._clients


def test_an_address_that_cannot_be_served_is_told():
    for where, words in (
        ("127.0.0.1", "is no address of a stream; expected"),
        ("qtm://127.0.0.1", "is nothing that names are sent by; expected natnet://HOST"),
        ("natnet://8.8.8.8", "outside of this machine's own network"),
        ("natnet://10.254.253.252", r"cannot be listened at \(.+\); expected an address of this machine, and a port"),
    ):
        refused(words, NamesServer, where, SETS)
    where = f"natnet://127.0.0.1:{free_port()}"
    with NamesServer(where, SETS), pytest.raises(InputError, match="a port that is free"):
        NamesServer(where, SETS)
