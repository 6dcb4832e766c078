# SPDX-License-Identifier: GPL-3.0-or-later
"""What programs stream as a kind of file: the packets of our servers, with a mark between, fed to their readers."""

import random
import socket
import struct
import tracemalloc
from contextlib import nullcontext, suppress
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np

from addon.core.data.errors import InputError, UserError
from addon.demo.take import MODEL
from addon.io.source import read_bytes
from addon.io.streams.natnet import NatNetStream
from addon.io.streams.qtm_rt import QtmStream
from addon.io.streams.sources import open_stream
from addon.io.streams.vicon import ViconStream
from addon.io.streams.wire import LiveStream, StreamFrame
from addon.jobs import live
from tests.io.samples import walk
from tests.io.streams.servers import NatNetServer, QtmServer, ViconServer, frames_of_points

KINDS = {
    "qtm_rt": (QtmStream, QtmServer, {"labelled": 2}),
    "natnet_3": (NatNetStream, NatNetServer, {"version": (3, 0)}),
    "natnet_4": (NatNetStream, NatNetServer, {}),
    "vicon": (ViconStream, ViconServer, {}),
}
BETWEEN = b"<another packet>"
PATIENCE = 0.4  # s
# What a reader may take for itself, and for each byte that it was sent.
OWN_BYTES, TIMES = 1 << 20, 60
NUMBERS = [0, 1, 2, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0xFFFFFFFE, 1 << 30, 1 << 24, (1 << 24) - 8, 1 << 20, 65536]
PLACES = [float("nan"), float("inf"), -float("inf"), 1e19, -3.4e38, 1e-40, 1e6, -0.0]


def sound_stream(kind: str) -> bytes:
    """All packets of a stream of half a second."""
    _, server, options = KINDS[kind]
    packets: list[bytes] = []
    frames = frames_of_points(walk(frames=60, points=12).xyz, 120.0)
    one = server(frames, 2000.0, wound=lambda packet: packets.append(packet) or packet, **options)
    one.data_port = 1511  # the same each time
    with one, open_stream(one.source) as stream:
        for _ in frames:
            next(stream)
    return BETWEEN.join(packets)


class Fed(LiveStream):
    """A stream that is fed from a file: packets over a pair of sockets, or datagrams."""

    packets: list[bytes]

    def connect_tcp(self):
        ours, theirs = socket.socketpair()
        self.sockets += [ours, theirs]
        theirs.settimeout(0.01)
        with suppress(TimeoutError):  # it takes no more: cut off
            theirs.sendall(b"".join(self.packets))
        theirs.shutdown(socket.SHUT_WR)

    def open_udp(self, *_):
        self.sockets = self.sockets or [socket.socket(socket.AF_INET, socket.SOCK_DGRAM)]

    def datagram(self, most):
        if not self.packets:
            raise EOFError
        return self.packets.pop(0)


def read_stream(kind: str, path: Path) -> list[StreamFrame]:
    """The frames of a stream; memory is by what it sends, and not by what it says that it does."""
    content = read_bytes(path)
    fed = type("FedStream", (Fed, KINDS[kind][0]), {"packets": content.split(BETWEEN)})
    frames: list[StreamFrame] = []
    tracemalloc.start()
    try:
        with fed(str(path), ("127.0.0.1", 9), PATIENCE).start() as stream:
            for frame in stream:
                if not np.isfinite(frame.points).all() or len(frame.ids) != len(frame.points):
                    raise AssertionError("points that are none, or have no number each")
                frames.append(frame)
    except UserError as error:
        raise InputError(error.message, error.file) from None
    finally:
        taken = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        if taken > OWN_BYTES + TIMES * len(content):
            raise AssertionError(f"takes {taken} bytes for {len(content)}")
    return frames


def named(frames: list[StreamFrame], folder: Path):
    """Names what was read, and keeps it."""
    stream = type("Stream", (list,), {"rate": None, "behind": False})(frames)
    nobody = SimpleNamespace(busy=False, hand=lambda _: None)
    job = live.LiveJob("natnet://fed", MODEL, folder / "live.c3d", overwrite=True)
    with patch.object(live, "open_stream", lambda *_: nullcontext(stream)):
        live.name_stream(job, nobody, lambda _: None, lambda: False)


def other_packets(content: bytes, chance: random.Random) -> bytes:
    """A stream with packets gone, repeated, out of order or cut, or with other numbers in them."""
    packets = content.split(BETWEEN)
    for _ in range(chance.choice([1, 1, 3, 20])):
        at, other = (chance.randrange(len(packets)) for _ in range(2))
        way = chance.randrange(8)
        if way == 0 and len(packets) > 1:
            del packets[at]
        elif way == 1:
            packets[at:at] = [packets[other]] * chance.choice([1, 2, 50])
        elif way == 2:
            packets[at], packets[other] = packets[other], packets[at]
        elif way == 3:
            packets[at] = packets[at][: chance.randrange(len(packets[at]) + 1)]
        else:
            packets[at] = _other_number(packets[at], chance)
    return BETWEEN.join(packets)


def _other_number(packet: bytes, chance: random.Random) -> bytes:
    """A packet with another number of four or eight bytes somewhere, often where it begins."""
    changed = bytearray(packet)
    at = chance.randrange(max(min(len(packet), 40 if chance.random() < 0.5 else len(packet)) - 3, 1))
    numbers = [struct.pack("<I", chance.choice([*NUMBERS, chance.randrange(64), chance.randrange(1 << 32)]))]
    numbers += [struct.pack("<f", chance.choice(PLACES)), struct.pack("<d", chance.choice(PLACES))]
    part = chance.choice([numbers[0], *numbers])
    changed[at : at + len(part)] = part
    return bytes(changed)
