# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever a stream sends, its reader gives frames or one sentence, in the time that it says and with little memory."""

import socket
import struct
import time
from collections.abc import Callable
from itertools import chain, count, islice, repeat

import pytest

from addon.core.data.errors import InputError, JobError, UserError
from addon.io.streams.sources import open_stream
from addon.io.streams.wire import StreamFrame
from tests.io.checks import memory_within, refused
from tests.io.streams.servers import NatNetServer, QtmServer, Server, ViconServer
from tests.io.streams.test_streams import WALK

PATIENCE = 0.4
DATA, XML = b"\3\0\0\0", b"\2\0\0\0"


class RawServer(Server):
    """Sends whatever there is, again and again or once, to whoever connects."""

    scheme = "qtm"

    def talk(self, connection):
        for content in self.frames:
            connection.sendall(content)
            if self.ended:
                return
            time.sleep(1 / self.rate if self.rate else 0)
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(4096):
            pass


def packet(kind: int, content: bytes, size: int | None = None) -> bytes:
    return struct.pack("<II", 8 + len(content) if size is None else size, kind) + content


def frame_of(parts: int, *content: bytes) -> bytes:
    return packet(3, struct.pack("<qII", 0, 1, parts) + b"".join(content))


def in_place_of(kind: bytes, other: bytes) -> Callable[[bytes], bytes]:
    return lambda sound: other if sound[4:8] == kind else sound


def part(kind: int, size: int, number: int) -> bytes:
    return struct.pack("<IIIhh", size, kind, number, 0, 0)


def told_of(source: str, patience: float = 5.0) -> str:
    """The sentence that a stream ends with."""
    with pytest.raises(UserError) as caught, open_stream(source, patience=patience) as stream:
        list(stream)
    assert "; expected" in caught.value.message and caught.value.file == source
    return caught.value.message


CUT = "cut short or makes no sense"


@pytest.mark.parametrize(
    ("wound", "sentence"),
    [
        (in_place_of(DATA, packet(3, b"", 2**31)), "sends a packet of over 16 MB"),
        (in_place_of(DATA, packet(3, b"", 7)), "sends a packet of 7 bytes"),
        (in_place_of(DATA, packet(3, b"", 0)), "sends a packet of 0 bytes"),
        (in_place_of(DATA, packet(3, b"abc")), CUT),
        (in_place_of(DATA, frame_of(1, part(2, 16, 2**32 - 1))), CUT),
        (in_place_of(DATA, frame_of(2**32 - 1, part(2, 0, 0))), CUT),
        (in_place_of(DATA, frame_of(2, part(2, 0, 0))), CUT),
        (in_place_of(DATA, frame_of(2, part(2, 2**31, 0))), CUT),
        (in_place_of(DATA, frame_of(1, part(1, 360_016, 30_000), bytes(360_000))), "with 30000 points"),
        (in_place_of(DATA, frame_of(1, part(1, 28, 1), struct.pack("<3f", 1e9, 0, 0))), "with a point or a time that"),
        (in_place_of(DATA, packet(0, b"Wrong component\0")), "sends no frames (Wrong component)"),
        (in_place_of(DATA, packet(0, b"a\xee\x80\x80b\x1b[2J\0")), "sends no frames (a b [2J)"),  # no letters
        (in_place_of(DATA, frame_of(1000, *repeat(part(2, 16, 900), 1000), bytes(14_400))), CUT),  # each as all of it
        (in_place_of(DATA, packet(6, b"\6")), "changes its cameras"),
        (in_place_of(DATA, packet(6, b"\14")), "ended before its first frame"),
        (in_place_of(XML, packet(0, b"Parameters not available\0")), "has no General parameters (Parameters not"),
    ],
)
def test_a_qualisys_stream_that_lies_is_told_in_one_sentence(wound, sentence):
    with QtmServer(WALK, wound=wound) as server:
        assert sentence in told_of(server.source)


HELLO = packet(1, b"QTM RT Interface connected\0")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ([b"HTTP/1.1 400 Bad Request\r\n\r\n"], "sends a packet of over 16 MB"),
        ([b""], "closes the connection; expected Qualisys Track Manager"),
        ([b"\50\0\0\0\1\0"], "broke off within a packet"),
        ([HELLO[:-3]], "broke off within a packet"),
        ([HELLO, *repeat(packet(1, b"Version NOT supported\0"), 7)], "no version of its protocol that is known"),
    ],
)
def test_what_is_no_qualisys_program_is_told(content, sentence):
    with RawServer(content) as server:
        assert sentence in told_of(server.source)


@pytest.mark.parametrize(
    ("content", "rate"),
    [
        (chain([struct.pack("<II", 1 << 20, 7)], repeat(b"\0")), 200),  # a byte now and then
        (repeat(packet(6, b"\3")), None),  # events as fast as can be
        (repeat(packet(7, bytes(1 << 23))), None),  # gigabytes of what is not asked for
        (repeat(b"", 100), 20),  # nothing
    ],
)
def test_a_stream_without_frames_ends_in_the_time_that_it_says_and_fills_no_memory(content, rate):
    begin, sentence = time.monotonic(), r"nothing that is new for 0\.4 s; exp"
    with memory_within(64 << 20), RawServer(content, rate) as server, pytest.raises(JobError, match=sentence):
        open_stream(server.source, patience=PATIENCE)
    assert time.monotonic() - begin < 5


def test_a_stream_that_stalls_or_only_repeats_itself_ends_in_the_time_that_it_says():
    for frames in (repeat(WALK[0]), (WALK[0] if at < 1 else time.sleep(3 * PATIENCE) for at in range(2))):
        with QtmServer(frames) as server, open_stream(server.source, patience=PATIENCE) as stream:
            next(stream)
            begin = time.monotonic()
            with pytest.raises(JobError, match="has sent nothing that is new"):
                next(stream)
            assert time.monotonic() - begin < 5


def test_an_hour_of_frames_takes_no_more_memory_than_some():
    frames = (StreamFrame(number, 0.0, WALK[0].points, WALK[0].ids) for number in count(1))
    with QtmServer(frames) as server, open_stream(server.source) as stream:
        next(stream)
        with memory_within(1 << 20):
            assert len([None for _ in islice(stream, 1500)]) == 1500


@pytest.mark.parametrize("version", [(2, 9), (5, 0)])
def test_a_version_of_natnet_that_is_not_known_is_told(version):
    with NatNetServer(WALK, version=version) as server:
        assert f"speaks NatNet {version[0]}.{version[1]}; expected Motive" in told_of(server.source)


def test_datagrams_of_others_are_no_frames():
    with NatNetServer([], 1.0) as server, open_stream(server.source, patience=PATIENCE) as stream:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.2", 0))
            frame = server.message(7, server.frame(WALK[0]))
            for _ in range(5):
                other.sendto(frame, ("127.0.0.1", stream.sockets[0].getsockname()[1]))
        with pytest.raises(JobError, match="has sent nothing that is new"):
            next(stream)


def test_what_is_no_vicon_program_or_sends_no_points_is_told():
    def none(sound: bytes) -> bytes:
        return sound.replace(struct.pack("<I", 7), struct.pack("<I", 8))

    for wound, sentence in (
        (none, "offers no points without labels"),
        (lambda sound: b"\0" + sound[1:], "sends a packet of the kind 0x1a2b0000"),
        (lambda sound: sound[:16], "has sent nothing that is new for 0.4 s"),
    ):
        with ViconServer(WALK, wound=wound) as server:
            assert sentence in told_of(server.source, patience=PATIENCE if "nothing" in sentence else 5.0)


@pytest.mark.parametrize(
    "source",
    ["", "qtm", "qtm://", "qtm:127.0.0.1", "http://127.0.0.1", "qtm://127.0.0.1/a", "qtm://a@127.0.0.1", "qtm://[::1",
     "qtm://127.0.0.1:70000", "qtm://127.0.0.1:0", "take.c3d", "vicon://127.0.0.1?x=1", "natnet://127.0.0.1#x"],
)  # fmt: skip
def test_what_is_no_address_is_refused(source):
    refused("is no address of a stream; expected qtm://HOST, natnet://HOST or vicon://", open_stream, source)


def test_hosts_outside_of_the_own_network_or_unknown_or_silent_are_refused():
    with pytest.raises(InputError, match=r"outside of this machine's own network \(8.8.8.8\); expected a private add"):
        open_stream("natnet://8.8.8.8")
    refused("is a host that is not known; expected its name or address", open_stream, f"qtm://{'a' * 300}")
    for scheme in ("qtm", "vicon"):
        refused(r"cannot be reached \(.+\); expected .+ at port 1", open_stream, f"{scheme}://127.0.0.1:1")
    with pytest.raises(UserError, match="; expected Motive"):
        open_stream("natnet://127.0.0.1:9", patience=PATIENCE)
